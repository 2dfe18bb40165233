"""What was true at a time, as known at a revision: one state, for every question of one state."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import text

from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    ReadOnlyError,
    UnknownRevisionError,
    connect,
)
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.query import Query
from tests.support.reading import store_of
from tests.support.statements import recorded

ROBOT, ROOM = PddlTypeDto("robot"), PddlTypeDto("room")
AT = PddlPredicateDto("at", [ROBOT, ROOM])


def fact(room: str) -> PddlPropositionDto:
    return PddlPropositionDto(AT, [PddlObjectDto(ROBOT, "rb1"), PddlObjectDto(ROOM, room)])


def rooms(kb: KnowledgeBase) -> list[str]:
    asked = [room for _, room in kb.query("(at ?r ?room)")]
    assert asked == sorted(dto.objects[1].name for dto in kb.propositions.get_by_predicate("at"))
    assert all(kb.holds(f"(at rb1 {room})") for room in asked)
    return asked


def test_what_nothing_was_said_of_is_what_was_known_at_that_time(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(fact("hall"))
    between = datetime.now(UTC)
    fresh_kb.propositions.delete(fact("hall"))
    fresh_kb.propositions.save(fact("lab"))
    assert rooms(fresh_kb.at(valid=between)) == ["hall"]
    assert rooms(fresh_kb.at(valid="now")) == rooms(fresh_kb) == ["lab"]
    assert rooms(fresh_kb.at(known=2, valid="now")) == []
    assert rooms(fresh_kb.at(valid="now").at(1)) == ["hall"]
    assert rooms(fresh_kb.at(known=3)) == ["lab"]
    assert fresh_kb.at(valid=between - timedelta(days=1)).propositions.get_all() == []
    # Objects are those that were known since.
    assert len(fresh_kb.at(valid=between).objects.get_all()) == 3
    assert fresh_kb.at(valid=between).revision == 3
    assert fresh_kb.diff(fresh_kb.at(valid="now"), fresh_kb) == []


def test_definitions_are_of_the_revision_unless_some_were_lost(fresh_kb: KnowledgeBase) -> None:
    def are_read() -> bool:
        with recorded() as statements:
            assert rooms(fresh_kb.at(valid=between)) == ["hall"]
        return any("FROM predicate_parameter" in each for each in statements)

    fresh_kb.propositions.save(fact("hall"))
    between = datetime.now(UTC)
    fresh_kb.propositions.save(fact("lab"))
    assert not are_read()
    fresh_kb.propositions.delete(fact("hall"))
    fresh_kb.objects.delete("hall")
    assert are_read()


def test_a_plan_is_validated_on_what_was_true(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        "(define (domain doors) (:requirements :strips) (:predicates (open) (left))"
        " (:action leave :parameters () :precondition (open) :effect (left)))"
    )
    fresh_kb.goals.save("(left)")
    ten, now = datetime.now(UTC) - timedelta(minutes=10), datetime.now(UTC)
    with fresh_kb.transaction(valid_from=ten, valid_until=now - timedelta(minutes=5)):
        fresh_kb.propositions.save("(open)")
    known = fresh_kb.revision
    moments = {"known": fresh_kb, "true": fresh_kb.at(valid=ten), "before": fresh_kb.at(known - 1)}
    moments["after"] = fresh_kb.at(valid=now)
    moments["not yet known"] = fresh_kb.at(known=known - 1, valid=ten)
    found = {name: kb.validate("0: (leave)").valid for name, kb in moments.items()}
    assert [name for name, is_valid in found.items() if is_valid] == ["true"]


@pytest.mark.parametrize(
    "ask",
    [
        lambda kb: list(kb.log()),
        lambda kb: kb.when("(at rb1 hall)"),
        lambda kb: kb.diff(1, 2),
        lambda kb: kb.timeline(),
        lambda kb: kb.pddl.check_rules(["(always (at rb1 hall))"]),
        lambda kb: kb.store.verify(),
        lambda kb: next(kb.changes()),
        lambda kb: kb.executions.get_all(),
        lambda kb: kb.validate("", at=1),
    ],
)
def test_a_range_of_revisions_is_refused(
    fresh_kb: KnowledgeBase, ask: Callable[[KnowledgeBase], object]
) -> None:
    fresh_kb.propositions.save(fact("hall"))
    with pytest.raises(
        InvalidArgumentError, match=r"as known at revision 1, one state: ask kb\.at"
    ):
        ask(fresh_kb.at(valid="now"))


def test_it_is_for_reading(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(fact("hall"))
    then = fresh_kb.at(valid="now")
    with pytest.raises(ReadOnlyError, match="the past cannot be changed"):
        then.propositions.save(fact("lab"))
    with pytest.raises(ReadOnlyError), then.transaction():
        pass


def test_a_wrong_time_is_refused(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(InvalidArgumentError, match="valid is 3, expected a time"):
        fresh_kb.at(valid=3)
    with pytest.raises(UnknownRevisionError, match="give a revision's number"):
        fresh_kb.at()
    with pytest.raises(InvalidArgumentError, match="not both"):
        fresh_kb.at(0, known=0)
    with pytest.raises(UnknownRevisionError, match="in the future"):
        fresh_kb.at(valid=datetime.now(UTC) + timedelta(days=1))
    with pytest.raises(UnknownRevisionError, match="no zone"):
        fresh_kb.at(valid=datetime(2026, 1, 1))


def test_a_read_that_has_begun_is_of_what_is_known_when_it_began(file_url: str) -> None:
    with connect(file_url) as kb:
        kb.propositions.save(fact("hall"))
        between = datetime.now(UTC)
        with kb.transaction(valid_from=between):
            kb.propositions.delete(fact("hall"))
        view = kb.at(valid=between)
        held = Query(text("SELECT count(*) FROM proposition_held AS v WHERE v.kb_id = :kb"))

        def meanwhile(session: Session, kb_id: int | None) -> object:
            # The others list what was said: their statements are other ones from then on.
            with ThreadPoolExecutor(1) as other:
                assert other.submit(lambda: [rooms(view) for _ in range(3)]).result() == [[]] * 3
            return session.rows(held, kb=kb_id)

        assert store_of(view).query(meanwhile) == [(0,)]
