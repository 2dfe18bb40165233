"""Reasoning on an SQL store, of the present or of the past."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

from typing_extensions import override

from ..arguments import expect
from ..dao.base import SqlDao
from ..documents.exchange import PlanningTask, read_task
from ..dto import PddlObjectDto
from ..dto.formulas import Formula, Node
from ..history.moments import state_at
from ..html import Feed
from ..moment_text import When
from ..planning import Plan, PlanStep
from ..plans.interfaces import RecordedPlan, RecordedStep
from ..store.state import State
from .act import applicable_actions, is_applicable, why_not
from .ask import Answers, Binding, holds, query
from .complete import DEFAULT_LIMIT, Completion, complete
from .durative import BrokenInvariant, abort, apply, broken_invariants, end, start
from .explain import is_goal_reached, metric_value, unsatisfied, unsatisfied_goals
from .failures import FailedCondition
from .held import HeldPeriods
from .interfaces import Reasoning
from .rules import Rules, check_rules
from .steps import Step
from .undo import Aborted
from .validate import Validation, validate
from .verdicts import Verdicts
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

    @override
    def complete(self, beginning: str, *, limit: int = DEFAULT_LIMIT) -> list[Completion]:
        return complete(self._store, self._at, beginning, limit)

    # Explain.

    @override
    def unsatisfied(self, condition: str | Node, /, **bindings: Binding) -> list[FailedCondition]:
        return unsatisfied(self._store, self._at, condition, bindings)

    @override
    def unsatisfied_goals(self) -> list[FailedCondition]:
        return unsatisfied_goals(self._store, self._at)

    @override
    def is_goal_reached(self) -> bool:
        return is_goal_reached(self._store, self._at)

    @override
    def metric_value(self) -> Decimal | None:
        return metric_value(self._store, self._at)

    @override
    def why_not(self, step: Step) -> list[FailedCondition]:
        return why_not(self._store, self._at, step)

    # Act.

    @override
    def applicable_actions(
        self, name: str | None = None, *, limit: int | None = None, **fixed: Binding
    ) -> Iterator[PlanStep]:
        def found(most: int | None) -> Iterator[PlanStep]:
            return applicable_actions(self._store, self._at, name, most, fixed)

        def again(most: int) -> Iterator[PlanStep]:
            return found(most if limit is None else min(most, limit))

        return Feed(found(limit), again=again, noun="step")

    @override
    def is_applicable(self, step: Step) -> bool:
        return is_applicable(self._store, self._at, step)

    @override
    def apply(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> int | None:
        self._check_writable()
        return apply(self._store, step, reason, plan_step)

    @override
    def start(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> RecordedStep:
        self._check_writable()
        return start(self._store, step, reason, plan_step)

    @override
    def end(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> int | None:
        self._check_writable()
        return end(self._store, step, reason, plan_step)

    @override
    def abort(self, step: Step, *, reason: str | None = None, undo: bool = False) -> Aborted:
        self._check_writable()
        return abort(self._store, step, reason, undo)

    @override
    def broken_invariants(self) -> list[BrokenInvariant]:
        return broken_invariants(self._store, self._at)

    # Plans.

    @override
    def validate(self, plan: Plan | RecordedPlan, *, at: When | None = None) -> Validation:
        expect(plan, (Plan, RecordedPlan), "the plan")
        state = self._state(at)
        return validate(state.domain, state.problem, plan)

    def _state(self, when: When | None) -> PlanningTask:
        """Read the whole state at a moment; by default the one that this is a view of."""
        store = self._store
        revision = self._at if when is None else state_at(store, when, self._at)
        return read_task(State(store, revision))

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

    @override
    def check_rules(
        self,
        rules: Rules | None = None,
        *,
        since: When | None = None,
        until: When | None = None,
        clock: str = "committed",
    ) -> Verdicts:
        return check_rules(self._store, rules, since, until, clock, self._at)
