"""Migration 0006 replaces the audit's views, and loses neither data nor answers on the way."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import kant_sql
from kant_sql.schema import current
from tests.audit.asking import ask
from tests.audit.story import record as record_story
from tests.chain import check_chain
from tests.conftest import Connect
from tests.migrations.test_0002 import rows_of
from tests.migrations.test_0004 import VIEWS, views
from tests.migrations.test_0005 import record
from tests.migrations.test_golden import dump_of

NEW = "audit_knowledge_base"


@pytest.fixture
def old_url(empty_url: str, connect: Connect) -> str:
    """The URL of a store with a story in it, as version 0005 of the tables has it."""
    kant_sql.upgrade(empty_url)
    kb = connect(empty_url, knowledge_base="courier")
    record_story(kb)
    kb.close()
    kant_sql.downgrade(empty_url, revision="0005")
    return empty_url


def answers(url: str) -> dict[str, list[str]]:
    """All that the views say."""
    return {view: sorted(ask(url, f"SELECT * FROM {view}")) for view in VIEWS}


def unchanged(url: str, change: Callable[[], None]) -> bool:
    """Tell whether the tables and views say the same before and after a change."""
    before = (rows_of(url), answers(url))
    change()
    return (rows_of(url), answers(url)) == before


def test_data_and_answers_survive_up_and_down(old_url: str) -> None:
    assert dump_of(old_url) == record("0005", old_url)
    assert views(old_url) == VIEWS
    assert unchanged(old_url, lambda: kant_sql.upgrade(old_url, revision="0006"))
    assert views(old_url) == {*VIEWS, NEW}
    assert dump_of(old_url) == record("0006", old_url)
    assert unchanged(old_url, lambda: kant_sql.downgrade(old_url, revision="0005"))
    assert dump_of(old_url) == record("0005", old_url)
    kant_sql.upgrade(old_url)
    check_chain(old_url)
    assert len(answers(old_url)["audit_change"]) > 50


def test_the_new_view_says_where_a_knowledge_base_stands(old_url: str) -> None:
    kant_sql.upgrade(old_url, revision="0006")
    assert current(old_url) == "0006"
    last = "2026-03-03T08:00:00.000000Z"
    assert ask(old_url, f"SELECT * FROM {NEW}") == [f"courier | 36 | {last} | 1772524800.0"]
