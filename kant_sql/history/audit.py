"""The views for auditors, as tables with types."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..dao.base import NO_ID
from ..errors import ReadOnlyError
from ..sql.audit_views import find_audit_view, import_arrow, read_view
from ..store.state import State

if TYPE_CHECKING:
    import pyarrow


def to_arrow(state: State, view: str) -> pyarrow.Table:
    """Read a view for auditors as a table with types, for pandas, polars and DuckDB.

    Times are timestamps in UTC, numbers of revisions, ids and counts 64-bit integers, seconds
    and numbers doubles, truths booleans; the rest, JSON of the source too, is text.

    Args:
        view: the view's name, as `fact` or `audit_fact`; `docs/audit.md` describes them.

    Returns:
        Its rows that are of this knowledge base, as they are committed, oldest first. To read
        more than fits into memory, use `kant_sql.export.open_reader`.

    Raises:
        InvalidArgumentError: there is no such view.
        ExtraMissingError: pyarrow is not installed; the extra `data` has it.
        ReadOnlyError: this is a view of the past, as these views have all of the history; or
            the task or thread has a transaction open.

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
    if store.current() is not None:
        raise ReadOnlyError(
            f"a transaction of knowledge base {store.name!r} is open, and {found.name} reads "
            "committed "
            "revisions; end it first"
        )
    return store.query_in_snapshot(
        lambda session, kb_id: read_view(session, found, NO_ID if kb_id is None else kb_id)
    )
