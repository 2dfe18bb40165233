"""Statistics of executions are those that a loop over all executions finds, now and in the past."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from functools import partial
from math import ceil
from statistics import mean, median
from typing import Any

import pytest

from kant_sql import Execution, KnowledgeBase, NotApplicableError
from kant_sql.acts.statistics import Statistics, wilson
from kant_sql.errors import InvalidArgumentError, UnknownNameError, UnknownRevisionError
from tests.support.reading import loaded
from tests.support.statements import count

DOMAIN = """
(define (domain doors) (:requirements :typing :durative-actions) (:types door robot)
  (:predicates (open ?d - door))
  (:action unlock :parameters (?r - robot ?d - door)
    :precondition (not (open ?d)) :effect (open ?d))
  (:durative-action swap :parameters (?a ?b - door) :duration (= ?duration 5)))
"""
PROBLEM = """
(define (problem home) (:domain doors) (:objects front back - door r1 r2 - robot))
"""
BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
GROUPINGS: list[tuple[Any, ...]] = [
    ("action",), ("action", "argument"), ("arguments",), ("argument",), ("actor",),
    ("action", "actor"), (),
]  # fmt: skip


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base in which much was done."""
    loaded(fresh_kb, DOMAIN, PROBLEM)
    dice = random.Random(5)
    acts: list[tuple[str, tuple[str, ...]]]
    acts = [("unlock", ("r1", "front")), ("unlock", ("r2", "back")), ("swap", ("front", "front"))]
    acts += [("say", ("bay 4", "bay 4")), ("say", ())]
    for _ in range(60):
        act, arguments = dice.choice(acts)
        outcome: Any = dice.choice(["running", "succeeded", "succeeded", "failed", "aborted"])
        begun = BEGIN + timedelta(seconds=dice.randrange(10**6), microseconds=dice.randrange(10**6))
        ended = begun + timedelta(milliseconds=dice.randrange(10**6))
        code = dice.choice([None, "E1", "E2"]) if outcome == "failed" else None
        with fresh_kb.transaction(actor=dice.choice(["night", "day", None])):
            made = fresh_kb.executions.report(
                act, arguments=arguments, outcome="running", started_at=begun
            )
        if outcome != "running":
            with fresh_kb.transaction(actor="other"):
                fresh_kb.executions.report(made, outcome=outcome, code=code, ended_at=ended)
    fresh_kb.apply("(unlock r1 front)")
    with pytest.raises(NotApplicableError):
        fresh_kb.apply("(unlock r1 front)", record_refusal=True)
    return fresh_kb


def keys(by: Iterable[str], act: Execution) -> set[tuple[Any, ...]]:
    """Give the groups that an execution is of."""
    own = {"action": act.action, "arguments": (act.action, act.arguments), "actor": act.actor}
    rest = act.arguments if "argument" in by else [None]
    return {tuple(word if name == "argument" else own[name] for name in by) for word in rest}


def expected(by: tuple[str, ...], acts: Iterable[Execution]) -> dict[tuple[Any, ...], Any]:
    """Group executions by a loop."""
    groups: dict[tuple[Any, ...], list[Execution]] = {}
    for act in acts:
        for key in keys(by, act):
            groups.setdefault(key, []).append(act)
    return {key: figures(each) for key, each in groups.items()}


def figures(acts: list[Execution]) -> Any:
    outcomes = Counter(each.outcome for each in acts)
    times = sorted(
        (each.ended_at - each.started_at).total_seconds()
        for each in acts
        if each.outcome in ("succeeded", "failed") and each.ended_at and each.started_at
    )
    return (
        len(acts),
        [outcomes[name] for name in ("running", "succeeded", "failed", "aborted", "refused")],
        pytest.approx(mean(times)) if times else None,
        pytest.approx(median(times)) if times else None,
        pytest.approx(times[ceil(0.95 * len(times)) - 1]) if times else None,
        Counter(each.code for each in acts if each.code is not None),
    )


def found(by: tuple[str, ...], given: list[Statistics]) -> dict[tuple[Any, ...], Any]:
    assert [each.count for each in given] == sorted((each.count for each in given), reverse=True)
    return {
        tuple(
            (each.action, each.arguments) if name == "arguments" else getattr(each, name)
            for name in by
        ): (
            each.count,
            [each.running, each.succeeded, each.failed, each.aborted, each.refused],
            each.mean,
            each.median,
            each.percentile_95,
            Counter(each.codes),
        )
        for each in given
    }


@pytest.mark.parametrize("by", GROUPINGS, ids="-".join)
def test_figures_are_those_of_a_loop(kb: KnowledgeBase, by: tuple[Any, ...]) -> None:
    assert found(by, kb.statistics(by=by)) == expected(by, kb.executions.get_all())
    middle = kb.at(kb.revision // 2)
    assert found(by, middle.statistics(by=by)) == expected(by, middle.executions.get_all())
    which: dict[str, Any] = {"actor": "night", "since": 20, "until": kb.revision - 20}
    assert found(by, kb.statistics(by=by, **which)) == expected(by, kb.executions.get_all(**which))


def test_what_ended_before_it_began_has_no_duration(fresh_kb: KnowledgeBase) -> None:
    """The clock of a component may be ahead of the database's."""
    fresh_kb.executions.report("say", outcome="succeeded", started_at=BEGIN.replace(year=2200))
    [said] = fresh_kb.statistics()
    assert (said.succeeded, said.mean, said.median, said.percentile_95) == (1, None, None, None)
    fresh_kb.executions.report("say", outcome="failed", started_at=BEGIN, ended_at=BEGIN)
    assert fresh_kb.statistics()[0].mean == 0


def test_statements_do_not_grow_with_executions(kb: KnowledgeBase) -> None:
    for by in GROUPINGS:
        assert count(partial(kb.statistics, by=by, since=3)) <= 20


def test_the_rate_and_its_interval(kb: KnowledgeBase) -> None:
    swap = next(each for each in kb.statistics() if each.action == "swap")
    assert swap.success_rate == swap.succeeded / (swap.succeeded + swap.failed)
    # Newcombe, Two-sided confidence intervals for the single proportion (1998), table I.
    for rate, interval in (
        ((81, 263), (0.2553, 0.3662)),
        ((15, 148), (0.0624, 0.1605)),
        ((0, 20), (0.0, 0.1611)),
        ((1, 29), (0.0061, 0.1718)),
    ):
        assert wilson(*rate) == pytest.approx(interval, abs=5e-5)
    assert wilson(0, 0) is None


def test_a_limit_and_what_is_pending(kb: KnowledgeBase) -> None:
    assert kb.statistics(limit=1) == kb.statistics()[:1]
    with kb.transaction():
        kb.executions.report("wave", outcome="failed", code="E9")
        assert next(each for each in kb.statistics() if each.action == "wave").codes == {"E9": 1}


def test_refusals(kb: KnowledgeBase) -> None:
    with pytest.raises(UnknownNameError, match="nobody"):
        kb.statistics(actor="nobody")
    with pytest.raises(UnknownRevisionError):
        kb.statistics(since=10_000)
    wrong: Any
    for wrong in ("action", ["colour"], 3):
        with pytest.raises(InvalidArgumentError):
            kb.statistics(by=wrong)
    assert kb.at(0).statistics() == []


def test_the_view_for_auditors_has_the_same_figures(kb: KnowledgeBase) -> None:
    rows = kb.store.to_arrow("statistics").to_pylist()
    assert sum(row["unconfirmed"] for row in rows) == 2
    of_all = {row["action"]: row for row in rows if row["arguments"] is None}
    of_each = {
        (row["action"], row["arguments"]): row for row in rows if row["arguments"] is not None
    }
    whole, each = kb.statistics(), kb.statistics(by=["arguments"])
    assert len(rows) == len(whole) + len(each)
    pairs = [(of_all[one.action], one) for one in whole]
    pairs += [(of_each[one.action, " ".join(one.arguments or ())], one) for one in each]
    for row, one in pairs:
        counts = ("running", "succeeded", "failed", "aborted", "refused")
        assert [row[name] for name in counts] == [getattr(one, name) for name in counts]
        assert (row["executions"], row["unconfirmed"]) == (one.count, one.unconfirmed)
        found = [row["success_rate"], row["success_low"], row["success_high"]]
        interval = one.interval or (None, None)
        assert found == pytest.approx([one.success_rate, *interval], abs=1e-12)
        times = ("mean", "median", "percentile_95")
        assert [row[name] for name in times] == pytest.approx(
            [getattr(one, name) for name in times], abs=1e-6
        )
        codes = dict(pair.split(": ") for pair in (row["codes"] or "").split(", ") if pair)
        assert codes == {code: str(count) for code, count in one.codes.items()}


def test_effects_that_nobody_has_seen_are_counted(kb: KnowledgeBase) -> None:
    def waiting(**which: Any) -> dict[str, int]:
        return {str(one): one.unconfirmed for one in kb.statistics(**which) if one.unconfirmed}

    assert waiting() == {"unlock": 1}
    assert waiting(by=["arguments"]) == {"(unlock r1 front)": 1}
    assert waiting(by=["argument"]) == {"r1": 1, "front": 1}
    assert waiting(until=kb.revision - 2) == {}
    with kb.transaction(actor="camera"):
        kb.propositions.confirm(["(open front)"])
    assert waiting() == {}
