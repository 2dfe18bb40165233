"""Rules about the past have VAL's verdicts, when a plan's happenings are recorded as observed.

Each case is a random plan: VAL executes it under random constraints, and its happenings are written
as revisions whose knowledge was observed at the times of the plan. Preferences stand for their
constraints, so that one plan is judged by many; some cases have a hard constraint, too.
"""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path
from random import Random
from typing import NamedTuple

import kant_sql
from kant_sql import KnowledgeBase, Verdicts
from tests.meaning import val
from tests.meaning.material import ALL, Pair
from tests.meaning.walks import modal, preferences

CASES = 1_000 if ALL else 120
BASE = datetime(2026, 1, 1, tzinfo=UTC)
DOMAIN = """(define (domain switches)
  (:requirements :adl :constraints :preferences :fluents)
  (:predicates (a) (b) (lit ?x))
  (:functions (level))
  (:action put-a :parameters () :precondition (and) :effect (a))
  (:action put-b :parameters () :precondition (and) :effect (b))
  (:action clear-a :parameters () :precondition (and) :effect (not (a)))
  (:action clear-b :parameters () :precondition (and) :effect (not (b)))
  (:action swap :parameters () :precondition (and)
    :effect (and (when (a) (and (not (a)) (b))) (when (b) (and (not (b)) (a)))))
  (:action turn :parameters (?x) :precondition (and) :effect (lit ?x))
  (:action dim :parameters (?x) :precondition (and) :effect (not (lit ?x)))
  (:action fill :parameters () :precondition (and) :effect (and (increase (level) 1))))"""
ACTIONS = (
    *("put-a", "put-b", "clear-a", "clear-b", "swap", "fill"),
    *("turn x", "turn y", "turn z", "dim x", "dim y"),
)
INNER = (
    *("(a)", "(b)", "(not (a))", "(or (a) (b))", "(exists (?y) (lit ?y))", "(>= (level) 2)"),
    "(forall (?y) (imply (lit ?y) (b)))",
)


class Case(NamedTuple):
    """Constraints, the facts that hold first, and the steps of a plan with their times."""

    rules: tuple[str, ...]
    hard: str | None
    initial: frozenset[str]
    steps: tuple[tuple[float, str], ...]

    def problem(self) -> str:
        rules = " ".join([*self.rules, *([self.hard] if self.hard else [])])
        init = " ".join(sorted(self.initial))
        return f"""(define (problem p) (:domain switches) (:objects x y z)
          (:init {init} (= (level) 0)) (:goal (and)) (:constraints (and {rules}))
          (:metric minimize (total-time)))"""

    def plan(self) -> str:
        return "".join(f"{time}: ({step})\n" for time, step in self.steps)


def make_case(random: Random) -> Case:
    rules = preferences(random, 12, INNER)
    hard = modal(random, INNER) if random.random() < 0.4 else None
    initial = frozenset(fact for fact in ("(a)", "(b)", "(lit x)") if random.random() < 0.3)
    times = sorted(random.sample(range(1, 21), random.randint(1, 8)))
    steps = tuple((time / 2, random.choice(ACTIONS)) for time in times)
    return Case(tuple(rules), hard, initial, steps)


def effects(step: str, facts: frozenset[str]) -> frozenset[str]:
    """The facts after a step."""
    name, _, argument = step.partition(" ")
    if name == "swap":
        other = {"(a)": "(b)", "(b)": "(a)"}
        swapped = {other[fact] for fact in facts & other.keys()}
        return frozenset(facts - other.keys() | swapped)
    fact = f"(lit {argument})" if argument else f"({name[-1]})"
    if name.startswith(("put", "turn")):
        return facts | {fact}
    return facts if name == "fill" else facts - {fact}


def record(kb: KnowledgeBase, case: Case) -> None:
    """Write the happenings of a plan; the first revision is the initial state."""
    with kb.transaction(observed_at=BASE):
        kb.load_domain(DOMAIN)
        kb.load_problem(case.problem())
    facts = case.initial
    for number, (time, step) in enumerate(case.steps):
        after = effects(step, facts)
        seen = BASE + timedelta(seconds=time)
        with kb.transaction(actor=f"step {number}", reason=step, observed_at=seen):
            for fact in facts - after:
                kb.propositions.delete(fact)
            kb.propositions.save_all(sorted(after - facts))
            if step == "fill":
                kb.function_values.increase("level", objects=[], by=1)
        facts = after


def counted(verdict: val.Verdict) -> Counter[str]:
    """How often VAL says that each preference is violated."""
    counts: Counter[str] = Counter()
    for line in verdict.violations:
        name, _, number = line.partition(":")
        counts[name] += int(number)
    return counts


def test_verdicts_are_those_of_val(tmp_path: Path) -> None:
    random = Random(11)
    wrong: list[str] = []
    seen: Counter[str] = Counter()
    domain = tmp_path / "domain.pddl"
    domain.write_text(DOMAIN)
    for number in range(CASES):
        case = make_case(random)
        pair = Pair(f"case {number}", domain, tmp_path / f"problem{number}.pddl")
        plan = tmp_path / f"{number}.plan"
        pair.problem.write_text(case.problem())
        plan.write_text(case.plan())
        judged = val.validate(pair, plan)
        assert not judged.refused, judged.output
        with kant_sql.connect("sqlite://") as kb:
            record(kb, case)
            verdicts = kb.pddl.check_rules(clock="observed")
        seen.update(compare(case, verdicts, judged, wrong))
    print(f"{CASES} cases", dict(sorted(seen.items())))
    assert not wrong, "\n\n".join(wrong)
    assert min(seen[kind] for kind in ("kept", "violated", "hard kept", "hard violated")) >= 10


def compare(case: Case, verdicts: Verdicts, judged: val.Verdict, wrong: list[str]) -> Counter[str]:
    """Compare the verdicts of one plan; count what they are."""
    about = f"{case.problem()}\n{case.plan()}{verdicts}\n{judged.output}"
    if verdicts.is_satisfied is not judged.valid:
        wrong.append(f"is_satisfied is {verdicts.is_satisfied}: {about}")
    elif judged.valid and Counter(verdicts.violated_preferences) != counted(judged):
        wrong.append(f"{verdicts.violated_preferences} for {counted(judged)}: {about}")
    hard = [one for one in verdicts if not one.is_preference]
    kinds = Counter("hard kept" if one.is_satisfied else "hard violated" for one in hard)
    kinds.update(
        "kept" if one.is_satisfied else "violated" for one in verdicts if one.is_preference
    )
    for one in verdicts.violated:
        assert one.revision is not None, about
        assert one.time is not None, about
        # Each revision is a happening, but those that change nothing.
        assert one.time in {0, *(time for time, _ in case.steps)}, about
    return kinds
