"""Migration 0009 counts unconfirmed effects in the view of statistics, and changes nothing else."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, answers, record, rows_of, run_script, views, written
from tests.migrations.test_golden import digest_of
from tests.support.pages import ask
from tests.support.reading import findings
from tests.support.stores import Connect

VIEW = "audit_statistics"
COUNTS = f"FROM {VIEW} WHERE unconfirmed > 0 AND arguments IS NULL AND knowledge_base = 'rounds'"


def test_the_view_changes_and_nothing_else(make: Make, connect: Connect) -> None:
    url = make(written("store"))
    kant_sql.upgrade(url, revision="0008")
    others = views(url) - {VIEW}
    before, said, counted = rows_of(url), answers(url, others), answers(url, {VIEW})
    # Views of users stay where they are.
    run_script(url, f"CREATE VIEW own AS SELECT action, executions FROM {VIEW}")
    own = ask(url, "SELECT * FROM own")
    kant_sql.upgrade(url, revision="0009")
    assert ask(url, "SELECT * FROM own") == own
    run_script(url, "DROP VIEW own")
    assert (rows_of(url), answers(url, others)) == (before, said)
    assert digest_of(url) == record("0009", url)
    kant_sql.operations.downgrade(url, revision="0008")
    assert (rows_of(url), answers(url, others)) == (before, said)
    assert (digest_of(url), answers(url, {VIEW})) == (record("0008", url), counted)
    kant_sql.upgrade(url)
    assert findings(url) == []
    kb = connect(url, knowledge_base="rounds", actor="test")
    expected = {f"{one.action} | {one.unconfirmed}" for one in kb.statistics() if one.unconfirmed}
    assert {*ask(url, f"SELECT action, unconfirmed {COUNTS}")} == expected != set()
