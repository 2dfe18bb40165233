"""Following what changes: a feed that can be resumed."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from sqlalchemy import select

from ..backends import Query, Session
from ..errors import ArchivedError
from ..head import check_numbers
from ..knowledge.loading import KB
from ..store import Store
from ..tables import HeadRow
from ..view import archive_of, vanished
from .pages import PAGE, read_page
from .revisions import LogEntry, at_most, check_after, refuse_unknown

_HEAD = Query(select(HeadRow.revision, HeadRow.archived_revision).where(HeadRow.kb_id == KB))


class Place(NamedTuple):
    """Where a knowledge base stands.

    Attributes:
        kb_id: its id; None when it was never written to.
        head: the last revision.
        archived: what ended up to this revision was moved to an archive.
    """

    kb_id: int | None
    head: int
    archived: int


def read_changes(
    store: Store, after: int = 0, limit: int | None = None, upto: int | None = None
) -> Iterator[LogEntry]:
    """Read what changed, oldest first, in pages; `History.changes` says all of it.

    Args:
        store: the store.
        after: only revisions with a larger number.
        limit: at most so many; None for all that there are.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The entries. The first page is read, so that what is wrong with `after` is known at once.
    """
    check_after(after)
    left = at_most(limit)
    return _following(store, after, left, upto, _read_page(store, after, min(left, PAGE), upto))


def _following(
    store: Store, after: int, left: int, upto: int | None, page: list[LogEntry]
) -> Iterator[LogEntry]:
    size = PAGE
    while page:
        yield from page
        wanted, left = min(left, size), left - len(page)
        after = page[-1].revision.number
        # A page that ended early for its many changes says how many to ask for next.
        size = min(2 * size, PAGE) if len(page) == wanted else len(page)
        page = _read_page(store, after, min(left, size), upto)


def _read_page(store: Store, after: int, size: int, upto: int | None) -> list[LogEntry]:
    return store.look(partial(_page, name=store.name, after=after, size=size, upto=upto))


def _page(
    session: Session, kb_id: int | None, name: str, after: int, size: int, upto: int | None
) -> list[LogEntry]:
    _, head, archived = read_place(session, kb_id)
    head = head if upto is None else upto
    refuse_unknown(name, after, head)
    if kb_id is not None and after < archived:
        raise ArchivedError(
            f"changes of knowledge base {name!r} up to revision {archived} were moved to an "
            f"archive; begin after that one, or ask the archive in "
            f"{archive_of(session, kb_id, after)}"
        )
    high = int(min(head, after + size))
    return [] if kb_id is None or high <= after else read_page(session, kb_id, after + 1, high)


def read_place(session: Session, kb_id: int | None) -> Place:
    """Read where a knowledge base stands, by one statement.

    Args:
        session: the session.
        kb_id: the knowledge base; None when it was never written to.

    Returns:
        The place.

    Raises:
        StoreIntegrityError: the knowledge base was there, and is gone, or its head has no numbers.
    """
    if kb_id is None:
        return Place(None, 0, 0)
    row = session.first(_HEAD, kb=kb_id)
    if row is None:
        raise vanished(session)
    check_numbers(session, kb_id, zip(("revision", "archived_revision"), row[:2], strict=True))
    return Place(kb_id, row[0], row[1])
