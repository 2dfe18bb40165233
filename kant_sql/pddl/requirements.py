"""Which requirements a domain and a problem really use, whatever they declare.

The rules are those of Kovacs, Complete BNF description of PDDL 3.1 (2011), where each production
names its requirement, with `:time` for processes and events (Fox and Long, Modelling mixed
discrete-continuous domains for planning, 2006). There is one deviation: Kovacs asks for
`:numeric-fluents` wherever there is a metric, while PDDL 2.1 (appendix A) and PDDL 3.0 (section 3)
do not, nor do the files of the competitions; here a metric over `total-time` and preferences alone
does not need it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..arguments import expect
from ..dto.formula import (
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Equal,
    Exists,
    Fluent,
    Forall,
    Imply,
    IsViolated,
    Modal,
    Node,
    Not,
    Or,
    Preference,
    Timed,
    TypedName,
    Variable,
    When,
)
from ..dto.name import ROOT_TYPE, fold
from ..dto.node import children, walk
from ..errors import InvalidArgumentError
from .document import DURATIVE_ACTION, EVENT, PROCESS, Action, Domain, Function, Predicate, Problem
from .numeric import numeric_requirement

REQUIREMENTS = (
    ":strips",
    ":typing",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":equality",
    ":existential-preconditions",
    ":universal-preconditions",
    ":conditional-effects",
    ":numeric-fluents",
    ":object-fluents",
    ":durative-actions",
    ":duration-inequalities",
    ":continuous-effects",
    ":derived-predicates",
    ":timed-initial-literals",
    ":preferences",
    ":constraints",
    ":action-costs",
    ":time",
)


def used_requirements(domain: Domain, *, problem: Problem | None = None) -> tuple[str, ...]:
    """Tell which requirements are really used.

    Numbers that only count costs need `:action-costs` instead of `:numeric-fluents`. Abbreviations
    such as `:adl` are written out, and `:strips` is always among them.

    Args:
        domain: the domain.
        problem: a problem of it, whose uses count as well.

    Returns:
        The requirements, in the order of the standard.
    """
    expect(domain, Domain, "the domain", InvalidArgumentError)
    if problem is not None:
        expect(problem, Problem, "the problem", InvalidArgumentError)
    used = {":strips", numeric_requirement(domain, problem), *_of_domain(domain)}
    if problem is not None:
        used.update(_of_problem(problem))
    if _is_typed(domain, problem):
        used.add(":typing")
    if any(map(_takes_fluent, _all_nodes(domain, problem))):
        used.add(":object-fluents")
    return tuple(requirement for requirement in REQUIREMENTS if requirement in used)


def _of_domain(domain: Domain) -> Iterator[str]:
    if any(function.types for function in domain.functions):
        yield ":object-fluents"
    for rule in domain.derived:
        yield ":derived-predicates"
        yield from _of_condition(walk(rule.formula))
    for action in domain.actions:
        yield from _of_action(action)
    for constraint in domain.constraints:
        yield from _of_constraint(constraint)


def _of_problem(problem: Problem) -> Iterator[str]:
    if any(isinstance(literal, Equal) for literal in problem.literals):
        yield ":equality"
    if any(isinstance(value.value, Constant) for value in problem.values):
        yield ":object-fluents"
    for timed in problem.timed:
        yield ":timed-initial-literals"
        if isinstance(timed.effect, Assign) and isinstance(timed.effect.value, Constant):
            yield ":object-fluents"
    yield from _of_condition(walk(*problem.goal))
    for constraint in problem.constraints:
        yield from _of_constraint(constraint)
    if problem.metric is not None:
        for node in walk(problem.metric):
            if isinstance(node, IsViolated):
                yield ":preferences"


def _of_action(action: Action) -> Iterator[str]:
    if action.kind in (PROCESS, EVENT):
        yield ":time"
    if action.kind == DURATIVE_ACTION:
        yield ":durative-actions"
        yield from _of_duration(action)
    yield from _of_condition(walk(*action.condition))
    yield from _of_effects(action.effect)


def _of_duration(action: Action) -> Iterator[str]:
    constraints = [n for n in walk(*action.duration) if isinstance(n, Comparison)]
    if len(constraints) > 1 or any(constraint.operator != "=" for constraint in constraints):
        yield ":duration-inequalities"
    for node in walk(*action.effect):
        if isinstance(node, ContinuousTime):
            yield ":continuous-effects"
        elif isinstance(node, Variable) and fold(node.name) == "duration":
            yield ":duration-inequalities"


def _of_condition(nodes: Iterable[Node]) -> Iterator[str]:
    for node in nodes:
        match node:
            case Not(Atom() | Equal()):
                yield ":negative-preconditions"
            case Not() | Or() | Imply():
                yield ":disjunctive-preconditions"
            case Equal():
                yield ":equality"
            case Exists():
                yield ":existential-preconditions"
            case Forall():
                yield ":universal-preconditions"
            case Preference():
                yield ":preferences"


def _of_constraint(constraint: Node) -> Iterator[str]:
    yield ":constraints"
    yield from _of_condition(node for node in walk(constraint) if not _is_of_constraints(node))


def _is_of_constraints(node: Node) -> bool:
    """Whether it quantifies over constraints, which is a part of `:constraints`."""
    if not isinstance(node, Forall):
        return False
    within = list(walk(node.formula))
    return any(isinstance(part, Modal | Timed) for part in within) and not any(
        isinstance(part, Preference) for part in within
    )


def _of_effects(effects: Iterable[Node]) -> Iterator[str]:
    stack = list(effects)
    while stack:
        node = stack.pop()
        if isinstance(node, When | Forall):
            yield ":conditional-effects"
        if isinstance(node, When):
            yield from _of_condition(walk(node.condition))
            stack.append(node.effect)
        elif not isinstance(node, Assign):
            stack.extend(children(node))


def _all_nodes(domain: Domain, problem: Problem | None) -> Iterator[Node]:
    roots: list[Node] = [*domain.constraints, *domain.derived]
    for action in domain.actions:
        roots += [*action.duration, *action.condition, *action.effect]
    if problem is not None:
        roots += [*problem.goal, *problem.constraints]
    return walk(*roots)


def _takes_fluent(node: Node) -> bool:
    return isinstance(node, Atom | Equal | Fluent) and any(
        isinstance(term, Fluent) for term in children(node)
    )


def _is_typed(domain: Domain, problem: Problem | None) -> bool:
    names: list[TypedName] = [*domain.constants, *(problem.objects if problem else ())]
    skeletons: list[Predicate | Function | Action] = [
        *domain.predicates,
        *domain.functions,
        *domain.actions,
    ]
    for skeleton in skeletons:
        names += skeleton.parameters
    for node in _all_nodes(domain, problem):
        names += getattr(node, "variables", ())
    return bool(domain.types) or any(name.types != (ROOT_TYPE,) for name in names)
