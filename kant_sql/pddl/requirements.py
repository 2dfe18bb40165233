"""Requirements that a domain and a problem use, whatever they declare.

The rules follow Kovacs, Complete BNF description of PDDL 3.1 (2011), where each production names
its requirement, with `:time` for processes and events (Fox and Long, Modelling mixed
discrete-continuous domains for planning, 2006). One rule deviates: Kovacs requires
`:numeric-fluents` for every metric, while PDDL 2.1 (appendix A), PDDL 3.0 (section 3) and the files
of the competitions do not; here a metric over `total-time` and preferences alone does not.

The rules for `:action-costs` are those of the competition that introduced it: Modeling Action Costs
in IPC-2008, https://ipc08.icaps-conference.org/deterministic/PddlActionCosts.html, repeated by
Kovacs (section 1.3). The docstrings number them as there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..arguments import expect
from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidArgumentError
from . import document as pddl

NUMERIC_FLUENTS, ACTION_COSTS = ":numeric-fluents", ":action-costs"


def numeric_requirement(domain: pddl.Domain, problem: pddl.Problem | None = None) -> str | None:
    """Return the requirement of the numbers, if there are any."""
    effects = _numeric_effects(domain)
    values = [] if problem is None else [v for v in problem.values if isinstance(v.value, f.Number)]
    metric = None if problem is None else problem.metric
    if _needs_numbers(domain, problem):
        return NUMERIC_FLUENTS
    if not (effects or values or _measures(metric)) and all(one.types for one in domain.functions):
        return None
    costs = any(
        fold(function.name) == f.TOTAL_COST and not function.parameters and not function.types
        for function in domain.functions
    )
    if costs and _only_costs(effects) and _starts_well(values):
        durative = any(action.kind == pddl.DURATIVE_ACTION for action in domain.actions)
        if metric is None or _minimizes_costs(metric, durative):
            return ACTION_COSTS
    return NUMERIC_FLUENTS


def _numeric_effects(domain: pddl.Domain) -> list[f.Assign]:
    objects = {fold(function.name) for function in domain.functions if function.types}
    return [
        node
        for action in domain.actions
        for node in f.walk(*action.effect)
        if isinstance(node, f.Assign) and fold(node.fluent.function) not in objects
    ]


def _needs_numbers(domain: pddl.Domain, problem: pddl.Problem | None) -> bool:
    """Return whether numbers affect what is possible, or change over time (rule 1)."""
    timed = () if problem is None else problem.timed
    effects = [each.effect for each in timed if isinstance(each.effect, f.Assign)]
    durations = f.walk(*(formula for action in domain.actions for formula in action.duration))
    others = f.walk(*pddl.formulas(domain, problem, durations=False))
    return (
        any(not isinstance(effect.value, f.Constant) for effect in effects)
        or any(isinstance(node, f.Comparison) for node in others)
        or any(
            isinstance(node, f.Fluent | f.Arithmetic)
            or (isinstance(node, f.Variable) and fold(node.name) != f.DURATION)
            for node in durations
        )
    )


def _measures(metric: f.Metric | None) -> bool:
    return metric is not None and not functions_in(metric) <= {f.TOTAL_TIME}


def functions_in(*nodes: f.Node) -> set[str]:
    """Return the folded names of the functions that nodes mention."""
    return {fold(node.function) for node in f.walk(*nodes) if isinstance(node, f.Fluent)}


def is_function(node: f.Node, *names: str) -> bool:
    """Return whether a node is one of the named functions, without terms."""
    return isinstance(node, f.Fluent) and not node.terms and fold(node.function) in names


def _only_costs(effects: list[f.Assign]) -> bool:
    """Return whether all effects add costs that are never negative (rules 2 and 3)."""
    return all(
        effect.operator == "increase"
        and is_function(effect.fluent, f.TOTAL_COST)
        and _is_cost(effect.value)
        for effect in effects
    )


def _is_cost(value: f.Expression | f.Term) -> bool:
    if isinstance(value, f.Number):
        return value.value >= 0
    return (
        isinstance(value, f.Fluent)
        and fold(value.function) != f.TOTAL_COST
        and not any(isinstance(term, f.Fluent) for term in value.terms)
    )


def _starts_well(values: list[pddl.FunctionValue]) -> bool:
    """Return whether costs start at 0 and none is negative (rules 2 and 4)."""
    # No requirement allows adding to an undefined value: planners treat a missing one as 0.
    numbers = [(v.fluent, v.value.value) for v in values if isinstance(v.value, f.Number)]
    return all(
        number == 0 if is_function(fluent, f.TOTAL_COST) else number >= 0
        for fluent, number in numbers
    )


def _minimizes_costs(metric: f.Metric, durative: bool) -> bool:
    """Return whether the metric is costs, or with durations a sum of costs and time (rule 5)."""
    if metric.optimization != "minimize":
        return False
    if is_function(metric.expression, f.TOTAL_COST):
        return True
    return durative and all(map(_is_of_linear_sum, f.walk(metric.expression)))


def _is_of_linear_sum(node: f.Node) -> bool:
    match node:
        case f.Number():
            return node.value >= 0
        case f.Fluent():
            return is_function(node, f.TOTAL_COST, f.TOTAL_TIME)
        case f.Arithmetic("+"):
            return not any(isinstance(child, f.Number) for child in f.children(node))
        case f.Arithmetic("*"):
            return sum(not isinstance(child, f.Number) for child in f.children(node)) == 1
    return False


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
# With these abbreviations, and requirements of PDDL 1.2 and of extensions, to find misspelt ones.
KNOWN = (
    *REQUIREMENTS,
    *(":adl", ":fluents", ":quantified-preconditions", ":goal-utilities", ":negation", ":mdp"),
    *(":expression-evaluation", ":domain-axioms", ":subgoals-through-axioms", ":open-world"),
    *(":safety-constraints", ":true-negation", ":ucpop", ":action-expansions", ":axioms"),
    *(":foreach-expansions", ":dag-expansions", ":timed-initial-fluents", ":non-deterministic"),
    *(":probabilistic-effects", ":rewards", ":partial-observability", ":hierarchy", ":htn"),
    *(":method-preconditions", ":method-constraints", ":multi-agent", ":factored-privacy"),
    *(":unfactored-privacy", ":processes", ":events", ":supply-demand"),
)


def used_requirements(
    domain: pddl.Domain, *, problem: pddl.Problem | None = None
) -> tuple[str, ...]:
    """Return the requirements that documents use.

    Numbers that only count costs require `:action-costs` instead of `:numeric-fluents`.
    Abbreviations such as `:adl` are expanded, and `:strips` is always included.

    Args:
        domain: the domain.
        problem: a problem of the domain, which is included.

    Returns:
        The requirements, in the order of the standard.
    """
    expect(domain, pddl.Domain, "the domain", InvalidArgumentError)
    if problem is not None:
        expect(problem, pddl.Problem, "the problem", InvalidArgumentError)
    used = {":strips", numeric_requirement(domain, problem), *_of_domain(domain)}
    if problem is not None:
        used.update(_of_problem(problem))
    names = pddl.typed_names(domain, problem)
    if domain.types or any(name.types != (ROOT_TYPE,) for name in names):
        used.add(":typing")
    applied = f.Atom | f.Equal | f.Fluent
    nodes = (n for n in f.walk(*pddl.formulas(domain, problem)) if isinstance(n, applied))
    if any(isinstance(term, f.Fluent) for node in nodes for term in f.children(node)):
        used.add(":object-fluents")
    return tuple(requirement for requirement in REQUIREMENTS if requirement in used)


def _of_domain(domain: pddl.Domain) -> Iterator[str]:
    if any(function.types for function in domain.functions):
        yield ":object-fluents"
    for rule in domain.derived:
        yield ":derived-predicates"
        yield from _of_condition(f.walk(rule.formula))
    for action in domain.actions:
        yield from _of_action(action)
    for constraint in domain.constraints:
        yield from _of_constraint(constraint)


def _of_problem(problem: pddl.Problem) -> Iterator[str]:
    if any(isinstance(literal, f.Equal) for literal in problem.literals):
        yield ":equality"
    if any(isinstance(value.value, f.Constant) for value in problem.values):
        yield ":object-fluents"
    for timed in problem.timed:
        yield ":timed-initial-literals"
        if isinstance(timed.effect, f.Assign) and isinstance(timed.effect.value, f.Constant):
            yield ":object-fluents"
    yield from _of_condition(f.walk(*problem.goal))
    for constraint in problem.constraints:
        yield from _of_constraint(constraint)
    if problem.metric and f.mentions(f.IsViolated, problem.metric):
        yield ":preferences"


def _of_action(action: pddl.Action) -> Iterator[str]:
    if action.kind in (pddl.PROCESS, pddl.EVENT):
        yield ":time"
    if action.kind == pddl.DURATIVE_ACTION:
        yield ":durative-actions"
        yield from _of_duration(action)
    yield from _of_condition(f.walk(*action.condition))
    yield from _of_effects(action.effect)


def _of_duration(action: pddl.Action) -> Iterator[str]:
    constraints = [n for n in f.walk(*action.duration) if isinstance(n, f.Comparison)]
    if len(constraints) > 1 or any(constraint.operator != "=" for constraint in constraints):
        yield ":duration-inequalities"
    for node in f.walk(*action.effect):
        if isinstance(node, f.ContinuousTime):
            yield ":continuous-effects"
        elif isinstance(node, f.Variable) and fold(node.name) == f.DURATION:
            yield ":duration-inequalities"


def _of_condition(nodes: Iterable[f.Node]) -> Iterator[str]:
    for node in nodes:
        match node:
            case f.Not(f.Atom() | f.Equal()):
                yield ":negative-preconditions"
            case f.Not() | f.Or() | f.Imply():
                yield ":disjunctive-preconditions"
            case f.Equal():
                yield ":equality"
            case f.Exists():
                yield ":existential-preconditions"
            case f.Forall():
                yield ":universal-preconditions"
            case f.Preference():
                yield ":preferences"


def _of_constraint(constraint: f.Node) -> Iterator[str]:
    yield ":constraints"
    yield from _of_condition(node for node in f.walk(constraint) if not _is_of_constraints(node))


def _is_of_constraints(node: f.Node) -> bool:
    """Return whether a node quantifies over constraints, which is part of `:constraints`."""
    if not isinstance(node, f.Forall):
        return False
    within = list(f.walk(node.formula))
    return any(isinstance(part, f.Modal | f.Timed) for part in within) and not any(
        isinstance(part, f.Preference) for part in within
    )


def _of_effects(effects: Iterable[f.Node]) -> Iterator[str]:
    stack = list(effects)
    while stack:
        node = stack.pop()
        if isinstance(node, f.When | f.Forall):
            yield ":conditional-effects"
        if isinstance(node, f.When):
            yield from _of_condition(f.walk(node.condition))
            stack.append(node.effect)
        elif not isinstance(node, f.Assign):
            stack.extend(f.children(node))
