"""Erases the name of an object in all texts that mention it, or texts of revisions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import Any, NamedTuple

from sqlalchemy import Text, bindparam, cast, select, union_all

from ...arguments import expect, flag, iterate, one_of, shown, whole_number
from ...dto.elements import PddlObjectDto
from ...dto.lexical import fold, is_word
from ...errors import ConflictError, InvalidArgumentError, UnknownNameError, UnknownRevisionError
from ...knowledge.canonical import SAID, erasure_text
from ...sql import tables as t
from ...sql.changes import ERASURE
from ...sql.definition_rows import find_identities
from ...sql.dialects.base import Session
from ...sql.dialects.containing import contains, is_in, pattern_of
from ...sql.query import Query
from ...sql.rows import KB, table_of
from ...store.snapshot import archive_of
from ...store.state import State
from ...store.store import Store
from ...store.transaction import Transaction
from ..rewriting.parts import Destroyer
from ..rewriting.texts import ChangeKey, Renaming, TextWriter, has_word, spellings
from ..verify.chain import read_links
from ..verify.parts import PREFIX, said_in_place
from .archived import ArchiveDestroyer, ArchivedPart, open_archive

logger = logging.getLogger("kant_sql.history")

OBJECT, TEXTS = "object", "texts"
_ERASURE, _REVISION = table_of(t.ErasureRow), table_of(t.RevisionRow)
_OBJECTS = t.TABLES["object"].c
_GIVEN_OUT = Query(
    union_all(
        select(_OBJECTS.key).where(_OBJECTS.kb_id == KB, _OBJECTS.key.like(bindparam("like"))),
        select(_ERASURE.c.pseudonym).where(_ERASURE.c.kb_id == KB),
    )
)
_SAYING_IT = {
    label: Query(
        select(_REVISION.c.number, cast(_REVISION.c[label], Text)).where(
            _REVISION.c.kb_id == KB, contains(cast(_REVISION.c[label], Text))
        )
    )
    for label in SAID
}
# A shorter erased text may be a part of any word.
_TELLING = 4


class Erased(NamedTuple):
    """The result of an erasure.

    Attributes:
        revision: the revision of the erasure; None if there was nothing to erase.
        element_id: the object, whose id stays; None if texts of revisions were erased.
        pseudonym: the text that replaces the erased ones.
        parts: the number of erased texts.
        revisions: the number of their revisions.
        form_1: the number of these with form 1 of the hash, from which a name can be guessed.
        remaining: where old bytes may remain in the database, and the command that removes them.
    """

    revision: int | None
    element_id: int | None
    pseudonym: str
    parts: int
    revisions: int
    form_1: int
    remaining: tuple[str, ...] = ()


class Wanted(NamedTuple):
    """What to erase, as requested."""

    name: str | None
    also: tuple[str, ...]  # parts of revisions to erase if they contain the name
    said: Mapping[int, tuple[str, ...]]  # parts of some revisions
    # Parts chosen by rules, not by their texts, which may be used again. It is called under the
    # lock: another call may have erased them.
    by_rule: Callable[[Session, int], Mapping[int, tuple[str, ...]]] | None = None


def erase(
    state: State,
    element: PddlObjectDto | str | None = None,
    *,
    reason: str,
    also: Collection[str] = (),
    revisions: Collection[int] = (),
    parts: Collection[str] = (),
    form_1: bool = False,
    archive: str | None = None,
    actor: str | None = None,
) -> Erased:
    """Erase the name of an object in all texts that mention it, or texts of some revisions.

    The object keeps its id and is called `erased-1` from now on, at every revision: facts, values,
    actions, formulas, rules, documents, plans and executions that mention it use the new name, and
    joins and counts still work. The erasure destroys the hashed texts and keeps a commitment to
    each, so you can verify the chain, anchors and replicas as before. An erasure is a revision.
    Call `erasure_preview` first: you cannot undo an erasure.

    Args:
        element: the object, or its name.
        reason: why; it must not contain the erased text.
        also: parts to erase as well in each revision where they contain the name of the object:
            some of `actor`, `reason` and `source`.
        revisions: instead of an object, the revisions whose `parts` to erase.
        parts: the parts to erase there: some of `actor`, `reason` and `source`.
        form_1: whether to erase in revisions of form 1 of the hash, too: anybody can check a guess
            of the name against their hashes.
        archive: the URL of the archive that has a part of the history: it is verified first, and
            also erases the texts.
        actor: who erases; by default the knowledge base's actor.

    Returns:
        The erasure, and where bytes of the texts may remain.

    Raises:
        UnknownNameError: there never was such an object.
        UnknownRevisionError: there is no such revision.
        InvalidArgumentError: the reason or the actor contains the erased text.
        ConflictError: revisions of form 1 mention the object; or `archive` is not the archive that
            has a part of the history.
        StoreIntegrityError: a revision does not match its hash, here or in the archive.
        DivergedError: the archive has another history.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
        ReplicaError: this is a replica: erase at its origin.

    Examples:
        >>> kb.erase("rb1", reason="the robot was sold").pseudonym
        'erased-1'
        >>> print(*kb.propositions.get_all())
        (robot_at erased-1 wp1)
        >>> kb.store.verify().is_intact
        True
    """
    wanted = make_wanted(element, also, revisions, parts)
    flag(form_1, "form_1", InvalidArgumentError)
    return run_erasure(state.store, wanted, form_1, actor, reason, archive)


def run_erasure(
    store: Store,
    wanted: Wanted,
    form_1: bool,
    actor: str | None,
    reason: str | None,
    archive: str | None,
) -> Erased:
    """Erase in its own revision, and remove the bytes; without an erased part, make no revision."""
    with opened(store, archive) as moved:
        done = None
        with suppress(NothingErasedError), begun(store, moved, actor, reason) as transaction:
            done = Eraser(transaction, wanted, form_1, moved).run()
            if not done.parts:
                raise NothingErasedError
        assert done is not None
        if not done.parts:
            return done._replace(revision=None)
        logger.info(
            "knowledge base %r: revision %s erased %d texts of %d revisions",
            *(store.name, done.revision, done.parts, done.revisions),
        )
        # First here: the erasure must be on disk before the archive, which must not be ahead.
        remaining = store.backend.wipe()
        return done._replace(remaining=remaining + (moved.follow(done.revision) if moved else ()))


def opened(store: Store, archive: str | None) -> AbstractContextManager[ArchivedPart | None]:
    """Open the archive for an erasure, if one is given."""
    # An erasure has its own revision.
    store.refuse_open()
    return nullcontext() if archive is None else open_archive(store, archive)


def begun(
    store: Store, moved: ArchivedPart | None, actor: str | None, reason: str | None
) -> AbstractContextManager[Transaction]:
    """Begin the transaction of an erasure."""
    return store.transaction(actor, reason) if moved is None else moved.begin(actor, reason)


def make_wanted(
    element: PddlObjectDto | str | None,
    also: Collection[str],
    revisions: Collection[int],
    parts: Collection[str],
) -> Wanted:
    """Check the request."""
    name, error = None, InvalidArgumentError
    if element is not None:
        given: Any = expect(element, (PddlObjectDto, str), "what to erase", InvalidArgumentError)
        name = given if isinstance(given, str) else given.get_name()
    if (name is None) == (not revisions) or bool(parts) != bool(revisions):
        raise InvalidArgumentError(
            "give an object to erase, or revisions=[17] with parts=['reason']"
        )
    labels, listed = "a list of actor, reason and source", "a list of numbers"
    texts = [
        tuple([one_of(each, SAID, "what to erase") for each in iterate(given, role, labels, error)])
        for role, given in (("also", also), ("parts", parts))
    ]
    if name is None and texts[0]:
        raise InvalidArgumentError("also= belongs to an object; of revisions, name all in parts=")
    numbers = {
        whole_number(number, "a revision", least=1, expected="a revision from 1 on")
        for number in iterate(revisions, "revisions", listed, error)
    }
    return Wanted(name, texts[0], dict.fromkeys(sorted(numbers), texts[1]))


class NothingErasedError(Exception):
    """Rolls back the transaction of an erasure."""


class Eraser:
    """One erasure, in its transaction."""

    def __init__(
        self, transaction: Transaction, wanted: Wanted, form_1: bool, moved: ArchivedPart | None
    ) -> None:
        self._transaction = transaction
        self._session = transaction.session
        self._kb = transaction.kb_id
        self._wanted = wanted
        self._form_1 = form_1
        self._moved = moved

    def run(self) -> Erased:
        """Erase, and record the erasure."""
        transaction, wanted, moved = self._transaction, self._wanted, self._moved
        if moved is None:
            self._refuse_archived()
        self._session.replan()
        self._session.overwrite_deleted()
        transaction.erases = True
        pseudonym = next_pseudonym(self._session, self._kb)
        where = self._session, self._kb, transaction.name
        destroyer = Destroyer(*where) if moved is None else ArchiveDestroyer(where[2], moved)
        found = None if wanted.name is None else self._find(wanted.name)
        renaming = None if found is None else Renaming(*found, pseudonym)
        old: dict[ChangeKey, str] = {}
        if renaming is not None:
            self._refuse_telling(renaming.name)
            writer = TextWriter(*where, renaming) if moved is None else moved.writer(renaming)
            writer.run()
            old = writer.old
        said = self._said(pseudonym, None if found is None else found[1])
        destroyer.destroy(old, said)
        if destroyer.form_1 and not self._form_1:
            raise ConflictError(
                f"{destroyer.form_1} revisions of form 1 mention it: their hashes cover the texts "
                "themselves, so anyone can check a guess of the name; nothing was erased: "
                "erase all the same with form_1=True (--form-1)"
            )
        id_ = transaction.allocate()
        element_id = None if found is None else found[0]
        of = TEXTS if found is None else OBJECT, element_id, pseudonym
        what = transaction.head.revision, *of, destroyer.parts, destroyer.digest()
        transaction.record(ERASURE, _ERASURE, erasure_text, id_, *what)
        # The rows below refer to this one.
        transaction.flush()
        destroyer.write(id_, said)
        if moved is not None:
            moved.finish(transaction, renaming, id_)
        counts = destroyer.parts, destroyer.revisions, destroyer.form_1
        return Erased(transaction.number, element_id, pseudonym, *counts)

    def _refuse_archived(self) -> None:
        head = self._transaction.head
        if head.archived_revision:
            place = archive_of(self._session, self._kb, head.archived_revision - 1)
            raise ConflictError(
                f"versions that ended up to revision {head.archived_revision} are in the archive "
                f"{place}, where the name would stay; nothing was erased: give its URL, with its "
                "password, as archive= (--archive URL)"
            )

    def _find(self, name: str) -> tuple[int, str]:
        """Find the object, with its first spelling."""
        key = fold(name)
        known = find_identities(self._session, self._kb, OBJECT, {key}) if is_word(name) else {}
        found = known.get(key)
        if found is None:
            raise UnknownNameError(
                f"knowledge base {self._transaction.name!r} has never had an object {shown(name)}"
            )
        return found

    def _refuse_telling(self, text: str) -> None:
        """Refuse an erasure whose own actor or reason contains the erased text."""
        said = self._transaction.metadata
        for label, given in (("actor", said.actor), ("reason", said.reason)):
            if given is None:
                continue
            if tells(given, text):
                raise InvalidArgumentError(
                    f"the {label} of the erasure contains the erased text, and would stay; give "
                    "another one"
                )

    def _said(self, pseudonym: str, name: str | None) -> dict[int, dict[str, str]]:
        """Find the parts of revisions to erase."""
        session, kb, wanted = self._session, self._kb, self._wanted
        asked = {**(wanted.said if wanted.by_rule is None else wanted.by_rule(session, kb))}
        if name is not None:
            for label in wanted.also:
                for pattern in patterns_of(session, name):
                    for number, text in session.rows(_SAYING_IT[label], kb=kb, pattern=pattern):
                        if tells(text, name):
                            asked[number] = (*asked.get(number, ()), label)
        links = {link.number: link for link in read_links(session, kb, sorted(asked))}
        said: dict[int, dict[str, str]] = {}
        for number, labels in asked.items():
            if number not in links:
                raise UnknownRevisionError(
                    f"knowledge base {self._transaction.name!r} has no revision {number}: it is at "
                    f"{self._transaction.head.revision}"
                )
            metadata = links[number].metadata
            given = {label: getattr(metadata, label) for label in labels}
            own = [label for label, text in given.items() if text is not None]
            for label in () if wanted.by_rule or name else own:
                self._refuse_telling(given[label])
            if own:
                said[number] = said_in_place(pseudonym, own)
        return said


def tells(text: str, name: str) -> bool:
    """Return whether a text contains a name: a short one as a word, a longer one anywhere."""
    if len(name) < _TELLING:
        return has_word(text, name)
    return any(is_in(one, text) for one in spellings(name))


def patterns_of(session: Session, name: str) -> set[str]:
    """Return the patterns of texts that contain a name, in any spelling."""
    return {pattern_of(session, spelled, is_composed=False) for spelled in spellings(name)}


def next_pseudonym(session: Session, kb_id: int) -> str:
    """Return a name that no element has ever had."""
    rows = session.rows(_GIVEN_OUT, kb=kb_id, like=f"{PREFIX}%")
    taken = {row[0].removeprefix(PREFIX) for row in rows}
    return f"{PREFIX}{1 + max((int(one) for one in taken if one.isdecimal()), default=0)}"
