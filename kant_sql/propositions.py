"""The propositions that a transaction touches."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .atoms import ABSENT, Atom, AtomCache, AtomKey, Status, open_status
from .knowledge.changes import ASSERTED, FACT, GOAL, RETRACTED, Change
from .knowledge.past import HOLDS_NOW
from .knowledge.proposition import CLOSED_HERE, FIND, OPEN, VERSIONS
from .knowledge.rows import table_of
from .tables import PropositionArgumentRow, PropositionRow

if TYPE_CHECKING:
    from .transaction import Transaction

# So many pending propositions are written out and forgotten, to keep memory flat.
SPILL_AT = 10_000


class PendingPropositions:
    """The propositions that a transaction has touched.

    Attributes:
        pending: proposition id -> whether it is to hold, of what is not written yet.
        spilled: whether some changes were written and forgotten, because there were many.
    """

    def __init__(self, transaction: Transaction, cache: AtomCache) -> None:
        self._transaction = transaction
        self._cache = cache
        self._cached_since = cache.at(transaction.head.revision)
        self._known: dict[AtomKey, Atom] = {}
        self._atoms: dict[int, Atom] = {}
        self._new: dict[int, Atom] = {}
        self._status: dict[int, Status] = {}
        self.pending: dict[int, bool] = {}
        self.spilled = False

    @property
    def is_untouched(self) -> bool:
        """Whether no proposition came to be in the transaction so far."""
        return not (self.spilled or self._known)

    def find(self, keys: Collection[AtomKey]) -> dict[AtomKey, Atom]:
        """Find the identities of propositions, with one statement for each predicate at most.

        Args:
            keys: what to find.

        Returns:
            Those that were ever known.
        """
        found: dict[AtomKey, Atom] = {}
        missing: dict[tuple[bool, int], list[str]] = {}
        for key in keys:
            atom = self._known.get(key) or self._cache.identities.get(key)
            if atom is not None:
                found[key] = atom
            else:
                missing.setdefault(key[:2], []).append(key.arguments)
        session = self._transaction.session
        for (is_goal, predicate_id), arguments in missing.items():
            rows = session.rows(
                FIND,
                kb=self._transaction.kb_id,
                is_goal=is_goal,
                predicate=predicate_id,
                arguments=session.list_value(arguments),
            )
            for id_, text_arguments, text, since in rows:
                atom = Atom(id_, AtomKey(is_goal, predicate_id, text_arguments), text)
                found[atom.key] = self.know(atom)
                if id_ not in self._status and not self.spilled:
                    self._transaction.assign(self._status, id_, open_status(since))
        return found

    def know(self, atom: Atom) -> Atom:
        """Remember an identity for the rest of the transaction.

        Args:
            atom: the identity, as the tables have it.

        Returns:
            The same.
        """
        self._transaction.assign(self._known, atom.key, atom)
        return atom

    def add_all(self, texts: Mapping[AtomKey, str]) -> None:
        """Let propositions hold that were never known, and make their identities.

        Args:
            texts: what makes each the one that it is, with its canonical PDDL text.
        """
        ids = self._transaction.allocate_many(len(texts))
        atoms = dict(zip(ids, map(Atom, ids, texts, texts.values()), strict=True))
        for part, entries in (
            (self._known, dict(zip(texts, atoms.values(), strict=True))),
            (self._new, atoms),
            (self._status, dict.fromkeys(ids, ABSENT)),
            (self._atoms, atoms),
            (self.pending, dict.fromkeys(ids, True)),
        ):
            self._transaction.assign_all(part, entries)

    def hold_all(self, texts: Mapping[AtomKey, str], old: Collection[AtomKey] | None = None) -> int:
        """Let propositions hold, with statements only for each predicate.

        Args:
            texts: what makes each the one that it is, with its canonical PDDL text.
            old: those that may have been known before; None for all.

        Returns:
            How many of them were changes.
        """
        found = self.find(texts if old is None else old)
        self.look_at(found.values())
        new = {key: text for key, text in texts.items() if key not in found}
        self.add_all(new)
        return len(new) + sum([self.set(atom, True) for atom in found.values()])

    def look_at(self, atoms: Iterable[Atom]) -> None:
        """Read whether propositions hold, in one or two statements for all of them.

        Args:
            atoms: the propositions.
        """
        unknown = []
        for atom in atoms:
            if atom.id not in self._status:
                if atom.id in self._cached_since and not self.spilled:
                    status = open_status(self._cached_since[atom.id])
                    self._transaction.assign(self._status, atom.id, status)
                else:
                    unknown.append(atom.id)
        if not unknown:
            return
        session, kb = self._transaction.session, self._transaction.kb_id
        ids = session.list_value(unknown)
        found = {}
        if self.spilled:
            closed = session.rows(CLOSED_HERE, kb=kb, ids=ids, at=self._transaction.number)
            found = {id_: Status(since, False) for id_, since in closed if since is not None}
        for id_, since in session.rows(OPEN, kb=kb, ids=ids):
            if since is not None:
                found[id_] = Status(since, True)
        for id_ in unknown:
            self._transaction.assign(self._status, id_, found.get(id_, ABSENT))

    def note(self, open_since: Mapping[int, int | None]) -> None:
        """Remember what the tables say of propositions that the transaction has not touched.

        Args:
            open_since: the revision of the open version of each, by id; None when it has none.
        """
        self._status.update((id_, open_status(since)) for id_, since in open_since.items())

    def holds(self, atom: Atom) -> bool:
        """Tell whether a proposition holds, as changed so far.

        Args:
            atom: the proposition.

        Returns:
            Whether it holds.
        """
        wanted = self.pending.get(atom.id)
        if wanted is not None:
            return wanted
        if atom.id not in self._status:
            self.look_at((atom,))
        return self._status[atom.id].holds

    def set(self, atom: Atom, holds: bool) -> bool:
        """Let a proposition hold, or hold no more.

        Args:
            atom: the proposition.
            holds: whether it is to hold.

        Returns:
            Whether that is a change.
        """
        if self.holds(atom) == holds:
            return False
        self._transaction.assign(self._atoms, atom.id, atom)
        self._transaction.assign(self.pending, atom.id, holds)
        return True

    def spill(self) -> None:
        """Write out and forget what is pending, if it has become much."""
        if len(self.pending) < SPILL_AT:
            return
        self._transaction.flush()
        self.spilled = True
        for part in self.state():
            part.clear()

    def changes(self) -> Iterator[Change]:
        """Give what the transaction has changed so far, if nothing was spilled.

        Yields:
            The changes, in no order.
        """
        for id_, atom in self._atoms.items():
            status = self._status[id_]
            before = status.since not in (None, self._transaction.number)
            now = self.pending.get(id_, status.holds)
            if now != before:
                kind = GOAL if atom.key.is_goal else FACT
                yield Change(ASSERTED if now else RETRACTED, kind, atom.text)

    def write(self) -> None:
        """Write what is pending."""
        transaction = self._transaction
        kb, number, session = transaction.kb_id, transaction.number, transaction.session
        self._write_identities()
        inserts: list[tuple[Any, ...]] = []
        closed: list[int] = []
        unmade: list[int] = []
        reopened: list[int] = []
        asserted = Status(number, True)
        for id_, wanted in self.pending.items():
            status = self._status[id_]
            if wanted == status.holds:
                continue
            if status.since is None:
                key = self._atoms[id_].key
                inserts.append((kb, id_, number, None, key.predicate_id, key.is_goal, HOLDS_NOW))
                self._status[id_] = asserted
            elif status.since == number:
                unmade.append(id_)
                self._status[id_] = ABSENT
            else:
                (reopened if wanted else closed).append(id_)
                self._status[id_] = Status(status.since, wanted)
        session.run_for(VERSIONS.close, closed, kb=kb, at=number)
        session.run_for(VERSIONS.unmake, unmade, kb=kb)
        session.run_for(VERSIONS.reopen, reopened, kb=kb, at=number)
        session.insert(VERSIONS.table, inserts)
        self.pending.clear()

    def _write_identities(self) -> None:
        if not self._new:
            return
        transaction = self._transaction
        kb, atoms = transaction.kb_id, self._new.values()
        transaction.session.insert(
            table_of(PropositionRow),
            [
                (kb, id_, predicate_id, is_goal, arguments, text)
                for id_, (is_goal, predicate_id, arguments), text in atoms
            ],
        )
        transaction.session.insert(
            table_of(PropositionArgumentRow),
            [
                (kb, id_, position, int(object_id))
                for id_, (_, _, arguments), _ in atoms
                for position, object_id in enumerate(arguments.split())
            ],
        )
        self._new.clear()

    def state(self) -> list[dict[Any, Any]]:
        """Give the parts of the state, for the transaction to undo."""
        return [self._known, self._atoms, self._new, self._status, self.pending]

    def publish(self, revision: int) -> None:
        """Let later transactions know what this one has learned, once it has ended well.

        Args:
            revision: the head after it.
        """
        cache, head = self._cache, self._transaction.head
        made = revision != head.revision
        # Without a revision, what the transaction wrote was rolled back, and the ids that it gave
        # out with it.
        forgotten = self._new if made else self._atoms
        cache.know(
            {
                key: atom
                for key, atom in self._known.items()
                if atom.id not in self._new and (made or atom.id < head.next_id)
            }
        )
        news = {
            id_: status.since if status.holds else None
            for id_, status in self._status.items()
            if id_ not in forgotten
        }
        cache.learn(self._cached_since, head.revision, revision, None if self.spilled else news)
