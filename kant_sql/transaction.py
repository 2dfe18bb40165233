"""The unit of work: one connection, many DAOs, one revision.

A transaction keeps what it changes in memory and writes it when it commits, or earlier when it
reads propositions or has collected many. What is asserted and retracted in one transaction leaves
no trace, and a call that fails inside a transaction is undone alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import timedelta
from itertools import chain
from typing import Any

from .atoms import AtomCache
from .backends import Session
from .canonical import FORM, Metadata, revision_hash, time_text
from .dto.name import fold, is_word
from .errors import ConnectionLostError
from .fluents import FluentCache
from .function_values import PendingFunctionValues
from .head import Committed, Head, move_head
from .knowledge.changes import Change, stream_changes
from .knowledge.definitions import KINDS, Definitions, PendingDefinitions
from .knowledge.elements import Definition
from .knowledge.rows import table_of
from .knowledge.writing import DefinitionWriter, find_identities
from .propositions import PendingPropositions
from .records import PendingRecords
from .step_statuses import PendingStepStatuses
from .tables import RevisionPlanStepRow, RevisionRow
from .undo import Undo

_REVISION = table_of(RevisionRow)
_PLAN_STEP = table_of(RevisionPlanStepRow)


class Transaction:
    """What one writer changes in one revision. One thread uses it, between BEGIN and COMMIT.

    Attributes:
        session: the session.
        kb_id: the knowledge base.
        name: the knowledge base's name.
        head: where the knowledge base stood when it began.
        number: the revision that it makes.
        definitions: the definitions, as changed so far.
        propositions: the propositions that it has touched.
        values: the values of functions that it has touched.
        records: the plans and archives that it records.
        step_statuses: the steps of plans that it has touched.
        committed: the revision, from just before COMMIT is sent.
        redefined: whether the revision changes a definition.
        changed: how many changes the revision has.
    """

    def __init__(
        self,
        session: Session,
        kb_id: int,
        name: str,
        head: Head,
        metadata: Metadata,
        definitions: Definitions,
        atoms: AtomCache,
        fluents: FluentCache,
    ) -> None:
        self.session = session
        self.kb_id = kb_id
        self.name = name
        self.head = head
        self.number = head.revision + 1
        self.metadata = metadata
        self.definitions = PendingDefinitions(definitions)
        self.propositions = PendingPropositions(self, atoms)
        self.values = PendingFunctionValues(self, fluents)
        self.records = PendingRecords(self)
        self.step_statuses = PendingStepStatuses(self)
        # In the order in which they are written: each refers to those before it only.
        self._parts = (self.propositions, self.values, self.records, self.step_statuses)
        self.committed: Committed | None = None
        self.redefined = False
        # Within a batch, the types that were found to agree with what is stored, by address.
        self.agreed_types: dict[int, object] | None = None
        self.changed = 0
        self._next_id = head.next_id
        self._started = time.monotonic()
        self._writer = DefinitionWriter(session, kb_id, self.number, self.definitions)
        self._undo = Undo(session, self._state, self.definitions.reshape)
        # What sets an entry of the state, or many, for `scope` to undo.
        self.assign = self._undo.assign
        self.assign_all = self._undo.assign_all

    @property
    def age(self) -> float:
        """How many milliseconds ago it began."""
        return (time.monotonic() - self._started) * 1e3

    @property
    def is_stateless(self) -> bool:
        """Whether no proposition and no fluent came to be in it so far."""
        return self.propositions.is_untouched and self.values.is_untouched

    def allocate(self) -> int:
        """Give out the next id.

        Returns:
            An id that no element of the knowledge base has.
        """
        self._next_id += 1
        return self._next_id - 1

    def allocate_many(self, number: int) -> range:
        """Give out the next ids.

        Args:
            number: how many.

        Returns:
            Ids that no element of the knowledge base has.
        """
        first = self._next_id
        self._next_id += number
        return range(first, self._next_id)

    def look_up(self, kind: str, names: Iterable[str]) -> None:
        """Find the identities of names that are not live, in one statement.

        Args:
            kind: the kind of element.
            names: the names.
        """
        elements = self.definitions.elements(kind)
        spellings = {fold(name): name for name in names}
        keys = {
            key
            for key, name in spellings.items()
            if key not in elements.interned
            and elements.get(elements.ids.get(key)) is None
            # What is no name is refused when it is saved; a driver might refuse to send it.
            and is_word(name)
        }
        if keys:
            for key, identity in find_identities(self.session, self.kb_id, kind, keys).items():
                self.assign(elements.interned, key, identity)

    def intern(self, kind: str, name: str) -> tuple[int, str]:
        """Find the identity of a name that is not live, or make it.

        Args:
            kind: the kind of element.
            name: the name.

        Returns:
            The id, and the name in its first spelling.
        """
        elements = self.definitions.elements(kind)
        key = fold(name)
        if key not in elements.interned:
            self.look_up(kind, (name,))
        identity = elements.interned[key]
        if identity is None:
            identity = (self.allocate(), name)
            self.assign(elements.interned, key, identity)
            self.assign(elements.unwritten, identity[0], name)
        return identity

    def define(self, kind: str, definition: Definition) -> bool:
        """Set what an element is.

        Args:
            kind: the kind of element.
            definition: the definition, with the id of its identity.

        Returns:
            Whether that is a change.
        """
        elements = self.definitions.elements(kind)
        before = elements.get(definition.id)
        if before == definition:
            return False
        if kind == "type":
            self.definitions.reshape(definition.id if before is None else None)
        self.assign(elements.changes, definition.id, definition)
        return True

    def undefine(self, kind: str, id_: int) -> None:
        """Let an element be no more.

        Args:
            kind: the kind of element.
            id_: its id.
        """
        if kind == "type":
            self.definitions.reshape()
        self.assign(self.definitions.elements(kind).changes, id_, None)

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Check each type that the elements of a batch refer to once: nobody else runs in between.

        Yields:
            Nothing.
        """
        self.agreed_types = {}
        try:
            yield
        finally:
            self.agreed_types = None

    def scope(self) -> AbstractContextManager[None]:
        """Make what happens within undoable: it happens whole or not at all.

        Returns:
            The context manager.
        """
        return self._undo.scope()

    def flush(self) -> None:
        """Write what is pending, so that a query sees it."""
        definitions = self._writer.pending()
        pending = [part for part in self._parts if part.pending]
        if definitions or pending:
            self._check_open()
            self._undo.before_write()
            if definitions:
                self._writer.write()
            for part in pending:
                part.write()

    def commit(self) -> Committed | None:
        """Write the revision and commit; without a change, roll back.

        Returns:
            The revision, or None when nothing has changed.
        """
        if self.propositions.spilled:
            self.flush()
            changes = self._stored_changes()
        else:
            parts = self._writer, *self._parts
            changes = sorted(chain.from_iterable(part.changes() for part in parts))
            self.changed = len(changes)
        if not changes:
            self.session.rollback()
            return None
        self._check_open()
        if self.session.backend.revision_comes_last:
            self.flush()
        made = self._write_revision(changes)
        # After the revision, if it is still to be written: that spares the database from keeping
        # book of references whose target is yet to come.
        self.flush()
        self._move_head(made)
        self.committed = made
        self.session.commit(self.kb_id)
        return made

    def publish(self) -> None:
        """Let later transactions know what this one has learned, once it has ended well."""
        revision = self.head.revision if self.committed is None else self.committed.number
        self.propositions.publish(revision)
        self.values.publish(revision)

    def _check_open(self) -> None:
        """Refuse to write after an error with which the database has ended the transaction."""
        if not (self.session.is_abandoned or self.session.in_transaction()):
            raise ConnectionLostError(
                f"{self.session.backend.label}: an error has ended this transaction; nothing of "
                "the open transaction was written, try again"
            )

    def _write_revision(self, changes: Iterable[Change]) -> Committed:
        elapsed = timedelta(seconds=time.monotonic() - self._started)
        committed_at = max(self.head.clock + elapsed, self.head.committed_at or self.head.clock)
        digest = revision_hash(
            self.head.hash, self.name, self.number, time_text(committed_at), self.metadata, changes
        )
        moment = self.session.from_time(committed_at)
        actor, reason, source, seen, step = self.metadata
        observed_at = None if seen is None else self.session.from_time(seen)
        said = (moment, actor, reason, source, FORM, digest, observed_at)
        self.session.insert(_REVISION, [(self.kb_id, self.number, *said)])
        if step is not None:
            self.session.insert(_PLAN_STEP, [(self.kb_id, self.number, *step)])
        return Committed(self.number, digest, moment)

    def _move_head(self, made: Committed) -> None:
        self.redefined = any(True for _ in self._writer.changes())
        definitions = made.number if self.redefined else self.head.definition_revision
        move_head(self.session, self.kb_id, made, definitions, self._next_id)

    def _stored_changes(self) -> Iterable[Change]:
        """Give the changes as the tables say them, for they were too many to keep."""
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

    def _state(self) -> list[dict[Any, Any]]:
        parts: list[dict[Any, Any]] = [self._writer.written]
        parts += chain.from_iterable(part.state() for part in self._parts)
        for kind in KINDS:
            elements = self.definitions.elements(kind)
            parts += [elements.changes, elements.interned, elements.unwritten]
        return parts
