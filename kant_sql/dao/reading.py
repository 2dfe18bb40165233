"""Reading what held, now or at a revision, together with the definitions that go with it."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, Select, literal_column, select, union_all

from ..backends import Query, Row
from ..knowledge.loading import KB
from ..knowledge.past import then
from ..tables import HeadRow
from ..view import DefinitionsMovedError, View, refuse_archived

_Rows = Select[*tuple[Any, ...]]
# The head says, in the same statement, which definitions go with what is read, and what was moved
# to an archive. Ids begin at 1.
_HEAD_ID, NO_ID, _ARCHIVE_ID = 0, -1, -2


class Reading:
    """One question about what holds, as asked of the present and of the past."""

    def __init__(self, now: _Rows, then: _Rows, *blank: ColumnElement[Any]) -> None:
        """Make it.

        Args:
            now: reads what holds now; its first two columns are numbers, an id and another.
            then: reads the same of the revision `at`.
            *blank: what the row of the head has in the other columns.
        """
        head, archive = (
            select(literal_column(str(id_)), column, *blank).where(HeadRow.kb_id == KB)
            for id_, column in (
                (_HEAD_ID, HeadRow.definition_revision),
                (_ARCHIVE_ID, HeadRow.archived_revision),
            )
        )
        self._now = Query(union_all(now, head))
        self._then = Query(union_all(then, head, archive))

    def rows(self, view: View, **parameters: Any) -> list[Row]:
        """Ask it.

        Args:
            view: the state to read from.
            **parameters: the question's parameters.

        Returns:
            The rows, in the order of their ids.

        Raises:
            DefinitionsMovedError: the definitions of the view are not those of the head any more.
            ArchivedError: a part of the past that the view looks at was moved to an archive.
        """
        if view.kb_id is None:
            return []
        query, past = self._now, {}
        if view.at is not None:
            query, past = self._then, then(view.session, view.at)
        rows = view.session.rows(query, kb=view.kb_id, **past, **parameters)
        rows.sort()
        if view.at is not None and rows and rows[0][0] == _ARCHIVE_ID:
            refuse_archived(view.session, view.kb_id, view.at, rows.pop(0)[1])
        head = rows.pop(0) if rows and rows[0][0] == _HEAD_ID else None
        if view.definition_revision not in (None, head and head[1]):
            raise DefinitionsMovedError
        return rows
