"""Which revision held at a time, and how far a knowledge base has come."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import bindparam, literal_column, select

from ..arguments import whole_number
from ..backends import Query, Session, StoreClock, first_rows
from ..errors import UnknownRevisionError, reading_rows
from ..head import check_numbers
from ..knowledge.loading import KB
from ..store import Store
from ..tables import HeadRow, RevisionRow
from .revisions import FIRST_MOMENT, LAST_MOMENT, refuse_archived, refuse_unknown

_COLUMNS: tuple[Any, ...] = (
    HeadRow.revision,
    HeadRow.archived_revision,
    HeadRow.definition_revision,
    HeadRow.committed_at,
)
_HEAD = select(*_COLUMNS).where(HeadRow.kb_id == KB)


def _last_until(moment: str) -> Any:
    # By the index of times: the largest number would be looked for from the head on.
    numbers = (
        select(RevisionRow.number)
        .where(RevisionRow.kb_id == KB, RevisionRow.committed_at <= bindparam(moment))
        .order_by(RevisionRow.committed_at.desc(), RevisionRow.number.desc())
    )
    return first_rows(numbers, literal_column("1")).scalar_subquery()


_MOMENTS = ("one", "other")
_STAND = Query(_HEAD)
_STAND_AND_TIMES = Query(_HEAD.add_columns(StoreClock(), *map(_last_until, _MOMENTS)))

When = int | datetime


class Stand(NamedTuple):
    """How far a knowledge base has come.

    Attributes:
        revision: the last revision; 0 before the first.
        archived: what ended up to this revision was moved to an archive.
        redefined: the last revision that changed a definition.
        found: the last revision up to each of the times that were asked for.
    """

    revision: int
    archived: int
    redefined: int
    found: tuple[int, ...] = ()


def read_stand(store: Store, moments: Sequence[datetime] = ()) -> Stand:
    """Read how far a knowledge base has come, with one statement.

    Args:
        store: the store.
        moments: the times to find revisions of, two at most.

    Returns:
        The stand.

    Raises:
        UnknownRevisionError: a time lies in the future, or has no zone.
    """
    for moment in moments:
        check_zone(moment)

    def work(session: Session, kb_id: int | None) -> Stand:
        row = None
        if kb_id is not None and not moments:
            row = session.first(_STAND, kb=kb_id)
        elif kb_id is not None:
            row = session.first(_STAND_AND_TIMES, kb=kb_id, **_times(session, moments))
        if row is None:
            for moment in moments:
                _refuse_future(moment, store.clock(session), FIRST_MOMENT)
            return Stand(0, 0, 0, (0,) * len(moments))
        revision, archived, redefined, committed_at, *times = row
        # From a revision without end, a log would never end.
        names = ("revision", "archived_revision", "definition_revision")
        check_numbers(session, kb_id or 0, zip(names, row[:3], strict=True))
        if moments:
            now = session.now(times.pop(0))
            with reading_rows("head", f"knowledge base {kb_id!r}"):
                last = FIRST_MOMENT if committed_at is None else session.to_time(committed_at)
            for moment in moments:
                _refuse_future(moment, now, last)
        found = tuple(number or 0 for number in times[: len(moments)])
        return Stand(revision, archived, redefined, found)

    return store.glance(work)


def _times(session: Session, moments: Sequence[datetime]) -> dict[str, Any]:
    times = dict.fromkeys(_MOMENTS)
    for name, moment in zip(_MOMENTS, moments, strict=False):
        times[name] = session.from_time(min(max(moment, FIRST_MOMENT), LAST_MOMENT))
    return times


def check_zone(moment: datetime) -> None:
    """Refuse a time without zone.

    Args:
        moment: the time.

    Raises:
        UnknownRevisionError: it has none.
    """
    if moment.utcoffset() is None:
        raise UnknownRevisionError(f"the time {moment.isoformat()} has no zone; give one, as UTC")


def _refuse_future(moment: datetime, now: datetime, last: datetime) -> None:
    # The clock may have gone back since the last revision.
    if moment > now and moment > last:
        raise UnknownRevisionError(
            f"the time {moment.isoformat()} is in the future: the store's clock says "
            f"{now.isoformat()}"
        )


def head_revision(store: Store) -> int:
    """Read the number of the last revision.

    Args:
        store: the store.

    Returns:
        The number; 0 before the first revision.
    """
    transaction = store.current()
    return read_stand(store).revision if transaction is None else transaction.head.revision


def revision_at(store: Store, when: When, upto: int | None = None) -> int:
    """Find the revision that held at a time, or check a revision's number.

    Args:
        store: the store.
        when: a revision's number, or an aware time.
        upto: the revision that a view of the past looks at, which knows no later one; None for
            the head.

    Returns:
        The number; 0 before the first revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to it yet, or the time has no zone.
    """
    if upto is not None and not isinstance(when, datetime):
        return check_number(store, when, upto)
    (revision,), _ = _find(store, [when], upto)
    return revision


def state_at(store: Store, when: When, upto: int | None = None) -> int:
    """Find the revision that held at a time, and make sure that its state is in this store.

    Args:
        store: the store.
        when: a revision's number, or an aware time.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The number; 0 before the first revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to it yet, or the time has no zone.
        ArchivedError: a part of that state was moved to an archive.
    """
    (revision,), _ = states_at(store, [when], upto)
    return revision


def states_at(
    store: Store, whens: Sequence[When], upto: int | None = None
) -> tuple[list[int], Stand]:
    """Find the revisions of one or two states, as `state_at` does, with one statement.

    Args:
        store: the store.
        whens: revisions' numbers, or aware times.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The numbers, and how far the knowledge base has come.
    """
    revisions, stand = _find(store, whens, upto)
    for revision in revisions:
        if revision < stand.archived:
            refuse_archived(store, revision)
    return revisions, stand


def _find(store: Store, whens: Sequence[When], upto: int | None) -> tuple[list[int], Stand]:
    stand = read_stand(store, [when for when in whens if isinstance(when, datetime)])
    found = iter(stand.found)
    revisions = []
    for when in whens:
        if not isinstance(when, datetime):
            revisions.append(check_number(store, when, last_known(store, stand, upto)))
        else:
            revisions.append(next(found) if upto is None else min(next(found), upto))
    return revisions, stand


def last_known(store: Store, stand: Stand, upto: int | None) -> int:
    """Give the last revision that someone may ask for.

    Args:
        store: the store.
        stand: how far the knowledge base has come.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        Its number. What an open transaction has made is no revision yet, in memory neither.
    """
    if upto is not None:
        return upto
    transaction = store.current()
    return stand.revision if transaction is None else transaction.head.revision


def check_number(store: Store, when: int, last: int) -> int:
    """Refuse what is not the number of a revision that there is.

    Args:
        store: the store.
        when: the number; 0 is before the first revision.
        last: the last revision.

    Returns:
        The number.

    Raises:
        UnknownRevisionError: it is none.
    """
    expected = "a revision's number, or an aware time"
    whole_number(
        when, "what is asked for", least=None, expected=expected, error=UnknownRevisionError
    )
    refuse_unknown(store.name, when, last)
    return when
