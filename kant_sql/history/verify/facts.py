"""Compares the texts of facts, goals, values and plans with their ids and columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from hashlib import sha256
from math import copysign
from typing import Any

from sqlalchemy import func, select

from ...dto.elements import atom_text, value_text
from ...sql.dialects.base import Row, Session
from ...sql.intervals import fork
from ...sql.plans import PlanDefinition, StepDefinition, plan_rows, status_text
from ...sql.query import Query
from ...sql.rows import KB, table_of
from ...sql.tables import (
    FunctionValueArgumentRow,
    FunctionValueRow,
    FunctionValueVersionRow,
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    PropositionArgumentRow,
    PropositionRow,
    PropositionVersionRow,
    RevisionPlanStepRow,
    RevisionRow,
)
from .findings import Report
from .identities import (
    IdentityNames,
    ObjectFunctions,
    Side,
    doubles,
    in_order,
    is_decimal,
    is_end,
    side,
)

_ATOM, _FLUENT = table_of(PropositionRow), table_of(FunctionValueRow)

# The columns that both checks use come first.
_ATOMS = in_order(_ATOM, "id", "predicate_id", "arguments", "text", "is_goal", key=1)
_FLUENTS = in_order(_FLUENT, "id", "function_id", "arguments", "text", key=1)
_ATOM_ARGUMENTS = in_order(table_of(PropositionArgumentRow), key=2)
_FLUENT_ARGUMENTS = in_order(table_of(FunctionValueArgumentRow), key=2)
_ATOM_VERSIONS = in_order(
    table_of(PropositionVersionRow),
    *("proposition_id", "since", "until", "predicate_id", "fork", "is_goal"),
    key=2,
)
_VALUES = in_order(
    table_of(FunctionValueVersionRow),
    *("function_value_id", "since", "until", "function_id", "fork"),
    *("value", "number", "object_id", "text"),
    key=2,
)

_DOUBLE_ATOMS, _DOUBLE_FLUENTS = (
    Query(doubles(table, *key).order_by(func.min(table.c.id)))
    for table, key in (
        (_ATOM, ("is_goal", "predicate_id", "arguments")),
        (_FLUENT, ("function_id", "arguments")),
    )
)


class FactCheck:
    """Compares interned propositions, fluents and their versions with what they refer to."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        names: IdentityNames,
        object_functions: ObjectFunctions,
        report: Report,
        tick: Callable[[int], None],
    ) -> None:
        self._session = session
        self._kb_id = kb_id
        self._report = report
        self._tick = tick
        self._predicates = names.known["predicate"]
        self._functions = names.known["function"]
        self._objects = names.known["object"]
        self._object_functions = object_functions

    def run(self) -> None:
        """Run the checks."""
        self._check("proposition", _ATOMS, _ATOM_ARGUMENTS, _ATOM_VERSIONS)
        self._check("function_value", _FLUENTS, _FLUENT_ARGUMENTS, _VALUES)
        for table, query in (("proposition", _DOUBLE_ATOMS), ("function_value", _DOUBLE_FLUENTS)):
            for first, second in self._session.rows(query, kb=self._kb_id):
                self._report.add(None, table, f"rows {first} and {second} of {table} are the same")

    def _check(self, table: str, identities: Query, arguments: Query, versions: Query) -> None:
        """Merge identities, arguments and versions by the id of the identity."""
        is_atom = table == "proposition"
        owners = self._predicates if is_atom else self._functions
        is_right = _has_its_kind if is_atom else self._is_value_right
        session, kb_id, stray = self._session, self._kb_id, self._stray
        argument_side = side(session, kb_id, arguments, 1, stray(f"{table}_argument", table))
        version_side = side(session, kb_id, versions, 1, stray(f"{table}_version", table))
        for row in session.stream(identities, kb=kb_id):
            self._check_text(table, row, owners[row[1]], [*argument_side.take(row[0])])
            before: int | None = 0
            for version in version_side.take(row[0]):
                _, since, until, owner, kept, *_ = version
                if (
                    before is None
                    or since < before
                    or (until is not None and until <= since)
                    or kept != fork(since, until)
                ):
                    self._report_interval(table, row, before, version)
                if owner != row[1] or not is_right(row, version):
                    self._report_version(table, row, version)
                before = until
            self._tick(row[0])
        argument_side.end()
        version_side.end()

    def _check_text(self, table: str, row: Row, owner: str, arguments: list[Row]) -> None:
        ids = [argument[2] for argument in arguments]
        if atom_text(owner, [self._objects[id_] for id_ in ids]) != row[3]:
            self._report.add(
                None,
                table,
                f"row {row[0]}, '{row[3]}', is not what its predicate or function "
                "and the rows of its arguments say",
            )
        positions = [each[1] for each in arguments]
        if " ".join(map(str, ids)) != row[2] or positions != [*range(len(ids))]:
            self._report.add(
                None,
                f"{table}_argument",
                f"row {row[0]} of {table}, '{row[3]}', has the arguments {row[2]!r}, and other "
                f"rows in {table}_argument",
            )

    def _report_interval(self, table: str, row: Row, before: int | None, version: Row) -> None:
        since, until, kept = version[1], version[2], version[4]
        fault = f"has the fork {kept}, which is not that of its revisions"
        if until is not None and until <= since:
            fault = "ends before it begins"
        elif before is None or since < before:
            fault = "overlaps the version before it"
        message = f"'{row[3]}' since revision {since} {fault}"
        self._report.add(since, f"{table}_version", message)

    def _report_version(self, table: str, row: Row, version: Row) -> None:
        if table == "proposition":
            fault = f"'{row[3]}' since revision {version[1]} has another predicate_id or is_goal "
            fault += "than its proposition"
        else:
            fault = f"'{version[-1]}' since revision {version[1]} has another function_id than its "
            fault += "fluent, or a value, number or object that its text does not say"
        self._report.add(version[1], f"{table}_version", fault)

    def _is_value_right(self, row: Row, version: Row) -> bool:
        value, number, object_id, text = version[5:]
        # Otherwise a number could pass for an object of that name.
        if (object_id is not None) != (row[1] in self._object_functions.at(version[1])):
            return False
        if object_id is not None:
            name = self._objects[object_id]
            return value is None and number is None and value_text(row[3], name) == text
        if value is None or number is None:
            return False
        return value_text(row[3], value) == text and _is_nearest(number, value)

    def _stray(self, table: str, identity: str) -> Callable[[Row], None]:
        def report(row: Row) -> None:
            self._report.add(
                None, table, f"a row of {table} is of {row[0]}, of which {identity} has no row"
            )

        return report


def _has_its_kind(row: Row, version: Row) -> bool:
    # SQLite takes any number for true, the queries only 1.
    return version[5] == row[4] and row[4] in (False, True)


def _is_nearest(number: float, value: str) -> bool:
    try:
        nearest = float(value)
    except ValueError:
        return False
    # A number too small for a double is a signed zero; SQLite drops the sign.
    return nearest == number and (number != 0 or copysign(1, number) >= copysign(1, nearest))


_STEP, _LINK = table_of(PlanStepRow).c, table_of(RevisionPlanStepRow).c
_REVISION = table_of(RevisionRow).c

_PLANS = in_order(table_of(PlanRow), key=1)
_STEPS = in_order(table_of(PlanStepRow), key=2)
_ARGUMENTS = in_order(table_of(PlanStepArgumentRow), key=3)
_VERSIONS = in_order(table_of(PlanStepVersionRow), key=3)
# The steps of revisions, and whether revision and step exist.
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
    """Compares plans with their steps and the status of these."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        names: IdentityNames,
        report: Report,
    ) -> None:
        self._session = session
        self._kb_id = kb_id
        self._actions, self._objects = names.known["action"], names.known["object"]
        self._report = report

    def run(self) -> None:
        """Run the checks."""
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
        expected = Counter((insert.table.name, *row[1:]) for insert, row in written)
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
    """Build a plan from its rows."""
    objects: dict[int, list[int]] = {}
    for _, position, _, object_id in arguments:
        objects.setdefault(position, []).append(object_id)
    made = tuple(
        StepDefinition(start, duration, action_id, tuple(objects.get(position, ())), text)
        for _, position, start, duration, action_id, text in steps
    )
    return PlanDefinition._make((plan[0], *plan[2:11], made))
