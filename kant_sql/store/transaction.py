"""The unit of work: one connection, many DAOs, one revision.

A transaction keeps its changes in memory and writes them at the commit, or earlier if it reads
possibly changed data or has collected many changes. An element asserted and retracted in one
transaction leaves no trace. Untouched kinds cost nothing.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from functools import cached_property
from itertools import chain
from typing import Any

from sqlalchemy import Table, func, select

from ..errors import ConnectionLostError, InvalidArgumentError
from ..knowledge.atoms import GroundAtom
from ..knowledge.canonical import FORM, SEED, Metadata, revision_hash, time_text
from ..knowledge.definitions import KINDS, Definition, PendingDefinitions
from ..knowledge.sayings import FROM_NOW_ON, Given, Period
from ..sql.changes import ASSERTED, CONFIRMATION, PLAN, Change, stream_changes
from ..sql.dialects.base import Session
from ..sql.executions import Key
from ..sql.query import Insert, Query, whole_rows
from ..sql.rows import FACT, KB, table_of
from ..sql.tables import ConfirmationRow, PlanRow, RequestRow, RevisionExecutionRow, RevisionRow
from .caches import Agreements, AtomCache, FluentCache
from .head import MOVED, Committed, Head, set_head
from .journal import JournalScope
from .ledger import (
    DefinitionLedger,
    ExecutionLedger,
    FunctionValueLedger,
    InternedLedger,
    Ledger,
    PendingChanges,
    PropositionLedger,
    Records,
    SayingLedger,
    WriteContext,
)

_NEW_REVISION = whole_rows(table_of(RevisionRow))
_NEW_REQUEST = Insert(table_of(RequestRow), "kb_id", "number", "key", "digest", "results")
_NEW_LINK = Insert(table_of(RevisionExecutionRow), "kb_id", "number", "plan_id", "position")

_MOVE_HEAD = set_head(**MOVED)

# Flush above this count of pending propositions to bound memory.
SPILL_AT = 10_000

_NEW_CONFIRMATION = Insert(table_of(ConfirmationRow), "kb_id", "proposition_id", "since")
LAST_PLAN = Query(select(func.max(PlanRow.id)).where(PlanRow.kb_id == KB))

_PROPOSITIONS, _VALUES, _RECORDS, _EXECUTIONS = "propositions", "values", "records", "executions"
# The order of writing: each refers only to earlier ones.
_SAYINGS = {_PROPOSITIONS: "sayings of facts", _VALUES: "sayings of values"}
_ORDER = (*KINDS, _PROPOSITIONS, _VALUES, *_SAYINGS.values(), _RECORDS, _EXECUTIONS)


@dataclass(eq=False, repr=False)
class Transaction:
    """The changes of one writer in one revision. One thread uses it, between BEGIN and COMMIT."""

    session: Session
    kb_id: int
    name: str
    head: Head  # the locked head row
    metadata: Metadata  # the metadata of the revision
    definitions: PendingDefinitions  # the definitions, with changes so far
    # References by DTOs that agree with the store.
    agreements: Agreements
    _context: WriteContext
    _atoms: AtomCache
    _fluents: FluentCache
    given: Given = FROM_NOW_ON  # the given beginning and end of its valid period
    number: int = field(init=False)  # the number of its revision
    # The revision, from just before COMMIT is sent.
    committed: Committed | None = field(default=None, init=False)
    redefined: bool = field(default=False, init=False)  # whether the revision changes a definition
    # Within a batch, types that agree with the store, by address.
    agreed_types: dict[int, object] | None = field(default=None, init=False)
    changed: int = field(default=0, init=False)  # the number of changes
    # Whether saving a fact that already holds confirms it.
    confirms: bool = field(default=False, init=False)
    # Whether it changes texts of earlier revisions: then no cache is valid.
    erases: bool = field(default=False, init=False)
    # The key, the digest and the results of its request, if that may be repeated.
    request: tuple[str, str, str] | None = field(default=None, init=False)
    _started: float = field(init=False)
    # The ledgers of the kinds touched so far.
    _ledgers: dict[str, PendingChanges] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.number = self._context.number
        self._started = time.monotonic()

    @cached_property
    def propositions(self) -> PropositionLedger:
        """The changed propositions."""
        made = PropositionLedger(self._context, self._atoms)
        self._track(_PROPOSITIONS, made)
        return made

    @cached_property
    def values(self) -> FunctionValueLedger:
        """The changed values of functions."""
        made = FunctionValueLedger(self._context, self._fluents)
        self._track(_VALUES, made)
        return made

    @property
    def _was_spilled(self) -> bool:
        """Whether propositions were written and forgotten."""
        return _PROPOSITIONS in self._ledgers and self.propositions.was_spilled

    def _track(self, name: str, ledger: InternedLedger[Any, Any]) -> None:
        self._ledgers[name] = ledger
        if ledger.sayings is not None:
            self._ledgers[_SAYINGS[name]] = ledger.sayings

    @cached_property
    def records(self) -> Records:
        """The recorded plans, confirmations and archives."""
        made = self._ledgers[_RECORDS] = Records(self._context)
        return made

    @cached_property
    def executions(self) -> ExecutionLedger:
        """The new outcomes of executions."""
        made = self._ledgers[_EXECUTIONS] = ExecutionLedger(self._context)
        return made

    def _ledger(self, kind: str) -> DefinitionLedger:
        """Return the ledger of the definitions of one kind."""
        ledger = self._ledgers.get(kind)
        if ledger is None:
            elements = self.definitions.elements(kind)
            ledger = self._ledgers[kind] = DefinitionLedger(self._context, kind, elements)
            self._context.journal.when_rolled_back = self._forget_shape
        assert isinstance(ledger, DefinitionLedger)
        return ledger

    def _forget_shape(self) -> None:
        """Clear results that depend on definitions about to change."""
        self.definitions.reshape()
        self.agreements.clear()

    def _touched(self) -> list[PendingChanges]:
        """Return what was touched, in the order of writing."""
        return [self._ledgers[name] for name in sorted(self._ledgers, key=_ORDER.index)]

    @property
    def age(self) -> float:
        """Milliseconds since it began."""
        return (time.monotonic() - self._started) * 1e3

    @property
    def made(self) -> int | None:
        """Its revision; None if it has changed nothing, or has not ended."""
        return None if self.committed is None else self.committed.number

    @property
    def is_stateless(self) -> bool:
        """Whether it has used no proposition and no fluent so far."""
        return all(
            ledger.is_untouched
            for ledger in self._ledgers.values()
            if isinstance(ledger, InternedLedger)
        )

    def allocate(self) -> int:
        """Allocate the next id."""
        return self._context.allocate(1)[0]

    def number_plan(self) -> int:
        """Return the number of the next plan: 1, 2, 3 ..., independent of the ids of elements."""
        (last,) = self.session.first(LAST_PLAN, kb=self.kb_id) or (None,)
        number = 1 + (last or 0) + sum(change.kind == PLAN for change in self.records.pending)
        # Verification expects no id beyond the head's.
        self._context.reserve([number])
        return number

    def look_up(self, kind: str, names: Iterable[str]) -> None:
        """Find the identities of names without a live element, in one statement."""
        self._ledger(kind).look_up(names)

    def intern(self, kind: str, name: str) -> tuple[int, str]:
        """Find or make the identity of a name without a live element."""
        return self._ledger(kind).intern(name)

    def define(self, kind: str, definition: Definition) -> bool:
        """Set the definition of an element; return whether it changed."""
        before = self.definitions.elements(kind).get(definition.id)
        if before == definition:
            return False
        if before is not None:
            self.agreements.clear()
        if kind == "type":
            self.definitions.reshape(definition.id if before is None else None)
        else:
            self.definitions.derived.clear()
        self._ledger(kind).put(definition.id, definition)
        return True

    def redefine(self, kind: str, definition: Definition) -> None:
        """Set the definition of an element whose name this process may not know."""
        if self.define(kind, definition):
            self._ledger(kind).know(definition)

    def adopt(self, kind: str, definition: Definition) -> None:
        """Define an element of another knowledge base, under its id, in an empty knowledge base."""
        if kind == "type":
            self.definitions.reshape(definition.id)
        else:
            self.definitions.derived.clear()
        self._ledger(kind).adopt(definition)

    def undefine(self, kind: str, id_: int) -> None:
        """Remove the definition of an element."""
        self._forget_shape()
        self._ledger(kind).put(id_, None)

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Check each type in a batch of elements once; no other call may intervene."""
        self.agreed_types = {}
        try:
            yield
        finally:
            self.agreed_types = None

    @property
    def says(self) -> bool:
        """Whether it has a valid period."""
        return self._context.says

    @contextmanager
    def of_now(self) -> Iterator[None]:
        """Change the state from now on, whatever the period of the transaction."""
        before, self._context.says = self._context.says, False
        try:
            yield
        finally:
            self._context.says = before

    def say_all(self, period: Period, kind: str, said: Mapping[Any, tuple[str, Any]]) -> None:
        """Add sayings about one of several periods of the revision."""
        is_fact = kind == FACT
        ledger = self.propositions if is_fact else self.values
        ledger.say_all(period, said)
        self._track(_PROPOSITIONS if is_fact else _VALUES, ledger)

    def refuse_period(self, what: str, remedy: str, *, unless_open: bool = False) -> None:
        """Refuse a call that has no meaning in a period; with `unless_open`, in a past period."""
        period = self._context.period
        if self.says and period is not None and not (unless_open and period.is_open):
            begin, end = map(time_text, period[:2])
            raise InvalidArgumentError(
                f"{what} cannot be about a period, and this transaction is about that from "
                f"{begin} until {end}: {remedy}"
            )

    def scope(self) -> JournalScope:
        """Open a scope, which is atomic."""
        return self._context.journal.scope()

    @contextmanager
    def joined(self) -> Iterator[Transaction]:
        """Open a scope for a nested block."""
        with self.scope():
            yield self

    def find_execution(self, key: Key) -> str | None:
        """Find an execution; return its text."""
        if _RECORDS in self._ledgers and self.records.pending:
            self.flush()
        return self.executions.find(key)

    def confirm(self, atoms: Iterable[GroundAtom]) -> int:
        """Confirm facts that held before it, each once; return the number."""
        self.refuse_period("a confirmation", "confirm facts in another transaction")
        kb, number, add = self.kb_id, self.number, self.records.add
        return sum(
            add(Change(ASSERTED, CONFIRMATION, text), [(_NEW_CONFIRMATION, (kb, id_, number))])
            for id_, _, text in filter(self.propositions.held_before, atoms)
        )

    def record(
        self, kind: str, table: Table, write: Callable[..., str], id_: int, *values: Any
    ) -> None:
        """Add a record: its row has an id, the revision, the values, and their text."""
        text = write(id_, *values)
        row = (self.kb_id, id_, self.number, *values, text)
        self.records.add(Change(ASSERTED, kind, text), [(whole_rows(table), row)])

    def spill(self) -> None:
        """Write and forget the pending propositions, if they are many."""
        if _PROPOSITIONS in self._ledgers and len(self.propositions.pending) >= SPILL_AT:
            self.flush()
            self.propositions.forget()

    def flush(self) -> None:
        """Write pending changes, so that a query sees them."""
        pending = [ledger for ledger in self._touched() if ledger.pending] if self._ledgers else ()
        if pending:
            self._check_open()
            self._write(pending)

    def _write(self, pending: Iterable[PendingChanges]) -> None:
        self._context.journal.before_write()
        for ledger in pending:
            ledger.write()

    def commit(self) -> Committed | None:
        """Write the revision and commit; without a change, roll back."""
        touched = self._touched()
        self.check_rules()
        changes = self._changes(touched)
        if not changes:
            self.session.rollback()
            return None
        self._check_open()
        pending = [ledger for ledger in touched if ledger.pending]
        if self.session.backend.revision_comes_last:
            with self.session.together():
                self._write(pending)
                made = self._write_revision(changes)
        else:
            # After the revision: otherwise the database would have to track references to a future
            # row.
            made = self._write_revision(changes)
            self._write(pending)
        is_moved = self.redefined or self.erases
        definitions = made.number if is_moved else self.head.definition_revision
        self.session.run(
            _MOVE_HEAD,
            kb=self.kb_id,
            number=made.number,
            definitions=definitions,
            next=self._context.next_id,
            digest=made.hash,
            time=made.moment,
        )
        self.committed = made
        self.session.commit(self.kb_id)
        return made

    def check_rules(self) -> None:
        """Check the refusing rules; this takes statements only if changes touch one."""
        if self.definitions.origin.rules.is_blank and "rule" not in self._ledgers:
            return
        from .guard import TouchedRules

        changes = {
            kind: [*ledger.differences()]
            for kind, ledger in self._ledgers.items()
            # Sayings about the past break no rule about the present.
            if isinstance(ledger, Ledger) and not isinstance(ledger, SayingLedger)
        }
        touched = TouchedRules(self.definitions, None if self._was_spilled else changes)
        if touched.whole or touched.rows:
            self.flush()
            touched.refuse(self.session, self.kb_id)

    def publish(self) -> None:
        """Share its caches with later transactions, after a successful end."""
        before = self.head.revision
        revision = self.made or before
        if _PROPOSITIONS in self._ledgers:
            self.propositions.publish(revision)
        else:
            self._atoms.advance(before, revision)
        if _VALUES in self._ledgers:
            self.values.publish(revision)
        else:
            self._fluents.advance(before, revision)

    def _check_open(self) -> None:
        """Refuse to write after an error that ended the transaction in the database."""
        if not (self.session.is_abandoned or self.session.in_transaction()):
            raise ConnectionLostError(
                f"{self.session.backend.label}: an error has ended this transaction; nothing of "
                "the open transaction was written, try again"
            )

    def _changes(self, touched: list[PendingChanges]) -> Iterable[Change]:
        """Return the sorted lines of the revision; false if there are none."""
        was_spilled = self._was_spilled
        lines: list[Change] = []
        for ledger in touched:
            if not (was_spilled and ledger is self.propositions):
                found = ledger.lines()
                self.redefined = self.redefined or bool(ledger.defines and found)
                lines += found
        if was_spilled:
            self.flush()
            return self._stored_changes()
        lines.sort()
        self.changed = len(lines)
        return lines

    def _stored_changes(self) -> Iterable[Change]:
        """Return the changes from the tables, because they were too many to keep."""
        stream = self._counted(
            change
            for _, change in stream_changes(self.session, self.kb_id, self.number, self.number)
        )
        first = next(stream, None)
        return () if first is None else chain((first,), stream)

    def _counted(self, changes: Iterable[Change]) -> Iterator[Change]:
        for change in changes:
            self.changed += 1
            yield change

    def _write_revision(self, changes: Iterable[Change]) -> Committed:
        head, session, period = self.head, self.session, self._context.period
        committed_at = head.clock + timedelta(seconds=time.monotonic() - self._started)
        if period is not None and period.is_open:
            committed_at = period.valid_until
        # Never before the last revision.
        if head.committed_at is not None and committed_at < head.committed_at:
            committed_at = head.committed_at
        when = time_text(committed_at)
        # 16 bytes, from which all salts are derived.
        seed = os.urandom(SEED)
        said = when, self.metadata, changes, seed
        digest = revision_hash(head.hash, self.name, self.number, *said)
        moment = session.from_time(committed_at, when)
        actor, reason, source, seen, step = self.metadata
        observed_at = None if seen is None else session.from_time(seen)
        row = (moment, actor, reason, source, FORM, digest, observed_at, seed)
        session.insert(_NEW_REVISION, [(self.kb_id, self.number, *row)])
        if step is not None:
            session.insert(_NEW_LINK, [(self.kb_id, self.number, *step)])
        if self.request is not None:
            session.insert(_NEW_REQUEST, [(self.kb_id, self.number, *self.request)])
        return Committed(self.number, digest, moment)
