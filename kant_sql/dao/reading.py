"""Reading what held, now or at a revision, together with the definitions that go with it."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, Select, literal_column, select, union_all

from ..backends import Query, Row
from ..knowledge.loading import KB
from ..tables import HeadRow
from ..view import DefinitionsMovedError, View

_Rows = Select[*tuple[Any, ...]]
# The head says, in the same statement, which definitions go with what is read. Ids begin at 1.
_HEAD_ID, NO_ID = 0, -1


class Reading:
    """One question about what holds, as asked of the present and of the past."""

    def __init__(self, now: _Rows, then: _Rows, *blank: ColumnElement[Any]) -> None:
        """Make it.

        Args:
            now: reads what holds now; its first two columns are numbers, an id and another.
            then: reads the same of the revision `at`.
            *blank: what the row of the head has in the other columns.
        """
        head = select(literal_column(str(_HEAD_ID)), HeadRow.definition_revision, *blank).where(
            HeadRow.kb_id == KB
        )
        self._now = Query(union_all(now, head))
        self._then = Query(then)

    def rows(self, view: View, **parameters: Any) -> list[Row]:
        """Ask it.

        Args:
            view: the state to read from.
            **parameters: the question's parameters.

        Returns:
            The rows, in the order of their ids.

        Raises:
            DefinitionsMovedError: the definitions of the view are not those of the head any more.
        """
        if view.kb_id is None:
            return []
        if view.at is not None:
            rows = view.session.rows(self._then, kb=view.kb_id, at=view.at, **parameters)
            rows.sort()
            return rows
        rows = view.session.rows(self._now, kb=view.kb_id, **parameters)
        rows.sort()
        head = rows.pop(0) if rows and rows[0][0] == _HEAD_ID else None
        if view.definition_revision not in (None, head and head[1]):
            raise DefinitionsMovedError
        return rows
