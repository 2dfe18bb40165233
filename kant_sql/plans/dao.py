"""The DAO of plans in an SQL store: check and record a plan, read it, set a step's status."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import NamedTuple

from sqlalchemy import bindparam, literal_column, select
from typing_extensions import override

from .. import html
from ..arguments import one_of, shown, storable_text, whole_number
from ..dao.base import SqlDao
from ..dao.formula import read_formulas
from ..dto.elements import atom_text
from ..dto.lexical import number_text
from ..errors import InvalidKnowledgeError, PlanError, reading_rows
from ..history.moments import head_revision, state_at
from ..history.revisions import LARGEST, Version, read_numbered, refuse_archived_revision
from ..knowledge.definitions import METRIC, ActionDefinition, Definitions, ObjectDefinition
from ..pddl.cursor import hint
from ..pddl.document import ACTION, DURATIVE_ACTION
from ..planning import Plan, PlanStep, problem_hash
from ..sql import tables as t
from ..sql.changes import ASSERTED, PLAN, PLAN_STEP, Change
from ..sql.dialects.base import Row
from ..sql.plans import STEP_VERSIONS, PlanDefinition, Step, StepDefinition, plan_rows
from ..sql.query import Query, integer
from ..sql.rows import KB, table_of
from ..store.snapshot import View
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from . import Given, PlanDao, RecordedPlan, RecordedStep, StepStatus

# The metric in the text that the library writes.
_GIVEN_METRIC = re.compile(r"^  \(:metric (.*)\)$", re.MULTILINE)


def check_steps(definitions: Definitions, revision: int, plan: Plan) -> tuple[StepDefinition, ...]:
    """Find the actions and objects of a plan's steps, at the revision of its state."""
    if not isinstance(plan.steps, tuple | list):
        raise PlanError(f"the plan has the steps {shown(plan.steps)}, expected a tuple")
    return tuple(
        _StepCheck(definitions, revision, position, step).read()
        for position, step in enumerate(plan.steps)
    )


def exact_text(number: Decimal | int | None, role: str) -> str | None:
    """Write a number as exact decimal text."""
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float | Decimal):
        raise PlanError(f"{role} is {shown(number)}, expected a number or None")
    try:
        return number_text(number)
    except InvalidKnowledgeError as error:
        raise PlanError(f"{role}: {error}") from error


class _StepCheck:
    """Checks one step against the state that its plan was made from."""

    def __init__(
        self, definitions: Definitions, revision: int, position: int, step: PlanStep
    ) -> None:
        self._definitions = definitions
        self._revision = revision
        self._step = step
        role = f"step {position} of the plan"
        if not isinstance(step, PlanStep):
            raise PlanError(f"{role} is a PlanStep, not {shown(step)}")
        if not isinstance(step.arguments, tuple | list):
            raise PlanError(f"{role} has the arguments {shown(step.arguments)}, expected a tuple")
        names = (step.action, *step.arguments)
        for name in names:
            if not isinstance(name, str):
                raise PlanError(f"{role}: a name is a string, not {shown(name)}")
        self._role = f"{role}, {shown(atom_text(names[0], names[1:]))}"

    def read(self) -> StepDefinition:
        action = self._action()
        objects = self._objects(action)
        return StepDefinition(
            self._seconds(self._step.start, "start"),
            self._seconds(self._step.duration, "duration"),
            action.id,
            tuple(object_.id for object_ in objects),
            atom_text(action.name, [object_.name for object_ in objects]),
        )

    def _action(self) -> ActionDefinition:
        action = self._definitions.actions.named(self._step.action)
        if action is None:
            known = [one.name for one in self._definitions.actions]
            raise PlanError(
                f"{self._role}: action {shown(self._step.action)} is not known at revision "
                f"{self._revision}, the state that it was planned from"
                f"{hint(self._step.action, known)}; give the plan the revision of the state that "
                "has it"
            )
        if action.kind not in (ACTION, DURATIVE_ACTION):
            raise PlanError(
                f"{self._role}: {action.name!r} is of kind {action.kind}, which happens by itself; "
                "leave the step out"
            )
        return action

    def _objects(self, action: ActionDefinition) -> list[ObjectDefinition]:
        names = self._step.arguments
        if len(names) != len(action.parameters):
            raise PlanError(
                f"{self._role} has {len(names)} arguments, expected {len(action.parameters)} as in "
                f"{' '.join(action.text.split()):.200}"
            )
        return [self._object(action, number, name) for number, name in enumerate(names)]

    def _object(self, action: ActionDefinition, number: int, name: str) -> ObjectDefinition:
        object_ = self._definitions.objects.named(name)
        if object_ is None:
            known = [one.name for one in self._definitions.objects]
            raise PlanError(
                f"{self._role}: object {shown(name)} is not known at revision {self._revision}, "
                f"the state that it was planned from{hint(name, known)}; give the plan the "
                "revision of the state that has it"
            )
        allowed = action.parameters[number].type_ids
        if not self._definitions.any_fits(object_.type_ids, allowed):
            types = self._definitions.types
            wanted = " or ".join(types.live(id_).name for id_ in allowed)
            raise PlanError(
                f"{self._role}: argument {number + 1}, {object_.name!r}, is "
                f"{object_.text!r} at revision {self._revision}, expected a {wanted} as action "
                f"{action.name!r} has it; replan from the present state"
            )
        return object_

    def _seconds(self, number: Decimal | None, role: str) -> str | None:
        text = exact_text(number, f"{self._role}: its {role}")
        if text is not None and text.startswith("-"):
            raise PlanError(f"{self._role}: its {role} is {text}, expected 0 seconds or more")
        return text


# The next statuses of each status; None: not started.
_NEXT: dict[str | None, tuple[str, ...]] = {
    None: ("started", "aborted"),
    "started": ("succeeded", "failed", "aborted"),
}
_SHOWN = {
    None: "was not started",
    "started": "is started",
    "succeeded": "has succeeded",
    "failed": "has failed",
    "aborted": "was aborted",
}
_STATUSES = tuple(filter(None, _SHOWN))


def set_status(transaction: Transaction, step: RecordedStep, status: StepStatus) -> bool:
    """Set the status of a step."""
    one_of(status, _STATUSES, "the status", PlanError)
    place = place_of(step)
    check_step(transaction, step)
    statuses = transaction.step_statuses
    before = statuses.now(place)
    if before == status:
        return False
    if status not in _NEXT.get(before, ()):
        raise PlanError(
            f"step {step.position} of plan {step.plan_id}, {step}, {_SHOWN[before]}, so it cannot "
            f"be {status!r} next"
        )
    statuses.put(place, status)
    return True


def place_of(step: RecordedStep) -> Step:
    """Return the id of a step's plan, and its position."""
    if not isinstance(step, RecordedStep):
        raise PlanError(
            f"a step is one of a recorded plan, as kb.plans.record(plan).steps has them, not "
            f"{shown(step)}"
        )
    return step.plan_id, step.position


def check_step(transaction: Transaction, step: RecordedStep) -> None:
    """Refuse a step that is not of a plan of this knowledge base."""
    role = f"step {step.position} of plan {step.plan_id}, {step},"
    if step.knowledge_base != transaction.name:
        raise PlanError(
            f"{role} is of knowledge base {step.knowledge_base!r}, not of {transaction.name!r}; "
            "use that one, or record the plan here"
        )
    found = transaction.find_step(place_of(step))
    if found is None:
        raise PlanError(
            f"{role} is not in knowledge base {transaction.name!r}: its transaction was not "
            "committed, or it is of another store; record the plan first"
        )
    if found != atom_text(step.action, step.arguments):
        raise PlanError(
            f"{role} is {found} in knowledge base {transaction.name!r}: it is of another store; "
            "record the plan here"
        )


_KEPT = Query(
    select(t.PlanRow.domain_pddl, t.PlanRow.problem_pddl).where(
        t.PlanRow.kb_id == KB, t.PlanRow.id == bindparam("plan")
    )
)
# The stored texts of a plan's domain and problem; None for those that can be written again.
Kept = tuple[str | None, str | None]


def _write_given(store: Store, revision: int) -> Given:
    state = State(store, revision)
    from ..documents.exchange import domain_pddl, problem_pddl

    return Given(domain_pddl(state), problem_pddl(state))


def _complete(kept: Kept, written: Given) -> Given:
    return Given(*(text if own is None else own for own, text in zip(kept, written, strict=True)))


def _read_kept(view: View, name: str, plan_id: int) -> Kept:
    row = view.session.first(_KEPT, kb=view.kb_id, plan=plan_id)
    if row is None:
        raise PlanError(
            f"knowledge base {name!r} has no plan {plan_id}: the transaction that recorded it was "
            "not committed"
        )
    domain, problem = row
    return domain, problem


def read_given(store: Store, plan: RecordedPlan) -> Given:
    """Read the texts that a planner was given, and compare them with the plan's hash."""
    kept = store.read_in_snapshot(lambda view: _read_kept(view, store.name, plan.id))
    if None in kept:
        given = _complete(kept, _write_given(store, state_at(store, plan.revision)))
    else:
        given = Given(*kept)  # type: ignore[arg-type]
    if problem_hash(given.domain, problem=given.problem) != plan.problem_hash:
        raise PlanError(
            f"plan {plan.id}: the stored problem, at revision {plan.revision}, differs from what "
            f"the planner was given: its SHA-256 is not {plan.problem_hash}; this version of the "
            "library writes PDDL in another way, or the tables were changed: run verify()"
        )
    return given


class _Reads(NamedTuple):
    """Columns of some plans, or of steps of one that may be long, as of a revision."""

    plans: Query
    steps: Query


def _reads(
    mapped: type[t.Base], order: int, *names: str, known_from: str | None = "since"
) -> _Reads:
    columns = table_of(mapped).c
    read = [columns[name] for name in names]
    known = [] if known_from is None else [columns[known_from] <= integer("at")]
    query = select(*read).where(columns.kb_id == KB, *known).order_by(*read[:order])
    of_plans = query.where(read[0].between(integer("low"), integer("high")))
    near = read[1].between(integer("first"), integer("last"))
    return _Reads(Query(of_plans), Query(query.where(read[0] == integer("plan"), near)))


_PLANS = _reads(t.PlanRow, 1, "id", "since", *PlanDefinition._fields[1:8]).plans
# The text has the names, exactly: to look up each of them takes longer than all the rest.
_STEPS = _reads(
    t.PlanStepRow, 2, "plan_id", "position", "start", "duration", "text", known_from=None
)
_READ_STATUSES = _reads(
    t.PlanStepVersionRow, 3, "plan_id", "position", "since", "until", "status", "text"
)
_REVISIONS = _reads(t.RevisionPlanStepRow, 3, "plan_id", "position", "number", known_from="number")


class _Status(NamedTuple):
    status: StepStatus
    text: str
    since: int
    until: int | None


class _PlanReader:
    """Reads plans and the outcomes of their steps, as of one revision."""

    def __init__(self, store: Store, view: View, kb_id: int) -> None:
        self._store = store
        self._session = view.session
        self._kb_id = kb_id
        self._at = LARGEST if view.at is None else view.at

    def read(self, plan_id: int | None) -> list[RecordedPlan]:
        low, high = (0, LARGEST) if plan_id is None else (plan_id, plan_id)
        plans = self._session.rows(_PLANS, kb=self._kb_id, low=low, high=high, at=self._at)
        if not plans:
            return []
        steps: dict[int, list[RecordedStep]] = defaultdict(list)
        for step in self._steps(low=plans[0][0], high=plans[-1][0]):
            steps[step.plan_id].append(step)
        return [_recorded_plan(self._store, row, steps[row[0]]) for row in plans]

    def steps(self, plan_id: int, positions: Sequence[int]) -> list[RecordedStep]:
        """Read steps of one plan, which are near each other."""
        near = self._steps(plan=plan_id, first=min(positions), last=max(positions))
        return [step for step in near if step.position in positions]

    def _rows(self, reads: _Reads, own: dict[str, int]) -> list[Row]:
        query = reads.steps if "plan" in own else reads.plans
        return self._session.rows(query, kb=self._kb_id, at=self._at, **own)

    def _steps(self, **own: int) -> Iterator[RecordedStep]:
        """Yield the steps of some plans, or some of one."""
        statuses = self._statuses(own)
        outcomes = self._outcomes(statuses)
        revisions: dict[Step, list[int]] = defaultdict(list)
        for plan_id, position, number in self._rows(_REVISIONS, own):
            revisions[plan_id, position].append(number)
        for plan_id, position, *said in self._rows(_STEPS, own):
            place = (plan_id, position)
            with reading_rows("plan_step", f"step {position!r} of plan {plan_id!r}"):
                step = _recorded_step(self._store, place, *said)
            yield replace(
                step,
                status=next((one.status for one in statuses[place] if one.until is None), None),
                outcomes=outcomes[place],
                revisions=tuple(revisions[place]),
            )

    def _statuses(self, own: dict[str, int]) -> dict[Step, list[_Status]]:
        found: dict[Step, list[_Status]] = defaultdict(list)
        for plan_id, position, since, until, status, text in self._rows(_READ_STATUSES, own):
            ended = None if until is None or until > self._at else until
            found[plan_id, position].append(_Status(status, text, since, ended))
        return found

    def _outcomes(self, statuses: dict[Step, list[_Status]]) -> dict[Step, tuple[Version, ...]]:
        ends = [end for each in statuses.values() for one in each for end in (one.since, one.until)]
        known = read_numbered(self._session, self._kb_id, {end for end in ends if end is not None})
        found: dict[Step, tuple[Version, ...]] = defaultdict(tuple)
        for place, of_step in statuses.items():
            found[place] = tuple(
                Version(PLAN_STEP, one.text, known[one.since], known.get(one.until or 0))
                for one in of_step
                # An uncommitted revision is not in the table yet.
                if one.since in known
            )
        return found


def _recorded_step(
    store: Store, place: Step, start: str | None, duration: str | None, text: str
) -> RecordedStep:
    """Make a step without outcomes of its texts; no name has a space or a parenthesis."""
    action, *arguments = text[1:-1].split(" ")
    at, length = _decimal(start), _decimal(duration)
    return RecordedStep(*place, at, action, tuple(arguments), length, None, (), (), store.name)


def _recorded_plan(store: Store, row: Row, steps: Iterable[RecordedStep]) -> RecordedPlan:
    """Make a plan of a row of `_PLANS`."""
    id_, since, revision, digest, planner, version, objective, value, status = row
    with reading_rows("plan", f"plan {id_!r}"):
        said = (planner, version, objective, _decimal(value), status)
    given = partial(read_given, store)
    return RecordedPlan(id_, since, revision, digest, *said, tuple(steps), given)


def _decimal(text: str | None) -> Decimal | None:
    return None if text is None else Decimal(text)


class SqlPlanDao(SqlDao, PlanDao):
    """Plans in an SQL store."""

    @override
    def record(
        self,
        plan: Plan,
        *,
        planner: str | None = None,
        planner_version: str | None = None,
        objective: str | None = None,
        value: Decimal | int | None = None,
        domain_pddl: str | None = None,
        problem_pddl: str | None = None,
    ) -> RecordedPlan:
        self._check_writable()
        if not isinstance(plan, Plan):
            raise PlanError(f"the plan is a Plan of kant_sql, not {shown(plan)}")
        revision = self._state_of(plan)
        # A past state never changes, so its text is written without a lock.
        said = (
            plan.domain_pddl if domain_pddl is None else domain_pddl,
            plan.problem_pddl if problem_pddl is None else problem_pddl,
        )
        digest, kept = self._compare(plan, revision, said)
        metric, steps = self._open_store.read_definitions(
            lambda known: (_metric(known), check_steps(known, revision, plan)), revision
        )
        measured = _objective(plan, metric, objective)
        if value is None and measured is not None:
            value = plan.value
        definition = PlanDefinition(
            0,
            revision,
            digest,
            storable_text(planner or plan.engine or None, "the planner's name", PlanError),
            storable_text(planner_version, "the planner's version", PlanError),
            storable_text(measured, "the objective", PlanError),
            exact_text(value, "the objective's value"),
            storable_text(plan.status or None, "the plan's status", PlanError),
            *kept,
            steps,
        )
        return self._open_store.write(lambda transaction: self._record(transaction, definition))

    def _state_of(self, plan: Plan) -> int:
        """Find the revision of the state that a plan was made from."""
        head = head_revision(self._open_store)
        at = head if plan.revision is None else plan.revision
        if at > head and plan.problem_hash is not None:
            raise PlanError(self._elsewhere(at))
        revision = state_at(self._open_store, at)
        if revision == 0:
            raise PlanError(
                f"the plan was made from knowledge base {self._open_store.name!r} before its first "
                "revision; commit the knowledge that the planner needs, and plan again"
            )
        return revision

    def _elsewhere(self, revision: int) -> str:
        return (
            f"the planner was not given revision {revision} of knowledge base "
            f"{self._open_store.name!r}: the plan is of a branch, of another knowledge base or of "
            "the uncommitted state of a transaction; record it where it was made, plan again here, "
            "or pass what the planner was given as domain_pddl and problem_pddl, and the revision "
            "of this knowledge base in the plan"
        )

    def _compare(self, plan: Plan, revision: int, said: Kept) -> tuple[str, Kept]:
        """Hash the planner's input, and find which of its texts to store."""
        for text, role in zip(said, ("domain_pddl", "problem_pddl"), strict=True):
            storable_text(text, role, PlanError)
        written = _write_given(self._open_store, revision)
        given = _complete(said, written)
        digest = problem_hash(given.domain, problem=given.problem)
        if plan.problem_hash not in (None, digest):
            raise PlanError(
                self._elsewhere(revision)
                if said == (None, None)
                else "domain_pddl and problem_pddl differ from the planner's input, by its SHA-256"
            )
        domain, problem = (a if a != b else None for a, b in zip(given, written, strict=True))
        return digest, (domain, problem)

    def _record(self, transaction: Transaction, definition: PlanDefinition) -> RecordedPlan:
        if definition.revision < transaction.head.archived_revision:
            # It was moved since the problem was written.
            refuse_archived_revision(self._open_store, definition.revision)
        plan = definition._replace(id=transaction.number_plan())
        rows = plan_rows(transaction.kb_id, transaction.number, plan)
        transaction.records.add(Change(ASSERTED, PLAN, plan.text), rows)
        steps = [
            _recorded_step(
                self._open_store, (plan.id, position), step.start, step.duration, step.text
            )
            for position, step in enumerate(plan.steps)
        ]
        return _recorded_plan(self._open_store, (plan.id, transaction.number, *plan[1:8]), steps)

    @override
    def get(self, id_: int) -> RecordedPlan | None:
        whole_number(id_, "the id of a plan", least=None, expected="a whole number")
        if not 0 < id_ <= LARGEST:
            return None
        plans = self._read(id_)
        return plans[0] if plans else None

    @override
    def get_all(self) -> list[RecordedPlan]:
        return html.Listing(self._read(None), "plan")

    def _read(self, id_: int | None) -> list[RecordedPlan]:
        def read(view: View) -> list[RecordedPlan]:
            if view.kb_id is None:
                return []
            return _PlanReader(self._open_store, view, view.kb_id).read(id_)

        return self._open_store.read_in_snapshot(read, self._at)

    @override
    def set_status(self, step: RecordedStep, *, status: StepStatus) -> bool:
        self._check_writable()
        return self._open_store.write(lambda transaction: set_status(transaction, step, status))


def _objective(plan: Plan, metric: str | None, stated: str | None) -> str | None:
    """Return the metric that a planner was given: the state's, a part of it, or none."""
    if stated is not None:
        return stated
    if not plan.ignored or plan.problem_pddl is None:
        return metric
    given = _GIVEN_METRIC.search(plan.problem_pddl)
    return None if given is None else given[1]


# The steps that run now are few among all that ever had a status.
_RUNNING = Query(
    select(STEP_VERSIONS.c.plan_id, STEP_VERSIONS.c.position)
    .where(STEP_VERSIONS.c.kb_id == KB, STEP_VERSIONS.c.until.is_(None))
    .where(STEP_VERSIONS.c.status == literal_column("'started'"))
    .order_by(STEP_VERSIONS.c.plan_id, STEP_VERSIONS.c.position)
)


def running_steps(store: Store) -> list[RecordedStep]:
    """Read the steps that are started and have not ended."""

    def read(view: View) -> list[RecordedStep]:
        if view.kb_id is None:
            return []
        running: dict[int, list[int]] = defaultdict(list)
        for plan_id, position in view.session.rows(_RUNNING, kb=view.kb_id):
            running[plan_id].append(position)
        reader = _PlanReader(store, view, view.kb_id)
        return [step for one in running.items() for step in reader.steps(*one)]

    return store.read_in_snapshot(read)


def read_step(store: Store, step: RecordedStep) -> RecordedStep:
    """Read a step as it is now."""

    def work(view: View) -> RecordedStep:
        assert view.kb_id is not None
        [now] = _PlanReader(store, view, view.kb_id).steps(step.plan_id, [step.position])
        return now

    return store.read_in_snapshot(work)


def record_step(store: Store, transaction: Transaction, step: PlanStep) -> RecordedStep:
    """Record a step that is of no plan, as a plan of its own; no planner was given a problem."""
    definition = PlanDefinition(
        0,
        transaction.head.revision,
        problem_hash("", problem=""),
        None,
        None,
        None,
        None,
        "executed",
        "",
        "",
        check_steps(transaction.definitions, transaction.head.revision, Plan((step,), "", "")),
    )
    return SqlPlanDao(store, None)._record(transaction, definition).steps[0]


def _metric(definitions: Definitions) -> str | None:
    stored = read_formulas(definitions, METRIC)
    return stored[0].text.removeprefix("(:metric ").removesuffix(")") if stored else None
