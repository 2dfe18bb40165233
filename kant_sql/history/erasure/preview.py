"""The preview of an erasure: the texts it would destroy, and others that may name the person."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from difflib import SequenceMatcher
from functools import cache
from itertools import islice
from typing import Any, NamedTuple

from sqlalchemy import Text, cast, null, select

from ... import html
from ...dto.elements import PddlObjectDto
from ...dto.lexical import fold
from ...sql import tables as t
from ...sql.dialects.base import Session
from ...sql.dialects.containing import contains, is_in
from ...sql.query import Query
from ...sql.rows import KB, KIND_TABLES, table_of
from ...store.state import State
from ..rewriting.texts import WITH_TREES
from .erase import Eraser, NothingErasedError, begun, make_wanted, opened, patterns_of, tells

# The maximum number of listed texts per place.
LISTED = 100
# The minimum similarity of similar names, from 0 to 1.
_SIMILAR = 0.8
_DOCUMENT = t.TABLES["document_version"]
_Place = tuple[str, Any, str, str | None]
# Texts by people and planners, which are not rewritten from rows.
_PLACES: tuple[_Place, ...] = (
    ("actor", table_of(t.RevisionRow), "actor", "number"),
    ("reason", table_of(t.RevisionRow), "reason", "number"),
    ("source", table_of(t.RevisionRow), "source", "number"),
    ("message", table_of(t.ExecutionVersionRow), "message", "since"),
    ("code", table_of(t.ExecutionVersionRow), "code", "since"),
    ("act", table_of(t.ExecutionRow), "name", "since"),
    ("argument", table_of(t.ExecutionArgumentRow), "value", None),
    ("planner", table_of(t.PlanRow), "planner", "since"),
    ("planner's version", table_of(t.PlanRow), "planner_version", "since"),
    ("plan's objective", table_of(t.PlanRow), "objective", "since"),
    ("plan's status", table_of(t.PlanRow), "status", "since"),
    ("plan's domain", table_of(t.PlanRow), "domain_pddl", "since"),
    ("plan's problem", table_of(t.PlanRow), "problem_pddl", "since"),
    ("document's title", _DOCUMENT, "title", "since"),
    *(
        (name.split("_")[-1], table, "name", None)
        for name, table in t.TABLES.items()
        if name.endswith(("_parameter", "_variable"))
    ),
    *(("preference", t.TABLES[f"{kind}_node"], "value", None) for kind in WITH_TREES),
)
# The name, and other stores' places: only from this store, even if an archive has the history.
_OWN: tuple[_Place, ...] = (
    ("knowledge base", table_of(t.KnowledgeBaseRow), "name", None),
    ("archive", table_of(t.ArchiveRow), "target", "revision"),
    ("origin", table_of(t.PromotionRow), "origin", "revision"),
)


class Mention(NamedTuple):
    """A text that contains the name, and that the erasure would not change.

    Attributes:
        place: the kind of text: `reason`, `message` ...
        revision: its revision; None if the table has none.
        text: the text.
    """

    place: str
    revision: int | None
    text: str

    def _html_row_(self) -> html.Row:
        return self._asdict()


class ErasurePreview(NamedTuple):
    """The effect of an erasure, and other texts that may name the same person.

    Attributes:
        element_id: the object.
        pseudonym: its new name.
        parts: the number of texts that would be erased.
        revisions: the number of their revisions.
        form_1: the number of these with form 1 of the hash, from which a name can be guessed.
        mentions: other texts that contain the name; the first hundred of each place.
        similar: other names that contain it, are part of it or have a similar spelling.
    """

    element_id: int | None
    pseudonym: str
    parts: int
    revisions: int
    form_1: int
    mentions: tuple[Mention, ...]
    similar: tuple[str, ...]

    def _repr_html_(self) -> str:
        counts = self._asdict() | {"mentions": len(self.mentions)}
        return html.fields(counts) + html.listing(self.mentions, "mention")


@cache
def _mentions(table: Any, column: str, revision: str | None) -> Query:
    said = cast(table.c[column], Text)
    at = null() if revision is None else table.c[revision]
    own = table.c.get("kb_id", table.c.get("id"))
    return Query(select(at, said).where(own == KB, contains(said)))


_NAMES = {
    kind: Query(select(tables.identity.c.name).where(tables.identity.c.kb_id == KB))
    for kind, tables in KIND_TABLES.items()
    if kind not in ("formula", "document")
}


def erasure_preview(
    state: State, element: PddlObjectDto | str, *, archive: str | None = None
) -> ErasurePreview:
    """Count the texts that an erasure would destroy, and list others that may name the person.

    It erases in a transaction, counts, and rolls back: it changes nothing.

    Args:
        element: the object, or its name.
        archive: the URL of the archive that has a part of the history: it is verified, and gets the
            revisions that it lacks.

    Returns:
        The counts, the texts that contain the name and would stay, and similar names.

    Raises:
        UnknownNameError: there never was such an object.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
        ConflictError: `archive` is not the archive that has a part of the history.

    Examples:
        >>> found = kb.erasure_preview("rb1")
        >>> found.parts, found.revisions, found.mentions
        (2, 1, ())
    """
    store, wanted = state.store, make_wanted(element, (), (), ())
    found = None
    with (
        opened(store, archive) as moved,
        suppress(NothingErasedError),
        begun(store, moved, None, None) as transaction,
    ):
        done = Eraser(transaction, wanted, True, moved).run()
        own = transaction.session, transaction.kb_id
        name = wanted.name or ""
        history = own if moved is None else moved.stores[:2]
        mentions = (*_mentioned(*history, name, _PLACES), *_mentioned(*own, name, _OWN))
        similar = tuple(sorted(_similar(*own, name)))
        found = ErasurePreview(*done[1:6], mentions, similar)
        raise NothingErasedError
    assert found is not None
    return found


def _mentioned(
    session: Session, kb_id: int, name: str, places: tuple[_Place, ...]
) -> Iterator[Mention]:
    patterns = patterns_of(session, name)
    for place, *column in places:
        query = _mentions(*column)
        found: set[Any] = set()
        for each in patterns:
            rows = session.stream(query, kb=kb_id, pattern=each)
            found |= {*islice((row for row in rows if tells(row[1], name)), LISTED)}
        yield from (Mention(place, *row) for row in sorted(found))


def _similar(session: Session, kb_id: int, name: str) -> Iterator[str]:
    key = fold(name)
    matcher = SequenceMatcher(b=key)
    for kind, query in _NAMES.items():
        for (other,) in session.stream(query, kb=kb_id):
            given = fold(other)
            matcher.set_seq1(given)
            is_alike = matcher.real_quick_ratio() >= _SIMILAR and matcher.ratio() >= _SIMILAR
            if is_in(name, other) or (len(given) > 2 and is_in(other, name)) or is_alike:
                yield other if kind == "object" else f"{kind} {other}"
