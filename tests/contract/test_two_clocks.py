"""What is said of a period: writing, and what it leaves in the tables."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, Plan
from kant_sql.errors import InvalidArgumentError
from kant_sql.knowledge.canonical import text_time, time_text
from kant_sql.store import transaction
from tests.support.pages import Page
from tests.support.reading import (
    as_actor,
    facts,
    last_changes,
    nothing_changes,
    rows,
    store_of,
    undone,
)
from tests.support.servers import Server
from tests.support.statements import count, recorded
from tests.support.stores import Connect, new_file_store
from tests.support.two_clocks import FACTS, Model, Writer

HALL, LAB = "(at r1 hall)", "(at r1 lab)"


@pytest.fixture
def writer(fresh_kb: KnowledgeBase) -> Writer:
    return Writer(fresh_kb)


@pytest.fixture
def kb(writer: Writer) -> KnowledgeBase:
    writer.kb.propositions.save(LAB)
    return writer.kb


def ago(minutes: float) -> datetime:
    return datetime.now(UTC) - timedelta(minutes=minutes)


def within(kb: KnowledgeBase, call: Callable[[], object] = lambda: None, **given: Any) -> None:
    with kb.transaction(**given):
        call()


def sayings(kb: KnowledgeBase) -> list[tuple[Any, ...]]:
    """All rows of sayings, by revision and text."""
    found: list[tuple[Any, ...]] = []
    for table, columns in (
        ("proposition_saying", "holds"),
        ("function_value_saying", "value, object_id"),
    ):
        own = f"since, text, valid_from, valid_until, {columns}"
        found += rows(kb, f"SELECT {own} FROM {table} WHERE kb_id = :kb")
    return sorted(found, key=lambda row: (row[0], row[1]))


def moment(raw: Any) -> datetime:
    return text_time(raw) if isinstance(raw, str) else raw


def test_a_period_that_is_over_leaves_the_present(kb: KnowledgeBase) -> None:
    begin, end = ago(60), ago(30)
    with kb.transaction(actor="camera", reason="late", valid_from=begin, valid_until=end):
        assert kb.propositions.save(HALL)
        assert kb.propositions.delete(LAB)
        assert kb.function_values.set("(battery r1)", value=80)
        assert kb.function_values.set("(home r1)", value="hall")
    assert facts(kb) == [LAB]
    assert kb.function_values.get_all() == []
    period = f':from "{time_text(begin)}" :until "{time_text(end)}"'
    assert last_changes(kb) == [
        f"+ saying (:held (= (battery r1) 80) {period})",
        f"+ saying (:held (= (home r1) hall) {period})",
        f"+ saying (:held (at r1 hall) {period})",
        f"+ saying (:not-held (at r1 lab) {period})",
    ]
    assert [(moment(row[2]), moment(row[3])) for row in sayings(kb)] == [(begin, end)] * 4
    assert kb.store.verify().is_intact


def test_an_open_period_changes_the_present_too(kb: KnowledgeBase) -> None:
    begin = ago(5)
    with kb.transaction(valid_from=begin):
        kb.propositions.save(HALL)
        kb.propositions.delete(LAB)
        kb.function_values.set("(battery r1)", value=70)
    assert facts(kb) == [HALL]
    assert kb.function_values.get("(battery r1)") == 70
    committed = next(iter(kb.log(limit=1))).revision.committed_at
    assert [(moment(row[2]), moment(row[3])) for row in sayings(kb)] == [(begin, committed)] * 3
    kinds = sorted(one.split()[1] for one in last_changes(kb))
    assert kinds == ["fact", "fact", "saying", "saying", "saying", "value"]
    assert kb.store.verify().is_intact


def test_what_was_said_last_is_not_said_again(kb: KnowledgeBase) -> None:
    period: dict[str, Any] = {"valid_from": ago(60), "valid_until": ago(30)}

    def say(*, holds: bool, battery: object) -> int:
        before = kb.revision
        with kb.transaction(**period):
            (kb.propositions.save if holds else kb.propositions.delete)(HALL)
            kb.function_values.set("(battery r1)", value=battery)  # type: ignore[arg-type]
        return kb.revision - before

    assert say(holds=True, battery=80) == 1
    assert say(holds=True, battery=Decimal("80.0")) == 0
    assert say(holds=False, battery=80) == 1
    assert say(holds=True, battery=80) == 1
    assert len(sayings(kb)) == 4
    with kb.transaction(**period):
        kb.propositions.delete(HALL)
        kb.propositions.save(HALL)
    assert len(sayings(kb)) == 4


def test_what_was_never_known_did_not_hold(kb: KnowledgeBase) -> None:
    with kb.transaction(valid_from=ago(60), valid_until=ago(30)):
        assert kb.propositions.delete("(open)")
        assert kb.function_values.unset("(battery r2)")
    assert [row[1].split(" :from")[0] for row in sayings(kb)] == [
        "(:not-held (battery r2)",
        "(:not-held (open)",
    ]
    assert kb.store.verify().is_intact


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"valid_from": ago(-100_000)}, r"valid_from .* store's clock.*kb\.pddl\.timed_initial_"),
        ({"valid_from": ago(5), "valid_until": ago(-100_000)}, r"valid_until .* store's clock"),
        ({"valid_from": ago(5), "valid_until": ago(6)}, "is not after valid_from"),
        (dict.fromkeys(("valid_from", "valid_until"), ago(5)), "is not after valid_from"),
        ({"valid_until": ago(5)}, "no valid_from"),
        ({"valid_from": datetime(2026, 1, 1)}, "time with its zone"),
        ({"valid_from": 3}, "time with its zone"),
        ({"valid_from": "long ago"}, "neither a revision's number nor a time"),
        ({"valid_from": ago(5), "confirm": True}, "confirm=True cannot be about a period"),
    ],
)
def test_wrong_periods_are_refused(kb: KnowledgeBase, given: dict[str, Any], message: str) -> None:
    with nothing_changes(kb), pytest.raises(InvalidArgumentError, match=message):
        within(kb, **given)


def test_what_speaks_of_now_is_refused_in_a_period(kb: KnowledgeBase) -> None:
    kb.load_domain(
        "(define (domain clocks) (:requirements :typing :fluents :object-fluents)"
        "(:types robot room) (:predicates (at ?r - robot ?p - room) (clean ?p - room) (open))"
        "(:functions (battery ?r - robot) - number (home ?r - robot) - room)"
        "(:action sweep :parameters (?p - room) :effect (clean ?p)))",
        mode="merge",
    )
    step = kb.plans.record(Plan.read("(sweep hall)")).steps[0]
    calls: dict[str, Any] = {
        "an act": lambda: kb.apply("(sweep hall)"),
        "the status of a step": lambda: kb.plans.set_status(step, status="running"),
        "an execution": lambda: kb.executions.report("(sweep hall)", outcome="succeeded"),
        r"delete_all\(\)": kb.propositions.delete_all,
        "insert or update": lambda: kb.propositions.insert(HALL),
        "a value that is increased": lambda: kb.function_values.increase("(battery r1)", by=1),
        "a confirmation": lambda: kb.propositions.confirm(LAB),
        "a restored state": lambda: kb.restore(1),
        "mode='replace'": lambda: kb.load_problem(
            "(define (problem p) (:domain clocks) (:init) (:goal (and)))"
        ),
    }
    for what, call in calls.items():
        with nothing_changes(kb), pytest.raises(InvalidArgumentError, match=f"{what} cannot be"):
            within(kb, call, valid_from=ago(60), valid_until=ago(30))


def test_a_block_within_speaks_of_the_same(kb: KnowledgeBase) -> None:
    period: dict[str, Any] = {"valid_from": ago(60), "valid_until": ago(30)}
    with kb.transaction(**period):
        with kb.transaction():
            kb.propositions.save(HALL)
        with kb.transaction(**period):
            kb.propositions.save("(open)")
        with pytest.raises(InvalidArgumentError, match="another period"):
            within(kb, valid_from=ago(10))
    assert len(sayings(kb)) == 2
    assert facts(kb) == [LAB]
    with kb.transaction(), pytest.raises(InvalidArgumentError, match="another period"):
        within(kb, **period)


def test_a_block_that_fails_takes_back_what_it_said(kb: KnowledgeBase) -> None:
    with kb.transaction(valid_from=ago(60), valid_until=ago(30)):
        kb.propositions.save(HALL)
        with undone(kb):
            kb.propositions.delete(HALL)
            kb.propositions.save("(open)")
            kb.propositions.get_all()
    assert [row[1].split(" :from")[0] for row in sayings(kb)] == [f"(:held {HALL}"]


def test_definitions_and_goals_have_one_clock(kb: KnowledgeBase) -> None:
    with kb.transaction(valid_from=ago(60), valid_until=ago(30)):
        kb.goals.save(HALL)
        kb.objects.delete("lab")
        kb.propositions.save(HALL)
    assert facts(kb) == []
    assert [str(goal) for goal in kb.goals.get_propositions()] == [HALL]
    assert [one.split(" :from")[0] for one in last_changes(kb)] == [
        f"+ goal {HALL}",
        f"+ saying (:held {HALL}",
        f"- fact {LAB}",
        "- object lab - room",
    ]


WAYS = re.findall(r"^\| (.*) \| (\d) \| (\d) \| `(.*)` \|$", Page("two-clocks.md").text, re.M)


def test_thirteen_ways_are_documented() -> None:
    """Each pair of periods is in another of Allen's relations."""
    ends = {
        tuple((one > other) - (one < other) for one in (int(begin), int(end)) for other in (2, 6))
        for _, begin, end, _ in WAYS
    }
    assert len(WAYS) == len(ends) == 13


@pytest.mark.parametrize(("way", "begin", "end", "expected"), WAYS)
def test_two_periods_can_lie_in_thirteen_ways(
    kb: KnowledgeBase, way: str, begin: str, end: str, expected: str
) -> None:
    ten = datetime(2026, 1, 31, 10, tzinfo=UTC)
    minutes = [ten + timedelta(minutes=minute) for minute in range(9)]
    for room, first, last in (("kitchen", 2, 6), ("hall", int(begin), int(end))):
        with kb.transaction(valid_from=minutes[first], valid_until=minutes[last]):
            kb.objects.save(f"{room} - room")
            kb.function_values.set("(home r1)", value=room)
            kb.propositions.save(f"(at r1 {room})")
            if room == "hall":
                kb.propositions.delete("(at r1 kitchen)")
    found = there = ""
    for minute in minutes[:8]:
        then = kb.at(valid=minute)
        value: Any = then.function_values.get("(home r1)")
        found += "-" if value is None else value.name[0]
        [*held] = map(str, then.propositions.get_all())
        there += "-" if not held else held[0].split()[-1][0]
        assert len(held) < 2
    assert (found, there) == (expected, expected), way


def test_a_random_history_leaves_the_rows_of_its_model(writer: Writer) -> None:
    writer.run(60)
    kb, model = writer.kb, writer.model
    held = [
        (row[0], moment(row[2]), moment(row[3]), row[1].split(" :from")[0]) for row in sayings(kb)
    ]
    assert held == rows_of(model)
    assert facts(kb) == sorted(one for one in FACTS if model.then(one, kb.revision))
    assert kb.store.verify().is_intact


def rows_of(model: Model) -> list[tuple[Any, ...]]:
    """The sayings that are not those before them again, as rows."""
    last: dict[str, tuple[Any, ...]] = {}
    found = []
    for element, content, begin, end, since in model.sayings:
        if last.get(element) != (content, begin, end):
            said = element if isinstance(content, bool | None) else f"(= {element} {content})"
            holds = "held" if content not in (False, None) else "not-held"
            found.append((since, begin, end, f"(:{holds} {said}"))
        last[element] = (content, begin, end)
    return sorted(found, key=lambda row: (row[0], row[3]))


def test_a_plain_write_has_no_part_in_it(kb: KnowledgeBase) -> None:
    with recorded() as statements:
        kb.propositions.save(HALL)
        kb.propositions.delete(LAB)
        kb.function_values.set("(battery r1)", value=1)
    assert not [sql for sql in statements if "saying" in sql]
    assert sayings(kb) == []


def test_a_period_takes_two_statements_more_however_much_is_said(kb: KnowledgeBase) -> None:
    rooms = [f"room{number}" for number in range(60)]
    kb.objects.save_all([f"{room} - room" for room in rooms])
    facts = [f"(at r1 {room})" for room in rooms]
    kb.propositions.save_all(facts)

    def say(number: int, minutes: float) -> int:
        def call() -> None:
            with kb.transaction(valid_from=ago(minutes), valid_until=ago(minutes - 1)):
                kb.propositions.save_all(facts[:number])

        return count(call)

    def save() -> None:
        with kb.transaction():
            kb.propositions.save_all(facts[:30])

    say(60, 9)
    kb.propositions.delete_all(facts)
    plain = count(save)
    assert say(30, 5) == say(60, 3) <= plain + 2


def test_many_facts_are_said_in_parts(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transaction, "SPILL_AT", 5)
    rooms = [f"room{number}" for number in range(20)]
    init = " ".join(f"(at r1 {room})" for room in rooms)
    problem = (
        f"(define (problem p) (:domain clocks) (:objects {' '.join(rooms)} hall lab - room "
        f"r1 - robot) (:init {init} (= (battery r1) 5)) (:goal (at r1 room0)))"
    )
    for period in ((ago(60), ago(30)), (ago(20), None)):
        begin, end = period
        with kb.transaction(valid_from=begin, valid_until=end):
            kb.load_problem(problem, mode="merge")
            kb.propositions.delete("(at r1 room3)")
            kb.propositions.save("(at r1 room3)")
            kb.propositions.delete("(at r1 room4)")
            kb.propositions.delete(LAB)
        assert kb.store.verify().is_intact
        assert (len(facts(kb)) > 1) == (end is None)
    held = [row[1].split(" :from")[0] for row in sayings(kb)]
    expected = [f"(:held (at r1 {room})" for room in rooms if room != "room4"]
    more = ["(:held (= (battery r1) 5)", "(:not-held (at r1 room4)", f"(:not-held {LAB}"]
    assert sorted(held) == sorted(2 * [*expected, *more])


def test_a_connection_takes_the_time_of_messages(kb: KnowledgeBase) -> None:
    seen = ago(2)
    camera = as_actor(kb, "camera")
    store_of(camera).write_clock = "observed"
    with camera.transaction(observed_at=seen):
        camera.propositions.save(HALL)
    [row] = sayings(kb)
    assert moment(row[2]) == seen
    assert next(iter(kb.store.revisions(kb.revision - 1))).observed_at == seen
    with camera.transaction(observed_at=ago(-2)):
        camera.propositions.delete(HALL)
    camera.propositions.save("(open)")
    with camera.transaction(observed_at=seen, valid_from=ago(9), valid_until=ago(8)):
        camera.propositions.save("(open)")
    assert len(sayings(kb)) == 2
    with pytest.raises(InvalidArgumentError, match="the clock is 'now', expected"):
        kant_sql.connect("sqlite://", clock="now")


def test_a_branch_begins_with_the_state_alone(kb: KnowledgeBase) -> None:
    with kb.transaction(valid_from=ago(60), valid_until=ago(30)):
        kb.propositions.save(HALL)
    with kb.branch(url="sqlite://") as branch:
        assert facts(branch) == [LAB]
        assert sayings(branch) == []
        assert branch.at(valid=ago(45)).propositions.get_all() == []


def test_replicas_and_archives_have_what_was_said(writer: Writer, tmp_path: Path) -> None:
    kb = writer.kb
    writer.run(20)
    half = kb.revision
    target = new_file_store(tmp_path / "replica.db")
    kb.store.push(target)
    writer.run(20)
    kb.store.push(target)
    kb.objects.delete("attic")
    archive = new_file_store(tmp_path / "archive.db")
    done = kb.store.archive(before=half, to=archive)
    kb.store.push(target)
    said = [row[:2] for row in sayings(kb)]
    with kant_sql.connect(target, knowledge_base=store_of(kb).name) as replica:
        assert [row[:2] for row in sayings(replica)] == said
        assert replica.store.verify().is_intact
    with kant_sql.connect(
        f"sqlite:///{tmp_path / 'archive.db'}", knowledge_base=store_of(kb).name
    ) as old:
        assert [row[:2] for row in sayings(old)] == [row for row in said if row[0] <= done.upto]
        assert old.store.verify().is_intact
    assert kb.store.verify().is_intact


@pytest.mark.parametrize("zone", ["America/New_York", "Asia/Kolkata"])
def test_the_ends_of_the_calendar_are_read_in_every_zone(
    server: Server, connect: Connect, zone: str
) -> None:
    url = make_url(server.new_store()).update_query_dict({"options": f"-ctimezone={zone}"})
    kb = connect(url.render_as_string(hide_password=False), knowledge_base="kb")
    kb.predicates.save("(open)")
    first, last = (each.replace(tzinfo=UTC) for each in (datetime.min, datetime.max))
    with kb.transaction(valid_from=first, valid_until="2020-01-01T00:00Z", observed_at=last):
        kb.propositions.save("(open)")
    assert kb.store.verify().findings == ()
    (period,) = kb.when("(open)", clock="valid")
    assert period.since_time == first
    assert next(iter(kb.log(limit=1))).revision.observed_at == last
    assert len([*kb.corrections()]) == 1
