"""Migration 0011 adds views of what was said: rows, and answers of others, stay as they were."""

from __future__ import annotations

import pytest

import kant_sql
from tests.migrations.stores import Make, answers, record, rows_of, run_script, views, written
from tests.migrations.test_golden import digest_of
from tests.support.pages import ask

CHANGES = "audit_change"
OWN = f"CREATE VIEW own AS SELECT kind, text FROM {CHANGES} WHERE sign = '+'"
# What version 0010 has room for: (busy rb1) held from 8 to 9, and then, only until half past 8.
START, HALF, END = (f"2026-11-01T{time}:00.000000Z" for time in ("08:00", "08:30", "09:00"))
SAID = f"""
    INSERT INTO proposition_saying
    (kb_id, proposition_id, since, valid_from, valid_until, predicate_id, holds, first_object_id,
        fork, text) VALUES
    (1, 17, 12, '{START}', '{END}', 4, TRUE, 8, 0,
        'it was busy'),
    (1, 17, 16, '{HALF}', '{END}', 4, FALSE, 8, 0,
        'it was not')
"""
RECTANGLES = """
    SELECT valid_from, valid_until, known_since, known_until
    FROM audit_fact_valid WHERE text = '(busy rb1)' ORDER BY valid_from
"""


def write_0010(url: str) -> None:
    """Create a store of version 0010 in which something was said of the past."""
    written("store")(url)
    kant_sql.upgrade(url, revision="0010")
    run_script(url, SAID)


@pytest.mark.more
def test_views_show_what_was_said_before_they_came(make: Make) -> None:
    url = make(write_0010)
    names = views(url)
    before, said = rows_of(url), answers(url, names)
    run_script(url, OWN)
    kant_sql.upgrade(url, revision="0011")
    # A view of a user is still there, and reads the new one.
    assert {*ask(url, "SELECT * FROM own")} >= {"saying | it was busy", "saying | it was not"}
    run_script(url, "DROP VIEW own")
    assert (rows_of(url), digest_of(url)) == (before, record("0011", url))
    after = answers(url, names)
    new = {*after.pop(CHANGES)} - {*(changes := said.pop(CHANGES))}
    assert (after, len(new)) == (said, 2)
    assert ask(url, RECTANGLES) == [f"{START} | {HALF} | 12 | NULL", f"{HALF} | {END} | 12 | 16"]
    kant_sql.operations.downgrade(url, revision="0010")
    assert (rows_of(url), digest_of(url)) == (before, record("0010", url))
    assert (views(url), answers(url, names)) == (names, {**said, CHANGES: changes})
