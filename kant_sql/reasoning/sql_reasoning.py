"""Reasoning on an SQL store, of the present or of the past."""

from __future__ import annotations

from typing_extensions import override

from ..dao.base import SqlDao
from ..dto.formulas import Node
from .ask import Answers, Binding, holds, query
from .interfaces import Reasoning


class SqlReasoning(SqlDao, Reasoning):
    """Reasoning on an SQL store, of the present or of the past."""

    # Ask.

    @override
    def holds(self, condition: str | Node, /, **bindings: Binding) -> bool:
        return holds(self._store, self._at, condition, bindings)

    @override
    def query(
        self,
        condition: str | Node,
        /,
        *,
        parameters: str | None = None,
        limit: int | None = None,
        **bindings: Binding,
    ) -> Answers:
        return query(self._store, self._at, condition, parameters, limit, bindings)

    # Explain.

    # Act.

    # Plans.

    # The past.

    # What if.
