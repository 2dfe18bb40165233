"""From the names in a problem to the ids of what they name, for very many facts and values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import NamedTuple

from ..atoms import AtomKey
from ..dto.formula import Atom, Constant, Number
from ..dto.number import decimal_text
from ..fluents import FluentKey, FluentValue
from ..knowledge.definitions import Definitions
from ..pddl.document import FunctionValue
from ..transaction import Transaction

_NAME = attrgetter("name")


class _Head(NamedTuple):
    """A predicate or a function: its id, and the name that its declaration gives it."""

    id: int
    name: str


class Named(NamedTuple):
    """Ground atoms as the store knows them.

    Attributes:
        texts: what makes each the one that it is, with its canonical PDDL text.
        old: those that may have been known before; the others mention what is new.
    """

    texts: dict[AtomKey, str]
    old: list[AtomKey]


class NamedValues(NamedTuple):
    """Fluents and their values as the store knows them.

    Attributes:
        entries: what makes each fluent the one that it is, its canonical PDDL text without the
            value, and the value.
        old: those that may have been known before; the others mention what is new.
    """

    entries: list[tuple[FluentKey, str, FluentValue]]
    old: list[FluentKey]


class Names:
    """From names in a consistent document to ids; a document has each name in one spelling."""

    def __init__(self, transaction: Transaction) -> None:
        """Make it for one problem, whose objects are defined by now.

        Args:
            transaction: the transaction.
        """
        definitions, next_id = transaction.definitions, transaction.head.next_id
        self._definitions: Definitions = definitions
        self._predicates: dict[str, _Head] = {}
        self._functions: dict[str, _Head] = {}
        # By the address of a number, which the document keeps: equal numbers may be spelled apart.
        self._numbers: dict[int, FluentValue] = {}
        self._ids = {object_.name: str(object_.id) for object_ in definitions.objects}
        # The objects of which nothing can be known yet, for they are new themselves.
        self._new: frozenset[str] = frozenset()
        if transaction.is_stateless:
            self._new = frozenset(id_ for id_ in self._ids.values() if int(id_) >= next_id)

    def atoms(self, atoms: Iterable[Atom], is_goal: bool) -> Named:
        """Find what makes ground atoms the ones that they are.

        Args:
            atoms: the atoms.
            is_goal: whether they are goals rather than facts.

        Returns:
            The atoms, each once.
        """
        texts: dict[AtomKey, str] = {}
        old: list[AtomKey] = []
        is_old, find = self._new.isdisjoint, self._arguments
        for atom in atoms:
            head = self._predicates.get(atom.predicate) or self._predicate(atom.predicate)
            ids, names = find(atom.terms)
            key = AtomKey(is_goal, head.id, " ".join(ids))
            texts[key] = f"({head.name} {' '.join(names)})" if names else f"({head.name})"
            # A document has each fact once, but maybe not each goal.
            if is_goal or is_old(ids):
                old.append(key)
        return Named(texts, old)

    def values(self, values: Iterable[FunctionValue]) -> NamedValues:
        """Find what makes fluents the ones that they are.

        Args:
            values: the fluents with their values.

        Returns:
            The fluents with their values.
        """
        made = NamedValues([], [])
        for fluent, value in values:
            head = self._functions.get(fluent.function) or self._function(fluent.function)
            ids, names = self._arguments(fluent.terms)
            text = f"({head.name} {' '.join(names)})" if names else f"({head.name})"
            held = self._numbers.get(id(value)) or self._value(value)
            key = FluentKey(head.id, " ".join(ids))
            made.entries.append((key, text, held))
            if self._new.isdisjoint(ids):
                made.old.append(key)
        return made

    def _arguments(self, terms: Sequence[object]) -> tuple[list[str], list[str]]:
        names: list[str] = [*map(_NAME, terms)]
        try:
            return [*map(self._ids.__getitem__, names)], names
        except KeyError:
            # The store had the object before, in another spelling.
            found = [self._object(name) for name in names]
            return [id_ for id_, _ in found], [name for _, name in found]

    def _object(self, name: str) -> tuple[str, str]:
        object_ = self._definitions.objects.named(name)
        assert object_ is not None
        return str(object_.id), object_.name

    def _predicate(self, name: str) -> _Head:
        predicate = self._definitions.predicates.named(name)
        assert predicate is not None
        head = self._predicates[name] = _Head(predicate.id, predicate.name)
        return head

    def _function(self, name: str) -> _Head:
        function = self._definitions.functions.named(name)
        assert function is not None
        head = self._functions[name] = _Head(function.id, function.name)
        return head

    def _value(self, value: Number | Constant) -> FluentValue:
        if isinstance(value, Constant):
            id_, name = self._object(value.name)
            return FluentValue(name, int(id_))
        held = self._numbers[id(value)] = FluentValue(decimal_text(value.value))
        return held
