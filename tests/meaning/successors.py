"""Walks of other tools through the states of a pair, each in a process of its own.

Other tools refuse what does not concern the states: preferences, constraints, the metric. So they
get a pair without these, in our writing. A durative action becomes its start: an action with the
conditions and the effects at its start.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import ACTION, DURATIVE_ACTION, Action, Domain, Predicate, Problem
from kant_sql.pddl.requirements import used_requirements
from tests.meaning.material import HERE
from tests.support.corpus import Pair
from tests.support.evaluator import Ground

PYPERPLAN, MIMIR, UNIFIED_PLANNING = "pyperplan", "pymimir", "unified_planning"


@dataclass(frozen=True)
class Look:
    """A state: what holds of what actions change, what is applicable, and what is done next."""

    facts: frozenset[Ground]
    values: dict[Ground, float]
    applicable: frozenset[Ground]
    taken: Ground | None


@dataclass(frozen=True)
class Plain:
    """A pair as other tools read it, with the documents that it was written from."""

    domain: Domain
    problem: Problem
    folder: Path

    @property
    def files(self) -> list[str]:
        return [str(self.folder / "domain.pddl"), str(self.folder / "problem.pddl")]

    @property
    def arities(self) -> dict[str, int]:
        """The number of parameters of each action."""
        return {fold(action.name): len(action.parameters) for action in self.domain.actions}

    @property
    def changed(self) -> frozenset[tuple[str, int]]:
        """The predicates that actions change, by name and number of arguments."""
        effects = [effect for action in self.domain.actions for effect in action.effect]
        return frozenset(
            (fold(atom.predicate), len(atom.terms))
            for effect in effects
            for atom in literals(effect)
        )


def plain(pair: Pair, folder: Path) -> Plain:
    """Write a pair for other tools."""
    domain = read_domain(pair.domain)
    problem = read_problem(pair.problem, domain=domain)
    domain = replace(
        domain,
        requirements=(),
        constraints=(),
        # Real files repeat the names of a predicate's parameters.
        predicates=tuple(map(_numbered, domain.predicates)),
        actions=tuple(map(_instant, domain.actions)),
    )
    problem = replace(
        problem,
        requirements=(),
        goal=_hard(problem.goal),
        constraints=(),
        metric=None,
        literals=(),
        timed=(),
    )
    used = {*used_requirements(domain, problem=problem), ":adl", ":negative-preconditions"}
    if any(fold(function.name) == "total-cost" for function in domain.functions):
        used.add(":action-costs")
    made = Plain(replace(domain, requirements=tuple(sorted(used))), problem, folder)
    for path, text in zip(made.files, (write(made.domain), write(problem)), strict=True):
        Path(path).write_text(text, encoding="utf-8")
    return made


def _numbered(predicate: Predicate) -> Predicate:
    parameters = enumerate(predicate.parameters)
    return replace(
        predicate, parameters=tuple(f.TypedName(f"a{n}", part.types) for n, part in parameters)
    )


def _hard(formulas: Sequence[f.Formula]) -> tuple[f.Formula, ...]:
    return tuple(
        formula
        for formula in formulas
        if not any(isinstance(node, f.Preference) for node in f.walk(formula))
    )


def _instant(action: Action) -> Action:
    condition = _hard(action.condition)
    if action.kind != DURATIVE_ACTION:
        return replace(action, condition=condition)
    return Action(
        ACTION,
        action.name,
        action.parameters,
        (),
        tuple(part for each in condition for part in _at_start(each)),
        tuple(part for each in action.effect for part in _at_start(each)),
    )


def _at_start(formula: f.Formula) -> list[f.Formula]:
    """What a condition or an effect says of the start."""
    match formula:
        case f.Timed():
            return [formula.formula] if formula.time == f.AT_START else []
        case f.And():
            return [part for each in formula.formulas for part in _at_start(each)]
        case f.Forall():
            inner = _at_start(formula.formula)
            return [f.Forall(formula.variables, f.And(tuple(inner)))] if inner else []
        case f.When():
            effect = f.And(tuple(_at_start(formula.effect)))
            condition = f.And(tuple(_at_start(formula.condition)))
            return [f.When(condition, effect)] if effect.formulas else []
        case f.Assign():
            # A continuous effect.
            return []
    raise TypeError(f"no time: {formula}")


def literals(effect: f.Node) -> Iterator[f.Atom]:
    """The atoms that an effect adds or deletes."""
    if isinstance(effect, f.Atom):
        yield effect
    elif isinstance(effect, f.When):
        yield from literals(effect.effect)
    elif not isinstance(effect, f.Assign):
        for part in f.children(effect):
            yield from literals(part)


def looks(judge: str, pair: Plain, steps: int, seconds: float) -> tuple[list[Look], str]:
    """The states of a random walk of another tool, as far as it comes; and why it ended."""
    lines, ended = _walk(judge, pair, steps, seconds)
    if not lines:
        # On a busy machine the tool may not even have been imported by then.
        lines, ended = _walk(judge, pair, steps, 10 * seconds)
    return [_look(json.loads(line), pair) for line in lines], ended


def _walk(judge: str, pair: Plain, steps: int, seconds: float) -> tuple[list[str], str]:
    program = [sys.executable, str(HERE / "child_successors.py"), judge, *pair.files]
    printed = pair.folder / f"{judge}.jsonl"
    with printed.open("w") as output:
        try:
            done = subprocess.run(
                [*program, str(steps), "1"],
                stdout=output,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                timeout=seconds,
                check=False,
            )
            ended = done.stderr[-500:] if done.returncode else ""
        except subprocess.TimeoutExpired:
            ended = f"no end within {seconds} s"
    lines = printed.read_text().splitlines(True)
    return [line for line in lines if line.endswith("\n")], ended


def _look(line: dict[str, Any], pair: Plain) -> Look:
    def step(words: Sequence[str]) -> Ground:
        # Mimir takes the variables of an `exists` for further parameters.
        return _folded(words[: 1 + pair.arities[fold(words[0])]])

    facts = map(_folded, line["facts"])
    return Look(
        frozenset(fact for fact in facts if (fact[0], len(fact) - 1) in pair.changed),
        {_folded(fluent): float(value) for fluent, value in line["values"]},
        frozenset(map(step, line["applicable"])),
        step(line["taken"]) if line["taken"] else None,
    )


def _folded(words: Sequence[str]) -> Ground:
    return tuple(map(fold, words))


def is_near(left: float | Decimal, right: float) -> bool:
    """Whether two numbers are equal but for rounding."""
    return abs(float(left) - right) <= 1e-6 * max(1.0, abs(right))
