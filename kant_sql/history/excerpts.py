"""What pages have in common that show a part of a large store: where they read, and texts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, bindparam, func, select

from ..errors import InvalidArgumentError
from ..sql.dialects.base import Session
from ..sql.query import Query, in_list
from ..sql.rows import KB, PROPOSITION, VERSION_COLUMNS
from ..store.store import Store

# A pattern longer than this is refused by SQLite, which takes 50,000 bytes.
LONGEST_SOUGHT = 5_000


class StateReader(NamedTuple):
    """Where a page reads: a knowledge base, up to now or up to one revision."""

    store: Store
    at: int | None


class Place(NamedTuple):
    """A version of an element, before its text is read.

    Attributes:
        source: the key of `VERSION_COLUMNS`.
        kind: its kind, as in `Change`.
        owner: the id of its identity.
        since: the revision that asserted it.
    """

    source: str
    kind: str
    owner: int
    since: int


def contains(column: Any) -> ColumnElement[bool]:
    """Return whether a text contains the one of the parameter `pattern`, in any case."""
    return func.lower(column).like(bindparam("pattern"), escape="!")


def pattern_of(text: str) -> str:
    """Return the pattern of what contains a text.

    Raises:
        InvalidArgumentError: no text can contain it.
    """
    if "\0" in text:
        raise InvalidArgumentError("no text of a store contains a NUL; leave it out")
    # As `lower` of both databases does, which leaves all but ASCII as it is.
    folded = "".join([one.lower() if one.isascii() else one for one in text[:LONGEST_SOUGHT]])
    for special in ("!", "%", "_"):
        folded = folded.replace(special, f"!{special}")
    return f"%{folded}%"


def word_pattern(name: str) -> str:
    """Return the pattern of what has a name among words between spaces."""
    return f"% {pattern_of(name)[1:-1]} %"


@cache
def _texts(source: str) -> Query:
    columns = VERSION_COLUMNS[source]
    if source == PROPOSITION:
        atom = columns.identity
        return Query(select(atom.id, atom.text).where(atom.kb_id == KB, in_list(atom.id, "ids")))
    version = columns.version
    return Query(
        select(columns.owner, version.since, columns.text).where(
            version.kb_id == KB, in_list(columns.owner, "ids"), in_list(version.since, "revisions")
        )
    )


def read_texts(session: Session, kb_id: int, places: Sequence[Place]) -> list[str]:
    """Read the texts of some versions, in one statement for each source."""
    by_source: defaultdict[str, list[Place]] = defaultdict(list)
    for place in places:
        by_source[place.source].append(place)
    texts: dict[tuple[str, int, int], str] = {}
    for source, some in by_source.items():
        lists = {"ids": session.list_value(sorted({one.owner for one in some}))}
        if source != PROPOSITION:
            lists["revisions"] = session.list_value(sorted({one.since for one in some}))
        for owner, *since, text in session.rows(_texts(source), kb=kb_id, **lists):
            texts[source, owner, since[0] if since else 0] = text
    return [
        texts.get((one.source, one.owner, 0 if one.source == PROPOSITION else one.since), "")
        for one in places
    ]


class Excerpt(NamedTuple):
    """A page of something longer.

    Attributes:
        rows: what is on the page.
        next: the offset that the next page begins with; None for the last page.
    """

    rows: list[Any]
    next: int | None


def excerpt(rows: Iterable[Any], offset: int, limit: int) -> Excerpt:
    """Cut the row that a query reads beyond a page to know whether there is more."""
    found = list(rows)
    return Excerpt(found[:limit], offset + limit if len(found) > limit else None)
