"""Migration 0009 counts unconfirmed effects in the view of statistics."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, run_script, written
from tests.support.pages import ask
from tests.support.stores import Connect

VIEW = "audit_statistics"
COUNTS = f"FROM {VIEW} WHERE unconfirmed > 0 AND arguments IS NULL AND knowledge_base = 'rounds'"


def test_the_view_counts_and_views_of_users_stay(make: Make, connect: Connect) -> None:
    url = make(written("store"))
    kant_sql.upgrade(url, revision="0008")
    run_script(url, f"CREATE VIEW own AS SELECT action, executions FROM {VIEW}")
    own = ask(url, "SELECT * FROM own")
    kant_sql.upgrade(url, revision="0009")
    assert ask(url, "SELECT * FROM own") == own
    run_script(url, "DROP VIEW own")
    kant_sql.upgrade(url)
    kb = connect(url, knowledge_base="rounds", actor="test")
    expected = {f"{one.action} | {one.unconfirmed}" for one in kb.statistics() if one.unconfirmed}
    assert {*ask(url, f"SELECT action, unconfirmed {COUNTS}")} == expected != set()
