"""The merge of a branch: its changes since it began, as one revision here.

The base is the state in which the branch began, or was merged last. A merge takes over changes that
only the branch has made since; elements that both changed differently are conflicts.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from sqlalchemy import Text, cast, literal_column, select

from ..arguments import shown
from ..documents.carry import Key, carry, refuse_misfits
from ..dto.lexical import fold
from ..errors import (
    ConflictError,
    InvalidArgumentError,
    KantSqlError,
    MergeConflictError,
    ReadOnlyError,
    ReplicaError,
    RuleViolatedError,
    StaleRevisionError,
    few_of,
)
from ..knowledge.canonical import read_source
from ..knowledge.definitions import Definitions
from ..sql.changes import in_range
from ..sql.dialects import create_backend
from ..sql.dialects.base import Session
from ..sql.query import Query
from ..sql.rows import KB
from ..sql.tables import RevisionRow
from ..store.head import hash_of
from ..store.snapshot import View, read_position, refuse_archived
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .merge_sayings import MergeSaying, compare_sayings, say_all
from .merge_sides import MergeComparison, SideChanges, read_side
from .merged import NAMED, OURS, THEIRS, Decision, Merge, MergeConflict, MergeSide
from .moments import refuse_valid
from .restore import read_origin, refuse_open, write_branch
from .revisions import LAST_MOMENT, Revision, read_numbered, read_revisions

logger = logging.getLogger("kant_sql.history")

_SOURCE = cast(RevisionRow.source, Text)
# Canonical JSON sorts its keys: the source of a merge begins like this.
_MERGES = Query(
    select(RevisionRow.number, _SOURCE)
    .where(
        RevisionRow.kb_id == KB,
        in_range(RevisionRow.number),
        _SOURCE.like(literal_column("'{\"base\"%'")),
    )
    .order_by(RevisionRow.number.desc())
)


class _Branch(NamedTuple):
    """A branch, and the base of its merge."""

    name: str
    head: int
    hash: str
    origin: int  # the revision of this knowledge base that it began with
    base: int  # that revision, or the one of the last merge here
    merged: int  # its own revision then
    merges: list[tuple[int, int, str]]  # all merges of branches with its name
    own: frozenset[int]  # the merges here of its revisions up to its head


def _find(state: State, branch: State) -> _Branch:
    """Find where a branch began, and when it was merged last."""
    refuse_valid(branch, "merge")
    store, other = state.store, branch.store
    for each in (store, other):
        refuse_open(each, "to be merged")
    first, last = other.query_in_snapshot(
        lambda session, kb_id: _read_ends(session, kb_id, branch.at)
    )
    source: Any = None if first is None else first.source
    if first is None or last is None or not (isinstance(source, dict) and "parent" in source):
        raise _no_branch(store, other, "its first revision names no knowledge base that it is of")
    if source["parent"] != store.name:
        said = f"its first revision says that it is of {shown(source['parent'])}"
        raise _no_branch(store, other, said)
    origin: Any = source.get("revision")

    def compare(session: Session, kb_id: int | None) -> list[tuple[int, int, str]]:
        position = read_position(session, kb_id)
        digest = hash_of(session, kb_id, origin) if kb_id and type(origin) is int else None
        if kb_id is None or digest is None or digest != source.get("hash"):
            said = f"it began with a revision {shown(origin)} that is not in this history"
            raise _no_branch(store, other, said)
        refuse_archived(session, kb_id, origin, position.archived)
        return _merges(session, kb_id, origin, position.head, other.name)

    merges = store.query_in_snapshot(compare)
    numbers = {number for _, number, _ in merges}
    known = read_revisions(other, numbers)
    own = {
        here: number
        for here, number, digest in merges
        if number <= last.number and number in known and known[number].hash == digest
    }
    base, merged = next(iter(own.items()), (origin, 1))
    ends = last.number, last.hash, origin, base, merged
    return _Branch(other.name, *ends, merges, frozenset(own))


def _read_ends(
    session: Session, kb_id: int | None, at: int | None
) -> tuple[Revision | None, Revision | None]:
    """Read the first revision of a branch, and its last revision to merge."""
    position = read_position(session, kb_id)
    head = position.head if at is None else at
    if kb_id is None or not head:
        return None, None
    refuse_archived(session, kb_id, 1, position.archived)
    found = read_numbered(session, kb_id, {1, head})
    return found[1], found[head]


def _merges(
    session: Session, kb_id: int, low: int, high: int, name: str
) -> list[tuple[int, int, str]]:
    """Read the merges of branches with a name, the last first, each with its source."""
    found = []
    for number, text in session.rows(_MERGES, kb=kb_id, low=low + 1, high=high):
        source = read_source(text)
        said = source.get("branch"), source.get("revision"), source.get("hash")
        if said[0] == name and type(said[1]) is int and isinstance(said[2], str):
            found.append((number, said[1], said[2]))
    return found


def _no_branch(store: Store, other: Store, why: str) -> ConflictError:
    return ConflictError(
        f"knowledge base {other.name!r} of {other.backend.label} is not a branch of "
        f"{store.name!r}: {why}; merge a branch that kb.branch() made of this one, or compare the "
        "two with kb.diff() and save the elements that you want"
    )


def _read_decisions(decide: Mapping[str, Decision] | None) -> dict[str, Decision]:
    if decide is None:
        return {}
    if not isinstance(decide, Mapping):
        raise InvalidArgumentError(
            f"decide is a mapping from elements to 'ours' or 'theirs', not {shown(decide)}"
        )
    for element, side in decide.items():
        if not isinstance(element, str) or side not in (OURS, THEIRS):
            raise InvalidArgumentError(
                f"{shown(element)} is decided as {shown(side)}: give the element of a conflict, "
                "as its text, and 'ours' or 'theirs'"
            )
    return {fold(element.strip()): side for element, side in decide.items()}


def _said_here(
    session: Session, kb_id: int, side: SideChanges, asked: Set[Key]
) -> list[MergeSaying]:
    """Return the statements about elements: plain writes, and sayings, which override them."""
    traces = [(key, side.traces[key]) for key in asked & side.traces.keys()]
    plain = [(number, key, text) for key, one in traces for number, text in one.since.items()]
    revisions = read_numbered(session, kb_id, {number for number, *_ in plain})
    found = [
        MergeSaying(number, key, text, text or "", revisions[number].committed_at, LAST_MOMENT)
        for number, key, text in plain
    ]
    return found + [said for said in side.sayings if said.key in asked]


class _Merging:
    """One merge: reads the branch, then compares and writes under the lock of the head."""

    def __init__(self, state: State, branch: State, decide: Mapping[str, Decision] | None) -> None:
        self.store = state.store
        self._given = _read_decisions(decide)
        self._other = branch.store
        self.branch = found = _find(state, branch)

        def read(view: View) -> SideChanges:
            assert view.kb_id is not None
            archived = read_position(view.session, view.kb_id).archived
            refuse_archived(view.session, view.kb_id, 1, archived)
            own = (2, found.head, found.merged)
            return read_side(view.session, view.kb_id, view.definitions, *own)

        self._theirs = self._other.read_in_snapshot(read, found.head)
        self._sayings = [said for said in self._theirs.sayings if said.number > found.merged]
        # The rules that the result would break, with the changes that break them.
        self._broken: dict[str, set[Key]] = {}

    def compare(
        self, session: Session, kb_id: int, definitions: Definitions, head: int, archived: int
    ) -> tuple[Merge, MergeComparison]:
        """Compare the branch with this knowledge base."""
        found = self.branch
        refuse_archived(session, kb_id, found.origin, archived)
        merges = _merges(session, kb_id, found.origin, head, found.name)
        if merges != found.merges:
            raise StaleRevisionError(
                f"branch {found.name!r} was merged just now by another writer, in revision "
                f"{merges[0][0]}; nothing was written: look at it, and merge again",
                found.base,
                merges[0][0],
            )
        ours = read_side(session, kb_id, definitions, found.origin + 1, head, found.base)
        compared = MergeComparison(found.base, found.merged, ours, self._theirs)
        decided = self._decide(compared)
        known = _said_here(session, kb_id, ours, {said.key for said in self._sayings})
        compared.sayings = [*compare_sayings(self._sayings, known, found.own)]
        broken = [key for keys in self._broken.values() for key in keys]
        here = read_numbered(session, kb_id, compared.numbers(OURS, broken))
        there = read_revisions(self._other, compared.numbers(THEIRS, broken))
        conflicts = [
            MergeConflict(
                compared.element(key),
                compared.base(key),
                compared.side(OURS, key, here),
                compared.side(THEIRS, key, there),
                decided.get(key),
            )
            for key in compared.conflicts
        ]
        conflicts += self._decide_rules(compared, here, there)
        conflicts += self._decide_sayings(compared, here, there)
        made = Merge(
            *(found.name, found.head, found.hash, found.base, head),
            tuple(sorted(compared.changes())),
            tuple(sorted(conflicts, key=lambda each: each.element)),
        )
        return made, compared

    def _decide(self, compared: MergeComparison) -> dict[Key, Decision]:
        """Apply decisions."""
        decided: dict[Key, Decision] = {}
        for key in compared.conflicts:
            side = self._decided(compared.element(key))
            if side is not None:
                decided[key] = side
        compared.decide(decided)
        return decided

    def _decide_rules(
        self, compared: MergeComparison, here: Mapping[int, Revision], there: Mapping[int, Revision]
    ) -> Iterator[MergeConflict]:
        """Leave out the changes that break a rule, or undo those made here, as decided."""
        for element, keys in self._broken.items():
            decided = self._decided(element)
            compared.keep(keys, decided)
            ours = compared.broken_by(OURS, keys, here)
            theirs = compared.broken_by(THEIRS, keys, there)
            yield MergeConflict(element, None, ours, theirs, decided)

    def _learn(self, compared: MergeComparison, error: RuleViolatedError) -> bool:
        """Make a conflict from a rule that the result breaks; return whether it is new."""
        element = f"rule {error.rule} {error.instance}"
        known = self._broken.get(element, set())
        found = compared.read_by(error) | known
        if found == known or len(self._broken) >= NAMED:
            return False
        self._broken[element] = found
        return True

    def _decided(self, element: str) -> Decision | None:
        """Return the decision about an element, by its name with or without its kind."""
        whole = fold(element)
        return self._given.get(whole, self._given.get(whole.partition(" ")[2]))

    def _decide_sayings(
        self, compared: MergeComparison, here: Mapping[int, Revision], there: Mapping[int, Revision]
    ) -> Iterator[MergeConflict]:
        """Take over sayings about periods, unless they are in conflict or decided otherwise."""
        for said, against in compared.sayings:
            decided = self._given.get(fold(said.element), self._given.get(fold(said.text)))
            if decided == THEIRS or (against is None and decided is None):
                compared.said.append(said)
            if against is not None:
                ours = MergeSide(against.text or None, here.get(against.number))
                theirs = MergeSide(said.text, there.get(said.number))
                yield MergeConflict(said.element, None, ours, theirs, decided)

    def refuse_unknown(self, made: Merge, compared: MergeComparison) -> None:
        """Refuse decisions that match no conflict and no saying, or several."""
        sayings = [said.element for said, _ in compared.sayings]
        elements = [*dict.fromkeys((*(each.element for each in made.conflicts), *sayings))]
        names = [fold(each) for each in elements]
        bare = [name.partition(" ")[2] for name in names]
        for given in self._given:
            several = [each for each, own in zip(elements, bare, strict=True) if own == given]
            if given in names or len(several) == 1:
                continue
            if several:
                raise InvalidArgumentError(
                    f"{given!r} is in several conflicts: decide {' and '.join(map(repr, several))}"
                )
            known = ", ".join(map(repr, elements[:NAMED])) or "none"
            raise InvalidArgumentError(
                f"{given!r} is not a conflict of this merge; the conflicts are: {known}"
            )

    def write(self, transaction: Transaction) -> _Tried:
        """Compare under the lock of the head, and write the result."""
        definitions, head = transaction.definitions.origin, transaction.head
        where = transaction.session, transaction.kb_id, definitions
        found = self.compare(*where, head.revision, head.archived_revision)
        return self.apply(transaction, *found)

    def apply(self, transaction: Transaction, made: Merge, compared: MergeComparison) -> _Tried:
        """Write a result; raise `_AgainError` if it breaks a rule, which becomes a conflict."""
        failed: KantSqlError | None = None
        try:
            compared.refuse_pseudonyms()
            carry(transaction, self._theirs.definitions, compared.wanted())
            say_all(transaction, compared.said)
            if compared.is_mixed:
                refuse_misfits(transaction)
            transaction.check_rules()
        except KantSqlError as error:
            if isinstance(error, RuleViolatedError) and self._learn(compared, error):
                raise _AgainError from error
            failed = error
        self.refuse_unknown(made, compared)
        # With undecided conflicts as `ours`, more may be refused than after the decisions.
        return _Tried(made, None if made.undecided else failed)

    def refuse_undecided(self, made: Merge) -> None:
        """Refuse a merge with undecided conflicts."""
        if undecided := made.undecided:
            count = f"{len(undecided)} open conflict{'s' * (len(undecided) > 1)}"
            raise MergeConflictError(
                f"branch {self.branch.name!r} has {count}: {few_of(undecided, NAMED)}; nothing was "
                "written: decide each as 'ours' or 'theirs', or change one of the two",
                made.conflicts,
            )


class _Tried(NamedTuple):
    """A merge whose result was written, and why it is refused."""

    made: Merge
    failed: KantSqlError | None


class _AgainError(Exception):
    """Rolls back a result that breaks a rule, which becomes a conflict."""


class _PreviewedError(Exception):
    """Rolls back a result that was written to be judged."""


def merge_preview(
    state: State, branch: State, decide: Mapping[str, Decision] | None = None
) -> Merge:
    """Compare a branch with a knowledge base, like `KnowledgeBase.merge_preview`."""
    merging = _Merging(state, branch, decide)
    try:
        made, failed = _try(state.store, merging.write)
    except (ReadOnlyError, ReplicaError):
        made, failed = _try_on_copy(merging, state.store)
    return made if failed is None else replace(made, refused=str(failed))


def _try(store: Store, write: Callable[[Transaction], _Tried]) -> _Tried:
    """Write a result and roll it back, again for each rule that becomes a conflict."""
    tried: _Tried | None = None
    while tried is None:
        with suppress(_AgainError, _PreviewedError), store.transaction() as transaction:
            tried = write(transaction)
            raise _PreviewedError
    return tried


def _try_on_copy(merging: _Merging, store: Store) -> _Tried:
    """Write the result to a copy of the state in memory, for a store that cannot be written."""

    def compare(view: View) -> tuple[Merge, MergeComparison]:
        session, kb_id = view.session, view.kb_id
        assert kb_id is not None
        position = read_position(session, kb_id)
        head = position.head if view.at is None else view.at
        return merging.compare(session, kb_id, view.definitions, head, position.archived)

    made, compared = store.read_in_snapshot(compare)
    if not compared.may_be_refused:
        merging.refuse_unknown(made, compared)
        return _Tried(made, None)
    with closing(Store(create_backend("sqlite://"), store.name, store.actor)) as copy:
        write_branch(copy, read_origin(store, made.head))
        return _try(
            copy,
            lambda own: merging.apply(own, *store.read_in_snapshot(compare, made.head)),
        )


def merge(
    state: State,
    branch: State,
    decide: Mapping[str, Decision] | None = None,
    reason: str | None = None,
    actor: str | None = None,
    expected_revision: int | None = None,
) -> Merge:
    """Merge a branch into a knowledge base, like `KnowledgeBase.merge`."""
    merging = _Merging(state, branch, decide)
    found, store = merging.branch, state.store
    why = f"merged {found.name} at revision {found.head}" if reason is None else reason
    source = {"base": found.base, "branch": found.name, "hash": found.hash, "revision": found.head}
    write = partial(store.transaction, actor, why, source, expected_revision=expected_revision)
    made: Merge | None = None
    while made is None:
        with suppress(_AgainError), write() as transaction:
            made, failed = merging.write(transaction)
            merging.refuse_undecided(made)
            if failed is not None:
                raise failed
    number = transaction.made
    logger.info(
        "knowledge base %r: branch %r merged, by revision %s", store.name, found.name, number
    )
    return replace(made, revision=number)
