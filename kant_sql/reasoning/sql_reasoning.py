"""Reasoning on an SQL store, of the present or of the past."""

from __future__ import annotations

from typing_extensions import override

from ..arguments import expect
from ..dao.base import SqlDao
from ..documents.exchange import SqlExchange
from ..documents.interfaces import State
from ..dto import PddlObjectDto
from ..dto.formulas import Formula, Node
from ..history.interfaces import When
from ..history.moments import state_at
from ..planning import Plan
from ..plans.interfaces import RecordedPlan
from .ask import Answers, Binding, holds, query
from .held import HeldPeriods
from .interfaces import Reasoning
from .validate import Validation, validate
from .when import when


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

    @override
    def validate(self, plan: Plan | RecordedPlan, *, at: When | None = None) -> Validation:
        expect(plan, (Plan, RecordedPlan), "the plan")
        state = self._state(at)
        return validate(state.domain, state.problem, plan)

    def _state(self, when: When | None) -> State:
        """Read the whole state at a moment; by default the one that this is a view of."""
        store = self._store
        revision = self._at if when is None else state_at(store, when, self._at)
        return SqlExchange(store, revision)._state()

    # The past.

    @override
    def when(
        self,
        condition: Formula | str,
        /,
        *,
        since: When | None = None,
        until: When | None = None,
        parameters: str | None = None,
        **bindings: str | PddlObjectDto,
    ) -> HeldPeriods:
        return when(self._store, condition, since, until, parameters, bindings, self._at)
