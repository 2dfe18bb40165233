"""The names that formulas may use, and the hierarchy of their types."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from enum import Enum
from graphlib import CycleError, TopologicalSorter
from typing import Generic, NamedTuple, TypeVar

from ..dto.formulas import Atom, Constant, Formula, Preference, Term, TypedName, Variable, walk
from ..dto.lexical import ROOT_TYPE, fold, is_name
from .document import Domain, Function, Predicate, formulas

Types = tuple[str, ...]
K = TypeVar("K", bound=Hashable)


class Fit(Enum):
    """Whether an argument of some types fits a parameter of some types."""

    YES = "yes"
    # The argument's type is a supertype of the parameter's: some of its objects fit.
    PERHAPS = "perhaps"
    NO = "no"


class _Place(NamedTuple, Generic[K]):
    """The place of a type: its distance from a root along first parents, and its ancestors."""

    depth: int
    parent: K | None
    # An ancestor, chosen to make each level reachable in logarithmically many steps.
    jump: K
    # The nearest type with several parents along first parents, itself included.
    fork: K | None


class Ancestry(Generic[K]):
    """The subtype relation; the cost of a check is logarithmic in the levels between two types.

    Each type knows its parent and a jump to an ancestor (E. W. Myers, An applicative random-access
    stack, 1983). A type with several parents continues at each of them, so a check costs a step for
    each such ancestor.
    """

    __slots__ = ("_parents", "_places")

    def __init__(self, parents: Callable[[K], Sequence[K]]) -> None:
        self._parents = parents  # returns the parents of a type, which must not change afterwards
        self._places: dict[K, _Place[K]] = {}

    def is_below(self, lower: K, upper: K) -> bool:
        """Return whether a type equals another or is a subtype of it."""
        depth = self._place(upper).depth
        pending, seen = [lower], {lower}
        while pending:
            current = pending.pop()
            if self._is_on_path(current, upper, depth):
                return True
            fork = self._place(current).fork
            while fork is not None:
                others = self._parents(fork)[1:]
                if fork != current and fork in seen:
                    break
                seen.add(fork)
                pending += [other for other in others if other not in seen]
                seen.update(others)
                parent = self._places[fork].parent
                fork = None if parent is None else self._places[parent].fork
        return False

    def forget(self, type_: K) -> None:
        """Forget the place of a new type, which has no subtypes yet."""
        self._places.pop(type_, None)

    def _is_on_path(self, type_: K, upper: K, depth: int) -> bool:
        """Return whether a type, at a depth, is another or above it along first parents."""
        place = self._place(type_)
        while place.depth > depth:
            above = self._places[place.jump]
            if above.depth >= depth:
                type_ = place.jump
            elif place.parent is not None:
                type_ = place.parent
            place = self._places[type_]
        return type_ == upper

    def _place(self, type_: K) -> _Place[K]:
        found = self._places.get(type_)
        if found is not None:
            return found
        path: dict[K, Sequence[K]] = {}
        current: K | None = type_
        while current is not None and current not in self._places:
            above = path[current] = self._parents(current)
            # Only damaged tables have cycles.
            current = above[0] if above and above[0] not in path else None
        for one in reversed(path):
            self._places[one] = self._below(one, current, path[one])
            current = one
        return self._places[type_]

    def _below(self, type_: K, parent: K | None, parents: Sequence[K]) -> _Place[K]:
        if parent is None:
            return _Place(0, None, type_, type_ if len(parents) > 1 else None)
        above = self._places[parent]
        jump = self._places[above.jump]
        is_equal = above.depth - jump.depth == jump.depth - self._places[jump.jump].depth
        fork = type_ if len(parents) > 1 else above.fork
        return _Place(above.depth + 1, parent, jump.jump if is_equal else parent, fork)


def find_cycle(parents: Mapping[str, Types]) -> str | None:
    """Return a type that is its own ancestor, or None."""
    try:
        TopologicalSorter(parents).prepare()
    except CycleError as error:
        cycle: list[str] = error.args[1]
        return cycle[0]
    return None


# A term and the types of the object that it denotes.
Entity = tuple[Term, Types]
ANY: Types = (ROOT_TYPE,)


class Signature:
    """A predicate or a function, as readers need it."""

    __slots__ = ("accepted", "bare", "name", "parameters", "types")

    def __init__(self, name: str, parameters: tuple[Types, ...] | None, types: Types = ()) -> None:
        self.name = name
        self.parameters = parameters  # the types of its parameters; None if they are unknown
        # For each parameter, its types, and the types of arguments that fit it.
        self.accepted: tuple[tuple[Types, set[Types]], ...] = tuple(
            [(wanted, {wanted}) for wanted in parameters or ()]
        )
        # The types of a function's values; empty for numbers and for a predicate.
        self.types = types
        self.bare = Atom(name)  # the atom without arguments


class Signatures:
    """The signatures of the predicates, or of the functions, by name; `kind` is for messages."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._found: dict[str, Signature] = {}

    def declare(self, element: Predicate | Function) -> None:
        """Add a declaration."""
        types = element.types if isinstance(element, Function) else ()
        parameters = tuple([parameter.types for parameter in element.parameters])
        self.add(Signature(element.name, parameters, types))

    def add(self, signature: Signature) -> None:
        """Add a signature."""
        self._found[signature.name] = self._found[fold(signature.name)] = signature

    def find(self, name: str) -> Signature | None:
        """Look up a name."""
        found = self._found.get(name)
        if found is None:
            found = self._found.get(fold(name))
            if found is not None:
                self._found[name] = found
        return found

    def names(self) -> list[str]:
        """Return the names, as declared."""
        return list({fold(one.name): one.name for one in self._found.values()}.values())

    def longest(self) -> int:
        """Return the maximum number of parameters."""
        return max((len(one.accepted) for one in self._found.values()), default=0)


class BoundVariable(NamedTuple):
    """A variable in scope: its declaration, its folded name with `?`, and its entity."""

    declared: TypedName
    key: str
    entity: Entity


# The meaning of the word after a parenthesis: a predicate, or the reader's method for an operator.
Head = Signature | Callable[..., Formula]


class SymbolTable:
    """The names that formulas may use."""

    def __init__(self, unknown_domain: bool = False) -> None:
        # Whether there is no domain, so undeclared names are accepted.
        self.unknown_domain = unknown_domain
        self.grows = False  # whether undeclared types are added, as in a domain
        # The declared spelling of each type, by folded name.
        self.types: dict[str, str] = {ROOT_TYPE: ROOT_TYPE}
        # Cache of the declared spelling of each list of types.
        self.resolved: dict[Types, Types] = {}
        self.parents: dict[str, Types] = {}  # the supertypes of each type
        self.predicates = Signatures("predicate")
        self.functions = Signatures("function")
        self.objects: dict[str, Entity] = {}  # cache of constants and objects, by spelling
        self.preferences: dict[str, str] = {}  # the names of preferences, by folded name
        self._domain: Domain | None = None
        # Cache of the heads of conditions, by spelling; `effect_heads` those of effects.
        self.heads: dict[str, Head] = {}
        self.effect_heads: dict[str, Head] = {}
        self._bound: dict[tuple[str, Types], BoundVariable] = {}
        self._declared_objects: dict[str, Entity] = {}
        self._fits: dict[tuple[Types, Types], Fit] = {}
        self._ancestry: Ancestry[str] = Ancestry(lambda type_: self.parents.get(type_, ()))

    @classmethod
    def of_domain(cls, domain: Domain) -> SymbolTable:
        """Make the symbol table of a domain."""
        symbols = cls()
        symbols._domain = domain
        symbols.add_types(domain.types)
        for constant in domain.constants:
            symbols.add_object(constant)
        for predicate in domain.predicates:
            symbols.predicates.declare(predicate)
        for function in domain.functions:
            symbols.functions.declare(function)
        return symbols

    def add_types(self, types: Iterable[TypedName]) -> None:
        """Declare types."""
        for type_ in types:
            self.types[fold(type_.name)] = type_.name
            self.parents[type_.name] = type_.types

    def add_object(self, item: TypedName) -> None:
        """Declare a constant or an object."""
        entity = (Constant(item.name), item.types)
        self._declared_objects[fold(item.name)] = entity
        self.objects[item.name] = entity

    def bound(self, word: str, types: Types) -> BoundVariable:
        """Return a variable with its types."""
        found = self._bound.get((word, types))
        if found is None:
            name = word[1:]
            entity = (Variable(name), types)
            found = BoundVariable(TypedName(name, types), fold(word), entity)
            self._bound[word, types] = found
        return found

    def preference(self, name: str) -> str | None:
        """Look up a preference."""
        if self._domain is not None and fold(name) not in self.preferences:
            # Only a metric needs the preferences of the domain, so they are found on demand.
            for node in walk(*formulas(self._domain)):
                if isinstance(node, Preference) and node.name is not None:
                    self.preferences.setdefault(fold(node.name), node.name)
            self._domain = None
        return self.preferences.get(fold(name))

    def object(self, name: str) -> Entity | None:
        """Look up a constant or an object."""
        found = self.objects.get(name)
        if found is None:
            found = self._declared_objects.get(fold(name))
            if found is None and self.unknown_domain and is_name(name, "object"):
                found = self._declared_objects[fold(name)] = (Constant(name), ANY)
            if found is not None:
                self.objects[name] = found
        return found

    def is_object(self, name: str) -> bool:
        """Return whether a constant or an object is declared."""
        return name in self.objects or fold(name) in self._declared_objects

    def object_names(self) -> list[str]:
        """Return the names of constants and objects, as declared."""
        return [str(term) for term, _ in self._declared_objects.values()]

    def fit(self, given: Types, wanted: Types) -> Fit:
        """Return whether an argument fits a parameter."""
        found = self._fits.get((given, wanted))
        if found is None:
            found = Fit.NO
            if ROOT_TYPE in wanted or self._is_below(given, wanted):
                found = Fit.YES
            elif ROOT_TYPE in given or self._is_below(wanted, given):
                found = Fit.PERHAPS
            self._fits[given, wanted] = found
        return found

    def _is_below(self, lower: Types, upper: Types) -> bool:
        """Return whether one of some types equals one of others or is a subtype of it."""
        is_below = self._ancestry.is_below
        if not set(lower).isdisjoint(upper):
            return True
        return any(is_below(one, other) for one in lower for other in upper)
