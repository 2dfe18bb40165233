"""Hypothesis strategies for documents: any well-formed domain, and any problem of one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from kant_sql.dto.formula import (
    Arithmetic,
    Assign,
    Constant,
    Derived,
    Equal,
    Expression,
    Fluent,
    Formula,
    IsViolated,
    Metric,
    Node,
    Not,
    Number,
    Preference,
    TimedLiteral,
    TypedName,
)
from kant_sql.dto.name import ROOT_TYPE, fold
from kant_sql.dto.node import walk
from kant_sql.pddl.document import (
    ACTION,
    DURATIVE_ACTION,
    EVENT,
    PROCESS,
    Action,
    Domain,
    Function,
    FunctionValue,
    Predicate,
    Problem,
)
from kant_sql.pddl.requirements import REQUIREMENTS, used_requirements
from tests.document_formulas import Formulas
from tests.document_world import World, distinct, world_of

EXTRA = (*REQUIREMENTS, ":adl", ":fluents", ":quantified-preconditions")


@st.composite
def domains(draw: DrawFn, repeats: bool = False) -> Domain:
    """Any well-formed domain, with the requirements that it uses and maybe more.

    With repeats, a predicate's or a function's parameters may share a name, as in real files.
    """
    names = draw(distinct(20))
    world = _world(draw, names, repeats)
    words = Formulas(draw, world)
    derived = _derived(words)
    actions = tuple(_action(words, name) for name in names[17:] if words.flip())
    constraints = words.conjuncts(words.constraint, 2)
    bare = Domain(
        names[16],
        types=tuple(TypedName(name, (above,)) for name, above in world.parents.items()),
        constants=world.things,
        predicates=world.predicates,
        functions=world.functions,
        constraints=constraints,
        derived=derived,
        actions=actions,
    )
    return replace(bare, requirements=_requirements(draw, used_requirements(bare)))


@st.composite
def problems(draw: DrawFn, domain: Domain) -> Problem:
    """Any well-formed problem of a domain."""
    taken = [domain.name, *(part.name for part in (*domain.types, *domain.constants))]
    for elements in (domain.predicates, domain.functions, domain.actions):
        taken += [element.name for element in elements]
    names = draw(distinct(6, taken))
    choice = world_of(domain).type_choice
    objects = tuple(TypedName(name, draw(choice)) for name in names[1 : draw(st.integers(1, 6))])
    words = Formulas(draw, world_of(domain, objects))
    goal = words.conjuncts(lambda: words.condition(()))
    constraints = words.conjuncts(lambda: words.constraint(soft=True), 2)
    problem = _initial(words, Problem(names[0], domain.name, objects=objects))
    problem = replace(problem, goal=goal, constraints=constraints)
    if words.flip():
        problem = replace(problem, metric=_metric(words, domain, problem))
    missing = set(used_requirements(domain, problem=problem)) - set(domain.requirements)
    return replace(problem, requirements=_requirements(draw, missing))


@st.composite
def domains_and_problems(draw: DrawFn, repeats: bool = False) -> tuple[Domain, Problem]:
    """Any well-formed domain, with a problem of it."""
    domain = draw(domains(repeats))
    return domain, draw(problems(domain))


def _requirements(draw: DrawFn, needed: Iterable[str]) -> tuple[str, ...]:
    more = draw(st.lists(st.sampled_from(EXTRA), max_size=3))
    return tuple(draw(st.permutations(list(dict.fromkeys([*sorted(needed), *more])))))


def _world(draw: DrawFn, names: list[str], repeats: bool) -> World:
    parents: dict[str, str] = {}
    for name in names[: draw(st.integers(0, 4))]:
        parents[name] = draw(st.sampled_from([ROOT_TYPE, *parents]))
    if draw(st.booleans()):
        # A type may be declared before the one above it.
        parents = dict(draw(st.permutations(list(parents.items()))))
    empty = World(parents, (), (), ())
    things = tuple(
        TypedName(name, draw(empty.type_choice)) for name in names[4 : 4 + draw(st.integers(0, 3))]
    )
    predicates = tuple(
        Predicate(name, draw(empty.parameters(repeats)))
        for name in names[8 : 8 + draw(st.integers(0, 4))]
    )
    functions = tuple(
        Function(
            name,
            draw(empty.parameters(2, repeats)),
            draw(st.one_of(st.just(()), empty.type_choice)),
        )
        for name in names[12 : 12 + draw(st.integers(0, 4))]
    )
    ruled = [predicate.name for predicate in predicates if draw(st.booleans())]
    predicates = (Predicate(names[7]), *predicates)
    return World(parents, things, predicates, functions, frozenset(map(fold, ruled)))


def _derived(words: Formulas) -> tuple[Derived, ...]:
    rules = []
    for predicate in words.world.predicates:
        if fold(predicate.name) in words.world.derived:
            parts = [TypedName(f"v{i}", part.types) for i, part in enumerate(predicate.parameters)]
            rules.append(Derived(predicate.name, tuple(parts), words.goal(tuple(parts), 2)))
    return tuple(rules)


def _action(words: Formulas, name: str) -> Action:
    kind = words.pick((ACTION, ACTION, DURATIVE_ACTION, DURATIVE_ACTION, PROCESS, EVENT))
    scope = words.draw(words.world.parameters(3))
    durative = kind == DURATIVE_ACTION
    soft = kind in (ACTION, DURATIVE_ACTION)
    if kind == PROCESS:
        rates = (words.continuous(scope), words.continuous(scope))
        effect: tuple[Formula, ...] = tuple(rate for rate in rates if rate is not None)
    else:
        effect = words.conjuncts(lambda: words.effect(scope, durative))
    return Action(
        kind,
        name,
        scope,
        words.conjuncts(lambda: words.duration(scope), 2) if durative else (),
        words.conjuncts(lambda: words.condition(scope, durative, soft)),
        effect,
    )


def _initial(words: Formulas, problem: Problem) -> Problem:
    atoms = list(dict.fromkeys(words.atom((), basic=True) for _ in range(words.pick(range(5)))))
    count = words.pick(range(len(atoms) + 1))
    literals: list[Not | Equal] = [Not(atom) for atom in atoms[count:]]
    things = [Constant(thing.name) for thing in words.world.things]
    if things and words.flip():
        literals.append(Equal(words.pick(things), words.pick(things)))
    values: dict[Fluent, FunctionValue] = {}
    timed: dict[TimedLiteral, None] = {}
    for function in words.world.functions:
        fluent = words.fluent((), function.types, nested=0)
        if fluent is None:
            continue
        value = _value(words, fluent)
        if value is not None:
            values[fluent] = FunctionValue(fluent, value)
            if words.flip():
                timed[TimedLiteral(words.number(0), Assign("assign", fluent, value))] = None
    if words.flip():
        timed[TimedLiteral(words.number(0), words.literal((), basic=True))] = None
    return replace(
        problem,
        facts=tuple(atoms[:count]),
        literals=tuple(literals),
        values=tuple(values.values()),
        timed=tuple(timed),
    )


def _value(words: Formulas, fluent: Fluent) -> Number | Constant | None:
    function = next(f for f in words.world.functions if f.name == fluent.function)
    if not function.types:
        return words.number()
    value = words.term(function.types, (), nested=0)
    return value if isinstance(value, Constant) else None


def _metric(words: Formulas, domain: Domain, problem: Problem) -> Metric:
    roots: list[Node] = [*problem.goal, *problem.constraints]
    for action in domain.actions:
        roots += action.condition
    preferences = {n.name for n in walk(*roots) if isinstance(n, Preference) and n.name}
    parts: list[Expression] = [words.expression(()), Fluent("total-time")]
    parts += [IsViolated(name) for name in sorted(preferences)]
    expression = words.pick(parts)
    if words.flip():
        weighted = Arithmetic("*", (words.number(0), words.pick(parts)))
        expression = Arithmetic("+", (expression, weighted, words.pick(parts)))
    return Metric(words.pick(("minimize", "maximize")), expression)
