"""Compares the texts of facts, goals, values, plans and executions with their ids and columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from hashlib import sha256
from math import copysign
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Table, and_, false, func, or_, select, union

from ...dto.elements import atom_text, value_text
from ...knowledge.sayings import Period
from ...sql import tables as t
from ...sql.dialects.base import Row
from ...sql.executions import (
    EXECUTION,
    NO_PLAN,
    OUTCOMES,
    PLAN_STEP,
    ExecutionDefinition,
    Key,
    PlanDefinition,
    id_text,
    of_execution,
    outcome_text,
    quoted,
    status_text,
)
from ...sql.intervals import FACT_SAYINGS, VALUE_SAYINGS, SayingTable, fork, fork_of_period
from ...sql.query import Query, constant, in_rows, integer
from ...sql.rows import ATOM_TABLES, KB, PROPOSITION, VALUE, AtomTables, looked_up, table_of
from .definition_check import IdentityNames, ObjectFunctions, doubles, is_decimal
from .sides import AFTER, Check, Touched, interval_fault, stored_time


class _Atoms(NamedTuple):
    """Ground atoms or fluents; the columns that both checks use come first."""

    tables: AtomTables
    sayings: SayingTable
    said: tuple[str, ...]  # columns of the identity table
    held: tuple[str, ...]  # columns of the version table
    doubles: Query
    touched: Touched


def _atoms(tables: AtomTables, sayings: SayingTable, *held: str) -> _Atoms:
    *others, head, arguments = tables.key
    said = ("id", head, arguments, "text", *others)
    ends = (tables.owner, "since", "until", head, "fork")
    # In the order of the unique index.
    double = doubles(tables.identity, *tables.key).order_by(func.min(tables.identity.c.id))
    touched = Touched(tables.version, tables.owner, tables.sayings)
    return _Atoms(tables, sayings, said, (*ends, *held), Query(double), touched)


_FACTS = _atoms(
    ATOM_TABLES[PROPOSITION], FACT_SAYINGS, "is_goal", "first_object_id", "second_object_id"
)
_FLUENTS = _atoms(ATOM_TABLES[VALUE], VALUE_SAYINGS, "value", "number", "object_id", "text")


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
        self._compare(_FACTS, "predicate", _is_fact_right, self._fact_said)
        self._compare(_FLUENTS, "function", self._is_value_right, self._value_said)
        # This reads all rows; a continued verification relies on the unique index for new ones.
        for atoms in () if self._check.after else (_FACTS, _FLUENTS):
            table = atoms.tables.identity.name
            for first, second in self._check.rows(atoms.doubles):
                self._add(None, table, f"rows {first} and {second} of {table} are the same")

    def _compare(
        self,
        atoms: _Atoms,
        kind: str,
        is_right: Callable[[Row, Row, Sequence[int]], bool],
        said: Callable[[Row, Row, Sequence[int]], tuple[bool, str] | None],
    ) -> None:
        """Merge identities, arguments, versions and sayings by the id of the identity."""
        tables, owners, touched = atoms.tables, self._names[kind], atoms.touched
        table, names, side = tables.identity, atoms.sayings.names[1:], self._check.side
        arguments = side(tables.arguments, table, narrow=touched.parts)
        versions = side(tables.version, table, *atoms.held, narrow=touched.versions)
        sayings = side(tables.sayings, table, *names, narrow=touched.said)
        for row in self._check.read(table, *atoms.said, narrow=touched.identities):
            own = [*arguments.take(row[0])]
            ids = [argument[2] for argument in own]
            self._check_text(atoms, row, owners[row[1]], own)
            before: int | None = 0
            for version in versions.take(row[0]):
                since, until, owner, kept = version[1:5]
                fault = interval_fault(before, since, until)
                if fault is None and kept != fork(since, until):
                    fault = f"has the fork {kept}, which is not that of its revisions"
                if fault is not None:
                    self._report_version(atoms, row[3], since, fault)
                if owner != row[1] or not is_right(row, version, ids):
                    text = version[-1] if "text" in atoms.held else row[3]
                    self._report_version(atoms, text, since, _DIFFERS[kind])
                before = until
            for saying in sayings.take(row[0]):
                fault = self._saying_fault(row, saying, said(row, saying, ids))
                if fault is not None:
                    shown = f"'{saying[5]}', said in revision {saying[1]}, {fault}"
                    self._add(saying[1], tables.sayings.name, shown)
            self._tick(row[0])
        arguments.end()
        versions.end()
        sayings.end()

    def _saying_fault(self, row: Row, saying: Row, said: tuple[bool, str] | None) -> str | None:
        """Find the fault of a saying; `said` is the meaning of its columns, if they have one."""
        _, _, *ends, kept, text, owner = saying[:7]
        try:
            begin, end = (stored_time(self._check.session, each) for each in ends)
        except (TypeError, ValueError):
            return "has a time that cannot be read"
        if not begin < end or kept != fork_of_period(begin, end):
            return f"has the fork {kept}, which is not that of its period, or no such period"
        if owner != row[1] or said is None:
            return "has columns that differ from what it is said of, or hold nothing that can be"
        if Period(begin, end, False).text(said[1], said[0]) != text:
            return "has a text that its columns do not show"
        return None

    def _fact_said(self, row: Row, saying: Row, ids: Sequence[int]) -> tuple[bool, str] | None:
        *objects, holds = saying[7:]
        # Facts only: goals have no sayings.
        is_right = _is_fact_right(row, (*saying[:5], False, *objects), ids)
        return (holds, row[3]) if is_right and holds in (False, True) else None

    def _value_said(self, row: Row, saying: Row, ids: Sequence[int]) -> tuple[bool, str] | None:
        value, number, object_id = saying[7:]
        if (value, number, object_id) == (None, None, None):
            return False, row[3]
        text = value_text(row[3], value if object_id is None else self._objects[object_id])
        version = (*saying[:5], value, number, object_id, text)
        return (True, text) if self._is_value_right(row, version, ids) else None

    def _check_text(self, atoms: _Atoms, row: Row, owner: str, arguments: list[Row]) -> None:
        table = atoms.tables.identity.name
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
        self._add(since, atoms.tables.version.name, f"'{text}' since revision {since} {fault}")

    def _is_value_right(self, row: Row, version: Row, _: Sequence[int]) -> bool:
        value, number, object_id, text = version[5:]
        # Otherwise a number could pass for an object with that name.
        if (object_id is not None) != (row[1] in self._object_functions.at(version[1])):
            return False
        if object_id is not None:
            name = self._objects[object_id]
            return value is None and number is None and value_text(row[3], name) == text
        if value is None or number is None:
            return False
        return value_text(row[3], value) == text and _is_nearest(number, value)


# The fault of a version that differs from its identity or its text, by kind.
_DIFFERS = {
    "predicate": "has another predicate_id, is_goal, first_object_id or second_object_id than its "
    "proposition",
    "function": "has another function_id than its fluent, or a value, number or object that its "
    "text does not show",
}


def _is_fact_right(row: Row, version: Row, arguments: Sequence[int]) -> bool:
    """Check the columns of a version of a fact."""
    # SQLite treats any number as true, the queries only 1.
    return row[4] in (False, True) and version[5:] == (row[4], *[*arguments[:2], None, None][:2])


def _is_nearest(number: float, value: str) -> bool:
    try:
        nearest = float(value)
    except ValueError:
        return False
    # A number too small for a double is a signed zero; SQLite drops the sign.
    return nearest == number and (number != 0 or copysign(1, number) >= copysign(1, nearest))


_CONFIRMED, _ATOM = table_of(t.ConfirmationRow).c, table_of(t.PropositionRow).c
_HELD = table_of(t.PropositionVersionRow).c
# The last version that began before the confirmation, and whether it held until then.
_SEEN = looked_up(
    _HELD.since,
    _HELD.proposition_id,
    _CONFIRMED.proposition_id,
    _HELD.since < _CONFIRMED.since,
    or_(_HELD.until.is_(None), _HELD.until >= _CONFIRMED.since),
)
_NOT_SEEN = Query(
    select(_CONFIRMED.since, _CONFIRMED.proposition_id)
    .where(_CONFIRMED.kb_id == KB, _CONFIRMED.since > AFTER)
    .where(
        or_(
            and_(_CONFIRMED.since > integer("archived"), _SEEN.is_(None)),
            looked_up(_ATOM.is_goal, _ATOM.id, _CONFIRMED.proposition_id).is_not(false()),
        )
    )
)


def check_confirmations(check: Check, archived: int) -> None:
    """Check that confirmed elements are facts that held; archived versions are elsewhere."""
    given = {"kb": check.kb_id, "after": check.after, "archived": archived}
    for number, id_ in check.session.stream(_NOT_SEEN, **given):
        message = f"row {id_} of proposition is confirmed, and it is no fact that held then"
        check.report.add(number, "confirmation", message)


_PLANS = table_of(t.PlanRow)
_EXECUTIONS, _ARGUMENTS = table_of(t.ExecutionRow), table_of(t.ExecutionArgumentRow)
_VERSIONS = table_of(t.ExecutionVersionRow)
_LINK, _REVISION = table_of(t.RevisionExecutionRow).c, table_of(t.RevisionRow).c
# The executions of revisions, and whether revision and execution exist.
_LINKS = Query(
    select(
        _LINK.number,
        _LINK.plan_id,
        _LINK.position,
        looked_up(_REVISION.number, _REVISION.number, _LINK.number),
        of_execution(_EXECUTIONS.c.position, _LINK),
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


def _of_plans(table: Table) -> ColumnElement[bool]:
    """Restrict a table to the steps of plans."""
    found: ColumnElement[bool] = table.c.plan_id > constant(NO_PLAN)
    return found


def _steps(table: Table) -> ColumnElement[bool]:
    """Restrict a table to the steps of touched plans."""
    return and_(_of_plans(table), in_rows(table.c.plan_id, _touched_plans()))


def _touched_executions(table: Table) -> ColumnElement[bool]:
    """Restrict a table to executions that began or ended, or whose plan was touched."""
    version = _VERSIONS.alias("ended").c
    either = or_(version.since > AFTER, version.until > AFTER)
    own = select(version.position).where(
        version.kb_id == KB, version.plan_id == constant(NO_PLAN), either
    )
    of_plan = in_rows(table.c.plan_id, _touched_plans())
    is_own = and_(table.c.plan_id == constant(NO_PLAN), in_rows(table.c.position, own))
    return or_(and_(_of_plans(table), of_plan), is_own)


class ExecutionCheck:
    """Compares executions with their arguments and outcomes, and links of revisions to them."""

    def __init__(self, check: Check, names: IdentityNames, archived: int) -> None:
        self._check = check
        self._add = check.report.add
        self._actions, self._objects = names.known["action"], names.known["object"]
        self._archived = archived

    def run(self) -> None:
        """Run the checks."""
        arguments, versions = (
            self._check.side(table, _EXECUTIONS, narrow=_touched_executions, width=2)
            for table in (_ARGUMENTS, _VERSIONS)
        )
        for row in self._check.read(_EXECUTIONS, narrow=_touched_executions):
            key: Key = (row[0], row[1])
            self._check_execution(key, row, [*arguments.take(key)], versions.take(key))
        arguments.end()
        versions.end()
        for number, plan_id, position, revision, execution in self._check.session.stream(
            _LINKS, kb=self._check.kb_id, after=self._check.after
        ):
            if revision is None or execution is None:
                self._add(
                    number,
                    "revision_execution",
                    f"it links revision {number} with execution {id_text((plan_id, position))}, "
                    "and one of them is missing",
                )

    def _check_execution(
        self, key: Key, row: Row, arguments: list[Row], versions: Iterable[Row]
    ) -> None:
        """Check one execution, and its outcomes."""
        _, _, since, *said = row
        given = tuple(value if id_ is None else id_ for _, _, _, id_, value in arguments)
        start, duration, action_id, name, text = said
        made = ExecutionDefinition(start, duration, action_id, name, given, text)
        for table, wrong in self._faults(key, made, arguments):
            self._add(since, table, f"execution {id_text(key)}: {wrong}")
        before: Row | None = None
        first = None
        for version in versions:
            first = version[2] if first is None else first
            fault = self._outcome_fault(key, made, since, version, before)
            if fault is not None:
                message = f"'{version[6]}' since revision {version[2]} {fault}"
                self._add(version[2], _VERSIONS.name, message)
            before = version
        # The first outcome may be in an archive, but not the present one.
        is_whole = first == since or (first is not None and since <= self._archived)
        if key[0] == NO_PLAN and not is_whole:
            fault = f"recorded in revision {since}, and its first outcome is not of that"
            self._add(since, "execution", f"execution {id_text(key)}: {fault}")

    def _faults(
        self, key: Key, made: ExecutionDefinition, arguments: list[Row]
    ) -> Iterator[tuple[str, str]]:
        if made.text != self._text(made):
            yield "execution", f"'{made.text}' differs from its action and arguments"
        if not all(each is None or is_decimal(each) for each in (made.start, made.duration)):
            yield "execution", f"'{made.text}' has a time that is not a number"
        is_reported = made.name is not None
        if is_reported != (made.action_id is None) or (key[0] != NO_PLAN and is_reported):
            yield "execution", f"'{made.text}' is of an action and has another name, or of neither"
        if key[0] == NO_PLAN and made.start is not None:
            yield "execution", f"'{made.text}' has a planned start, and no plan"
        positions = [each[2] for each in arguments]
        if positions != [*range(len(positions))]:
            yield "execution_argument", f"'{made.text}' has the arguments {positions}"
        if any((id_ is None) == (value is None) for *_, id_, value in arguments):
            yield "execution_argument", f"'{made.text}' has an object and a value, or neither"

    def _text(self, made: ExecutionDefinition) -> str:
        action = None if made.action_id is None else self._actions[made.action_id]
        words = [quoted(made.name or "") if action is None else action]
        words += [
            quoted(given) if isinstance(given, str) else self._objects[given]
            for given in made.arguments
        ]
        return f"({' '.join(words)})"

    def _outcome_fault(
        self, key: Key, made: ExecutionDefinition, recorded: int, version: Row, before: Row | None
    ) -> str | None:
        """Find the fault of an outcome."""
        _, _, since, until, kind, outcome, code, message, started_at, ended_at, text = version
        fault = interval_fault(0 if before is None else before[3], since, until)
        if fault is not None:
            return fault
        try:
            session = self._check.session
            times = [at and stored_time(session, at) for at in (started_at, ended_at)]
        except (TypeError, ValueError):
            return "has a time that cannot be read"
        if kind not in (EXECUTION, PLAN_STEP) or outcome not in OUTCOMES:
            return f"has the outcome {outcome!r} of the kind {kind!r}"
        if kind == PLAN_STEP and (code, message, started_at, ended_at) != (None,) * 4:
            return "has a code, a message or a time that its text does not show"
        said = (outcome, code, message, *times)
        if kind == PLAN_STEP:
            expected = status_text(key, outcome)
        else:
            expected = outcome_text(key, made, recorded, since, *said)
        if since < recorded or text != expected:
            return f"has the outcome {outcome!r}, or something else that its text does not show"
        return None


def check_plans(check: Check) -> None:
    """Compare plans with their steps; `ExecutionCheck` compares these with their arguments."""
    steps = check.side(_EXECUTIONS, _PLANS, narrow=_steps, whole=_of_plans)
    for plan in check.read(_PLANS, narrow=_touched):
        for table, fault in _plan_faults(plan, [*steps.take(plan[0])]):
            check.report.add(plan[1], table, f"plan {plan[0]}: {fault}")
    steps.end()


def _plan_faults(plan: Row, steps: list[Row]) -> Iterator[tuple[str, str]]:
    if [(row[1], row[2]) for row in steps] != [(n, plan[1]) for n in range(len(steps))]:
        yield "execution", "its steps differ from 0, 1 and so on, or are of other revisions"
    # Without their arguments, which their texts also have.
    made = tuple(
        ExecutionDefinition(start, duration, action, name, (), text)
        for _, _, _, start, duration, action, name, text in steps
    )
    definition = PlanDefinition._make((plan[0], *plan[2:11], made))
    domain, problem = definition.domain_pddl, definition.problem_pddl
    if domain is not None and problem is not None:
        digest = sha256(f"{domain}{problem}".encode()).hexdigest()
        if digest != definition.problem_hash:
            yield "plan", "problem_hash is not that of the stored texts"
    if definition.value is not None and not is_decimal(definition.value):
        yield "plan", f"its value {definition.value!r} is not a number"
    if definition.text != plan[11]:
        yield "plan", "its columns and its steps differ from its text"
