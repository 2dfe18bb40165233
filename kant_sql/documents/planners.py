"""What planners take and give: problems of unified-planning, and plans from a state to goals."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..pddl.writer import write
from ..planning import Plan, from_unified_planning, problem_hash, solve
from ..planning import to_unified_planning as convert
from ..store.state import State
from .exchange import Loaded, Mode, load_documents, read_task

if TYPE_CHECKING:
    from unified_planning.model import Problem as UpProblem


def to_unified_planning(state: State) -> UpProblem:
    """Convert the present state to a problem of unified-planning.

    Returns:
        The problem.

    Raises:
        UnsupportedConstructError: unified-planning cannot express something of it.
        PlannerMissingError: unified-planning is not installed.

    Examples:
        >>> kb.pddl.to_unified_planning().name
        'tiago'
    """
    task = read_task(state)
    return convert(task.domain, problem=task.problem)


def load_unified_planning(state: State, problem: UpProblem, *, mode: Mode = "replace") -> Loaded:
    """Load a problem of unified-planning with its domain, in at most one revision.

    Mode `replace` retracts what the problem does not declare, `merge` keeps it.

    Returns:
        The revision; there are no warnings.

    Raises:
        UnsupportedConstructError: PDDL cannot express something of it.
        ConflictError: with mode `merge`, the problem contradicts what is stored.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.pddl.load_unified_planning(kb.pddl.to_unified_planning()).revision
        2
    """
    own_domain, own = from_unified_planning(problem)
    return load_documents(state.store, own_domain, own, mode)


def plan(
    state: State, engine: str | None = None, *, timeout: float | None = None, strict: bool = False
) -> Plan:
    """Find a plan from the present state to the goals.

    A plugin gives preferences and metrics to planners as costs of actions. What of them a planner
    cannot be given is named in the plan's
    `ignored` and logged as a warning; all other parts of the problem are always given.

    Args:
        engine: an engine's name in unified-planning, for example `fast-downward`; None to
            choose an installed one that supports the problem.
        timeout: seconds to wait; None to wait without limit. Plans of problems with soft
            goals are improved for 10 seconds, or half of the timeout if that is less.
        strict: refuse to ignore a part of the metric or a preference.

    Returns:
        The plan, with the revision of the state. If soft goals were compiled away or ignored,
        it has the planner's input as `domain_pddl` and `problem_pddl`.

    Raises:
        NoPlanError: there is no plan, or none was found in time.
        UnsupportedConstructError: planners cannot express something of the problem, or with
            `strict` something of its metric or preferences.
        PlannerMissingError: unified-planning or the engine is not installed.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open))
        ...   (:action unlock :parameters () :effect (open)))''').revision
        2
        >>> kb.load_problem('''(define (problem enter) (:domain doors)
        ...   (:init) (:goal (open)))''').revision
        3
        >>> print(kb.plan("pyperplan"), end="")
        (unlock)
    """
    task = read_task(state)
    found = solve(task.domain, problem=task.problem, engine=engine, timeout=timeout, strict=strict)
    domain = write(task.domain) if found.domain_pddl is None else found.domain_pddl
    problem = write(task.problem) if found.problem_pddl is None else found.problem_pddl
    digest = problem_hash(domain, problem=problem)
    return replace(found, revision=task.revision, problem_hash=digest)
