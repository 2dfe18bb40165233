"""The ledger of intervals: the changes of a transaction in one version table.

A row of a version table is an interval from one revision until another. In one revision an element
can be asserted and retracted many times; the ledger keeps the versions before, the present ones,
and those in the tables, and writes the difference with at most four statements: close earlier
versions, delete versions of this revision, reopen versions that it closed, insert new ones.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from ..dto.elements import value_text
from ..dto.lexical import fold, is_word
from ..knowledge.atoms import AtomKey, FluentKey, FluentValue, GroundAtom, GroundFluent, HeldValue
from ..knowledge.definitions import Definition, Definitions, PendingElements
from ..knowledge.sayings import Period
from ..sql.changes import ASSERTED, RETRACTED, SAYING, Change
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Row, Session
from ..sql.executions import (
    EXECUTION,
    NEW_ARGUMENT,
    NEW_EXECUTION,
    NEW_OUTCOME,
    NO_PLAN,
    STATEMENTS,
    ExecutionDefinition,
    Key,
    OutcomeDefinition,
    argument_rows,
    execution_row,
    outcome_text,
)
from ..sql.executions import FIND as FIND_EXECUTION
from ..sql.intervals import (
    CLOSED_HERE,
    FACT_SAYINGS,
    FIND,
    FIND_VALUE,
    HOLDS_NOW,
    OPEN,
    OPEN_VALUE,
    VALUE_SAYINGS,
    VALUE_VERSIONS,
    VERSIONS,
    SayingTable,
    fork_of_period,
)
from ..sql.query import IdsQuery, Insert, whole_rows
from ..sql.rows import (
    ATOM_TABLES,
    FACT,
    GOAL,
    KIND_TABLES,
    PROPOSITION,
    VALUE,
    RowsByTable,
    VersionTable,
)
from .caches import InternCache
from .head import Head
from .journal import Journal

K = TypeVar("K")
V = TypeVar("V")


class WriteContext:
    """The parts of a transaction that its ledgers need.

    `head` is the locked row, `number` the new revision, `period` the valid period of the
    transaction (None: from now on), and `says` whether writes are sayings about it.
    """

    __slots__ = ("head", "journal", "kb_id", "next_id", "number", "period", "says", "session")

    def __init__(
        self, session: Session, kb_id: int, head: Head, period: Period | None = None
    ) -> None:
        self.session = session
        self.kb_id = kb_id
        self.head = head
        self.period = period
        self.says = period is not None
        self.number = head.revision + 1
        self.next_id = head.next_id
        self.journal = Journal(session)

    def allocate(self, number: int) -> range:
        """Allocate the next ids."""
        first = self.next_id
        self.next_id = first + number
        return range(first, first + number)

    def reserve(self, ids: Iterable[int]) -> None:
        """Allocate no id that another knowledge base has assigned."""
        self.next_id = max(self.next_id, 1 + max(ids, default=0))


class PendingChanges(ABC):
    """The changes of a transaction to one kind of knowledge; `pending` is not written yet."""

    defines: ClassVar[bool] = False
    pending: dict[Any, Any]

    @abstractmethod
    def lines(self) -> list[Change]:
        """Return the changes of the revision, if none were forgotten."""

    @abstractmethod
    def write(self) -> None:
        """Write pending changes."""


class Ledger(PendingChanges, Generic[K, V]):
    """The changes of a transaction in one version table: key -> the open version or None."""

    versions: VersionTable

    def __init__(
        self,
        context: WriteContext,
        origin: Callable[[K], V | None],
        changes: dict[K, V | None] | None = None,
        *tables: dict[Any, Any],
    ) -> None:
        self.context = context
        self.changes: dict[K, V | None] = {} if changes is None else changes
        self.pending: dict[K, None] = {}
        # The versions before the revision; and those in the tables, if different.
        self._origin = origin
        self._written: dict[K, V | None] = {}
        self.assign = context.journal.assign
        context.journal.track(self.changes, self.pending, self._written, *tables)

    def now(self, key: K) -> V | None:
        """Return the present versions, with changes so far."""
        return self.changes[key] if key in self.changes else self._origin(key)

    def put(self, key: K, value: V | None) -> None:
        """Set the version from this revision on; None for no version."""
        self.assign(self.changes, key, value)
        self.assign(self.pending, key, None)

    def lines(self) -> list[Change]:
        """Return the changes of the revision: one line for each end of an interval."""
        lines = []
        for key, before, now in self.differences():
            if before is not None:
                lines.append(Change(RETRACTED, *self._line(key, before)))
            if now is not None:
                lines.append(Change(ASSERTED, *self._line(key, now)))
        return lines

    def differences(self) -> Iterator[tuple[K, V | None, V | None]]:
        """Yield the earlier and the present version of each key, if they differ."""
        for key, now in self.changes.items():
            before = self._origin(key)
            if now != before:
                yield key, before, now

    def write(self) -> None:
        """Write pending changes."""
        self._write_identities()
        closed, unmade, reopened, opened = self._unwritten()
        self.pending.clear()
        if closed:
            self._run(self.versions.close, closed)
        if unmade:
            for statement in self.versions.unmake:
                self._run(statement, unmade)
        if reopened:
            self._run(self.versions.reopen, reopened)
        if opened:
            for into, rows in self._rows(opened):
                self.context.session.insert(into, rows)

    def _unwritten(self) -> tuple[list[K], list[K], list[K], list[tuple[K, V]]]:
        """Return the versions to close, delete, reopen and insert to update the tables."""
        closed: list[K] = []
        unmade: list[K] = []
        reopened: list[K] = []
        opened: list[tuple[K, V]] = []
        changes, written, origin = self.changes, self._written, self._origin
        for key in self.pending:
            now, first = changes[key], origin(key)
            before = written.get(key, first)
            if now == before:
                continue
            if before is not None:
                (closed if before == first else unmade).append(key)
            if now is not None:
                if now == first:
                    reopened.append(key)
                else:
                    opened.append((key, now))
            written[key] = now
        return closed, unmade, reopened, opened

    def _run(self, statement: IdsQuery, keys: list[K]) -> None:
        ids: Any = keys
        self.context.session.run_for(statement, ids, kb=self.context.kb_id, at=self.context.number)

    def _write_identities(self) -> None:
        """Write the identities made since the last write."""

    @abstractmethod
    def _line(self, key: K, value: V) -> tuple[str, str]:
        """Return the kind and the canonical text of a version."""

    @abstractmethod
    def _rows(self, opened: list[tuple[K, V]]) -> Iterable[tuple[Insert, list[Row]]]:
        """Return the rows of versions that begin with this revision, parents first."""


# An interned proposition or fluent; its key ends with the ids of its arguments.
I = TypeVar("I", bound="GroundAtom | GroundFluent")  # noqa: E741


# The text of the last saying, and its number.
_UNSAID: Row = (None, None)


class NewSaying(NamedTuple):
    """A saying about an element: its text, and the columns of its row after the keys."""

    text: str
    columns: Row


class SayingLedger(Ledger[int, NewSaying]):
    """The sayings of a transaction about its period, or several periods: one for each element."""

    versions: SayingTable

    def __init__(self, context: WriteContext, tables: SayingTable, period: Period) -> None:
        super().__init__(context, lambda _: None)
        self.versions = tables
        self._last: dict[int, Row] = {}
        self._was_spilled = False
        self.turn_to(period)

    def turn_to(self, period: Period) -> None:
        """Set the period of further sayings."""
        self.period = period
        times = map(self.context.session.from_time, period[:2])
        self._ends: Row = (*times, fork_of_period(*period[:2]))

    def load(self, ids: Iterable[int]) -> None:
        """Read the last earlier saying about each of some elements, in one statement."""
        unknown = [id_ for id_ in ids if id_ not in self._last]
        if unknown:
            context, session = self.context, self.context.session
            ids = session.list_value(unknown)
            found = session.rows(self.versions.last, kb=context.kb_id, ids=ids, at=context.number)
            self._last.update((row[0], row[1:]) for row in found)

    def last(self, id_: int) -> Row:
        """Return the text of the last saying about an element, and its number as text."""
        if id_ not in self._last:
            self.load((id_,))
        return self._last[id_]

    def note_new(self, ids: Iterable[int]) -> None:
        """Note that some elements have no sayings."""
        self._last.update(dict.fromkeys(ids, _UNSAID))

    def say(self, id_: int, columns: Row, text: str) -> bool:
        """Add a saying about an element; return whether it is new."""
        columns = (*self._ends, text, *columns)
        said = None if self.last(id_)[0] == text else NewSaying(text, columns)
        if said == self.now(id_):
            return False
        self.put(id_, said)
        return True

    def forget(self) -> None:
        """Forget written changes, to bound memory; the tables have them."""
        self._was_spilled = True
        for table in (self._last, self.changes, self._written):
            table.clear()

    def _unwritten(self) -> tuple[list[int], list[int], list[int], list[tuple[int, NewSaying]]]:
        every = [*self.pending] if self._was_spilled else []
        closed, unmade, reopened, opened = super()._unwritten()
        return closed, every or unmade, reopened, opened

    def _line(self, key: int, value: NewSaying) -> tuple[str, str]:
        return SAYING, value.text

    def _rows(self, opened: list[tuple[int, NewSaying]]) -> Iterable[tuple[Insert, list[Row]]]:
        kb, number = self.context.kb_id, self.context.number
        rows = [(kb, id_, number, *said.columns) for id_, said in opened]
        return ((self.versions.new, rows),)


class InternedLedger(Ledger[int, V], Generic[I, V]):
    """The ledger of elements identified by their arguments: ground atoms and fluents."""

    identity: ClassVar[type[Any]]
    # The columns of an identity: the id, the parts of the key, the text.
    new_identity: ClassVar[Insert]
    new_argument: ClassVar[Insert]
    new_version: ClassVar[Insert]
    said_in: ClassVar[SayingTable]

    def __init__(self, context: WriteContext, cache: InternCache[Any, I, V | None]) -> None:
        period = context.period
        self.sayings = None if period is None else SayingLedger(context, self.said_in, period)
        self._before: dict[int, V | None] = {}
        self._known: dict[Any, I] = {}
        self._new: dict[int, I] = {}
        super().__init__(context, self._before.get, None, self._before, self._known, self._new)
        self._cache = cache
        self._cached = cache.at(context.head.revision)
        self.was_spilled = False

    @property
    def is_untouched(self) -> bool:
        """Whether the transaction has used no element so far."""
        return not (self.was_spilled or self._known)

    def find(self, keys: Collection[Any]) -> dict[Any, I]:
        """Find identities, with one statement for each predicate or function at most."""
        found: dict[Any, I] = {}
        missing: dict[Any, list[str]] = {}
        known, cached = self._known, self._cache.identities
        for key in keys:
            identity = known.get(key) or cached.get(key)
            if identity is not None:
                found[key] = identity
            # New elements of this transaction are not stored unless it has spilled.
            elif self.was_spilled or key[-2] < self.context.head.next_id:
                missing.setdefault(key[:-1], []).append(key[-1])
        for group, arguments in missing.items():
            for identity, value in self._find(group, arguments):
                found[identity.key] = self.know(identity)
                if not self.was_spilled and identity.id not in self._before:
                    self.assign(self._before, identity.id, value)
        return found

    def find_one(self, key: Any) -> I | None:
        """Find an identity; None also for the key None."""
        return None if key is None else self.find((key,)).get(key)

    def find_or_say(self, key: Any, definitions: Definitions) -> I | None:
        """Find an identity; make it for a saying that the element did not hold in a period."""
        if key is None:
            return None
        found = self.find((key,)).get(key)
        if found is None and self.context.says:
            found = self.intern({key: key.text(definitions)})[key]
        return found

    def know(self, identity: I) -> I:
        """Keep an identity for the rest of the transaction."""
        self.assign(self._known, identity.key, identity)
        return identity

    def load(self, identities: Iterable[I]) -> None:
        """Read the versions of some elements, in one or two statements for all of them."""
        unknown: dict[int, I] = {}
        before, cached = self._before, self._cached
        for identity in identities:
            id_ = identity.id
            if id_ not in before:
                if id_ in cached and not self.was_spilled:
                    self.assign(before, id_, cached[id_])
                else:
                    unknown[id_] = identity
        if unknown:
            self._read(unknown)

    def value_of(self, identity: I) -> V | None:
        """Return the version of an element, with changes so far."""
        id_ = identity.id
        if id_ in self.changes:
            return self.changes[id_]
        if id_ not in self._before:
            self.load((identity,))
            return self.now(id_)
        return self._before[id_]

    def note(self, before: Mapping[int, V | None]) -> None:
        """Keep the stored versions of elements that the transaction has not touched."""
        self._before.update(before)

    def forget(self) -> None:
        """Forget written changes, to bound memory; the tables have them."""
        self.was_spilled = True
        for table in (self._known, self._new, self._before, self.changes, self._written):
            table.clear()
        if self.sayings is not None:
            self.sayings.forget()

    def intern(self, texts: Mapping[Any, str]) -> dict[Any, I]:
        """Find the identities of elements, or make them."""
        found = self.find(texts)
        new = [key for key in texts if key not in found]
        ids = self.context.allocate(len(new))
        made = {id_: self.identity(id_, key, texts[key]) for id_, key in zip(ids, new, strict=True)}
        self._add(made, dict.fromkeys(made))
        return found | {each.key: each for each in made.values()}

    def say_all(self, period: Period, said: Mapping[Any, tuple[str, Any]]) -> None:
        """Add sayings about a period, one of several: key -> the text and the value."""
        if self.sayings is None:
            self.sayings = SayingLedger(self.context, self.said_in, period)
        self.sayings.turn_to(period)
        found = self.intern({key: text for key, (text, _) in said.items()})
        self.sayings.load([each.id for each in found.values()])
        for key, each in found.items():
            self._say(self.sayings, each, said[key][1])

    def _add_new(self, identities: dict[int, I], values: dict[int, V | None]) -> None:
        """Assert new elements, in the period of the transaction if any."""
        sayings = self.sayings
        if sayings is None or not self.context.says:
            self._add(identities, values)
            return
        self._add(identities, values if sayings.period.is_open else dict.fromkeys(identities))
        sayings.note_new(identities)
        for id_, identity in identities.items():
            self._say(sayings, identity, values[id_])

    def _speak(self, identity: I, value: V | None) -> tuple[bool, bool]:
        """Add a saying about the period; return whether it is new, and whether it is all."""
        assert self.sayings is not None
        return self._say(self.sayings, identity, value), not self.sayings.period.is_open

    @abstractmethod
    def _say(self, sayings: SayingLedger, identity: I, value: V | None) -> bool:
        """Add a saying about the period; return whether it is new."""

    def _add(self, identities: dict[int, I], values: dict[int, V | None]) -> None:
        """Assert new elements; with the value None, only make their identities."""
        assign_all = self.context.journal.assign_all
        assign_all(self._known, {each.key: each for each in identities.values()})
        assign_all(self._new, identities)
        assign_all(self._before, dict.fromkeys(identities))
        assign_all(self.changes, values)
        assign_all(self.pending, dict.fromkeys(identities))

    def _write_identities(self) -> None:
        new = self._new
        if new:
            session, kb = self.context.session, self.context.kb_id
            rows: list[Row] = [(kb, id_, *each.key, each.text) for id_, each in new.items()]
            session.insert(self.new_identity, rows)
            session.insert(
                self.new_argument,
                [
                    (kb, id_, position, int(object_id))
                    for id_, each in new.items()
                    for position, object_id in enumerate(each.key[-1].split())
                ],
            )
            new.clear()

    def publish(self, revision: int) -> None:
        """Share the identities and versions of the transaction with later ones, after a commit."""
        # The revision that it made, or the one at which it began.
        head, known, before = self.context.head, self._known, self._before
        if revision != head.revision:
            news = {**before, **self.changes}
        else:
            # The writes were rolled back, so the allocated ids are unused.
            known = {key: each for key, each in known.items() if each.id < head.next_id}
            news = {id_: held for id_, held in before.items() if id_ < head.next_id}
        after = None if self.was_spilled else news
        self._cache.learn(known, self._cached, head.revision, revision, after)

    @abstractmethod
    def _find(self, group: Any, arguments: list[str]) -> Iterator[tuple[I, V | None]]:
        """Read the identities of one predicate or function, with their versions."""

    @abstractmethod
    def _read(self, unknown: dict[int, I]) -> None:
        """Read the versions of elements."""


class DefinitionLedger(Ledger[int, Definition]):
    """The changed definitions of one kind in a transaction."""

    defines = True

    def __init__(
        self, context: WriteContext, kind: str, elements: PendingElements[Definition]
    ) -> None:
        own = elements.interned, elements.unwritten
        super().__init__(context, elements.origin.get, elements.changes, *own)
        self._kind = kind
        self._elements = elements
        self._tables = KIND_TABLES[kind]
        self.versions = self._tables.version

    def look_up(self, names: Iterable[str]) -> None:
        """Find the identities of names without a live element, in one statement."""
        elements = self._elements
        keys = {
            key
            for key, name in {fold(name): name for name in names}.items()
            if key not in elements.interned
            and elements.get(elements.ids.get(key)) is None
            # Saving refuses an invalid name; here a driver might fail to encode it.
            and is_word(name)
        }
        if keys:
            context = self.context
            found = find_identities(context.session, context.kb_id, self._kind, keys)
            context.journal.assign_all(elements.interned, found)

    def intern(self, name: str) -> tuple[int, str]:
        """Find or make the identity of a name without a live element."""
        elements, key = self._elements, fold(name)
        if key not in elements.interned:
            self.look_up((name,))
        identity = elements.interned[key]
        if identity is None:
            (id_,) = self.context.allocate(1)
            identity = (id_, name)
            self.assign(elements.interned, key, identity)
            self.assign(elements.unwritten, id_, name)
        return identity

    def adopt(self, definition: Definition) -> None:
        """Keep an element of another knowledge base, whose identity this one lacks."""
        self.context.reserve((definition.id,))
        self.assign(self._elements.unwritten, definition.id, definition.name)
        self.know(definition)
        self.put(definition.id, definition)

    def know(self, definition: Definition) -> None:
        """Keep the identity of an element."""
        identity = (definition.id, definition.name)
        self.assign(self._elements.interned, fold(definition.name), identity)

    def _line(self, key: int, value: Definition) -> tuple[str, str]:
        return getattr(value, "section", self._kind), value.text

    def _write_identities(self) -> None:
        names = self._elements.unwritten
        kb = self.context.kb_id
        rows = [(kb, id_, name, fold(name)) for id_, name in names.items()]
        self.context.session.insert(self._tables.new_identity, rows)
        names.clear()

    def _rows(self, opened: list[tuple[int, Definition]]) -> Iterator[tuple[Insert, list[Row]]]:
        kb, number = self.context.kb_id, self.context.number
        version = self._tables.version
        rows: RowsByTable = {table: [] for table in (version.table, *version.children)}
        for _, definition in opened:
            self._tables.add_rows(rows, kb, number, definition)
        for table, its_rows in rows.items():
            yield whole_rows(table), its_rows


def _first_two(arguments: str) -> tuple[int | None, int | None]:
    """Return the ids of the first two arguments of a key; None for missing ones."""
    ids = arguments.split(" ", 2)
    return int(ids[0]) if arguments else None, int(ids[1]) if len(ids) > 1 else None


class PropositionLedger(InternedLedger[GroundAtom, GroundAtom]):
    """The asserted and retracted propositions of a transaction."""

    versions = VERSIONS
    said_in = FACT_SAYINGS
    identity = GroundAtom
    new_identity = Insert(
        ATOM_TABLES[PROPOSITION].identity, "kb_id", "id", *ATOM_TABLES[PROPOSITION].key, "text"
    )
    new_argument = whole_rows(ATOM_TABLES[PROPOSITION].arguments)
    new_version = whole_rows(VERSIONS.table)

    def hold_all(self, texts: Mapping[AtomKey, str], old: Collection[AtomKey] | None = None) -> int:
        """Assert propositions, with statements only for each predicate; count the new ones."""
        # `old` are those that may already be known; by default, all of them.
        found = self.find(texts if old is None else old)
        self.load(found.values())
        if self.sayings is not None:
            self.sayings.load([atom.id for atom in found.values()])
        changed = sum([self.set(atom, True) for atom in found.values()])
        if len(found) < len(texts):
            new = {key: text for key, text in texts.items() if key not in found}
            self.add_all(new)
            changed += len(new)
        return changed

    def add_all(self, texts: Mapping[AtomKey, str]) -> None:
        """Assert new propositions."""
        ids = self.context.allocate(len(texts))
        atoms = dict(zip(ids, map(GroundAtom, ids, texts, texts.values()), strict=True))
        # Goals have only known time.
        are_goals = any(key.is_goal for key in islice(texts, 1))
        (self._add if are_goals else self._add_new)(atoms, {**atoms})

    def adopt(self, atoms: dict[int, GroundAtom]) -> None:
        """Assert propositions of another knowledge base, under their ids."""
        self.context.reserve(atoms)
        self._add(atoms, {**atoms})

    def holds(self, atom: GroundAtom) -> bool:
        """Whether a proposition holds, with changes so far."""
        return self.value_of(atom) is not None

    def held_before(self, atom: GroundAtom) -> bool:
        """Whether a proposition held before this transaction."""
        self.value_of(atom)
        return self._before.get(atom.id) is not None

    def set(self, atom: GroundAtom, holds: bool) -> bool:
        """Assert or retract a proposition; return whether it changed."""
        said = False
        # Goals have only known time.
        if self.context.says and not atom.key.is_goal:
            said, is_all = self._speak(atom, atom if holds else None)
            if is_all:
                return said
        if (self.value_of(atom) is not None) == holds:
            return said
        self.put(atom.id, atom if holds else None)
        return True

    def _say(self, sayings: SayingLedger, identity: GroundAtom, value: GroundAtom | None) -> bool:
        id_, key, text = identity
        holds = value is not None
        columns = (key.predicate_id, *_first_two(key.arguments), holds)
        return sayings.say(id_, columns, sayings.period.text(text, holds))

    def _find(
        self, group: Any, arguments: list[str]
    ) -> Iterator[tuple[GroundAtom, GroundAtom | None]]:
        is_goal, predicate_id = group
        session = self.context.session
        for id_, text_arguments, text, since in session.rows(
            FIND,
            kb=self.context.kb_id,
            is_goal=is_goal,
            predicate=predicate_id,
            arguments=session.list_value(arguments),
        ):
            atom = GroundAtom(id_, AtomKey(is_goal, predicate_id, text_arguments), text)
            yield atom, None if since is None else atom

    def _read(self, unknown: dict[int, GroundAtom]) -> None:
        context = self.context
        ids, kb, number = context.session.list_value([*unknown]), context.kb_id, context.number
        before: dict[int, GroundAtom | None] = dict.fromkeys(unknown)
        written: dict[int, GroundAtom | None] = {}
        if self.was_spilled:
            for id_, since in context.session.rows(CLOSED_HERE, kb=kb, ids=ids, at=number):
                if since is not None:
                    before[id_], written[id_] = unknown[id_], None
        for id_, since in context.session.rows(OPEN, kb=kb, ids=ids):
            if since == number:
                written[id_] = unknown[id_]
            elif since is not None:
                before[id_] = unknown[id_]
        assign_all = context.journal.assign_all
        assign_all(self._before, before)
        if written:
            assign_all(self.changes, written)
            assign_all(self._written, written)

    def _line(self, key: int, value: GroundAtom) -> tuple[str, str]:
        return (GOAL if value.key.is_goal else FACT), value.text

    def _rows(self, opened: list[tuple[int, GroundAtom]]) -> Iterable[tuple[Insert, list[Row]]]:
        kb, number = self.context.kb_id, self.context.number
        rows: list[Row] = [
            (
                *(kb, id_, number, None, key.predicate_id, key.is_goal, HOLDS_NOW),
                *_first_two(key.arguments),
            )
            for id_, (_, key, _) in opened
        ]
        return ((self.new_version, rows),)


class FunctionValueLedger(InternedLedger[GroundFluent, HeldValue]):
    """The changed values of functions in a transaction."""

    versions = VALUE_VERSIONS
    said_in = VALUE_SAYINGS
    identity = GroundFluent
    new_identity = whole_rows(ATOM_TABLES[VALUE].identity)
    new_argument = whole_rows(ATOM_TABLES[VALUE].arguments)
    new_version = whole_rows(VALUE_VERSIONS.table)

    def value(self, fluent: GroundFluent) -> FluentValue | None:
        """Return the value of a fluent, with changes so far."""
        held = self.value_of(fluent)
        return None if held is None else held.value

    def set(self, fluent: GroundFluent, value: FluentValue | None) -> bool:
        """Set a value, or unset it with None; return whether it changed."""
        said = False
        if self.context.says:
            said, is_all = self._speak(fluent, None if value is None else HeldValue(fluent, value))
            if is_all:
                return said
        now = self.value(fluent)
        if now is None if value is None else value.is_same(now):
            return said
        first = self._before[fluent.id]
        # Setting the original value also restores its spelling.
        same = value is not None and first is not None and value.is_same(first.value)
        return self.spell(fluent, first.value if same and first is not None else value) or said

    def spell(self, fluent: GroundFluent, value: FluentValue | None) -> bool:
        """Set a value in exactly this spelling: 10.0 instead of 10."""
        if self.value(fluent) == value:
            return False
        self.put(fluent.id, None if value is None else HeldValue(fluent, value))
        return True

    def set_many(
        self,
        values: Collection[tuple[FluentKey, str, FluentValue]],
        old: Collection[FluentKey] | None = None,
    ) -> int:
        """Set values, with statements only for each function; count the changes."""
        # `old` are the fluents that may already be known; by default, all of them.
        found = self.find({key for key, _, _ in values} if old is None else old)
        self.load(found.values())
        if self.sayings is not None:
            self.sayings.load([fluent.id for fluent in found.values()])
        changed = 0
        new: dict[FluentKey, tuple[str, FluentValue]] = {}
        for key, text, value in values:
            fluent = found.get(key)
            if fluent is not None:
                changed += self.set(fluent, value)
            elif key not in new or not value.is_same(new[key][1]):
                new[key] = text, value
                changed += 1
        if new:
            self._add_all(new)
        return changed

    def _add_all(self, values: Mapping[FluentKey, tuple[str, FluentValue]]) -> None:
        fluents: dict[int, GroundFluent] = {}
        held: dict[int, HeldValue | None] = {}
        ids = self.context.allocate(len(values))
        for id_, (key, (text, value)) in zip(ids, values.items(), strict=True):
            fluent = fluents[id_] = GroundFluent(id_, key, text)
            held[id_] = HeldValue(fluent, value)
        self._add_new(fluents, held)

    def adopt(self, values: dict[int, HeldValue]) -> None:
        """Set values of another knowledge base, under their fluents' ids."""
        self.context.reserve(values)
        self._add({id_: held.fluent for id_, held in values.items()}, {**values})

    def unset(self, held: Iterable[HeldValue]) -> None:
        """Unset fluents whose values were read within the transaction, after a flush."""
        for each in held:
            fluent = each.fluent
            if fluent.id not in self._before:
                self.assign(self._before, fluent.id, each)
            self.know(fluent)
            self.set(fluent, None)

    def _say(
        self, sayings: SayingLedger, identity: GroundFluent, value: HeldValue | FluentValue | None
    ) -> bool:
        id_, key, text = identity
        if value is None:
            return sayings.say(
                id_, (key.function_id, None, None, None), sayings.period.text(text, False)
            )
        own = value.value if isinstance(value, HeldValue) else value
        before = sayings.last(id_)[1]
        if before is not None and own.is_same(FluentValue(before)):
            # The last saying is equal, in any spelling.
            spelled = sayings.period.text(value_text(text, before), True)
            own = own if spelled != sayings.last(id_)[0] else FluentValue(before)
        columns = (key.function_id, *_value_columns(own))
        return sayings.say(id_, columns, sayings.period.text(value_text(text, own.text), True))

    def _find(
        self, group: Any, arguments: list[str]
    ) -> Iterator[tuple[GroundFluent, HeldValue | None]]:
        (function_id,) = group
        session = self.context.session
        for id_, text_arguments, text, held, object_id in session.rows(
            FIND_VALUE,
            kb=self.context.kb_id,
            function=function_id,
            arguments=session.list_value(arguments),
        ):
            fluent = GroundFluent(id_, FluentKey(function_id, text_arguments), text)
            yield fluent, None if held is None else HeldValue.of(fluent, held, object_id)

    def _read(self, unknown: dict[int, GroundFluent]) -> None:
        session = self.context.session
        ids = session.list_value([*unknown])
        for id_, held, object_id in session.rows(OPEN_VALUE, kb=self.context.kb_id, ids=ids):
            now = None if held is None else HeldValue.of(unknown[id_], held, object_id)
            self.assign(self._before, id_, now)

    def _line(self, key: int, value: HeldValue) -> tuple[str, str]:
        return VALUE, value.text

    def _rows(self, opened: list[tuple[int, HeldValue]]) -> Iterable[tuple[Insert, list[Row]]]:
        kb, number = self.context.kb_id, self.context.number
        rows: list[Row] = []
        for id_, (fluent, value) in opened:
            own = value_text(fluent.text, value.text)
            place = (kb, id_, number, None, fluent.key.function_id)
            rows.append((*place, *_value_columns(value), own, HOLDS_NOW))
        return ((self.new_version, rows),)


def _value_columns(value: FluentValue) -> tuple[str | None, float | None, int | None]:
    """Return the columns of a value: a number is exact text and a float, an object its id."""
    text, object_id = value
    return (text, float(text), None) if object_id is None else (None, None, object_id)


class ExecutionLedger(Ledger[Key, OutcomeDefinition]):
    """The new outcomes of executions, and executions without a plan, in a transaction."""

    versions = STATEMENTS

    def __init__(self, context: WriteContext) -> None:
        self._before: dict[Key, OutcomeDefinition | None] = {}
        # The revision that recorded each, and found executions without their arguments.
        self._known: dict[Key, tuple[int, ExecutionDefinition]] = {}
        self._new: dict[Key, ExecutionDefinition] = {}
        super().__init__(context, self._before.get)
        context.journal.track(self._before, self._known, self._new)

    def find(self, key: Key) -> str | None:
        """Find an execution and read its outcome; return its text."""
        new = self._new.get(key)
        if new is not None:
            return new.text
        known = self._known.get(key)
        if known is None:
            plan_id, position = key
            context = self.context
            row = context.session.first(
                FIND_EXECUTION, kb=context.kb_id, plan=plan_id, position=position
            )
            if row is None:
                return None
            recorded, duration, text, *held = row
            known = recorded, ExecutionDefinition(None, duration, None, None, (), text)
            self.assign(self._known, key, known)
            self.assign(self._before, key, None if held[0] is None else OutcomeDefinition(*held))
        return known[1].text

    def record(self, execution: ExecutionDefinition, outcome: str, *said: Any) -> Key:
        """Record an execution without a plan; `said` are fields of an outcome, from `code` on."""
        key = NO_PLAN, self.context.allocate(1)[0]
        self.assign(self._new, key, execution)
        self._put(key, execution, self.context.number, outcome, said)
        return key

    def set(self, key: Key, outcome: str, *said: Any) -> None:
        """Set the outcome of a found or recorded execution."""
        new = self._new.get(key)
        recorded, execution = self._known[key] if new is None else (self.context.number, new)
        self._put(key, execution, recorded, outcome, said)

    def _put(
        self, key: Key, execution: ExecutionDefinition, recorded: int, outcome: str, said: Any
    ) -> None:
        text = outcome_text(key, execution, recorded, self.context.number, outcome, *said)
        self.put(key, OutcomeDefinition(EXECUTION, outcome, text, *said))

    def _write_identities(self) -> None:
        new = self._new
        if new:
            kb, number, session = self.context.kb_id, self.context.number, self.context.session
            session.insert(
                NEW_EXECUTION, [execution_row(kb, number, *each) for each in new.items()]
            )
            session.insert(
                NEW_ARGUMENT, [row for each in new.items() for row in argument_rows(kb, *each)]
            )
            # They are written, but stay known.
            self._known |= {key: (number, each) for key, each in new.items()}
            new.clear()

    def _run(self, statement: IdsQuery, keys: list[Key]) -> None:
        kb, at = self.context.kb_id, self.context.number
        for plan, position in keys:
            self.context.session.run_for(statement, [position], kb=kb, plan=plan, at=at)

    def _line(self, key: Key, value: OutcomeDefinition) -> tuple[str, str]:
        return value.kind, value.text

    def _rows(
        self, opened: list[tuple[Key, OutcomeDefinition]]
    ) -> Iterable[tuple[Insert, list[Row]]]:
        kb, number, session = self.context.kb_id, self.context.number, self.context.session
        rows: list[Row] = []
        for key, said in opened:
            times = [None if at is None else session.from_time(at) for at in said[5:]]
            rows.append((kb, *key, number, None, *said[:5], *times))
        return ((NEW_OUTCOME, rows),)


class Records(PendingChanges):
    """The plans, confirmations and archives of a transaction: rows are only added."""

    def __init__(self, context: WriteContext) -> None:
        self._context = context
        self._lines: dict[Change, None] = {}
        self.pending: dict[Change, tuple[tuple[Insert, Row], ...]] = {}
        context.journal.track(self._lines, self.pending)

    def add(self, change: Change, rows: Iterable[tuple[Insert, Row]]) -> bool:
        """Add a record: its change line, and its rows, parents first; False if it exists."""
        if change in self._lines:
            return False
        assign = self._context.journal.assign
        assign(self._lines, change, None)
        assign(self.pending, change, tuple(rows))
        return True

    def lines(self) -> list[Change]:
        """Return the records so far."""
        return [*self._lines]

    def write(self) -> None:
        """Write pending changes."""
        tables: dict[Insert, list[Row]] = {}
        for rows in self.pending.values():
            for into, row in rows:
                tables.setdefault(into, []).append(row)
        for into, all_rows in tables.items():
            self._context.session.insert(into, all_rows)
        self.pending.clear()
