"""What follows a knowledge base in place, and what stays as it is."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

import kant_sql
from tests.browser.addresses import address
from tests.browser.conftest import Serve, Visit

FACT = "(robot_at rb1 t4)"


@pytest.mark.parametrize(
    ("path", "element", "is_followed"),
    [
        ("/", "#knowledge-bases", True),
        (address("/log"), "#log", True),
        (address("/log", until=36), "#log", False),
        (address("/state"), "#parts", True),
        (address("/state", at=36), "#parts", False),
        (address("/state", kind="fact", text="rb1"), "#parts", True),
    ],
)
def test_a_page_of_the_present_follows_and_one_of_the_past_does_not(
    own_story: str, serve: Serve, visit: Visit, path: str, element: str, is_followed: bool
) -> None:
    visitor = visit(serve(own_story).address)
    visitor.open(path)
    part = visitor.page.locator(element)
    before = part.inner_text()
    assert FACT not in before
    with kant_sql.connect(own_story, knowledge_base="courier", actor="night shift") as kb:
        assert kb.propositions.save(FACT)
    status = visitor.page.locator("#live")
    expect(status).to_contain_text("39 revisions" if path == "/" else "night shift")
    if is_followed:
        expect(part).to_contain_text("night shift" if path == "/" else FACT)
    else:
        # As long as it takes where a page follows.
        visitor.page.wait_for_timeout(1_500)
        assert part.inner_text() == before
    assert visitor.faults == []
