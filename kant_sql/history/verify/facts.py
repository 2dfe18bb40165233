"""Compares the texts of facts, goals, values and plans with their ids and columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from hashlib import sha256
from math import copysign
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Table, func, select, union

from ...dto.elements import atom_text, value_text
from ...sql import tables as t
from ...sql.dialects.base import Row
from ...sql.intervals import fork
from ...sql.plans import PlanDefinition, StepDefinition, plan_rows, status_text
from ...sql.query import Query, in_rows
from ...sql.rows import KB, looked_up, table_of
from .definition_check import IdentityNames, ObjectFunctions, doubles, is_decimal
from .sides import AFTER, Check, Side, Touched, differing, interval_fault


class _Atoms(NamedTuple):
    """The tables of ground atoms or fluents; the columns that both checks use come first."""

    identity: Table
    arguments: Table
    version: Table
    said: tuple[str, ...]  # columns of the identity table
    held: tuple[str, ...]  # columns of the version table
    doubles: Query
    touched: Touched


def _atoms(
    identity: type[t.Base],
    arguments: type[t.Base],
    version: type[t.Base],
    key: tuple[str, ...],
    held: tuple[str, ...],
) -> _Atoms:
    tables = table_of(identity), table_of(arguments), table_of(version)
    owner, *others = key
    said = ("id", owner, "arguments", "text", *others)
    ends = (f"{tables[0].name}_id", "since", "until", owner, "fork")
    # In the order of the unique index.
    double = doubles(tables[0], *others, owner, "arguments").order_by(func.min(tables[0].c.id))
    touched = Touched(tables[2], ends[0])
    return _Atoms(*tables, said, (*ends, *held), Query(double), touched)


_FACTS = _atoms(
    t.PropositionRow,
    t.PropositionArgumentRow,
    t.PropositionVersionRow,
    ("predicate_id", "is_goal"),
    ("is_goal", "first_object_id", "second_object_id"),
)
_FLUENTS = _atoms(
    t.FunctionValueRow,
    t.FunctionValueArgumentRow,
    t.FunctionValueVersionRow,
    ("function_id",),
    ("value", "number", "object_id", "text"),
)


class FactCheck:
    """Compares interned propositions, fluents and their versions with their names and arguments."""

    def __init__(
        self,
        check: Check,
        names: IdentityNames,
        object_functions: ObjectFunctions,
        tick: Callable[[int], None],
    ) -> None:
        self._check = check
        self._add = check.report.add
        self._tick = tick
        self._names = names.known
        self._objects = names.known["object"]
        self._object_functions = object_functions

    def run(self) -> None:
        """Run the checks."""
        self._compare(_FACTS, "predicate", _is_fact_right)
        self._compare(_FLUENTS, "function", self._is_value_right)
        # All are read for it: of new ones, the unique index has none that was there before.
        for atoms in () if self._check.after else (_FACTS, _FLUENTS):
            table = atoms.identity.name
            for first, second in self._check.rows(atoms.doubles):
                self._add(None, table, f"rows {first} and {second} of {table} are the same")

    def _compare(
        self, atoms: _Atoms, kind: str, is_right: Callable[[Row, Row, Sequence[int]], bool]
    ) -> None:
        """Merge identities, arguments and versions by the id of the identity."""
        table, owners, touched = atoms.identity, self._names[kind], atoms.touched
        arguments = self._check.side(atoms.arguments, table, narrow=touched.parts)
        versions = self._check.side(atoms.version, table, *atoms.held, narrow=touched.versions)
        for row in self._check.read(table, *atoms.said, narrow=touched.identities):
            own = [*arguments.take(row[0])]
            ids = [argument[2] for argument in own]
            self._check_text(atoms, row, owners[row[1]], own)
            before: int | None = 0
            for version in versions.take(row[0]):
                _, since, until, owner, kept, *_ = version
                if (
                    before is None
                    or since < before
                    or (until is not None and until <= since)
                    or kept != fork(since, until)
                ):
                    fault = interval_fault(before, since, until)
                    fault = fault or f"has the fork {kept}, which is not that of its revisions"
                    self._report_version(atoms, row[3], since, fault)
                if owner != row[1] or not is_right(row, version, ids):
                    text = version[-1] if "text" in atoms.held else row[3]
                    self._report_version(atoms, text, since, _DIFFERS[kind])
                before = until
            self._tick(row[0])
        arguments.end()
        versions.end()

    def _check_text(self, atoms: _Atoms, row: Row, owner: str, arguments: list[Row]) -> None:
        table = atoms.identity.name
        ids = [argument[2] for argument in arguments]
        if atom_text(owner, [self._objects[id_] for id_ in ids]) != row[3]:
            self._add(
                None,
                table,
                f"row {row[0]}, '{row[3]}', differs from its predicate or function and the rows "
                "of its arguments",
            )
        positions = [each[1] for each in arguments]
        if " ".join(map(str, ids)) != row[2] or positions != [*range(len(ids))]:
            self._add(
                None,
                f"{table}_argument",
                f"row {row[0]} of {table}, '{row[3]}', has the arguments {row[2]!r}, and other "
                f"rows in {table}_argument",
            )

    def _report_version(self, atoms: _Atoms, text: str, since: int, fault: str) -> None:
        self._add(since, atoms.version.name, f"'{text}' since revision {since} {fault}")

    def _is_value_right(self, row: Row, version: Row, _: Sequence[int]) -> bool:
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


# The fault of a version that contradicts its identity or its text, by kind.
_DIFFERS = {
    "predicate": "has another predicate_id, is_goal, first_object_id or second_object_id than its "
    "proposition",
    "function": "has another function_id than its fluent, or a value, number or object that its "
    "text does not show",
}


def _is_fact_right(row: Row, version: Row, arguments: Sequence[int]) -> bool:
    is_goal, *objects = version[5:]
    first_two = [*arguments[:2], None, None][:2]
    # SQLite takes any number for true, the queries only 1.
    return is_goal == row[4] and row[4] in (False, True) and objects == first_two


def _is_nearest(number: float, value: str) -> bool:
    try:
        nearest = float(value)
    except ValueError:
        return False
    # A number too small for a double is a signed zero; SQLite drops the sign.
    return nearest == number and (number != 0 or copysign(1, number) >= copysign(1, nearest))


_PLANS = table_of(t.PlanRow)
_STEPS, _ARGUMENTS = table_of(t.PlanStepRow), table_of(t.PlanStepArgumentRow)
_VERSIONS = table_of(t.PlanStepVersionRow)
_STEP, _LINK = _STEPS.c, table_of(t.RevisionPlanStepRow).c
_REVISION = table_of(t.RevisionRow).c
# The steps of revisions, and whether revision and step exist.
_LINKS = Query(
    select(
        _LINK.number,
        _LINK.plan_id,
        _LINK.position,
        looked_up(_REVISION.number, _REVISION.number, _LINK.number),
        looked_up(_STEP.position, _STEP.position, _LINK.position, _STEP.plan_id == _LINK.plan_id),
    )
    .where(_LINK.kb_id == KB, _LINK.number > AFTER)
    .order_by(_LINK.number)
)


def _touched_plans() -> Select[Any]:
    """Select plans that were recorded, or a step of which changed, after a revision."""
    version, plan = _VERSIONS.c, _PLANS.c
    found = union(
        select(plan.id).where(plan.kb_id == KB, plan.since > AFTER),
        *(
            select(version.plan_id).where(version.kb_id == KB, end > AFTER)
            for end in (version.since, version.until)
        ),
    ).subquery("touched")
    return select(found.c.id)


def _touched(table: Table) -> ColumnElement[bool]:
    return in_rows(table.c.id, _touched_plans())


def _of_touched(table: Table) -> ColumnElement[bool]:
    return in_rows(table.c.plan_id, _touched_plans())


class PlanCheck:
    """Compares plans with their steps and the status of these."""

    def __init__(self, check: Check, names: IdentityNames) -> None:
        self._check = check
        self._add = check.report.add
        self._actions, self._objects = names.known["action"], names.known["object"]

    def run(self) -> None:
        """Run the checks."""
        sides = [
            self._check.side(table, _PLANS, narrow=_of_touched)
            for table in (_STEPS, _ARGUMENTS, _VERSIONS)
        ]
        steps, arguments, versions = sides
        for plan in self._check.read(_PLANS, narrow=_touched):
            count = self._check_plan(plan, steps, arguments)
            self._check_versions(plan, count, versions.take(plan[0]))
        for side in sides:
            side.end()
        for number, plan_id, position, revision, step in self._check.session.stream(
            _LINKS, kb=self._check.kb_id, after=self._check.after
        ):
            if revision is None or step is None:
                self._add(
                    number,
                    "revision_plan_step",
                    f"it links revision {number} with step {position} of plan {plan_id}, and one "
                    "of them is missing",
                )

    def _check_plan(self, plan: Row, steps: Side, arguments: Side) -> int:
        """Check one plan; return the number of its steps."""
        step_rows, argument_rows = [*steps.take(plan[0])], [*arguments.take(plan[0])]
        definition = _definition(plan, step_rows, argument_rows)
        for table, fault in self._faults(plan, definition):
            self._add(plan[1], table, f"plan {plan[0]}: {fault}")
        given = [
            ("plan", *plan),
            *(("plan_step", *row) for row in step_rows),
            *(("plan_step_argument", *row) for row in argument_rows),
        ]
        written = plan_rows(self._check.kb_id, plan[1], definition)
        expected = ((insert.table.name, *row[1:]) for insert, row in written)
        for table in differing(given, expected):
            self._add(plan[1], table, f"rows of {table} differ from those of plan {plan[0]}")
        return len(step_rows)

    def _faults(self, plan: Row, definition: PlanDefinition) -> Iterator[tuple[str, str]]:
        for step in definition.steps:
            if step.text != self._step_text(step):
                yield "plan_step", f"'{step.text}' differs from its action and arguments"
            if not all(each is None or is_decimal(each) for each in (step.start, step.duration)):
                yield "plan_step", f"'{step.text}' has a time that is not a number"
        domain, problem = definition.domain_pddl, definition.problem_pddl
        if domain is not None and problem is not None:
            digest = sha256(f"{domain}{problem}".encode()).hexdigest()
            if digest != definition.problem_hash:
                yield "plan", "problem_hash is not that of the stored texts"
        if definition.value is not None and not is_decimal(definition.value):
            yield "plan", f"its value {definition.value!r} is not a number"
        if definition.text != plan[11]:
            yield "plan", "its columns and its steps differ from its text"

    def _step_text(self, step: StepDefinition) -> str:
        names = [self._objects[id_] for id_ in step.object_ids]
        return atom_text(self._actions[step.action_id], names)

    def _check_versions(self, plan: Row, steps: int, versions: Iterable[Row]) -> None:
        before: Row | None = None
        for version in versions:
            plan_id, position, since, until, status, text = version
            ended = before[3] if before is not None and before[1] == position else 0
            fault = interval_fault(ended, since, until)
            if not 0 <= position < steps:
                fault = "is of a step that the plan does not have"
            elif text != status_text((plan_id, position), status):
                fault = f"has the status {status!r}"
            if fault is not None:
                message = f"'{text}' since revision {since} {fault}"
                self._add(since, _VERSIONS.name, message)
            before = version


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
