"""Anchors, to keep outside of the store, and views for auditors as tables with types."""

from __future__ import annotations

import json
import re
from collections import Counter
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from sqlalchemy import select

from .. import html
from ..arguments import expect, shown
from ..dao.base import NO_ID
from ..errors import AnchorError, ReadOnlyError, missing_revision, reading_rows
from ..knowledge.canonical import time_text
from ..sql.audit_views import find_audit_view, import_arrow, read_view
from ..sql.dialects.base import Session
from ..sql.query import Query, constant
from ..sql.tables import HeadRow, KnowledgeBaseRow, RevisionRow
from ..store.state import State

if TYPE_CHECKING:
    import pyarrow

FORMAT = 1
_HASH = re.compile(r"[0-9a-f]{64}")
# The hash of the revision, not of the head: verification compares with the former.
_HEADS = Query(
    select(
        KnowledgeBaseRow.name,
        HeadRow.revision,
        RevisionRow.number,
        RevisionRow.hash,
        RevisionRow.committed_at,
    )
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .outerjoin(
        RevisionRow, (RevisionRow.kb_id == HeadRow.kb_id) & (RevisionRow.number == HeadRow.revision)
    )
    .where(HeadRow.revision.is_distinct_from(constant(0)))
    .order_by(KnowledgeBaseRow.id)
)


class AnchoredHead(NamedTuple):
    """The head of a knowledge base.

    Attributes:
        knowledge_base: its name.
        revision: the number of its last revision.
        hash: that revision's hash.
        committed_at: that revision's time, `2026-01-31T09:30:00.000000Z`.
    """

    knowledge_base: str
    revision: int
    hash: str
    committed_at: str


class Anchor(NamedTuple):
    """The heads of the knowledge bases of a store.

    Attributes:
        heads: those with a revision, the oldest knowledge base first.
        made_at: the time of reading by the store's clock, `2026-01-31T09:30:00.000000Z`.
    """

    heads: tuple[AnchoredHead, ...]
    made_at: str = ""

    def head(self, knowledge_base: str) -> AnchoredHead | None:
        """Find a knowledge base.

        Args:
            knowledge_base: its name.

        Returns:
            Its head; None if it is not in the anchor.
        """
        return next((head for head in self.heads if head.knowledge_base == knowledge_base), None)

    def _repr_html_(self) -> str:
        return html.lines(self.text())

    def text(self) -> str:
        """Write one small JSON document, which `parse_anchor` reads.

        Returns:
            The document, a line for each knowledge base.
        """
        heads = ",\n".join("  " + json.dumps(head._asdict()) for head in self.heads)
        return (
            f'{{"format": {FORMAT}, "made_at": {json.dumps(self.made_at)}, "heads": [\n{heads}\n]}}'
        )


def anchor(state: State) -> Anchor:
    """Read the heads of all knowledge bases of the store, to keep elsewhere.

    Returns:
        The heads; `verify` compares a later state with them.

    Examples:
        >>> anchor = kb.store.anchor()
        >>> kb.store.verify(anchor).is_intact
        True
    """

    def work(session: Session, _: int | None) -> Anchor:
        heads = []
        for name, last, number, digest, moment in session.rows(_HEADS):
            if number is None:
                raise missing_revision(session.backend.label, name, last)
            with reading_rows("revision", f"revision {number!r} of {name!r}"):
                time = time_text(session.to_time(moment))
            heads.append(AnchoredHead(name, number, digest, time))
        return Anchor(tuple(heads), time_text(state.store.clock(session)))

    return state.store.query_in_snapshot(work)


def parse_anchor(text: str | bytes) -> Anchor:
    """Parse the text of an anchor.

    Args:
        text: the JSON document.

    Returns:
        The anchor.

    Raises:
        AnchorError: the text is not an anchor, or is one of a later version of the library.
    """
    expect(text, (str, bytes, bytearray), "the text of an anchor", AnchorError)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise AnchorError(f"this is not an anchor, because it is not JSON: {error}") from error
    given = document.get("format") if isinstance(document, dict) else None
    if given is None or not isinstance(document.get("heads"), list):
        raise AnchorError(
            "this JSON document is not an anchor; give the output of `kant-sql anchor`"
        )
    if given != FORMAT:
        raise AnchorError(
            f"this anchor is of format {shown(given)}, and this version of kant_sql reads "
            f"{FORMAT}; use the version that wrote it, or a later one"
        )
    heads = tuple(
        _checked_head(position, _head(head)) for position, head in enumerate(document["heads"])
    )
    counts = Counter(head.knowledge_base for head in heads)
    double = next((name for name, count in counts.items() if count > 1), None)
    if double is not None:
        raise AnchorError(
            f"this anchor has two heads of knowledge base {shown(double)}; write a new anchor"
        )
    return Anchor(heads, str(document.get("made_at", "")))


def _head(given: object) -> AnchoredHead:
    values = given if isinstance(given, dict) else {}
    return AnchoredHead(*(values.get(field) for field in AnchoredHead._fields))  # type: ignore[arg-type]


def check_anchor(anchor: Anchor) -> Anchor:
    """Check an anchor that a caller built without `parse_anchor`."""
    expect(anchor, Anchor, "the anchor", AnchorError)
    heads = expect(anchor.heads, tuple, "heads of the anchor", AnchorError)
    for position, head in enumerate(heads):
        _checked_head(position, expect(head, AnchoredHead, "a head of the anchor", AnchorError))
    return anchor


def _is_time(text: str) -> bool:
    try:
        return time_text(datetime.fromisoformat(text)) == text
    except (ValueError, OverflowError):
        return False


def _checked_head(position: int, head: AnchoredHead) -> AnchoredHead:
    name, revision, digest, time = head
    has_texts = all(isinstance(text, str) for text in (name, digest, time))
    is_number = isinstance(revision, int) and not isinstance(revision, bool)
    is_whole = has_texts and is_number and revision > 0 and _HASH.fullmatch(digest)
    if not (is_whole and _is_time(time)):
        raise AnchorError(
            f"head {position} of this anchor lacks {', '.join(AnchoredHead._fields)}, or one of "
            "them is damaged; take another copy of it"
        )
    return head


def to_arrow(state: State, view: str) -> pyarrow.Table:
    """Read a view for auditors as a table with types, for pandas, polars and DuckDB.

    Times are timestamps in UTC; revisions, ids and counts are 64-bit integers; seconds and numbers
    are doubles; truth values are booleans; the rest, including the JSON of the source, is text.

    Args:
        view: the view's name, such as `fact` or `audit_fact`; `docs/audit.md` describes them.

    Returns:
        Its committed rows of this knowledge base, oldest first. To read more than fits into memory,
        use `kant_sql.export.open_reader`.

    Raises:
        InvalidArgumentError: there is no such view.
        ExtraMissingError: pyarrow is not installed; it comes with the extra `data`.
        ReadOnlyError: this is a view of the past, but these views have the whole history; or the
            task or thread has a transaction open.

    Examples:
        >>> facts = kb.store.to_arrow("fact")
        >>> facts.select(["text", "since", "asserted_by"]).to_pylist()
        [{'text': '(robot_at rb1 wp1)', 'since': 1, 'asserted_by': 'perception'}]
    """
    store, at = state
    found = find_audit_view(view)
    import_arrow()
    if at is not None:
        raise ReadOnlyError(
            f"{found.name} covers the whole history, and this is knowledge base {store.name!r} at "
            f"revision {at}: ask the knowledge base itself, and take the rows with since <= "
            f"{at} and (until is NULL or until > {at})"
        )
    store.refuse_open(f", and {found.name} reads committed revisions")
    return store.query_in_snapshot(
        lambda session, kb_id: read_view(session, found, NO_ID if kb_id is None else kb_id)
    )
