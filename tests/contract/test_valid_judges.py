"""What was true when, judged by SQL: the audit's views, PostgreSQL's temporal keys, SQL:2011."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql import KnowledgeBase
from tests.support.servers import Server
from tests.support.two_clocks import FACTS, FLUENTS, Model, Writer

# No scalar has a GiST operator class without an extension, so an element is a range of one number.
TABLE = """
CREATE TABLE held (element int8range, valid tstzrange, content text,
    PRIMARY KEY (element, valid WITHOUT OVERLAPS))
"""
CUT = "DELETE FROM held WHERE element = int8range(%s, %s) AND valid && %s RETURNING valid, content"
REST = """
INSERT INTO held SELECT int8range(%s, %s), unnest(multirange(%s::tstzrange) - multirange(%s)), %s
"""


def test_temporal_keys_hold_the_same(server: Server) -> None:
    with psycopg.connect(server.new_database(), autocommit=True) as table:
        if table.info.server_version < 180_000:
            pytest.skip("temporal keys came with PostgreSQL 18")
        table.execute(TABLE)
        with kant_sql.connect("sqlite://") as kb:
            writer = Writer(kb, seed=5)
            model = writer.run(25)
            elements = [*FACTS, *FLUENTS]
            said: list[Any] = [
                (one.since, one.element, (one[2], one[3]), one.content) for one in model.sayings
            ]
            said += [
                (one.since, one.element, (model.times[one.since], None), one.content)
                for one in model.plain
            ]
            for number in sorted(model.times):
                for _, element, period, content in filter(lambda one: one[0] == number, said):
                    say(table, elements.index(element), period, content)
                compare(table, model, kb, number)


def say(table: psycopg.Connection[Any], number: int, period: Any, content: object) -> None:
    """Let a period of an element have a content, and keep the rest of what it had."""
    valid = psycopg.types.range.Range(*period)  # type: ignore[attr-defined]
    key = number, number + 1
    for before, text in table.execute(CUT, (*key, valid)).fetchall():
        table.execute(REST, (*key, before, valid, text))
    insert = "INSERT INTO held VALUES (int8range(%s, %s), %s, %s)"
    table.execute(insert, (*key, valid, str(content)))


def compare(table: psycopg.Connection[Any], model: Model, kb: KnowledgeBase, known: int) -> None:
    """Compare what the table has at some moments with what was true, as known at a revision."""
    for moment in model.moments()[:: 1 + len(model.moments()) // 12]:
        if moment > model.times[max(model.times)]:
            continue
        query = "SELECT lower(element), content FROM held WHERE valid @> %s"
        found = dict(table.execute(query, (moment,)).fetchall())
        held = {fact for n, fact in enumerate(FACTS) if found.get(n) == "True"}
        facts = kb.at(known=known, valid=moment).propositions.get_all()
        assert {str(fact) for fact in facts} == held, (moment, known)


def test_views_say_what_was_said_last(fresh_kb: KnowledgeBase) -> None:
    model = Writer(fresh_kb, seed=3).run(30)
    for view, element, content in (
        ("fact_valid", "text", None),
        ("value_valid", "fluent", "value"),
    ):
        rows = fresh_kb.store.to_arrow(view).to_pylist()
        for moment in model.moments():
            for known in range(1, max(model.times) + 1):
                found = [
                    (row[element], True if content is None else row[content])
                    for row in rows
                    if row["valid_from"] <= moment
                    and (row["valid_until"] is None or moment < row["valid_until"])
                    and row["known_since"] <= known
                    and (row["known_until"] is None or known < row["known_until"])
                ]
                wanted = {
                    one: model.truth(one, moment, known)
                    for one in (FACTS if content is None else FLUENTS)
                    if model.truth(one, moment, known) not in (None, False)
                }
                assert sorted(found) == sorted(wanted.items()), (moment, known)


DEPARTMENTS = """
(define (domain staff) (:requirements :typing) (:types employee department)
  (:predicates (works ?e - employee ?d - department)))
"""
WHOLE, PART = ("2010-01-01", "2011-11-12"), ("2011-02-03", "2011-09-10")


def day(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


@pytest.mark.parametrize("moves", [True, False], ids=["update", "delete"])
def test_portions_of_a_period_as_in_sql_2011(fresh_kb: KnowledgeBase, moves: bool) -> None:
    """Employee 22217 of Kulkarni and Michels: `FOR PORTION OF`, and both clocks in one query."""
    kb = fresh_kb
    kb.load_domain(DEPARTMENTS)
    kb.objects.save_all(["e22217 - employee", "d3 - department", "d4 - department"])
    with kb.transaction(valid_from=day(WHOLE[0]), valid_until=day(WHOLE[1])):
        kb.propositions.save("(works e22217 d3)")
    inserted = kb.revision
    with kb.transaction(valid_from=day(PART[0]), valid_until=day(PART[1])):
        kb.propositions.delete("(works e22217 d3)")
        if moves:
            kb.propositions.save("(works e22217 d4)")
    middle = ["d4"] if moves else []
    for text, now, before in (
        ("2009-12-31", [], []),
        ("2010-01-01", ["d3"], ["d3"]),
        ("2011-02-02", ["d3"], ["d3"]),
        ("2011-02-03", middle, ["d3"]),
        ("2011-09-09", middle, ["d3"]),
        ("2011-09-10", ["d3"], ["d3"]),
        ("2011-11-11", ["d3"], ["d3"]),
        ("2011-11-12", [], []),
    ):
        for then, wanted in ((kb.at(valid=text), now), (kb.at(known=inserted, valid=text), before)):
            assert [place for _, place in then.query("(works ?e ?d)")] == wanted, text
    assert kb.propositions.get_all() == []
