"""The views for auditors, as tables with types."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..dao.base import NO_ID
from ..errors import ReadOnlyError
from ..sql.arrow import import_arrow, read_view
from ..sql.audit_views import find_audit_view
from ..store.store import Store

if TYPE_CHECKING:
    import pyarrow


def read_audit(store: Store, view: str, at: int | None) -> pyarrow.Table:
    """Read what a view has of a knowledge base; see `History.to_arrow`."""
    found = find_audit_view(view)
    import_arrow()
    if at is not None:
        raise ReadOnlyError(
            f"{found.name} has all of the history, and this is knowledge base {store.name!r} as it "
            f"was at revision {at}: ask the knowledge base itself, and take the rows with since <= "
            f"{at} and (until is NULL or until > {at})"
        )
    if store.current() is not None:
        raise ReadOnlyError(
            f"a transaction of knowledge base {store.name!r} is open, and {found.name} has what is "
            "committed; end it first"
        )
    return store.query_in_snapshot(
        lambda session, kb_id: read_view(session, found, NO_ID if kb_id is None else kb_id)
    )
