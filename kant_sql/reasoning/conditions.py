"""Conditions and expressions, compiled for a world in memory.

A formula becomes a list of tests, each with the next test when it succeeds and when it fails, and
an expression becomes a list of operations on a stack, so that neither recurses however deep it is.
Only quantifiers within quantifiers do.

A quantified formula is a search for objects, of an example or a counterexample: a nested loop over
facts of the positive atoms in its conjunction, with the most terms known first, and over the
objects of a type where no atom is left; each other part is tested as soon as its variables have
objects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any, NamedTuple

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidKnowledgeError, UnsupportedConstructError
from ..knowledge.conditions import COMPARE
from .arithmetic import EXACT, LINEARS, Exact, Linear, Numbers, decimal_of
from .grounding import Binding
from .junctions import Literal, alternatives, junction, merged
from .relations import Relation, Row, picker
from .world import World

# Values of variables and constants, by slot.
Env = list[Any]
Test = Callable[[Env], bool]
# Yields whenever the variables of a search have objects in the environment.
Search = Callable[[Env], Iterator[None]]

_TRUE, _FALSE = -1, -2
MAX_QUANTIFIERS = 60


class _Lookup(NamedTuple):
    """An object fluent within a term: the slot that its value goes to."""

    slot: int
    table: dict[Row, Any]
    pick: Callable[[Any], Row]


class Compiler:
    """Compiles formulas that share their variables' slots."""

    def __init__(self, world: World, parameters: Sequence[f.TypedName]) -> None:
        self.world = world
        self.template: Env = []
        self._scope: dict[str, int] = {}
        self._constants: dict[str, int] = {}
        self._nesting = 0
        for parameter in parameters:
            self._scope[fold(parameter.name)] = self.slot()
        self.duration = self.slot()

    def slot(self, value: object = None) -> int:
        """Make a slot."""
        self.template.append(value)
        return len(self.template) - 1

    # Terms.

    def _simple(self, term: f.Variable | f.Constant) -> int:
        if isinstance(term, f.Variable):
            found = self._scope.get(fold(term.name))
            if found is None:
                raise InvalidKnowledgeError(f"the variable {term} has no object; bind it")
            return found
        if term.name not in self._constants:
            self._constants[term.name] = self.slot(self.world.object(term.name) or term.name)
        return self._constants[term.name]

    def terms(self, terms: Iterable[f.Term]) -> tuple[tuple[int, ...], tuple[_Lookup, ...]]:
        """Return the slots of terms, and the lookups that fill those of object fluents."""
        slots: list[int] = []
        lookups: list[_Lookup] = []
        for term in terms:
            if isinstance(term, f.Fluent):
                slots.append(self._fluent(term, lookups))
            else:
                slots.append(self._simple(term))
        return tuple(slots), tuple(lookups)

    def _fluent(self, fluent: f.Fluent, lookups: list[_Lookup]) -> int:
        """Append the lookups of a fluent, inner ones first."""
        done: list[int] = []
        stack: list[tuple[f.Term, bool]] = [(fluent, False)]
        while stack:
            term, is_over = stack.pop()
            if not isinstance(term, f.Fluent):
                done.append(self._simple(term))
            elif not is_over:
                stack.append((term, True))
                stack.extend((inner, False) for inner in reversed(term.terms))
            else:
                start = len(done) - len(term.terms)
                slots = tuple(done[start:])
                del done[start:]
                slot = self.slot()
                lookups.append(_Lookup(slot, self.world.table(term.function), picker(slots)))
                done.append(slot)
        return done[0]

    def row(self, terms: Sequence[f.Term]) -> Callable[[Env], Row | None]:
        """Compile terms; the result is None where an object fluent has no value."""
        slots, lookups = self.terms(terms)
        pick = picker(slots)

        def row(env: Env) -> Row | None:
            for slot, table, key in lookups:
                env[slot] = table.get(key(env))
                if env[slot] is None:
                    return None
            return pick(env)

        return row

    # Tests.

    def program(self, formula: f.Formula, negated: bool = False) -> Test:
        """Compile a formula."""
        code: list[list[Any]] = []
        labels: dict[int, int] = {_TRUE: _TRUE, _FALSE: _FALSE}
        count = 0
        stack = [(formula, negated, _TRUE, _FALSE, count)]
        while stack:
            part, negated, yes, no, start = stack.pop()
            inner = junction(part, negated)
            if inner is None:
                labels[start] = len(code)
                test = self._leaf(part, negated)
                code.append([test, yes, no])
                continue
            parts, is_and = inner
            if not parts:
                labels[start] = len(code)
                code.append([_always if is_and else _never, yes, no])
                continue
            starts = [start, *range(count + 1, count + len(parts))]
            count += len(parts)
            following = [*starts[1:], None]
            pushed = []
            for (one, flag), at, next_at in zip(parts, starts, following, strict=True):
                if next_at is None:
                    pushed.append((one, flag, yes, no, at))
                elif is_and:
                    pushed.append((one, flag, next_at, no, at))
                else:
                    pushed.append((one, flag, yes, next_at, at))
            stack.extend(reversed(pushed))
        if len(code) == 1:
            only: Test = code[0][0]
            return only
        steps = [(test, labels[yes], labels[no]) for test, yes, no in code]
        return _runner(steps)

    def _leaf(self, part: f.Formula, negated: bool) -> Test:
        test = self._positive_leaf(part, negated)
        if isinstance(part, f.Forall | f.Exists):
            return test
        return (lambda env: not test(env)) if negated else test

    def _positive_leaf(self, part: f.Formula, negated: bool) -> Test:
        if isinstance(part, f.Atom):
            return self.atom(part)
        if isinstance(part, f.Equal):
            return self._equal(part)
        if isinstance(part, f.Comparison):
            return self._comparison(part)
        if isinstance(part, f.Preference):
            return _always
        if isinstance(part, f.Forall | f.Exists):
            return self._quantified(part, negated)
        raise UnsupportedConstructError(
            f"({f.head(part)} ...) is no condition of a state, so it cannot be evaluated in one"
        )

    def atom(self, part: f.Atom) -> Test:
        """Compile an atom."""
        slots, lookups = self.terms(part.terms)
        pick = picker(slots)
        rows = self.world.relation(part.predicate).rows
        rules = self.world.rules(part.predicate)

        def plain(env: Env) -> bool:
            return pick(env) in rows

        def derived(env: Env) -> bool:
            assert rules is not None
            if not rules.is_fresh:
                rules.refresh()
            return pick(env) in rows

        return _after(lookups, plain if rules is None else derived)

    def _equal(self, part: f.Equal) -> Test:
        (left, right), lookups = self.terms((part.left, part.right))
        return _after(lookups, lambda env: env[left] == env[right])

    def _comparison(self, part: f.Comparison) -> Test:
        compare = COMPARE[part.operator]
        left, right = self.expression(part.left), self.expression(part.right)
        world = self.world

        def test(env: Env) -> bool:
            if world.rates:
                return _compare_linear(world, part.operator, left, right, env)
            first, second = left(env, EXACT), right(env, EXACT)
            return first is not None and second is not None and compare(first, second)

        return test

    def _quantified(self, part: f.Forall | f.Exists, negated: bool) -> Test:
        """Compile a quantifier as a search: for a counterexample of `forall`."""
        self._nesting += 1
        if self._nesting > MAX_QUANTIFIERS:
            raise UnsupportedConstructError(
                f"more than {MAX_QUANTIFIERS} quantifiers within quantifiers cannot be evaluated"
            )
        is_universal = isinstance(part, f.Forall)
        search = self.search(part.variables, [(part.formula, is_universal)])
        self._nesting -= 1
        if is_universal != negated:
            return lambda env: next(search(env), True) is True
        return lambda env: next(search(env), True) is None

    # Searches.

    def search(
        self,
        variables: Sequence[f.TypedName],
        parts: Sequence[Literal],
        delta: tuple[f.Atom, Relation] | None = None,
    ) -> Search:
        """Compile a search for the objects of variables, which yields with each solution in `env`.

        Args:
            variables: the variables; they hide others of the same names.
            parts: a conjunction of formulas, each with whether it is negated.
            delta: an atom of the conjunction to be read from other facts.
        """
        return self.open_search(*merged(variables, parts), delta)[0]

    def open_search(
        self,
        variables: Sequence[f.TypedName],
        parts: Sequence[Literal],
        delta: tuple[f.Atom, Relation] | None = None,
        within: Callable[[], None] | None = None,
    ) -> tuple[Search, tuple[int, ...]]:
        """Compile a search; return it with the slots of its variables.

        Args:
            variables: see `search`.
            parts: see `search`.
            delta: see `search`; the alternatives without its atom are left out.
            within: is called while the variables are in scope.
        """
        outside = dict(self._scope)
        unbound: dict[int, f.TypedName] = {}
        for variable in variables:
            slot = self._scope[fold(variable.name)] = self.slot()
            unbound[slot] = variable
        chosen = alternatives(parts)
        if delta is not None:
            chosen = [one for one in chosen if any(part is delta[0] for part, _ in one)]
        try:
            searches = [self._join(unbound, one, delta) for one in chosen]
            if within is not None:
                within()
        finally:
            self._scope = outside
        return _union(searches), tuple(unbound)

    def _join(
        self,
        variables: dict[int, f.TypedName],
        parts: Sequence[Literal],
        delta: tuple[f.Atom, Relation] | None,
    ) -> Search:
        """Compile a nested loop over a conjunction."""
        unbound = dict(variables)
        rest = [_Part(one, flag, self._free(one)) for one, flag in parts]
        steps: list[_Step] = []
        tests = self._ready(rest, unbound)
        while unbound:
            chosen = self._choose(rest, unbound, delta)
            if chosen is None:
                slot = min(unbound, key=lambda one: len(self.world.range_of(unbound[one])))
                names = [(name,) for name in self.world.range_of(unbound.pop(slot))]
                step = _Step(_constant(names), (0,), (slot,), ())
            else:
                rest.remove(chosen)
                assert isinstance(chosen.formula, f.Atom)
                step = self._scan(chosen.formula, unbound, delta)
            steps.append(step._replace(tests=tuple(self._ready(rest, unbound))))
        return _loop(tuple(tests), tuple(steps))

    def _free(self, formula: f.Formula) -> frozenset[int]:
        """Return the slots of the variables in scope that occur in a formula."""
        found: set[int] = set()
        stack: list[tuple[f.Node, frozenset[str]]] = [(formula, frozenset())]
        while stack:
            node, hidden = stack.pop()
            if isinstance(node, f.Variable):
                key = fold(node.name)
                if key not in hidden and key in self._scope:
                    found.add(self._scope[key])
                continue
            variables = getattr(node, "variables", ())
            if variables:
                hidden = hidden | {fold(one.name) for one in variables}
            stack.extend((child, hidden) for child in f.children(node))
        return frozenset(found)

    def _ready(self, rest: list[_Part], unbound: dict[int, f.TypedName]) -> list[Test]:
        """Compile and remove the parts whose variables all have objects."""
        ready = [part for part in rest if part.free.isdisjoint(unbound)]
        rest[:] = [part for part in rest if not part.free.isdisjoint(unbound)]
        ready.sort(key=lambda part: not isinstance(part.formula, f.Atom | f.Equal))
        return [self.program(part.formula, part.negated) for part in ready]

    def _choose(
        self,
        rest: list[_Part],
        unbound: dict[int, f.TypedName],
        delta: tuple[f.Atom, Relation] | None,
    ) -> _Part | None:
        """Choose the atom whose facts are looped over next."""
        best: tuple[tuple[int, int], _Part] | None = None
        for part in rest:
            atom = part.formula
            if part.negated or not isinstance(atom, f.Atom):
                continue
            if any(isinstance(term, f.Fluent) for term in atom.terms):
                continue
            if delta is not None and atom is delta[0]:
                return part
            known = sum(slot not in unbound for slot in self.terms(atom.terms)[0])
            rank = (len(atom.terms) - known, -known)
            if best is None or rank < best[0]:
                best = rank, part
        return None if best is None else best[1]

    def _scan(
        self,
        atom: f.Atom,
        unbound: dict[int, f.TypedName],
        delta: tuple[f.Atom, Relation] | None,
    ) -> _Step:
        """Compile a loop over the facts of an atom; its variables have objects from then on."""
        world = self.world
        slots, _ = self.terms(atom.terms)
        known = tuple([at for at, slot in enumerate(slots) if slot not in unbound])
        targets: dict[int, int] = {}
        repeated: list[tuple[int, int]] = []
        kinds: list[tuple[int, frozenset[str]]] = []
        for at, slot in enumerate(slots):
            if slot in targets:
                repeated.append((targets[slot], at))
            elif slot in unbound:
                targets[slot] = at
                wanted = unbound[slot].types
                if not world.always_fits(atom.predicate, at, wanted):
                    kinds.append((at, world.members(wanted)))
        for slot in targets:
            del unbound[slot]
        is_delta = delta is not None and atom is delta[0]
        relation = delta[1] if is_delta and delta else world.relation(atom.predicate)
        rules = None if is_delta else world.rules(atom.predicate)
        find, pick = relation.lookup(known), picker(tuple([slots[at] for at in known]))

        def rows(env: Env) -> Collection[Row]:
            if rules is not None and not rules.is_fresh:
                rules.refresh()
            return _fitting(find(pick(env)), repeated, kinds)

        return _Step(rows, tuple(targets.values()), tuple(targets), ())

    # Expressions.

    def expression(self, expression: f.Expression) -> Callable[[Env, Numbers[Any]], Any]:
        """Compile an expression; it returns None without a value."""
        operations = [*self._operations(expression)]
        if len(operations) == 1:
            only = operations[0]
            return lambda env, numbers: only(env, numbers, [])

        def run(env: Env, numbers: Numbers[Any]) -> Any:
            stack: list[Any] = []
            for operation in operations:
                value = operation(env, numbers, stack)
                if value is None:
                    return None
                stack.append(value)
            return stack[0]

        return run

    def _operations(self, expression: f.Expression) -> Iterator[_Operation]:
        """Yield the operations of an expression in postfix order."""
        stack: list[tuple[f.Expression, bool]] = [(expression, False)]
        while stack:
            part, is_over = stack.pop()
            if not isinstance(part, f.Arithmetic):
                yield self._operand(part)
            elif is_over:
                yield _operation(part.operator, len(part.operands))
            else:
                stack.append((part, True))
                stack.extend((inner, False) for inner in reversed(part.operands))

    def _operand(self, part: f.Expression) -> _Operation:
        world = self.world
        if isinstance(part, f.Number):
            value = part.value
            return lambda env, numbers, stack: numbers.of(value)
        if isinstance(part, f.Fluent):
            return self._value(part)
        if isinstance(part, f.IsViolated):
            name = fold(part.preference)
            return lambda env, numbers, stack: numbers.of(Decimal(world.violations.get(name, 0)))
        if isinstance(part, f.ContinuousTime):
            return _continuous_time
        assert isinstance(part, f.Variable)
        slot = self.duration

        def duration(env: Env, numbers: Numbers[Any], stack: list[Any]) -> Any:
            del stack
            return None if env[slot] is None else numbers.of(env[slot])

        return duration

    def _value(self, part: f.Fluent) -> _Operation:
        world = self.world
        is_time = fold(part.function) == f.TOTAL_TIME and not part.terms
        if is_time and not world.is_declared_function(part.function):
            return lambda env, numbers, stack: numbers.of(world.total_time)
        slots, lookups = self.terms(part.terms)
        table, pick, function = world.table(part.function), picker(slots), part.function

        def value(env: Env, numbers: Numbers[Any], stack: list[Any]) -> Any:
            del stack
            for lookup in lookups:
                env[lookup.slot] = lookup.table.get(lookup.pick(env))
            row = pick(env)
            if numbers is LINEARS:
                return world.linear(function, row)
            found = table.get(row)
            if not isinstance(found, Decimal):
                return None
            if world.rates and (function, row) in world.rates:
                found = world.value_now(function, row) or Decimal(0)
            return numbers.of(found)

        return value


_Operation = Callable[[Env, Numbers[Any], list[Any]], Any]


class _Part(NamedTuple):
    """A conjunct, whether it is negated, and the slots of its free variables."""

    formula: f.Formula
    negated: bool
    free: frozenset[int]


class _Step(NamedTuple):
    """A loop: rows, the positions in them that are new, their slots, and the tests of each."""

    rows: Callable[[Env], Collection[Row]]
    positions: tuple[int, ...]
    slots: tuple[int, ...]
    tests: tuple[Test, ...]


def _always(env: Env) -> bool:
    del env
    return True


def _never(env: Env) -> bool:
    del env
    return False


def _fitting(
    rows: Collection[Row],
    repeated: list[tuple[int, int]],
    kinds: list[tuple[int, frozenset[str]]],
) -> Collection[Row]:
    """Return the rows with the same objects at some positions, and some of certain types."""
    if not repeated and not kinds:
        return rows
    return [
        row
        for row in rows
        if all(row[one] == row[other] for one, other in repeated)
        and all(row[at] in members for at, members in kinds)
    ]


def _constant(rows: Collection[Row]) -> Callable[[Env], Collection[Row]]:
    return lambda env: rows


def _runner(steps: list[tuple[Test, int, int]]) -> Test:
    """Return what runs tests, each with its successors, from the first one on."""

    def run(env: Env) -> bool:
        at = 0
        while at >= 0:
            test, yes, no = steps[at]
            at = yes if test(env) else no
        return at == _TRUE

    return run


def _after(lookups: tuple[_Lookup, ...], test: Test) -> Test:
    """Return a test that looks up object fluents first, and fails without one's value."""
    if not lookups:
        return test

    def looked_up(env: Env) -> bool:
        for slot, table, pick in lookups:
            value = env[slot] = table.get(pick(env))
            if value is None:
                return False
        return test(env)

    return looked_up


def _union(
    searches: list[Search],
) -> Search:
    if len(searches) == 1:
        return searches[0]

    def run(env: Env) -> Iterator[None]:
        for search in searches:
            yield from search(env)

    return run


def _loop(tests: tuple[Test, ...], steps: tuple[_Step, ...]) -> Search:
    """Return a nested loop, on an explicit stack."""

    def run(env: Env) -> Iterator[None]:
        if not all(test(env) for test in tests):
            return
        if not steps:
            yield None
            return
        depth = len(steps)
        stack = [iter(steps[0].rows(env))]
        while stack:
            row = next(stack[-1], None)
            if row is None:
                stack.pop()
                continue
            step = steps[len(stack) - 1]
            for position, slot in zip(step.positions, step.slots, strict=True):
                env[slot] = row[position]
            for test in step.tests:
                if not test(env):
                    break
            else:
                if len(stack) == depth:
                    yield None
                else:
                    stack.append(iter(steps[len(stack)].rows(env)))

    return run


def _operation(operator: str, count: int) -> _Operation:
    """Return what replaces operands on a stack by a result."""

    def run(env: Env, numbers: Numbers[Any], stack: list[Any]) -> Any:
        del env
        operands = stack[len(stack) - count :]
        del stack[len(stack) - count :]
        if count == 1:
            return numbers.subtract(numbers.of(Decimal(0)), operands[0])
        apply = {
            "+": numbers.add,
            "-": numbers.subtract,
            "*": numbers.multiply,
            "/": numbers.divide,
        }[operator]
        result = operands[0]
        for operand in operands[1:]:
            result = apply(result, operand)
            if result is None:
                return None
        return result

    return run


def _continuous_time(env: Env, numbers: Numbers[Any], stack: list[Any]) -> Any:
    del env, stack
    if numbers is not LINEARS:
        raise UnsupportedConstructError(
            "#t is not a number; it belongs to a continuous effect such as "
            "(increase (fuel) (* #t 2))"
        )
    return Linear(Fraction(0), Fraction(1))


def _compare_linear(
    world: World,
    operator: str,
    left: Callable[[Env, Numbers[Any]], Any],
    right: Callable[[Env, Numbers[Any]], Any],
    env: Env,
) -> bool:
    """Compare while numbers change; note the time at which the sides are equal."""
    first, second = left(env, LINEARS), right(env, LINEARS)
    if first is None or second is None:
        return False
    difference = LINEARS.subtract(first, second)
    if difference.rate:
        world.roots.add(-difference.value / difference.rate)
    return COMPARE[operator](difference.at(world.elapsed), Fraction(0))


class Condition:
    """A formula compiled for a world.

    Attributes:
        formula: the formula.
        parameters: its free variables.
    """

    def __init__(
        self, world: World, formula: f.Formula, parameters: Sequence[f.TypedName] = ()
    ) -> None:
        """Compile a formula.

        Args:
            world: the world that it is evaluated in.
            formula: a condition; a preference in it holds always.
            parameters: its free variables.

        Raises:
            InvalidKnowledgeError: another variable is free in it.
            UnsupportedConstructError: it has effects or modal operators.
        """
        self.formula = formula
        self.parameters = tuple(parameters)
        compiler = Compiler(world, parameters)
        self._test = compiler.program(formula)
        self._template, self._duration = compiler.template, compiler.duration

    def holds(self, arguments: Sequence[str] = (), duration: Decimal | None = None) -> bool:
        """Return whether it holds now.

        Args:
            arguments: the objects of the parameters, in declared spelling.
            duration: the value of `?duration`.
        """
        env = self._template.copy()
        env[: len(arguments)] = arguments
        env[self._duration] = duration
        return self._test(env)


class Expression:
    """An expression compiled for a world."""

    def __init__(
        self, world: World, expression: f.Expression, parameters: Sequence[f.TypedName] = ()
    ) -> None:
        """Compile an expression; see `Condition`."""
        compiler = Compiler(world, parameters)
        self._run = compiler.expression(expression)
        self._template, self._duration = compiler.template, compiler.duration

    def value(
        self,
        arguments: Sequence[str] = (),
        duration: Decimal | None = None,
    ) -> Exact | None:
        """Return the value now; None without one."""
        env = self._template.copy()
        env[: len(arguments)] = arguments
        env[self._duration] = duration
        found: Exact | None = self._run(env, EXACT)
        return found


class Conditions:
    """The conditions of one world, each compiled once."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._compiled: dict[tuple[int, tuple[str, ...]], Condition] = {}

    def get(self, formula: f.Formula, names: Iterable[str] = ()) -> Condition:
        """Return a compiled condition with some free variables, by folded name."""
        key = id(formula), tuple(names)
        found = self._compiled.get(key)
        # An id is used again once its formula is gone; the condition keeps its own.
        if found is None:
            parameters = [f.TypedName(name) for name in key[1]]
            found = self._compiled[key] = Condition(self._world, formula, parameters)
        return found

    def holds(self, formula: f.Formula, binding: Binding, duration: Decimal | None = None) -> bool:
        """Return whether a formula holds now, with objects for its free variables."""
        return self.get(formula, binding).holds(tuple(binding.values()), duration)

    def number(
        self, expression: f.Expression, binding: Binding, duration: Decimal | None = None
    ) -> Decimal | None:
        """Return the value of an expression as it is written; None without one."""
        found = self.exact_number(expression, binding, duration)
        return None if found is None else decimal_of(found)

    def exact_number(
        self, expression: f.Expression, binding: Binding, duration: Decimal | None = None
    ) -> Exact | None:
        """Return the value of an expression now; None without one."""
        parameters = [f.TypedName(name) for name in binding]
        compiled = Expression(self._world, expression, parameters)
        return compiled.value(tuple(binding.values()), duration)
