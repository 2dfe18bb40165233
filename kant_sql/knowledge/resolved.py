"""Conditions with resolved names, for evaluation by a statement or in memory.

A condition is converted to a small normal form: only leaves and quantifiers are negated, `or`,
`not` and `exists` replace `imply` and `forall`, the value of an object fluent in a term becomes a
variable, and each variable has a unique number.

A fluent without a value makes the comparison, the equality or the atom around it false, as in the
validator VAL (Howey, Long, Fox 2004); a negation around that is classical.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from itertools import count
from operator import eq, ge, gt, le, lt
from typing import Any, Generic, NamedTuple, TypeVar, get_args

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidKnowledgeError, UnsupportedConstructError
from ..pddl.given import ReadCondition
from .definitions import Definitions, FunctionDefinition, PredicateDefinition
from .trees import ParameterDefinition

# The ids of types whose objects fit; None for all objects.
TypeSet = frozenset[int] | None
# SQLite refuses expressions of more than 1,000 levels; a level here takes up to six.
MAX_LEVELS = 120


@dataclass(frozen=True, slots=True)
class Slot:
    """A variable."""

    number: int


@dataclass(frozen=True, slots=True)
class Known:
    """An object."""

    id: int


Place = Slot | Known


@dataclass(frozen=True, slots=True)
class HoldsFact:
    """A fact holds; unless `is_stored`, it may also follow by a rule."""

    predicate: int
    terms: tuple[Place, ...]
    is_stored: bool = False


@dataclass(frozen=True, slots=True)
class FluentIs:
    """An object fluent has an object as its value."""

    function: int
    terms: tuple[Place, ...]
    value: Place


@dataclass(frozen=True, slots=True)
class SameObject:
    """Two terms are one object."""

    left: Place
    right: Place


@dataclass(frozen=True, slots=True)
class HasType:
    """An object has one of some types."""

    term: Place
    types: TypeSet


@dataclass(frozen=True, slots=True)
class NumberOf:
    """The value of a numeric fluent."""

    function: int
    terms: tuple[Place, ...]


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation on numbers: `+`, `-`, `*` or `/`."""

    operator: str
    operands: tuple[Quantity, ...]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number given with each evaluation, such as `?duration`."""

    name: str


Quantity = Decimal | NumberOf | Operation | Parameter


# How the operators of `Compares` compare.
COMPARE: dict[str, Callable[[Any, Any], bool]] = {
    "<": lt,
    "<=": le,
    "=": eq,
    ">=": ge,
    ">": gt,
}


@dataclass(frozen=True, slots=True)
class Compares:
    """Two numbers compare."""

    operator: str
    left: Quantity
    right: Quantity


@dataclass(frozen=True, slots=True)
class AllOf:
    """All parts hold; without parts, true."""

    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class OneOf:
    """One of the parts holds; without parts, false."""

    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Lacks:
    """The part does not hold."""

    part: Part


@dataclass(frozen=True, slots=True)
class Bound:
    """A variable, and the type sets, each of which its objects must fit."""

    slot: Slot
    types: tuple[TypeSet, ...]


@dataclass(frozen=True, slots=True)
class Witness:
    """There are objects for which the part holds."""

    bound: tuple[Bound, ...]
    part: Part


Part = HoldsFact | FluentIs | SameObject | HasType | Compares | AllOf | OneOf | Lacks | Witness

TRUE, FALSE = AllOf(()), OneOf(())


@dataclass(frozen=True, slots=True)
class Column:
    """A free variable: its name without question mark, and its objects."""

    name: str
    bound: Bound


@dataclass(frozen=True, slots=True)
class ResolvedCondition:
    """A condition with its free variables: the columns, and those with given objects."""

    part: Part
    columns: tuple[Column, ...]
    given: tuple[Column, ...] = ()


def negate(part: Part) -> Part:
    """Negate a part; the result is in normal form if the part is."""
    match part:
        case Lacks(inner):
            return inner
        case AllOf(parts):
            return OneOf(tuple(map(negate, parts)))
        case OneOf(parts):
            return AllOf(tuple(map(negate, parts)))
    return Lacks(part)


def all_of(parts: Iterable[Part]) -> Part:
    """Make a conjunction, flat and without constants."""
    return _joined(AllOf, FALSE, parts)


def any_of(parts: Iterable[Part]) -> Part:
    """Make a disjunction, flat and without constants."""
    return _joined(OneOf, TRUE, parts)


def _joined(kind: type[AllOf] | type[OneOf], decides: Part, parts: Iterable[Part]) -> Part:
    found: list[Part] = []
    for part in parts:
        if part == decides:
            return decides
        found += part.parts if isinstance(part, kind) else (part,)
    return found[0] if len(found) == 1 else kind(tuple(found))


def same(left: Place, right: Place) -> Part:
    """Make the condition that two terms are one object."""
    if left == right:
        return TRUE
    if isinstance(left, Known) and isinstance(right, Known):
        return FALSE
    return SameObject(left, right)


def closure(definitions: Definitions, type_ids: Iterable[int]) -> TypeSet:
    """Return the types whose objects fit a parameter of some types; None for all."""
    key = ("closure", frozenset(type_ids))
    found = definitions.derived.get(key, 0)
    if found == 0:
        ids = key[1]
        is_any = not ids or any(map(definitions.is_root, ids))
        found = definitions.derived[key] = None if is_any else frozenset(definitions.subtypes(*ids))
    types: TypeSet = found
    return types


def fits(definitions: Definitions, object_id: int, types: TypeSet) -> bool:
    """Return whether an object fits."""
    if types is None:
        return True
    return not types.isdisjoint(definitions.objects.live(object_id).type_ids)


class Needed(NamedTuple):
    """The variables for the values of object fluents, and their conditions."""

    bound: list[Bound]
    needed: list[Part]


D = TypeVar("D", PredicateDefinition, FunctionDefinition)


class AppliedTerms(NamedTuple, Generic[D]):
    """A predicate or a function with its terms, and the conditions of these."""

    definition: D
    terms: tuple[Place, ...]
    needed: Needed


class Resolver:
    """Resolves the names of formulas in one state; its rules share the `numbers` of variables."""

    def __init__(self, definitions: Definitions, numbers: Iterator[int] | None = None) -> None:
        self._definitions = definitions
        self._numbers = count() if numbers is None else numbers
        # The slots of variables in scope, innermost last; and the types that atoms allow for each
        # variable.
        self._scope: dict[str, list[Place]] = {}
        self._allowed: dict[Slot, dict[TypeSet, None]] = {}

    def slot(self) -> Slot:
        """Make a variable."""
        return Slot(next(self._numbers))

    def bind(self, name: str, place: Place) -> None:
        """Let a name denote a variable or an object, for all later formulas."""
        self._scope.setdefault(fold(name), []).append(place)

    def part(self, formula: f.Node) -> Part:
        """Resolve a formula."""
        return self._formula(formula, False)

    @contextmanager
    def within(self, variables: Sequence[f.TypedName]) -> Iterator[tuple[Bound, ...]]:
        """Bind variables for the formulas of a block."""
        yield self.variables(variables)
        for variable in variables:
            self._scope[fold(variable.name)].pop()

    def atom(self, atom: f.Atom) -> AppliedTerms[PredicateDefinition]:
        """Resolve the atom of an effect."""
        return self._applied(self._predicate(atom), atom.terms)

    def fluent(self, fluent: f.Fluent) -> AppliedTerms[FunctionDefinition]:
        """Resolve the fluent of an effect."""
        return self._applied(self._function(fluent), fluent.terms)

    def _applied(self, definition: D, terms: Sequence[f.Term]) -> AppliedTerms[D]:
        needed = Needed([], [])
        places = self._terms(terms, definition.parameters, needed)
        return AppliedTerms(definition, places, needed)

    def assigned(
        self, value: f.Expression | f.Term, function: FunctionDefinition, needed: Needed
    ) -> Quantity | Place:
        """Resolve the assigned value of a fluent, and add the conditions of its terms."""
        if not function.type_ids:
            return self._expression(value, needed)
        assert isinstance(value, f.Variable | f.Constant | f.Fluent)
        return self._term(value, needed)

    def number(self, expression: f.Expression) -> tuple[Quantity, Needed]:
        """Resolve a number."""
        needed = Needed([], [])
        return self._expression(expression, needed), needed

    def allowed(self, slot: Slot) -> tuple[TypeSet, ...]:
        """Return the types that the atoms with a variable allow."""
        return tuple(self._allowed.get(slot, ()))

    def variables(self, variables: Iterable[f.TypedName]) -> tuple[Bound, ...]:
        """Make variables of declared types, and bind their names."""
        found = []
        for variable in variables:
            slot = self.slot()
            self.bind(variable.name, slot)
            types = self.types(variable.types)
            found.append(Bound(slot, () if types is None else (types,)))
        return tuple(found)

    def types(self, names: Iterable[str]) -> TypeSet:
        """Return the types whose objects fit types given by name."""
        named = self._definitions.types.named
        ids = [found.id for name in names if (found := named(name)) is not None]
        return closure(self._definitions, ids)

    def _formula(self, node: f.Node, negative: bool) -> Part:
        match node:
            case f.Not(inner):
                return self._formula(inner, not negative)
            case f.And(parts) | f.Or(parts):
                found = [self._formula(part, negative) for part in parts]
                return (all_of if isinstance(node, f.And) != negative else any_of)(found)
            case f.Imply(condition, formula):
                first = self._formula(condition, not negative)
                second = self._formula(formula, negative)
                return (all_of if negative else any_of)([first, second])
            case f.Exists(variables, formula) | f.Forall(variables, formula):
                is_universal = isinstance(node, f.Forall)
                with self.within(variables) as bound:
                    within = self._formula(formula, is_universal)
                witness: Part = FALSE if within == FALSE else Witness(bound, within)
                return negate(witness) if negative != is_universal else witness
            case f.Count():
                counted = self._count(node)
                return negate(counted) if negative else counted
        leaf = self._leaf(node)
        return negate(leaf) if negative else leaf

    def _count(self, node: f.Count) -> Part:
        """Resolve a count: no two objects, and at least one for `exactly-one`."""
        copies = []
        for _ in range(3):
            with self.within(node.variables) as bound:
                copies.append(Witness(bound, self._formula(node.formula, False)))
        first, second, any_ = copies
        pairs = zip(first.bound, second.bound, strict=True)
        differ = any_of([Lacks(SameObject(one.slot, other.slot)) for one, other in pairs])
        both = all_of([first.part, second.part, differ])
        most = Lacks(Witness((*first.bound, *second.bound), both))
        return most if node.operator == f.COUNTS[0] else all_of([any_, most])

    def _leaf(self, node: f.Node) -> Part:
        needed = Needed([], [])
        found: Part
        match node:
            case f.Atom(_, terms):
                predicate = self._predicate(node)
                found = HoldsFact(predicate.id, self._terms(terms, predicate.parameters, needed))
            case f.Equal(left, right):
                found = same(self._term(left, needed), self._term(right, needed))
            case f.Comparison(operator, first, second):
                least = self._expression(first, needed)
                found = Compares(operator, least, self._expression(second, needed))
            case f.Preference():
                # A preference is counted, not required.
                return TRUE
            case _:
                raise UnsupportedConstructError(
                    f"{node} is not a condition of one state; give a formula of atoms, "
                    "comparisons, and, or, not, imply, forall and exists"
                )
        if not needed.bound:
            return found
        return Witness(tuple(needed.bound), all_of([*needed.needed, found]))

    def _predicate(self, atom: f.Atom) -> PredicateDefinition:
        predicate = self._definitions.predicates.named(atom.predicate)
        if predicate is None:
            raise InvalidKnowledgeError(
                f"{atom} is of predicate {atom.predicate!r}, which is not known; save it first"
            )
        return predicate

    def _function(self, fluent: f.Fluent) -> FunctionDefinition:
        function = self._definitions.functions.named(fluent.function)
        if function is None:
            raise InvalidKnowledgeError(f"function {fluent.function!r} is not known")
        return function

    def _terms(
        self, terms: Sequence[f.Term], parameters: Sequence[ParameterDefinition], needed: Needed
    ) -> tuple[Place, ...]:
        places = tuple([self._term(term, needed) for term in terms])
        for place, parameter in zip(places, parameters, strict=True):
            types = closure(self._definitions, parameter.type_ids)
            # A variable is an argument, so its objects fit the parameter.
            if isinstance(place, Slot) and types is not None:
                self._allowed.setdefault(place, {})[types] = None
        return places

    def _term(self, term: f.Term, needed: Needed) -> Place:
        """Resolve a term; the value of a fluent becomes a variable of its own."""
        if isinstance(term, f.Fluent):
            function, slot = self._function(term), self.slot()
            places = self._terms(term.terms, function.parameters, needed)
            types = closure(self._definitions, function.type_ids)
            needed.bound.append(Bound(slot, () if types is None else (types,)))
            needed.needed.append(FluentIs(function.id, places, slot))
            return slot
        if isinstance(term, f.Constant):
            found = self._definitions.objects.named(term.name)
            if found is None:
                raise InvalidKnowledgeError(f"object {term.name!r} is not known; save it first")
            return Known(found.id)
        scope = self._scope.get(fold(term.name))
        if not scope:
            raise InvalidKnowledgeError(f"nothing binds the variable {term}")
        return scope[-1]

    def _expression(self, node: f.Expression | f.Term, needed: Needed) -> Quantity:
        match node:
            case f.Number(value):
                return value
            case f.Fluent(name, terms):
                function = self._definitions.functions.named(name)
                if function is None:
                    return Parameter(fold(name))
                places = self._terms(terms, function.parameters, needed)
                return NumberOf(function.id, places)
            case f.Arithmetic(operator, operands):
                found: list[Quantity] = []
                for operand in operands:
                    inner = self._expression(operand, needed)
                    if isinstance(inner, Operation) and inner.operator == operator in ("+", "*"):
                        found += inner.operands
                    else:
                        found.append(inner)
                return Operation(operator, tuple(found))
            case f.Variable(name):
                return Parameter(fold(name))
            case f.ContinuousTime():
                return Parameter("#t")
            case f.IsViolated(name):
                return Parameter(f"is-violated {fold(name)}")
        raise UnsupportedConstructError(f"{node} is not a number")


def check_levels(part: Part) -> None:
    """Refuse a condition that no database would evaluate."""
    levels = 0
    level: list[Any] = [part]
    while level:
        levels += 1
        level = [inner for outer in level for inner in inner_parts(outer)]
    if levels > MAX_LEVELS:
        raise UnsupportedConstructError(
            f"the condition is nested {levels} levels deep once it is simplified, and at most "
            f"{MAX_LEVELS} can be evaluated; ask for parts of it"
        )


def inner_parts(part: Any) -> Sequence[Any]:
    """Return the direct parts and numbers of a part or a number."""
    match part:
        case AllOf(parts) | OneOf(parts):
            return parts
        case Lacks(inner) | Witness(_, inner):
            return (inner,)
        case Compares(_, left, right):
            return left, right
        case Operation(_, operands):
            return operands
    return ()


def parts_of(part: Part | Quantity) -> Iterator[Any]:
    """Yield a part with all parts and numbers within it."""
    stack: list[Any] = [part]
    while stack:
        found = stack.pop()
        yield found
        stack += inner_parts(found)


def slots_of(part: Part) -> set[Slot]:
    """Return the free variables of a part."""
    found: set[Slot] = set()
    bound: set[Slot] = set()
    for inner in parts_of(part):
        match inner:
            case HoldsFact(_, terms) | NumberOf(_, terms):
                found.update(term for term in terms if isinstance(term, Slot))
            case FluentIs(_, terms, value):
                found.update(term for term in (*terms, value) if isinstance(term, Slot))
            case SameObject(left, right):
                found.update(term for term in (left, right) if isinstance(term, Slot))
            case HasType(term, _) if isinstance(term, Slot):
                found.add(term)
            case Witness(variables, _):
                bound.update(variable.slot for variable in variables)
    # No two variables share a number, so none is both free and bound.
    return found - bound


def resolve(
    definitions: Definitions, read: ReadCondition, given: Collection[str] = ()
) -> ResolvedCondition:
    """Resolve a condition; `given` variables, by folded name, get objects at each evaluation."""
    resolver = Resolver(definitions)
    variables = resolver.variables(read.free)
    part = resolver.part(read.formula)
    check_levels(part)
    if not read.are_declared:
        variables = tuple([Bound(one.slot, resolver.allowed(one.slot)) for one in variables])
    columns = [Column(one.name, own) for one, own in zip(read.free, variables, strict=True)]
    return ResolvedCondition(
        part,
        tuple(column for column in columns if fold(column.name) not in given),
        tuple(column for column in columns if fold(column.name) in given),
    )


def exists(condition: ResolvedCondition) -> Part:
    """Make the condition that a condition holds for some objects of its free variables."""
    if not condition.columns:
        return condition.part
    return Witness(tuple(column.bound for column in condition.columns), condition.part)


# Classes that `replaced` copies with their fields; all other values stay.
_COPIED = {*get_args(Part), NumberOf, Operation, Bound}


def replaced(part: Part, places: dict[Slot, Place], numbers: Iterator[int]) -> Part:
    """Copy a part, with given slots for some variables and new variables for those it binds."""
    made: Any = _replace(part, places, numbers)
    return made  # type: ignore[no-any-return]


def _replace(value: Any, places: dict[Slot, Place], numbers: Iterator[int]) -> Any:
    kind = type(value)
    if kind is Slot:
        return places.get(value, value)
    if kind is tuple:
        return tuple([_replace(one, places, numbers) for one in value])
    if kind not in _COPIED:
        return value
    if kind is Witness:
        places.update((each.slot, Slot(next(numbers))) for each in value.bound)
    return kind(*[_replace(getattr(value, name), places, numbers) for name in kind.__slots__])
