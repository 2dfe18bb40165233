"""Plans, what became of their steps, and archives: texts against columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from hashlib import sha256
from typing import Any

from sqlalchemy import select

from ..backends import Query, Row, Session
from ..dto.atom_dto import atom_text
from ..knowledge.loading import KB
from ..knowledge.plan import PlanDefinition, StepDefinition, plan_rows, status_text
from ..knowledge.rows import table_of
from ..tables import (
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    RevisionPlanStepRow,
    RevisionRow,
)
from .findings import Report
from .merging import Side, in_order, side
from .naming import Names
from .wording import is_decimal, is_end

_STEP, _LINK = table_of(PlanStepRow).c, table_of(RevisionPlanStepRow).c
_REVISION = table_of(RevisionRow).c

_PLANS = in_order(table_of(PlanRow), key=1)
_STEPS = in_order(table_of(PlanStepRow), key=2)
_ARGUMENTS = in_order(table_of(PlanStepArgumentRow), key=3)
_VERSIONS = in_order(table_of(PlanStepVersionRow), key=3)
# The steps that revisions name, and whether there are such revisions and such steps.
_LINKS = Query(
    select(
        _LINK.number,
        _LINK.plan_id,
        _LINK.position,
        select(_REVISION.number)
        .where(_REVISION.kb_id == _LINK.kb_id, _REVISION.number == _LINK.number)
        .scalar_subquery(),
        select(_STEP.position)
        .where(
            _STEP.kb_id == _LINK.kb_id,
            _STEP.plan_id == _LINK.plan_id,
            _STEP.position == _LINK.position,
        )
        .scalar_subquery(),
    )
    .where(_LINK.kb_id == KB)
    .order_by(_LINK.number)
)


class PlanCheck:
    """Compares plans with their steps, and these with what became of them."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        names: Names,
        report: Report,
    ) -> None:
        """Make it.

        Args:
            session: the session, in a transaction.
            kb_id: the knowledge base.
            names: the names of actions and objects.
            report: takes what is wrong.
        """
        self._session = session
        self._kb_id = kb_id
        self._actions, self._objects = names.known["action"], names.known["object"]
        self._report = report

    def run(self) -> None:
        """Check all of them."""
        steps, arguments, versions = (
            side(self._session, self._kb_id, query, 1, self._stray(table))
            for query, table in (
                (_STEPS, "plan_step"),
                (_ARGUMENTS, "plan_step_argument"),
                (_VERSIONS, "plan_step_version"),
            )
        )
        for plan in self._session.stream(_PLANS, kb=self._kb_id):
            self._check_plan(plan, steps, arguments)
            self._check_versions(plan, [*versions.take(plan[0])])
        for each in (steps, arguments, versions):
            each.end()
        for number, plan_id, position, revision, step in self._session.stream(
            _LINKS, kb=self._kb_id
        ):
            if revision is None or step is None:
                self._report.add(
                    number,
                    "revision_plan_step",
                    f"revision {number} and step {position} of plan {plan_id} are said to belong "
                    "together, and one of them is missing",
                )

    def _check_plan(self, plan: Row, steps: Side, arguments: Side) -> None:
        step_rows, argument_rows = [*steps.take(plan[0])], [*arguments.take(plan[0])]
        self._steps = len(step_rows)
        definition = _definition(plan, step_rows, argument_rows)
        for table, fault in self._faults(plan, definition):
            self._report.add(plan[1], table, f"plan {plan[0]}: {fault}")
        given: Counter[Any] = Counter([("plan", *plan)])
        given.update(("plan_step", *row) for row in step_rows)
        given.update(("plan_step_argument", *row) for row in argument_rows)
        written = plan_rows(self._kb_id, plan[1], definition)
        expected = Counter((table.name, *row[1:]) for table, row in written)
        for table in {key[0] for key in (given - expected) + (expected - given)}:
            fault = f"rows of {table} are not those that plan {plan[0]} has"
            self._report.add(plan[1], table, fault)

    def _faults(self, plan: Row, definition: PlanDefinition) -> Iterator[tuple[str, str]]:
        for step in definition.steps:
            if step.text != self._step_text(step):
                yield "plan_step", f"'{step.text}' is not what its action and arguments say"
            if not all(each is None or is_decimal(each) for each in (step.start, step.duration)):
                yield "plan_step", f"'{step.text}' has a time that is no number"
        domain, problem = definition.domain_pddl, definition.problem_pddl
        if domain is not None and problem is not None:
            digest = sha256(f"{domain}{problem}".encode()).hexdigest()
            if digest != definition.problem_hash:
                yield "plan", "problem_hash is not that of the texts that are kept"
        if definition.value is not None and not is_decimal(definition.value):
            yield "plan", f"its value {definition.value!r} is no number"
        if definition.text != plan[11]:
            yield "plan", "its columns and its steps are not what its text says"

    def _step_text(self, step: StepDefinition) -> str:
        names = [self._objects[id_] for id_ in step.object_ids]
        return atom_text(self._actions[step.action_id], names)

    def _check_versions(self, plan: Row, versions: list[Row]) -> None:
        before: Row | None = None
        for version in versions:
            plan_id, position, since, until, status, text = version
            fault = None
            if not 0 <= position < self._steps:
                fault = "is of a step that the plan does not have"
            elif text != status_text((plan_id, position), status):
                fault = f"has the status {status!r}"
            elif until is not None and not is_end(until, since):
                fault = "ends before it begins, or in no revision"
            elif (
                before is not None
                and before[1] == position
                and (before[3] is None or before[3] > since)
            ):
                fault = "overlaps the status before it"
            if fault is not None:
                message = f"'{text}' since revision {since} {fault}"
                self._report.add(since, "plan_step_version", message)
            before = version

    def _stray(self, table: str) -> Any:
        def report(row: Row) -> None:
            self._report.add(
                None, table, f"a row of {table} is of plan {row[0]}, of which plan has no row"
            )

        return report


def _definition(plan: Row, steps: list[Row], arguments: list[Row]) -> PlanDefinition:
    """Make a plan of its rows, each list in its order."""
    objects: dict[int, list[int]] = {}
    for _, position, _, object_id in arguments:
        objects.setdefault(position, []).append(object_id)
    made = tuple(
        StepDefinition(start, duration, action_id, tuple(objects.get(position, ())), text)
        for _, position, start, duration, action_id, text in steps
    )
    return PlanDefinition._make((plan[0], *plan[2:11], made))
