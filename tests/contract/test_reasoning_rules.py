"""Rules about the past: trajectory constraints, held against what was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from random import Random
from typing import Any

import pytest

from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    PddlError,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownRevisionError,
    UnsupportedConstructError,
    Verdicts,
)
from kant_sql.dto.formulas import MODALS, Modal, Number
from kant_sql.errors import ArchivedError, SourceMissingError
from kant_sql.pddl import read_problem
from tests.support.reading import beside
from tests.support.statements import count
from tests.support.stores import Connect
from tests.unit.test_reasoning_trajectory import States, satisfied

ROBOT, ROOM = PddlTypeDto("robot"), PddlTypeDto("room")
AT = PddlPredicateDto("robot_at", [ROBOT, ROOM])
CHILD = PddlPredicateDto("child_in", [ROOM])
RB1, RB2 = PddlObjectDto(ROBOT, "rb1"), PddlObjectDto(ROBOT, "rb2")
HALL, KITCHEN = PddlObjectDto(ROOM, "hall"), PddlObjectDto(ROOM, "kitchen")
SAFETY = "(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))"
BASE = datetime(2026, 1, 1, tzinfo=UTC)


def at(robot: PddlObjectDto, room: PddlObjectDto) -> PddlPropositionDto:
    return PddlPropositionDto(AT, [robot, room])


def child(room: PddlObjectDto) -> PddlPropositionDto:
    return PddlPropositionDto(CHILD, [room])


def step(
    kb: KnowledgeBase,
    who: str,
    *changes: tuple[str, PddlPropositionDto],
    after: float | None = None,
) -> None:
    seen = None if after is None else BASE + timedelta(seconds=after)
    with kb.transaction(actor=who, reason=f"{who} did it", observed_at=seen):
        for sign, fact in changes:
            (kb.propositions.save if sign == "+" else kb.propositions.delete)(fact)


@pytest.fixture
def day(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Revisions at 0, 10, 20 ... seconds: 1 all in the hall, 2 a child in the kitchen ..."""
    kb = fresh_kb
    with kb.transaction(actor="installer", observed_at=BASE):
        kb.propositions.save_all([at(RB1, HALL), at(RB2, HALL)])
        kb.predicates.save(CHILD)
        kb.objects.save(KITCHEN)
    step(kb, "camera", ("+", child(KITCHEN)), after=10)
    step(kb, "driver", ("-", at(RB2, HALL)), ("+", at(RB2, KITCHEN)), after=20)
    step(kb, "driver", ("-", at(RB1, HALL)), ("+", at(RB1, KITCHEN)), after=30)
    step(kb, "camera", ("-", child(KITCHEN)), after=40)
    step(kb, "camera", ("+", child(KITCHEN)), after=50)
    step(kb, "driver", ("-", at(RB1, KITCHEN)), after=60)
    return kb


def found(verdicts: Verdicts) -> list[int | None]:
    """The first violating revision of each rule."""
    return [None if one.revision is None else one.revision.number for one in verdicts]


def judge(kb: KnowledgeBase, rule: str, **options: Any) -> int | None:
    [number] = found(kb.pddl.check_rules(rule, **options))
    return number


def test_a_safety_rule_is_one_line(day: KnowledgeBase) -> None:
    verdicts = day.pddl.check_rules(SAFETY, clock="observed")
    [verdict] = verdicts
    assert not verdicts.is_satisfied
    assert verdicts.violated == [verdict]
    assert not verdict.is_satisfied
    assert verdict.rule == SAFETY
    assert verdict.revision == day.store.revisions(3, limit=1)[0]
    assert verdict.revision is not None
    assert (verdict.revision.actor, verdict.revision.reason) == ("driver", "driver did it")
    assert verdict.time == 30
    assert "violated in revision 4" in str(verdicts)
    assert "driver did it" in str(verdicts)
    assert day.pddl.check_rules(SAFETY, until=3).is_satisfied
    assert str(day.pddl.check_rules(SAFETY, until=3)) == f"{SAFETY} is kept"


def test_each_operator(day: KnowledgeBase) -> None:
    rules = {
        "(always (robot_at rb2 hall))": 3,
        "(sometime (robot_at rb2 kitchen))": None,
        "(sometime (child_in hall))": 7,
        "(at-most-once (child_in kitchen))": 6,
        "(sometime-before (robot_at rb1 kitchen) (child_in kitchen))": None,
        "(sometime-before (child_in kitchen) (robot_at rb1 kitchen))": 2,
        "(sometime-after (child_in kitchen) (robot_at rb1 kitchen))": 7,
        "(sometime-after (robot_at rb2 hall) (robot_at rb1 kitchen))": None,
        "(sometime-after (child_in kitchen) (robot_at rb1 hall))": 4,
        "(at end (child_in kitchen))": None,
        "(at end (robot_at rb1 hall))": 7,
        "(within 20 (robot_at rb2 kitchen))": None,
        "(within 19.9 (robot_at rb2 kitchen))": 3,
        "(always-within 20 (child_in kitchen) (robot_at rb1 kitchen))": 7,
        "(always-within 30 (robot_at rb2 hall) (robot_at rb1 kitchen))": None,
        "(always-within 19 (child_in kitchen) (robot_at rb1 kitchen))": 2,
        "(hold-after 20 (robot_at rb2 kitchen))": None,
        "(hold-after 19 (robot_at rb2 kitchen))": 2,
        "(hold-during 10 40 (child_in kitchen))": None,
        "(hold-during 10 41 (child_in kitchen))": 5,
    }
    for rule, revision in rules.items():
        assert judge(day, rule, clock="observed") == revision, rule
    whole = day.pddl.check_rules("\n".join(rules), clock="observed")
    assert found(whole) == [*rules.values()]
    assert [one.rule for one in whole] == [*rules]
    assert whole.first == 1
    assert whole.last == 7


def test_times_of_rules_matter_where_nothing_mentioned_changes(fresh_kb: KnowledgeBase) -> None:
    """Revisions that touch nothing in a rule are states of the trajectory, too."""
    kb = fresh_kb
    with kb.transaction(observed_at=BASE):
        kb.propositions.save(at(RB1, HALL))
        kb.objects.save_all([RB2, KITCHEN])
    for number in range(1, 7):
        room = (HALL, KITCHEN)[number % 2]
        sign = "+" if number < 3 else "-"
        step(kb, "other", (sign, at(RB2, room)), after=10 * number)
    step(kb, "driver", ("-", at(RB1, HALL)), after=100)
    assert judge(kb, "(hold-during 25 35 (robot_at rb1 kitchen))", clock="observed") == 3
    assert judge(kb, "(hold-during 25 35 (robot_at rb1 hall))", clock="observed") is None
    assert judge(kb, "(within 45 (robot_at rb1 kitchen))", clock="observed") is not None
    assert judge(kb, "(hold-after 95 (robot_at rb1 hall))", clock="observed") == kb.revision


def test_preferences_are_counted(day: KnowledgeBase) -> None:
    verdicts = day.pddl.check_rules(
        "(and (preference calm (always (not (child_in kitchen))))"
        " (forall (?r - robot) (preference home (sometime-after (robot_at ?r kitchen)"
        " (robot_at ?r hall))))"
        " (preference (sometime (child_in hall))) (preference kept (sometime (child_in kitchen))))"
    )
    assert verdicts.is_satisfied
    assert verdicts.violated_preferences == {"calm": 1, "home": 2, "anonymous": 1}
    assert [one.is_preference for one in verdicts] == [True] * 5
    assert [one.preference for one in verdicts] == ["calm", "home", "home", None, "kept"]
    assert found(verdicts) == [2, 4, 3, 7, None]


def test_a_quantifier_makes_a_rule_for_each_object(day: KnowledgeBase) -> None:
    rule = "(forall (?r - robot) (always (not (and (robot_at ?r kitchen) (child_in kitchen)))))"
    verdicts = day.pddl.check_rules(rule)
    assert [one.rule for one in verdicts] == [SAFETY, SAFETY.replace("rb1", "rb2")]
    assert found(verdicts) == [4, 3]
    # One that comes later is judged from then on, one that goes until then.
    step(day, "installer", ("+", at(PddlObjectDto(ROBOT, "rb3"), HALL)))
    day.objects.delete(RB2)
    ever = "(forall (?r - robot) (always (exists (?w - room) (robot_at ?r ?w))))"
    later = day.pddl.check_rules(ever)
    assert found(later) == [7, None, None]
    assert ["rb1" in later[0].rule, "rb2" in later[1].rule, "rb3" in later[2].rule] == [True] * 3
    assert found(day.pddl.check_rules(rule)) == [4, 3, None]


def test_the_rules_of_the_store_are_the_default(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    assert len(kb.pddl.check_rules()) == 0
    kb.load_domain(
        """(define (domain d) (:requirements :constraints :typing :preferences)
      (:types robot room) (:predicates (robot_at ?r - robot ?w - room) (child_in ?w - room))
      (:constraints (forall (?r - robot) (at-most-once (robot_at ?r ?r)))))
      """.replace("(robot_at ?r ?r)", "(exists (?w - room) (robot_at ?r ?w))")
    )
    kb.load_problem("""(define (problem p) (:domain d) (:objects rb1 - robot hall kitchen - room)
      (:init (robot_at rb1 hall))
      (:constraints (and (always (not (child_in hall))) (preference p (sometime (child_in hall))))))
      """)
    verdicts = kb.pddl.check_rules()
    assert found(verdicts) == [None, None, 2]
    step(kb, "camera", ("+", child(HALL)))
    assert found(kb.pddl.check_rules()) == [None, 3, None]
    assert found(kb.at(2).pddl.check_rules()) == [None, None, 2]
    assert kb.pddl.check_rules().to_dicts()[1]["actor"] == "camera"


def test_files_nodes_and_constraints_sections(day: KnowledgeBase, tmp_path: Path) -> None:
    path = tmp_path / "rules.pddl"
    path.write_text(
        f"; What must never be.\n{SAFETY}\n\n(:constraints (sometime (child_in hall)))\n"
    )
    assert found(day.pddl.check_rules(path)) == [4, 7]
    assert found(day.pddl.check_rules(str(path))) == [4, 7]
    problem = read_problem(f"(define (problem p) (:domain d) (:constraints {SAFETY}))")
    assert found(day.pddl.check_rules(problem.constraints)) == [4]
    assert found(day.pddl.check_rules(problem.constraints[0])) == [4]
    assert found(day.pddl.check_rules("(and)")) == []
    with pytest.raises(SourceMissingError):
        day.pddl.check_rules(tmp_path / "missing.pddl")
    path.write_text(f"{SAFETY}\n(always (child_on kitchen))")
    with pytest.raises(PddlError, match="child_in") as caught:
        day.pddl.check_rules(path)
    assert (caught.value.line, str(path) in str(caught.value)) == (2, True)


def test_what_is_no_rule_is_refused(day: KnowledgeBase) -> None:
    for text in (
        *("(child_in kitchen)", "(always (child_in ?w))", "(always (child_in kitchen)", "()x"),
        *("(within -1 (child_in kitchen))", "(hold-during 5 1 (child_in kitchen))"),
    ):
        with pytest.raises(PddlError):
            day.pddl.check_rules(text)
    with pytest.raises(UnsupportedConstructError, match="sometime"):
        day.pddl.check_rules("(always (sometime (child_in kitchen)))")
    anything: Any = day
    with pytest.raises(InvalidArgumentError, match="the clock"):
        anything.pddl.check_rules(SAFETY, clock="wall")
    with pytest.raises(InvalidArgumentError, match="a source"):
        anything.pddl.check_rules(3)
    with pytest.raises(UnknownRevisionError):
        day.pddl.check_rules(SAFETY, until=99)


def test_a_range_that_ends_before_it_begins_is_refused(day: KnowledgeBase) -> None:
    first, last = (day.store.revisions(one, limit=1)[0].committed_at for one in (2, 5))
    for since, until in ((5, 2), (last, first), (5, first), (last, 2)):
        for asked in (
            lambda **span: list(day.log(**span)),
            lambda **span: day.when("(child_in ?w)", **span),
            lambda **span: day.pddl.check_rules(SAFETY, **span),
        ):
            with pytest.raises(InvalidArgumentError, match="the range ends before it begins"):
                asked(since=since, until=until)


def test_a_range_is_a_trajectory_of_its_own(day: KnowledgeBase) -> None:
    assert judge(day, SAFETY, since=5) == 6
    assert judge(day, SAFETY, since=7) is None
    assert judge(day, SAFETY, since=4, until=4) == 4
    within = "(within 15 (robot_at rb1 kitchen))"
    assert judge(day, within, clock="observed") == 3
    assert judge(day, within, clock="observed", since=3) is None
    times = [revision.committed_at for revision in day.store.revisions()]
    assert judge(day, SAFETY, since=times[0], until=times[6]) == 4
    assert day.at(3).pddl.check_rules(SAFETY).is_satisfied
    assert judge(day.at(4), SAFETY) == 4


def test_the_clocks(day: KnowledgeBase) -> None:
    """By the time of the commit, all of it takes less than a second."""
    assert judge(day, "(within 5 (robot_at rb1 kitchen))") is None
    assert judge(day, "(within 5 (robot_at rb1 kitchen))", clock="observed") == 2
    # Without a time of observation, that of the commit; one that is late does not go back.
    step(day, "late", ("+", at(RB1, HALL)), after=5)
    step(day, "late", ("-", at(RB1, HALL)), after=70)
    assert judge(day, "(hold-after 60 (not (robot_at rb1 hall)))", clock="observed") == 8


def test_definitions_are_those_of_each_revision(day: KnowledgeBase) -> None:
    day.predicates.delete(CHILD)
    assert judge(day, SAFETY) == 4
    step(day, "camera", ("+", child(HALL)))
    assert judge(day, "(always (child_in kitchen))", since=7) == 9
    day.objects.delete(KITCHEN)
    assert judge(day, SAFETY) == 4
    with pytest.raises(PddlError):
        day.pddl.check_rules("(always (child_in cellar))")


def test_a_rule_without_its_names_is_not_judged(day: KnowledgeBase) -> None:
    rule, soft = "(sometime (robot_at rb2 hall))", "(preference near (always (robot_at rb2 hall)))"
    day.propositions.delete(at(RB2, KITCHEN))
    since = day.objects.delete(RB2) and day.revision
    judged = day.pddl.check_rules(f"{SAFETY} {rule} {soft}", since=since)
    assert [one.verdict for one in judged] == ["kept", "not judged", "not judged"]
    assert (judged.is_satisfied, judged.violated, judged.violated_preferences) == (False, [], {})
    assert judged.not_judged == [judged[1], judged[2]]
    assert str(judged[1]) == f"{rule} is not judged: no state of the range has all its names"
    assert judged.to_dicts()[1]["verdict"] == "not judged"
    assert day.pddl.check_rules(f"{SAFETY} {soft}", since=since).is_satisfied
    assert day.pddl.check_rules(rule).is_satisfied


def test_numbers_and_derived_predicates(fresh_kb: KnowledgeBase) -> None:
    kb, battery = fresh_kb, PddlFunctionDto("battery", [ROBOT])
    for level in (90, 40, 19.5, 60):
        kb.function_values.set(battery, objects=[RB1], value=level)
    assert judge(kb, "(always (>= (battery rb1) 20))") == 3
    assert judge(kb, "(always (>= (battery rb1) 19))") is None
    assert judge(kb, "(sometime-after (< (battery rb1) 20) (> (battery rb1) 50))") is None


def test_it_takes_as_many_statements_however_long_the_past(day: KnowledgeBase) -> None:
    rules = f"{SAFETY} (within 20 (child_in kitchen))"
    day.pddl.check_rules(rules)
    few = count(lambda: day.pddl.check_rules(rules))
    assert few <= 16
    for _ in range(20):
        step(day, "driver", ("+", at(RB1, KITCHEN)))
        step(day, "driver", ("-", at(RB1, KITCHEN)))
    assert count(lambda: day.pddl.check_rules(rules)) == few


def test_an_archived_past_is_refused(shared_url: str, tmp_path: Path, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    step(kb, "a", ("+", at(RB1, HALL)))
    step(kb, "b", ("-", at(RB1, HALL)), ("+", at(RB1, KITCHEN)))
    step(kb, "c", ("-", at(RB1, KITCHEN)))
    kb.store.archive(3, to=f"sqlite:///{tmp_path / 'old.db'}")
    rule = "(always (robot_at rb1 kitchen))"
    with pytest.raises(ArchivedError, match=r"old\.db"):
        kb.pddl.check_rules(rule)
    assert judge(kb, rule, since=2) == 3
    assert judge(kb, "(sometime (robot_at rb1 kitchen))", since=2) is None


def test_nothing_was_recorded(fresh_kb: KnowledgeBase) -> None:
    assert len(fresh_kb.pddl.check_rules("(and)")) == 0
    assert fresh_kb.pddl.check_rules().is_satisfied
    assert str(fresh_kb.pddl.check_rules()) == "there are no rules"


ATOMS = ("(robot_at rb1 hall)", "(robot_at rb1 kitchen)", "(child_in hall)", "(child_in kitchen)")


def is_kept(rule: Sequence[str], states: States) -> bool:
    """Whether states keep a rule, by the definitions of PDDL 3.0."""
    operator, *words = rule
    numbers = tuple(Number(Decimal(word)) for word in words if not word.startswith("("))
    atoms = [word for word in words if word.startswith("(")]
    held = [
        (time, {name for name, atom in zip("ab", atoms, strict=False) if atom in facts})
        for time, facts in states
    ]
    return satisfied(Modal(operator, numbers, ()), held)


def random_rules(random: Random) -> list[tuple[str, ...]]:
    rules = []
    for operator, (numbers, atoms) in sorted(MODALS.items()):
        for _ in range(4):
            times = random.sample(("0", "1", "2.5", "4", "7", "11"), numbers)
            times.sort(key=Decimal)
            rules.append((operator, *times, *random.sample(ATOMS, atoms)))
    return rules


@pytest.mark.parametrize("seed", range(4))
def test_verdicts_of_a_random_past(fresh_kb: KnowledgeBase, seed: int) -> None:
    random = Random(seed)
    kb = beside(fresh_kb, f"{fresh_kb.store.factory._store.name} {seed}")  # type: ignore[attr-defined]
    facts = {
        str(fact): fact
        for fact in (at(RB1, HALL), at(RB1, KITCHEN), child(HALL), child(KITCHEN), at(RB2, HALL))
    }
    time = Decimal(0)
    with kb.transaction(observed_at=BASE):
        kb.propositions.save_all(facts.values())
    for _ in range(14):
        time += random.choice((Decimal(0), Decimal("0.5"), Decimal(1), Decimal("1.5")))
        changes = [
            (random.choice("+-"), facts[name])
            for name in random.sample([*facts], random.randint(1, 2))
        ]
        step(kb, "x", *changes, after=float(time))
    trajectory = observed(kb)
    rules = random_rules(random)
    verdicts = kb.pddl.check_rules(
        "\n".join(f"({' '.join(rule)})" for rule in rules), clock="observed"
    )
    for rule, verdict in zip(rules, verdicts, strict=True):
        assert verdict.is_satisfied is is_kept(rule, trajectory), (rule, trajectory)
    for low, high in ((3, kb.revision - 1), (5, 5)):
        cut = trajectory[low - 1 : high]
        moved = [(time - cut[0][0], held) for time, held in cut]
        for rule in rules[::3]:
            text = f"({' '.join(rule)})"
            [verdict] = kb.pddl.check_rules(text, clock="observed", since=low, until=high)
            assert verdict.is_satisfied is is_kept(rule, moved), (rule, low, high)


def observed(kb: KnowledgeBase) -> States:
    """The state of each revision, read by itself."""
    states = []
    for revision in kb.store.revisions():
        assert revision.observed_at is not None
        seconds = Decimal(str((revision.observed_at - BASE).total_seconds()))
        past = kb.at(revision.number).propositions.get_all()
        states.append((seconds, {str(fact) for fact in past}))
    return states
