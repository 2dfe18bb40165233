"""A reader at an address that needs a token."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.browser.addresses import address
from tests.browser.conftest import Serve, Visit
from tests.support.browsing import LOOKS, NARROW


def test_a_reader_gives_the_token_once(sqlite_story: str, serve: Serve, visit: Visit) -> None:
    running = serve(sqlite_story, "--host", "0.0.0.0")
    assert running.token is not None
    wanted = address("/revision", number=9)
    place = running.address.replace("0.0.0.0", "127.0.0.1")
    for width, scheme in LOOKS:
        other = visit(place, width=width, scheme=scheme)
        other.open(wanted, status=401)
        assert other.violations() == []
        assert other.overflow() == []
        assert "robot_at" not in other.page.content()
    visitor = visit(place, width=NARROW)
    visitor.open(wanted, status=401)
    box = visitor.page.get_by_label("The token that the server printed")
    box.fill("a wrong token")
    box.press("Enter")
    visitor.page.get_by_role("alert").get_by_text("This is not the token").wait_for()
    visitor.forgive(401)
    box.fill(running.token)
    visitor.page.get_by_role("button", name="Open").click()
    visitor.page.get_by_role("heading", name="Revision 9").wait_for()
    assert visitor.page.url == place + wanted
    assert running.token not in visitor.page.evaluate("document.cookie + location.href")
    visitor.page.reload()
    expect(visitor.page.get_by_role("heading", name="Revision 9")).to_be_visible()
    log = running.log()
    assert running.token not in log
    lines = log.splitlines()
    assert len(lines) == len(LOOKS) + 2
    assert all(" 401, " in line and "the token" in line for line in lines)
