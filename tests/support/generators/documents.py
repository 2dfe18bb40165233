"""Hypothesis strategies for documents: any well-formed domain, and any of its problems."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property, lru_cache
from typing import TypeVar

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import ROOT_TYPE, fold
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

T = TypeVar("T")
Scope = tuple[f.TypedName, ...]

# Legal names that a careless reader mistakes for something else.
AWKWARD = (
    *("at", "over", "start", "end", "all", "object1", "number1", "either1", "domain", "problem"),
    *("defined", "init", "goal", "x", "X1", "A-B", "a_b", "a-", "b--c", "T", "t1", "nil", "true"),
    *("minimize", "duration", "always1", "preference1", "is-violated1", "increase1", "not-p"),
    *("parameters", "condition", "effect", "metric", "e1", "E2", "inf", "NaN", "total-cost"),
)
LETTERS = "abcxyzABCXYZ"
NAMES = st.one_of(
    st.sampled_from(AWKWARD),
    st.builds(
        str.__add__, st.sampled_from(LETTERS), st.text(alphabet=LETTERS + "0189-_", max_size=5)
    ),
)
VARIABLES = ("x", "y", "Z1", "a-b", "r_", "start", "object", "either", "number", "end")


def distinct(count: int, taken: Sequence[str] = ()) -> SearchStrategy[list[str]]:
    """Draw names that differ in PDDL, from each other and from the taken ones."""
    keys = {fold(name) for name in taken}
    free = NAMES.filter(lambda name: fold(name) not in keys)
    return st.lists(free, min_size=count, max_size=count, unique_by=fold)


def some(elements: SearchStrategy[T], most: int, least: int = 0) -> SearchStrategy[tuple[T, ...]]:
    return st.lists(elements, min_size=least, max_size=most).map(tuple)


_FLIPS = st.booleans()


@lru_cache
def _below(count: int) -> SearchStrategy[int]:
    return st.integers(0, count - 1)


@dataclass(frozen=True)
class World:
    """The types with their parents, their objects, and the predicates and functions."""

    parents: dict[str, str]
    things: tuple[f.TypedName, ...]
    predicates: tuple[Predicate, ...]
    functions: tuple[Function, ...]
    derived: frozenset[str] = frozenset()

    def fits(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        return all(any(self._is_below(name, above) for above in wanted) for name in types)

    def fits_any(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        """Return whether an object of some types may be used where others are wanted."""
        return any(self._is_below(name, above) for name in types for above in wanted)

    def _is_below(self, name: str, above: str) -> bool:
        while name not in (above, ROOT_TYPE):
            name = self.parents[name]
        return name == above

    @cached_property
    def type_choice(self) -> SearchStrategy[tuple[str, ...]]:
        names = [*self.parents, ROOT_TYPE]
        one = st.sampled_from(names).map(lambda name: (name,))
        if len(names) == 1:
            return one
        either = st.lists(st.sampled_from(names), min_size=2, max_size=3, unique=True).map(tuple)
        return st.one_of(one, one, either)

    def parameters(self, most: int = 3, repeats: bool = False) -> SearchStrategy[Scope]:
        one = st.builds(f.TypedName, st.sampled_from(VARIABLES), self.type_choice)
        if repeats:
            return some(one, most)
        listed = st.lists(one, max_size=most, unique_by=lambda part: fold(part.name))
        return listed.map(tuple)


def world_of(domain: Domain, objects: tuple[f.TypedName, ...] = ()) -> World:
    return World(
        {name.name: name.types[0] for name in domain.types},
        (*domain.constants, *objects),
        domain.predicates,
        domain.functions,
        frozenset(fold(rule.predicate) for rule in domain.derived),
    )


def bind(scope: Scope, parts: Scope) -> Scope:
    """Return the scope with more variables: an inner one hides an outer one of the same name."""
    bound = {fold(part.name) for part in parts}
    return (*(part for part in scope if fold(part.name) not in bound), *parts)


class Words:
    """Draws well-typed terms, atoms and fluents."""

    def __init__(self, draw: DrawFn, world: World) -> None:
        self.draw, self.world = draw, world

    def pick(self, choices: Sequence[T]) -> T:
        return choices[self.draw(_below(len(choices)))]

    def flip(self) -> bool:
        return self.draw(_FLIPS)

    def between(self, least: int, most: int) -> int:
        return self.draw(st.integers(least, most))

    def term(self, wanted: tuple[str, ...], scope: Scope, nested: int) -> f.Term | None:
        fits = self.world.fits
        choices: list[f.Term] = [
            f.Constant(t.name) for t in self.world.things if fits(t.types, wanted)
        ]
        choices += [f.Variable(part.name) for part in scope if fits(part.types, wanted)]
        if nested and (fluent := self.fluent(scope, wanted, nested - 1)) is not None:
            choices.append(fluent)
        return self.pick(choices) if choices else None

    def arguments(self, parameters: Scope, scope: Scope, nested: int) -> tuple[f.Term, ...] | None:
        terms = [self.term(part.types, scope, nested) for part in parameters]
        found = tuple(term for term in terms if term is not None)
        return found if len(found) == len(parameters) else None

    def fluent(
        self, scope: Scope, wanted: tuple[str, ...] = (), nested: int = 1
    ) -> f.Fluent | None:
        """Draw a numeric fluent, or with wanted types an object fluent."""
        fitting = [
            function
            for function in self.world.functions
            if bool(function.types) == bool(wanted)
            and (not wanted or self.world.fits(function.types, wanted))
        ]
        if not fitting:
            return None
        function = self.pick(fitting)
        terms = self.arguments(function.parameters, scope, nested)
        return None if terms is None else f.Fluent(function.name, terms)

    def atom(self, scope: Scope, basic: bool = False, nested: int = 0) -> f.Atom:
        """Draw an atom; a basic one has a predicate without rules."""
        predicate = self.pick(
            [
                p
                for p in self.world.predicates
                if not basic or fold(p.name) not in self.world.derived
            ]
        )
        terms = self.arguments(predicate.parameters, scope, nested)
        if terms is None:
            # The first predicate has neither parameters nor a rule.
            return f.Atom(self.world.predicates[0].name)
        return f.Atom(predicate.name, terms)


DEPTH = 3
DURATION = f.Variable("duration")
NUMBERS = ("0", "1", "-1", "0.5", "1.50", "-3.25", "007", "1000000000000000000001", "0.1", "1E+3")


class Formulas(Words):
    """Draws all constructs of the grammar, each in its context."""

    def several(self, one: Callable[[], f.Formula], most: int = 3) -> tuple[f.Formula, ...]:
        return tuple(one() for _ in range(self.between(0, most)))

    def conjuncts(self, one: Callable[[], f.Formula], most: int = 3) -> tuple[f.Formula, ...]:
        """Draw the conjuncts of a goal, a condition or an effect: none is a conjunction."""
        found: list[f.Formula] = []
        stack = [*self.several(one, most)]
        while stack:
            formula = stack.pop(0)
            if isinstance(formula, f.And):
                stack[:0] = formula.formulas
            else:
                found.append(formula)
        return tuple(found)

    def bound(self, least: int = 1) -> Scope:
        parts = self.draw(self.world.parameters(2))
        return parts if len(parts) >= least else (f.TypedName("q", (ROOT_TYPE,)),)

    def number(self, least: int | None = None) -> f.Number:
        number = f.Number(Decimal(self.pick(NUMBERS)))
        return number if least is None or number.value >= least else f.Number(Decimal(least))

    def expression(self, scope: Scope, depth: int = 2, duration: bool = False) -> f.Expression:
        kind = self.pick(["number", "fluent", "fluent", "arithmetic", "duration"])
        if kind == "duration" and duration:
            return DURATION
        if kind == "arithmetic" and depth:
            operator = self.pick(f.ARITHMETIC)
            most = {"+": 3, "*": 3, "-": 2, "/": 2}[operator]
            count = self.between(1 if operator == "-" else 2, most)
            parts = [self.expression(scope, depth - 1, duration) for _ in range(count)]
            return f.Arithmetic(operator, tuple(parts))
        return self.number() if kind == "number" else self.fluent(scope) or self.number()

    def literal(self, scope: Scope, basic: bool = False, nested: int = 0) -> f.Atom | f.Not:
        atom = self.atom(scope, basic, nested)
        return f.Not(atom) if self.flip() else atom

    def comparison(self, scope: Scope) -> f.Formula:
        if self.flip():
            sides = [self.term((ROOT_TYPE,), scope, nested=2) for _ in range(2)]
            if sides[0] is not None and sides[1] is not None:
                return f.Equal(sides[0], sides[1])
        fluent = self.fluent(scope)
        if fluent is None:
            return self.literal(scope)
        pair = [fluent, self.expression(scope)]
        if self.flip():
            pair.reverse()
        return f.Comparison(self.pick(f.COMPARISONS), pair[0], pair[1])

    def goal(self, scope: Scope, depth: int = DEPTH) -> f.Formula:
        """Draw a goal description: without times and preferences."""
        kind = self.pick(
            [*("literal", "literal", "comparison"), *("not", "and", "or", "imply"), "all"]
        )
        if kind == "comparison":
            return self.comparison(scope)
        if kind == "literal" or not depth:
            return self.literal(scope, nested=2)
        if kind == "not":
            return f.Not(self.goal(scope, depth - 1))
        if kind == "imply":
            return f.Imply(self.goal(scope, depth - 1), self.goal(scope, depth - 1))
        if kind == "all":
            parts = self.bound()
            inner = self.goal(bind(scope, parts), depth - 1)
            return f.Forall(parts, inner) if self.flip() else f.Exists(parts, inner)
        parts_ = self.several(lambda: self.goal(scope, depth - 1))
        return f.And(parts_) if kind == "and" else f.Or(parts_)

    def nest(
        self, one: Callable[[Scope], f.Formula], scope: Scope, preferences: bool, depth: int = 2
    ) -> f.Formula:
        """Draw a part, a preference for it, or several of these for all objects."""
        kind = self.pick(["one", "one", "one", "preference", "forall", "and"])
        if kind == "forall" and depth:
            parts = self.bound()
            return f.Forall(parts, self.nest(one, bind(scope, parts), preferences, depth - 1))
        if kind == "and" and depth:
            return f.And(self.several(lambda: self.nest(one, scope, preferences, depth - 1), 2))
        if kind == "preference" and preferences:
            return f.Preference(self.pick([None, "p1", "P2", "at", "always1"]), one(scope))
        return one(scope)

    def condition(self, scope: Scope, durative: bool = False, soft: bool = True) -> f.Formula:
        """Draw a condition of an action; of a durative one, at a time."""
        if durative:
            return self.nest(lambda s: f.Timed(self.pick(f.TIMES), self.goal(s, 2)), scope, soft)
        return self.nest(lambda s: self.goal(s, 2), scope, soft)

    def assignment(self, scope: Scope, duration: bool = False) -> f.Formula:
        if self.flip():
            fluent = self.fluent(scope)
            if fluent is not None:
                value = self.expression(scope, duration=duration)
                return f.Assign(self.pick(f.ASSIGNMENTS), fluent, value)
        for function in self.world.functions:
            if not function.types or not self.flip():
                continue
            fluent = self.fluent(scope, function.types)
            value_ = self.term(function.types, scope, nested=2)
            if fluent is not None and value_ is not None and fluent.function == function.name:
                return f.Assign("assign", fluent, value_)
        return self.literal(scope, basic=True)

    def change(self, scope: Scope, duration: bool = False) -> f.Formula:
        if self.flip():
            return self.literal(scope, basic=True, nested=2)
        return self.assignment(scope, duration)

    def effect(self, scope: Scope, durative: bool = False, depth: int = 2) -> f.Formula:
        def one(inner: Scope) -> f.Formula:
            if durative:
                return f.Timed(self.pick((f.AT_START, f.AT_END)), self.change(inner, duration=True))
            return self.change(inner)

        kind = self.pick(["one", "one", "when", "forall", "and", "continuous"])
        if kind == "continuous" and durative:
            return self.continuous(scope) or one(scope)
        if kind == "when":
            condition = self.condition(scope, durative, soft=False)
            return f.When(condition, one(scope) if self.flip() else f.And((one(scope), one(scope))))
        if kind == "forall" and depth:
            parts = self.bound()
            return f.Forall(parts, self.effect(bind(scope, parts), durative, depth - 1))
        if kind == "and" and depth:
            return f.And(self.several(lambda: self.effect(scope, durative, depth - 1), 2))
        return one(scope)

    def continuous(self, scope: Scope) -> f.Assign | None:
        fluent = self.fluent(scope)
        if fluent is None:
            return None
        rate: f.Expression = f.ContinuousTime()
        if self.flip():
            pair = (rate, self.expression(scope, 1))
            rate = f.Arithmetic("*", pair if self.flip() else pair[::-1])
        return f.Assign(self.pick(("increase", "decrease")), fluent, rate)

    def duration(self, scope: Scope) -> f.Formula:
        operator = self.pick(("=", "<=", ">="))
        constraint = f.Comparison(operator, DURATION, self.expression(scope))
        return f.Timed(self.pick((f.AT_START, f.AT_END)), constraint) if self.flip() else constraint

    def modal(self, scope: Scope, depth: int = 1) -> f.Formula:
        operator = self.pick([f.AT_END, *f.MODALS])
        if operator == f.AT_END:
            return f.Timed(f.AT_END, self.goal(scope, 1))
        numbers, formulas = f.MODALS[operator]
        times = sorted((self.number(0) for _ in range(numbers)), key=lambda one: one.value)
        return f.Modal(
            operator,
            tuple(times),
            tuple(
                self.modal(scope, depth - 1) if depth and self.flip() else self.goal(scope, 1)
                for _ in range(formulas)
            ),
        )

    def constraint(self, scope: Scope = (), soft: bool = False) -> f.Formula:
        return self.nest(self.modal, scope, soft)


EXTRA = (*REQUIREMENTS, ":adl", ":fluents", ":quantified-preconditions")


@st.composite
def domains(draw: DrawFn, repeats: bool = False) -> Domain:
    """Draw any well-formed domain, with the requirements that it uses and perhaps more.

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
        types=tuple(f.TypedName(name, (above,)) for name, above in world.parents.items()),
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
    """Draw any well-formed problem of a domain."""
    taken = [domain.name, *(part.name for part in (*domain.types, *domain.constants))]
    for elements in (domain.predicates, domain.functions, domain.actions):
        taken += [element.name for element in elements]
    names = draw(distinct(6, taken))
    choice = world_of(domain).type_choice
    objects = tuple(f.TypedName(name, draw(choice)) for name in names[1 : draw(st.integers(1, 6))])
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
    """Draw any well-formed domain with one of its problems."""
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
        # A type may be declared before its parent.
        parents = dict(draw(st.permutations(list(parents.items()))))
    empty = World(parents, (), (), ())
    things = tuple(
        f.TypedName(name, draw(empty.type_choice))
        for name in names[4 : 4 + draw(st.integers(0, 3))]
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


def _derived(words: Formulas) -> tuple[f.Derived, ...]:
    rules = []
    for predicate in words.world.predicates:
        if fold(predicate.name) in words.world.derived:
            parts = [
                f.TypedName(f"v{i}", part.types) for i, part in enumerate(predicate.parameters)
            ]
            formula = words.goal(tuple(parts), 2)
            # Rules must be stratified: none negates a derived predicate.
            if words.world.derived.isdisjoint(map(fold, _negated(formula))):
                rules.append(f.Derived(predicate.name, tuple(parts), formula))
    return tuple(rules)


def _negated(node: f.Node, negated: bool = False) -> Iterator[str]:
    """Yield the predicates below a negation."""
    if isinstance(node, f.Atom) and negated:
        yield node.predicate
    for number, child in enumerate(f.children(node)):
        is_turned = isinstance(node, f.Not) or (isinstance(node, f.Imply) and number == 0)
        yield from _negated(child, negated != is_turned)


def _action(words: Formulas, name: str) -> Action:
    kind = words.pick((ACTION, ACTION, DURATIVE_ACTION, DURATIVE_ACTION, PROCESS, EVENT))
    scope = words.draw(words.world.parameters(3))
    durative = kind == DURATIVE_ACTION
    soft = kind in (ACTION, DURATIVE_ACTION)
    if kind == PROCESS:
        rates = (words.continuous(scope), words.continuous(scope))
        effect: tuple[f.Formula, ...] = tuple(rate for rate in rates if rate is not None)
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
    literals: list[f.Not | f.Equal] = [f.Not(atom) for atom in atoms[count:]]
    things = [f.Constant(thing.name) for thing in words.world.things]
    if things and words.flip():
        literals.append(f.Equal(words.pick(things), words.pick(things)))
    values: dict[f.Fluent, FunctionValue] = {}
    timed: dict[f.TimedLiteral, None] = {}
    for function in words.world.functions:
        fluent = words.fluent((), function.types, nested=0)
        if fluent is None:
            continue
        value = _value(words, fluent)
        if value is not None:
            values[fluent] = FunctionValue(fluent, value)
            if words.flip():
                timed[f.TimedLiteral(words.number(0), f.Assign("assign", fluent, value))] = None
    if words.flip():
        timed[f.TimedLiteral(words.number(0), words.literal((), basic=True))] = None
    return replace(
        problem,
        facts=tuple(atoms[:count]),
        literals=tuple(literals),
        values=tuple(values.values()),
        timed=tuple(timed),
    )


def _value(words: Formulas, fluent: f.Fluent) -> f.Number | f.Constant | None:
    function = next(one for one in words.world.functions if one.name == fluent.function)
    if not function.types:
        return words.number()
    value = words.term(function.types, (), nested=0)
    return value if isinstance(value, f.Constant) else None


def _metric(words: Formulas, domain: Domain, problem: Problem) -> f.Metric:
    roots: list[f.Node] = [*problem.goal, *problem.constraints]
    for action in domain.actions:
        roots += action.condition
    preferences = {n.name for n in f.walk(*roots) if isinstance(n, f.Preference) and n.name}
    parts: list[f.Expression] = [words.expression(()), f.Fluent("total-time")]
    parts += [f.IsViolated(name) for name in sorted(preferences)]
    expression = words.pick(parts)
    if words.flip():
        weighted = f.Arithmetic("*", (words.number(0), words.pick(parts)))
        expression = f.Arithmetic("+", (expression, weighted, words.pick(parts)))
    return f.Metric(words.pick(("minimize", "maximize")), expression)
