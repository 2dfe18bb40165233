"""`validate` and VAL say the same of plans, of plans with one thing changed, and of random steps.

Plans are those that planners found (`plans/`). By default, a sample is judged; the profile `long`
judges all of them and many more changes of each (`KANT_SQL_TEST_PROFILE=long`), and prints the
counts.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import pytest

from kant_sql import Plan
from kant_sql.dto import formulas as f
from kant_sql.pddl import Domain, Problem, read_domain, read_problem
from kant_sql.pddl.writer import write
from tests.meaning import val
from tests.meaning.judging import Judged, judge
from tests.meaning.material import ALL, Pair, Workshop, corpus_pairs, own_pairs
from tests.meaning.plan_mutations import KINDS, mutations
from tests.meaning.walks import preferences, walk
from tests.support.corpus import WITHOUT_CORPUS

# Processes happen by themselves.
OWN = [pair for pair in own_pairs() if pair.name != "process" and pair.plan.exists()]
# Changes of each kind.
EACH = 6 if ALL else 1
WALKS = 4 if ALL else 1
LENGTH = 12
# Of the competitions' pairs, every n-th is judged by default.
STEP = 1 if ALL else 20


class Case(NamedTuple):
    """A plan, and where it comes from."""

    origin: str
    plan: Plan


class Task(NamedTuple):
    """A pair, as files for VAL and as documents."""

    pair: Pair
    domain: Domain
    problem: Problem

    @property
    def objects(self) -> list[str]:
        return [one.name for one in (*self.domain.constants, *self.problem.objects)]


def read(pair: Pair) -> Task:
    domain = read_domain(pair.domain)
    return Task(pair, domain, read_problem(pair.problem, domain=domain))


def without_goal(task: Task, folder: Path) -> Task:
    """Leave only preferences of the goal, so that any plan has a value."""
    goal = tuple(
        part for part in task.problem.goal if any(isinstance(n, f.Preference) for n in f.walk(part))
    )
    problem = replace(task.problem, goal=goal)
    file = folder / f"{task.pair.name}.pddl"
    file.write_text(write(problem))
    return Task(replace(task.pair, problem=file), task.domain, problem)


def changed(task: Task, each: int) -> Iterator[Case]:
    """Yield the plan of a pair, and changes of it."""
    plan = Plan.read(task.pair.plan)
    yield Case("plan", plan)
    for kind, other in mutations(plan, task.objects, task.pair.name, each):
        yield Case(kind, other)


def walks(task: Task, count: int) -> Iterator[Case]:
    """Yield random steps, and changes of them."""
    for number in range(count):
        plan = walk(task.domain, task.problem, f"{task.pair.name} {number}", LENGTH)
        if plan.steps:
            yield Case("walk", plan)
            for _, other in mutations(plan, task.objects, number, 1):
                yield Case("changed walk", other)


def check(given: Iterable[tuple[Task, Iterable[Case]]], folder: Path) -> Counter[str]:
    """Check that plans are judged alike; count them by origin and outcome."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    for task, cases in given:

        def one(numbered: tuple[int, Case], task: Task = task) -> tuple[str, Judged]:
            number, case = numbered
            file = folder / f"{task.pair.name}.{number}.plan"
            return case.origin, judge(task.pair, task.domain, task.problem, case.plan, file)

        with ThreadPoolExecutor(2) as pool:
            for origin, judged in pool.map(one, enumerate(cases)):
                counts[f"{origin}: {judged.outcome}"] += 1
                counts["with VAL's tolerance"] += judged.is_tolerant
                if judged.difference:
                    wrong.append(f"{task.pair.name} {origin}: {judged.difference}")
    print(sum(counts.values()), dict(sorted(counts.items())))
    assert not wrong, "\n\n".join(wrong)
    return counts


def tasks(workshop: Workshop) -> list[Task]:
    """The pairs that are judged: as they are, or in our text if VAL reads only that."""
    found = []
    for pair in corpus_pairs()[::STEP]:
        readable = filter(val.accepts, (pair, workshop.ours(pair)))
        found += [read(one) for one in islice(readable, 1)]
    if not found:
        pytest.skip(WITHOUT_CORPUS)
    return found


@pytest.mark.parametrize("pair", OWN, ids=lambda pair: pair.name)
def test_own_plans_are_judged_as_val_judges_them(pair: Pair, tmp_path: Path) -> None:
    task = read(pair)
    free = without_goal(task, tmp_path)
    cases = [*walks(free, WALKS), *changed(free, EACH)]
    counts = check([(task, changed(task, 2 * EACH)), (free, cases)], tmp_path)
    assert counts["plan: valid"] == 2


def test_plans_of_the_competitions_are_judged_as_val_judges_them(
    workshop: Workshop, tmp_path: Path
) -> None:
    planned = (task for task in tasks(workshop) if task.pair.plan.exists())
    counts = check(((task, changed(task, EACH)) for task in planned), tmp_path)
    for origin in KINDS:
        assert any(name.startswith(f"{origin}: ") for name in counts), origin
    assert counts["plan: valid"] >= (80 if ALL else 3)


def test_random_steps_are_judged_as_val_judges_them(workshop: Workshop, tmp_path: Path) -> None:
    found = tasks(workshop)
    judged = [*(found if ALL else ()), *(without_goal(task, tmp_path) for task in found)]
    counts = check(((task, walks(task, WALKS)) for task in judged), tmp_path)
    assert counts["walk: valid"] >= 3


def test_changed_plans_are_the_same_each_time() -> None:
    task = read(OWN[0])
    first, second = ([*changed(task, 2)] for _ in range(2))
    assert first == second
    assert len({case.plan.steps for case in first}) == len(first) > len(KINDS)


SWITCHES = """(define (domain switches)
  (:requirements :adl :constraints :preferences :durative-actions)
  (:predicates (a) (b) (lit ?x) (ready))
  (:action put-a :parameters () :precondition (and) :effect (a))
  (:action put-b :parameters () :precondition (and) :effect (b))
  (:action clear-a :parameters () :precondition (and) :effect (not (a)))
  (:action clear-b :parameters () :precondition (and) :effect (not (b)))
  (:action turn :parameters (?x) :precondition (and) :effect (lit ?x))
  (:durative-action wait :parameters () :duration (= ?duration 3) :condition (over all (ready))
    :effect (at end (ready))))"""
SETS = ("put-a", "put-b", "clear-a", "clear-b", "turn x", "turn y", "turn z")
INNER = ("(a)", "(b)", "(not (a))", "(or (a) (b))", "(exists (?y) (lit ?y))")


def test_constraints_are_judged_as_val_judges_them(tmp_path: Path) -> None:
    """Each preference stands for its constraint, so that one plan is judged by many."""
    chance = random.Random(3)
    given = []
    for number in range(40 if ALL else 4):
        text = f"""(define (problem p) (:domain switches) (:objects x y z)
          (:init {chance.choice(("", "(a)", "(b)"))} (ready)) (:goal (and))
          (:constraints (and {" ".join(preferences(chance, 24, INNER))}))
          (:metric minimize (total-time)))"""
        folder = tmp_path / str(number)
        folder.mkdir()
        task = read(Pair.written(f"switches-{number}", folder, SWITCHES, text))
        cases = []
        for _ in range(6):
            times = sorted(chance.sample(range(1, 11), chance.randint(1, 6)))
            lines = [f"{time}: ({chance.choice(SETS)})" for time in times]
            lines += [f"{time - 0.5}: (wait) [3]" for time in times[:1]]
            cases.append(Case("switched", Plan.read("\n".join([*lines, ""]))))
        given.append((task, cases))
    counts = check(given, tmp_path)
    assert counts["switched: valid"] == sum(counts.values())


LATE = """(define (domain late) (:requirements :adl :durative-actions)
  (:predicates (p) (q) (lit ?x))
  (:durative-action first :parameters () :duration (= ?duration 2) :condition (and)
    :effect (when (at start (p)) (at end (q))))
  (:durative-action both :parameters (?x) :duration (= ?duration 3) :condition (and)
    :effect (when (at start (lit ?x)) (at end (not (p)))))
  (:action set :parameters () :precondition (and) :effect (p))
  (:action clear :parameters () :precondition (and) :effect (not (p)))
  (:action turn :parameters (?x) :precondition (and) :effect (lit ?x)))"""
LATER = """(define (problem p) (:domain late) (:objects x y) (:init (p)) (:goal (and)))"""
DONE = ("first", "first", "both x", "set", "clear", "turn x", "turn y")


def test_interference_with_a_condition_at_the_start_is_judged_as_val_judges_it(
    tmp_path: Path,
) -> None:
    chance = random.Random(7)
    cases = []
    for _ in range(500 if ALL else 30):
        chosen = [(chance.randint(1, 6), chance.choice(DONE)) for _ in range(3)]
        lasts = {"first": " [2]", "both x": " [3]"}
        lines = [f"{time}: ({step}){lasts.get(step, '')}" for time, step in chosen]
        cases.append(Case("late", Plan.read("\n".join([*lines, ""]))))
    task = read(Pair.written("late", tmp_path, LATE, LATER))
    counts = check([(task, cases)], tmp_path)
    assert min(counts["late: valid"], counts["late: step"]) > len(cases) / 20


TANK = """(define (domain tank)
  (:requirements :adl :durative-actions :fluents :duration-inequalities)
  (:predicates (running) (ready)) (:functions (level) (flow) (limit))
  (:durative-action fill :parameters () :duration (>= ?duration 0)
    :condition (over all (<= (level) (limit)))
    :effect (and (increase (level) (* #t (flow))) (at end (ready))))
  (:durative-action drain :parameters () :duration (>= ?duration 0)
    :condition (and (at start (>= (level) 1)) (over all (>= (level) 0.5)))
    :effect (and (decrease (level) (* #t 2)) (at end (ready))))
  (:durative-action watch :parameters () :duration (>= ?duration 0)
    :condition (over all (or (< (level) 3) (> (level) 4)))
    :effect (at end (running)))
  (:action faster :parameters () :precondition (and) :effect (and (increase (flow) 1)))
  (:action peek :parameters () :precondition (>= (level) 2.5) :effect (running)))"""
WATER = """(define (problem p) (:domain tank)
  (:init (= (level) 1) (= (flow) 1) (= (limit) 6)) (:goal (and)) (:metric minimize (level)))"""


def test_continuous_change_is_judged_as_val_judges_it(tmp_path: Path) -> None:
    chance = random.Random(5)
    cases = []
    for _ in range(500 if ALL else 30):
        lines = []
        for _ in range(chance.randint(1, 4)):
            action = chance.choice(("fill", "fill", "drain", "watch", "faster", "peek"))
            start, duration = chance.randint(10, 400) / 100, chance.randint(50, 500) / 100
            lasts = f" [{duration}]" if action in ("fill", "drain", "watch") else ""
            lines.append(f"{start}: ({action}){lasts}")
        cases.append(Case("filled", Plan.read("\n".join([*lines, ""]))))
    task = read(Pair.written("tank", tmp_path, TANK, WATER))
    counts = check([(task, cases)], tmp_path)
    assert min(counts["filled: valid"], counts["filled: step"]) > len(cases) / 10
