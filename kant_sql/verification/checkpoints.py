"""The chain of revisions as the tables have it, with the hash of what they say of each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from datetime import datetime
from hashlib import sha256
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import select

from ..backends import Query, Row, Session
from ..canonical import Metadata, revision_hash, time_text
from ..knowledge.changes import (
    ASSERTED,
    RETRACTED,
    in_range,
    stream_change_rows,
    stream_rows_left,
)
from ..knowledge.loading import KB
from ..knowledge.revision import REVISIONS
from ..tables import KnowledgeBaseRow, RevisionRow

SMALLEST, LARGEST = -(2**63), 2**63 - 1

_SIGNS = ASSERTED, RETRACTED
_DATE, _CLOCK = r"[0-9]{4}-[0-9]{2}-[0-9]{2}", r"(?:[01][0-9]|2[0-3]):[0-9]{2}:[0-9]{2}\.[0-9]{6}"
_TIME = re.compile(f"{_DATE}T{_CLOCK}Z")
_NAME = Query(select(KnowledgeBaseRow.name).where(KnowledgeBaseRow.id == KB))
_REVISIONS = Query(
    REVISIONS.add_columns(RevisionRow.form)
    .where(in_range(RevisionRow.number))
    .order_by(RevisionRow.number)
)


class Link(NamedTuple):
    """What the tables say of a revision, what it changed apart.

    Attributes:
        number: its number.
        committed_at: when, as the text that is hashed.
        metadata: who, why and from what.
        form: the form that was hashed.
        hash: its hash, as it is stored.
        is_readable: whether its times are times.
    """

    number: int
    committed_at: str
    metadata: Metadata
    form: int
    hash: str
    is_readable: bool

    def digest(
        self, name: str, previous: str | None, changes: Iterable[tuple[str, str, str]]
    ) -> str:
        """Hash it anew.

        Args:
            name: the knowledge base's name.
            previous: the hash of the revision before; None for the first.
            changes: what it changed.

        Returns:
            The hash that a revision that says this has.
        """
        said = self.committed_at, self.metadata, changes, self.form
        return revision_hash(previous, name, self.number, *said)


class Step(NamedTuple):
    """A number of the chain: a revision and its changes, or changes of a revision that is missing.

    Attributes:
        number: the number.
        link: the revision; None when there are only changes.
        changes: sign, kind and text of each change, to be read before the next step.
    """

    number: int
    link: Link | None
    changes: Iterator[tuple[str, str, str]]


def read_name(session: Session, kb_id: int) -> str:
    """Read what a knowledge base is called.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.

    Returns:
        Its name.
    """
    row = session.first(_NAME, kb=kb_id)
    return "" if row is None else str(row[0])


def stream_chain(
    session: Session,
    kb_id: int,
    low: int = SMALLEST,
    high: int = LARGEST,
    changes: Iterable[Row] | None = None,
) -> Iterator[Step]:
    """Read revisions together with what they changed, in two statements and in constant memory.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        low: the first number.
        high: the last number.
        changes: rows as of `stream_change_rows`, when it is not about all that was changed.

    Yields:
        The steps of the chain, in order.
    """
    bounds = {"kb": kb_id, "low": low, "high": high}
    rows = stream_change_rows(session, kb_id, low, high) if changes is None else changes
    groups = groupby(rows, key=itemgetter(0))
    group = next(groups, None)
    for row in session.stream(_REVISIONS, **bounds):
        while group is not None and group[0] < row[0]:
            yield Step(group[0], None, _lines(group[1]))
            group = next(groups, None)
        link = _link(session, row)
        if group is not None and group[0] == row[0]:
            yield Step(row[0], link, _lines(group[1]))
            group = next(groups, None)
        else:
            yield Step(row[0], link, iter(()))
    while group is not None:
        yield Step(group[0], None, _lines(group[1]))
        group = next(groups, None)


def _lines(rows: Iterable[Row]) -> Iterator[tuple[str, str, str]]:
    # What refers to nothing has no text.
    return ((_SIGNS[sign], kind, text or "") for _, sign, kind, text in rows)


def _link(session: Session, row: Row) -> Link:
    number, at, actor, reason, source, digest, seen, plan_id, position, form = row
    step = None if plan_id is None else (plan_id, position)
    try:
        committed_at, observed_at = moment_text(session, at), _moment(session, seen)
        if isinstance(at, str):
            # It is hashed as it stands, so it must be nothing but a time.
            _moment(session, at)
    except (TypeError, ValueError):
        metadata = Metadata(actor, reason, source, None, step)
        return Link(number, "", metadata, form, digest, False)
    metadata = Metadata(actor, reason, source, observed_at, step)
    return Link(number, committed_at, metadata, form, digest, True)


def moment_text(session: Session, raw: Any) -> str:
    """Give a time as it is hashed.

    Args:
        session: the session that it is from.
        raw: the driver's value.

    Returns:
        Its text: where times are stored as texts, that one, whatever it is.

    Raises:
        TypeError: it is no time.
    """
    return raw if isinstance(raw, str) else time_text(session.to_time(raw))


def _moment(session: Session, raw: Any) -> datetime | None:
    """Read a time that is stored as the library stores it."""
    if raw is None:
        return None
    # Of texts that are read as the same moment, one only has this form.
    if isinstance(raw, str) and _TIME.fullmatch(raw) is None:
        raise ValueError(f"{raw!r} is not written as times are")
    return session.to_time(raw)


class RestDigest:
    """The hash of what is left of revisions a part of which was moved to an archive."""

    def __init__(self) -> None:
        self._digest = sha256()

    def add(self, recomputed: str, stored: str) -> None:
        """Add a revision.

        Args:
            recomputed: the hash of what is left of it.
            stored: the hash that it had as a whole.
        """
        self._digest.update(f"{recomputed}{stored}".encode())

    def text(self) -> str:
        """Give the hash of all that were added.

        Returns:
            64 hexadecimal digits.
        """
        return self._digest.hexdigest()


def rest_digest(session: Session, kb_id: int, upto: int) -> str:
    """Hash what the tables say of the first revisions, but for what ended in them.

    That is what is left of them once this is moved elsewhere.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        upto: the last of these revisions.

    Returns:
        The SHA-256 of, for each revision in order, the hash of what the tables say of it and the
        hash that it has, both as 64 hexadecimal digits.
    """
    name, rest = read_name(session, kb_id), RestDigest()
    previous: str | None = None
    left = stream_rows_left(session, kb_id, upto)
    for step in stream_chain(session, kb_id, 1, upto, left):
        if step.link is not None:
            rest.add(step.link.digest(name, previous, step.changes), step.link.hash)
            previous = step.link.hash
    return rest.text()
