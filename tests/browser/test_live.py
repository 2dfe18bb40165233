"""Following a live change: new revisions appear without a reload, also after restarts."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import expect

import kant_sql
from tests.audit.story import record_store
from tests.browser.addresses import address
from tests.browser.conftest import Serve, Visit
from tests.support.browsing import Serving, Visitor
from tests.support.clusters import free_port
from tests.support.servers import MortalServer

HEAD = 36


@pytest.fixture(params=["sqlite", "postgresql"])
def own_url(request: pytest.FixtureRequest) -> str:
    """The URL of a store of the story that a test may write to."""
    if request.param == "sqlite":
        return str(request.getfixturevalue("own_story"))
    return record_store(request.getfixturevalue("server").new_store())


@pytest.fixture
def running(own_url: str, serve: Serve) -> Serving:
    # For one that takes its place.
    return serve(own_url, port=free_port())


def write(url: str, *facts: str, reason: str = "moved by hand") -> None:
    """Write a revision, as another program does."""
    opened = kant_sql.connect(url, knowledge_base="courier", actor="night shift")
    with opened as kb, kb.transaction(reason=reason):
        kb.propositions.save_all(list(facts))


def follow(visitor: Visitor) -> None:
    """Open the last revision: it has no next one yet."""
    visitor.open(address("/revision", number=HEAD))
    expect(visitor.page.get_by_role("link", name=f"{HEAD + 1} →")).to_have_count(0)


@pytest.mark.smoke
def test_a_revision_appears_without_a_reload(running: Serving, own_url: str, visit: Visit) -> None:
    visitor = visit(running.address)
    follow(visitor)
    visitor.page.evaluate("() => { window.isTheSamePage = true; }")
    write(own_url, "(robot_at rb1 t4)")
    status = visitor.page.get_by_role("status").filter(has_text=str(HEAD + 1))
    expect(status).to_contain_text("night shift")
    expect(visitor.page.get_by_role("link", name=f"{HEAD + 1} →")).to_be_visible()
    assert visitor.page.evaluate("window.isTheSamePage")
    assert visitor.violations() == []
    status.get_by_role("link").click()
    visitor.page.get_by_role("heading", name=f"Revision {HEAD + 1}").wait_for()
    for text in ("(robot_at rb1 t4)", "moved by hand"):
        expect(visitor.page.get_by_role("main")).to_contain_text(text)


def test_a_reader_follows_again_after_the_server_restarts(
    running: Serving, own_url: str, serve: Serve, visit: Visit
) -> None:
    visitor = visit(running.address)
    follow(visitor)
    running.stop()
    expect(visitor.page.get_by_role("status")).to_contain_text("trying again")
    write(own_url, "(robot_at rb1 t4)")
    serve(own_url, port=urlsplit(running.address).port or 0)
    expect(visitor.page.get_by_role("link", name=f"{HEAD + 1} →")).to_be_visible()
    lost = re.compile("ERR_(CONNECTION|INCOMPLETE|EMPTY|SOCKET|NETWORK)|Failed to fetch")
    visitor.faults = [fault for fault in visitor.faults if not lost.search(fault)]


def test_a_reader_follows_again_after_the_database_restarts(
    mortal_server: MortalServer, mortal_url: str, serve: Serve, visit: Visit
) -> None:
    record_store(mortal_url)
    visitor = visit(serve(mortal_url).address)
    follow(visitor)
    mortal_server.kill()
    mortal_server.restart()
    write(mortal_url, "(robot_at rb1 t4)")
    link = visitor.page.get_by_role("link", name=f"{HEAD + 1} →")
    expect(link).to_be_visible(timeout=60_000)
    for status in (500, 503):
        visitor.forgive(status)
