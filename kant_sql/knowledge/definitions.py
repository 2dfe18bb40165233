"""The definitions at one revision, in memory, by id and by name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import partial
from math import isqrt
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from ..dto.formulas import Node
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import StoreIntegrityError
from ..pddl.symbols import Ancestry
from .trees import ParameterDefinition, Tree


class Definition(Protocol):
    """A named element at one revision: immutable, equal when unchanged."""

    @property
    def id(self) -> int:
        """The id of the identity."""

    @property
    def name(self) -> str:
        """The first spelling of the name."""

    @property
    def text(self) -> str:
        """The canonical PDDL text."""


D = TypeVar("D", bound=Definition)
T = TypeVar("T")


class Elements(Generic[D]):
    """The live definitions of one kind of element, and all known ids of the kind.

    Threads share this snapshot; `evolve` makes the next one. Recent changes are separate from the
    bulk, so one change in a large knowledge base does not copy everything.
    """

    __slots__ = ("_base", "_delta", "ids")

    def __init__(
        self,
        ids: dict[str, int] | None = None,
        base: dict[int, D] | None = None,
        delta: dict[int, D | None] | None = None,
    ) -> None:
        # Folded name -> id. Identities are permanent, so all snapshots share one growing map.
        self.ids: dict[str, int] = {} if ids is None else ids
        self._base: dict[int, D] = base or {}
        self._delta: dict[int, D | None] = delta or {}

    def get(self, id_: int | None) -> D | None:
        """Return a live definition, by id."""
        if id_ in self._delta:
            return self._delta[id_]
        return self._base.get(id_)  # type: ignore[arg-type]

    def live(self, id_: int) -> D:
        """Return the definition of a live element."""
        definition = self.get(id_)
        if definition is None:
            raise StoreIntegrityError(
                f"element {id_} is referred to but not live; the tables were changed by hand"
            )
        return definition

    def named(self, name: str) -> D | None:
        """Return a live definition, by name in any spelling."""
        known = self.ids
        # Most are already folded.
        id_ = known.get(name) if type(name) is str else None
        return self.get(known.get(fold(name)) if id_ is None else id_)

    def __iter__(self) -> Iterator[D]:
        """Return the live definitions, in the order in which the elements were first known."""
        if not self._delta:
            live = list(self._base.values())
        else:
            merged: dict[int, D | None] = {**self._base, **self._delta}
            live = [definition for definition in merged.values() if definition is not None]
        return iter(sorted(live, key=lambda definition: definition.id))

    @property
    def is_blank(self) -> bool:
        """Whether no element of the kind is live, as far as a quick check can tell."""
        return not (self._base or self._delta)

    def evolve(self, changes: Mapping[int, D | None]) -> Elements[D]:
        """Make the snapshot that follows."""
        for definition in changes.values():
            if definition is not None:
                self.ids[fold(definition.name)] = definition.id
        return self._changed(changes)

    def _changed(self, changes: Mapping[int, D | None]) -> Elements[D]:
        if not changes:
            return self
        delta = {**self._delta, **changes}
        if len(delta) <= 64 + isqrt(len(self._base)):
            return Elements(self.ids, self._base, delta)
        base = dict(self._base)
        for id_, definition in delta.items():
            if definition is None:
                base.pop(id_, None)
            else:
                base[id_] = definition
        return Elements(self.ids, base)


class PendingElements(Elements[D]):
    """The definitions within a transaction: its changes on top of those at its start."""

    __slots__ = ("changes", "interned", "origin", "unwritten")

    def __init__(self, origin: Elements[D]) -> None:
        self.ids, self._base, self._delta = origin.ids, origin._base, origin._delta
        self.origin = origin
        self.changes: dict[int, D | None] = {}
        # Folded name -> id and first spelling of identities that the transaction looked up or
        # allocated; None for a name without identity. A rollback frees allocated ids.
        self.interned: dict[str, tuple[int, str] | None] = {}
        # Id -> name of identities without a row.
        self.unwritten: dict[int, str] = {}

    def get(self, id_: int | None) -> D | None:
        """Return a definition with its pending changes, by id."""
        for changes in (self.changes, self._delta):
            if id_ in changes:
                return changes[id_]
        return self._base.get(id_)  # type: ignore[arg-type]

    def named(self, name: str) -> D | None:
        """Return a definition with its pending changes, by name."""
        return self.get(self.id_of(name))

    def id_of(self, name: str) -> int | None:
        """Return the id of an element, also of a past or a pending one."""
        key = fold(name)
        id_ = self.ids.get(key)
        if id_ is None and (identity := self.interned.get(key)) is not None:
            return identity[0]
        return id_

    def __iter__(self) -> Iterator[D]:
        """Return the live definitions with their pending changes."""
        return iter(self.evolved())

    def evolved(self) -> Elements[D]:
        """Make the snapshot for after the commit."""
        return Elements(self.ids, self._base, self._delta)._changed(self.changes)

    def publish(self) -> Elements[D]:
        """Make the snapshot after the commit, with the allocated ids."""
        if not (self.interned or self.changes):
            return self.origin
        self.ids.update(
            (key, found[0])
            for key, found in self.interned.items()
            if found is not None and found[0] not in self.unwritten
        )
        return self.evolved()


class TypeDefinition(NamedTuple):
    """A type and its parents: none directly under the root, several for `either`."""

    id: int
    name: str
    parent_id: int | None
    other_parent_ids: tuple[int, ...] = ()
    text: str = ""

    @property
    def parent_ids(self) -> tuple[int, ...]:
        """All its parents; none directly under the root."""
        return () if self.parent_id is None else (self.parent_id, *self.other_parent_ids)


class ObjectDefinition(NamedTuple):
    """An object and its types, several for `either`; the domain declares constants."""

    id: int
    name: str
    type_id: int
    other_type_ids: tuple[int, ...] = ()
    is_constant: bool = False
    text: str = ""

    @property
    def type_ids(self) -> tuple[int, ...]:
        """All its types."""
        return (self.type_id, *self.other_type_ids)


class PredicateDefinition(NamedTuple):
    """A predicate and its parameters, in order."""

    id: int
    name: str
    parameters: tuple[ParameterDefinition, ...]
    text: str = ""


class FunctionDefinition(NamedTuple):
    """A function, its parameters, and the types of its values; no types for numbers."""

    id: int
    name: str
    parameters: tuple[ParameterDefinition, ...]
    type_ids: tuple[int, ...]
    text: str = ""


CONDITION, EFFECT, DURATION = "condition", "effect", "duration"


class ActionDefinition(NamedTuple):
    """An action, a process or an event (`kind`); its trees are conjunctions, or empty."""

    id: int
    name: str
    kind: str
    parameters: tuple[ParameterDefinition, ...]
    duration: Tree
    condition: Tree
    effect: Tree
    text: str = ""

    @property
    def trees(self) -> tuple[Tree, ...]:
        """All its trees."""
        return (self.duration, self.condition, self.effect)


DERIVED_PREDICATE, DOMAIN_CONSTRAINT = "derived", "domain constraint"
INITIAL, TIMED, GOAL, CONSTRAINT, METRIC = "initial", "timed", "goal", "constraint", "metric"
DOMAIN_SECTIONS = (DERIVED_PREDICATE, DOMAIN_CONSTRAINT)
PROBLEM_SECTIONS = (INITIAL, TIMED, GOAL, CONSTRAINT, METRIC)


class FormulaDefinition(NamedTuple):
    """A formula of a section of the domain or the problem; its name is its key, a SHA-256."""

    id: int
    name: str
    section: str
    tree: Tree
    text: str = ""


def formula_name(section: str, text: str) -> str:
    """Return the key of a formula."""
    return hashlib.sha256(f"{section}\n{text}".encode()).hexdigest()


REPORT, REFUSE = "report", "refuse"


class RuleDefinition(NamedTuple):
    """A kept rule, and its reaction to a violation: `report` or `refuse`."""

    id: int
    name: str
    on_violation: str
    constraint: Tree
    text: str = ""


DOMAIN, PROBLEM = "domain", "problem"


class Item(NamedTuple):
    """A place in a document: its section, and the element's name or a goal's ground atom."""

    section: str
    name: str


class DocumentDefinition(NamedTuple):
    """The domain, or the problem.

    Attributes:
        name: `domain` or `problem`.
        title: its name in PDDL.
        domain: the name of a problem's domain.
        items: its places, in order within each section.
        text: the whole document on one line.
    """

    id: int
    name: str
    title: str
    domain: str | None
    items: tuple[Item, ...]
    text: str = ""

    def names(self, section: str) -> Iterator[str]:
        """Return the names of one section, in order."""
        return (item.name for item in self.items if item.section == section)


# In the order of writing: each kind refers only to earlier ones. The others mention the declared
# kinds by name.
DECLARED = ("type", "object", "predicate", "function")
KINDS = (*DECLARED, "action", "formula", "rule", "document")
_ATTRIBUTES = tuple(f"{kind}s" for kind in KINDS)


class LiteralTemplate(NamedTuple):
    """A literal of an action, without the DTOs that differ by result.

    Attributes:
        terms: for each term the id of an object, or the complement of a parameter's position.
        time: the time of the literal; None in an instantaneous action.
    """

    predicate_id: int
    terms: tuple[int, ...]
    time: str | None
    is_negative: bool


class ActionTemplate(NamedTuple):
    """The content of an action's trees: reading these takes ten times as long as copying it."""

    definition: ActionDefinition
    duration: int | float | Decimal | tuple[Node, ...]
    conditions: tuple[LiteralTemplate | Node, ...]
    effects: tuple[LiteralTemplate | Node, ...]


class Definitions:
    """The definitions of one revision, as a snapshot that threads share.

    Attributes:
        templates: cache of the templates of actions by id, shared with later snapshots.
        guards: cache of the conditions that refusing rules forbid, shared with later snapshots.
        derived: cache of results that depend on this snapshot alone, by the function that computes
            them; a change within a transaction clears it.
        revision: a committed revision with these definitions, if known.
    """

    types: Elements[TypeDefinition]
    objects: Elements[ObjectDefinition]
    predicates: Elements[PredicateDefinition]
    functions: Elements[FunctionDefinition]
    actions: Elements[ActionDefinition]
    formulas: Elements[FormulaDefinition]
    rules: Elements[RuleDefinition]
    documents: Elements[DocumentDefinition]
    revision: int | None = None

    def __init__(self, *elements: Elements[Any]) -> None:
        self._ancestry: Ancestry[int] | None = None
        self.templates: dict[int, ActionTemplate] = {}
        self.guards: dict[Any, Any] = {}
        self.derived: dict[Any, Any] = {}
        given: Iterable[Elements[Any]] = elements or [Elements() for _ in KINDS]
        self._by_kind: dict[str, Any] = dict(zip(KINDS, given, strict=True))
        for name, of_kind in zip(_ATTRIBUTES, self._by_kind.values(), strict=True):
            setattr(self, name, of_kind)

    def elements(self, kind: str) -> Elements[Any]:
        """Return the elements of one kind."""
        elements: Elements[Any] = self._by_kind[kind]
        return elements

    def derive(self, compute: Callable[[Any], T]) -> T:
        """Return the result of a function of this snapshot, and cache it here."""
        if compute not in self.derived:
            self.derived[compute] = compute(self)
        found: T = self.derived[compute]
        return found

    def arguments(self, names: Iterable[str]) -> str | None:
        """Return the key of the arguments of a proposition or a fluent."""
        ids = []
        for name in names:
            object_ = self.objects.named(name)
            if object_ is None:
                return None
            ids.append(str(object_.id))
        return " ".join(ids)

    def names(self, arguments: str) -> list[str]:
        """Return the names of the objects in a key of arguments."""
        return [self.objects.live(int(id_)).name for id_ in arguments.split()]

    def ancestry(self, type_id: int) -> Iterator[TypeDefinition]:
        """Yield a type and all its supertypes."""
        pending, seen = [type_id], {type_id}
        while pending:
            definition = self.types.get(pending.pop(0))
            if definition is not None:
                yield definition
                above = [id_ for id_ in definition.parent_ids if id_ not in seen]
                seen.update(above)
                pending += above

    def is_root(self, type_id: int) -> bool:
        """Return whether a type is `object`, the root of all types (PDDL 2.1, appendix A)."""
        definition = self.types.get(type_id)
        return definition is not None and fold(definition.name) == ROOT_TYPE

    def fits(self, type_id: int, allowed: Iterable[int]) -> bool:
        """Return whether an object of a type fits a parameter."""
        return any(
            type_id == wanted or self.is_root(wanted) or self._hierarchy().is_below(type_id, wanted)
            for wanted in allowed
        )

    def _hierarchy(self) -> Ancestry[int]:
        """Return the index of the type hierarchy."""
        found = self._ancestry
        if found is None:
            # Snapshots share it, so it refers to the types only.
            found = self._ancestry = Ancestry(partial(_parents, self.types))
        return found

    def any_fits(self, type_ids: Iterable[int], allowed: Iterable[int]) -> bool:
        """Return whether one of some types fits a parameter."""
        return any(self.fits(type_id, allowed) for type_id in type_ids)

    def admits(self, owner: PredicateDefinition | FunctionDefinition, ids: Sequence[int]) -> bool:
        """Return whether objects fit the parameters, then the value if it is an object."""
        wanted = [parameter.type_ids for parameter in owner.parameters]
        if isinstance(owner, FunctionDefinition) and owner.type_ids:
            wanted.append(owner.type_ids)
        return len(ids) == len(wanted) and all(
            self.any_fits(self.objects.live(id_).type_ids, allowed)
            for id_, allowed in zip(ids, wanted, strict=True)
        )

    def subtypes(self, *type_ids: int) -> set[int]:
        """Return types and all their subtypes."""
        children: dict[int, list[int]] = {}
        for definition in self.types:
            for parent_id in definition.parent_ids:
                children.setdefault(parent_id, []).append(definition.id)
        found: set[int] = set()
        pending = list(type_ids)
        while pending:
            current = pending.pop()
            if current not in found:
                found.add(current)
                pending.extend(children.get(current, ()))
        return found


def _parents(types: Elements[TypeDefinition], type_id: int) -> tuple[int, ...]:
    definition = types.get(type_id)
    return () if definition is None else definition.parent_ids


class PendingDefinitions(Definitions):
    """The definitions within a transaction; `origin` has those at its start."""

    def __init__(self, origin: Definitions) -> None:
        # Most transactions use few kinds, so each is made on first use.
        self.origin = origin
        self._by_kind = {}
        self._ancestry = None
        self.templates = origin.templates
        self.guards = origin.guards
        self.derived = {}

    def __getattr__(self, name: str) -> Any:
        if name not in _ATTRIBUTES:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return self.elements(name[:-1])

    def current(self) -> Definitions:
        """Return the present definitions, for immediate use: they may lack later changes."""
        used = self._by_kind
        return self if used and any(each.changes for each in used.values()) else self.origin

    def elements(self, kind: str) -> PendingElements[Any]:
        """Return the elements of one kind, with their changes."""
        elements: PendingElements[Any] | None = self._by_kind.get(kind)
        if elements is None:
            elements = self._by_kind[kind] = PendingElements(self.origin.elements(kind))
            setattr(self, f"{kind}s", elements)
        return elements

    def _hierarchy(self) -> Ancestry[int]:
        """Return the index of the type hierarchy: the origin's until a type changes."""
        types = self._by_kind.get("type")
        return super()._hierarchy() if types and types.changes else self.origin._hierarchy()

    def reshape(self, new_type: int | None = None) -> None:
        """Clear the index of the type hierarchy, and derived results, before a change."""
        if self._ancestry is not None and new_type is not None:
            self._ancestry.forget(new_type)
        else:
            self._ancestry = None
        self.derived.clear()

    def publish(self) -> Definitions:
        """Make the snapshot after the commit."""
        used, origin = self._by_kind, self.origin
        made = Definitions(
            *[used[kind].publish() if kind in used else origin.elements(kind) for kind in KINDS]
        )
        made.templates, made.guards = self.templates, self.guards
        if "type" not in used or not used["type"].changes:
            made._ancestry = origin._hierarchy()
        return made
