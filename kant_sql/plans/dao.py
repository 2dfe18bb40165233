"""The DAO of plans in an SQL store: check, record and read a plan."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from decimal import Decimal
from functools import partial

from sqlalchemy import bindparam, select
from typing_extensions import override

from .. import html
from ..acts import Execution, Outcome
from ..acts.checking import check_steps
from ..acts.recording import STEP_OUTCOMES, ExecutionReader, key_of, set_outcome, unstarted
from ..arguments import one_of, shown, storable_text, whole_number
from ..dao.base import SqlDao
from ..dao.formula import read_formulas
from ..dto.lexical import number_text
from ..errors import InvalidKnowledgeError, PlanError, reading_rows
from ..history.moments import head_revision, state_at
from ..history.revisions import LARGEST, refuse_archived_revision
from ..knowledge.definitions import METRIC, Definitions
from ..planning import Plan, problem_hash
from ..sql import tables as t
from ..sql.changes import ASSERTED, PLAN, Change
from ..sql.dialects.base import Row
from ..sql.executions import PlanDefinition, plan_rows
from ..sql.query import Query, integer
from ..sql.rows import KB, table_of
from ..store.snapshot import View, read_position
from ..store.state import State
from ..store.store import Store
from ..store.transaction import LAST_PLAN, Transaction
from . import Given, PlanDao, RecordedPlan

# The metric in the text that the library writes.
_GIVEN_METRIC = re.compile(r"^  \(:metric (.*)\)$", re.MULTILINE)


_KEPT = Query(
    select(t.PlanRow.problem_hash, t.PlanRow.domain_pddl, t.PlanRow.problem_pddl).where(
        t.PlanRow.kb_id == KB, t.PlanRow.id == bindparam("plan")
    )
)
# The stored texts of a plan's domain and problem; None for those that can be written again.
Kept = tuple[str | None, str | None]


def last_plan(store: Store) -> int | None:
    """Return the id of the plan that was recorded last."""

    def read(view: View) -> int | None:
        row = None if view.kb_id is None else view.session.first(LAST_PLAN, kb=view.kb_id)
        return None if row is None else row[0]

    return store.read_in_snapshot(read)


def _write_given(store: Store, revision: int) -> Given:
    state = State(store, revision)
    from ..documents.exchange import domain_pddl, problem_pddl

    return Given(domain_pddl(state), problem_pddl(state))


def _complete(kept: Kept, written: Given) -> Given:
    return Given(*(text if own is None else own for own, text in zip(kept, written, strict=True)))


def _read_kept(view: View, name: str, plan_id: int) -> tuple[str, Kept]:
    row = view.session.first(_KEPT, kb=view.kb_id, plan=plan_id)
    if row is None:
        raise PlanError(
            f"knowledge base {name!r} has no plan {plan_id}: the transaction that recorded it was "
            "not committed"
        )
    digest, domain, problem = row
    return digest, (domain, problem)


def read_given(store: Store, plan: RecordedPlan) -> Given:
    """Read the texts that a planner was given, and compare them with the plan's hash."""
    # An erasure since the plan was read has changed its hash.
    digest, kept = store.read_in_snapshot(lambda view: _read_kept(view, store.name, plan.id))
    if None in kept:
        given = _complete(kept, _write_given(store, state_at(State(store), plan.revision)))
    else:
        given = Given(*kept)  # type: ignore[arg-type]
    if problem_hash(given.domain, problem=given.problem) != digest:
        raise PlanError(
            f"plan {plan.id}: the stored problem, at revision {plan.revision}, differs from what "
            f"the planner was given: its SHA-256 is not {digest}; this version of the "
            "library writes PDDL in another way, or the tables were changed: run verify()"
        )
    return given


_PLANS = Query(
    select(*(table_of(t.PlanRow).c[name] for name in ("id", "since", *PlanDefinition._fields[1:8])))
    .where(t.PlanRow.kb_id == KB, t.PlanRow.since <= integer("at"))
    .where(t.PlanRow.id.between(integer("low"), integer("high")))
    .order_by(t.PlanRow.id)
)


def _read_plans(store: Store, view: View, plan_id: int | None) -> list[RecordedPlan]:
    """Read a plan, or all, with the outcomes of their steps."""
    if view.kb_id is None:
        return []
    low, high = (1, LARGEST) if plan_id is None else (plan_id, plan_id)
    at = LARGEST if view.at is None else view.at
    plans = view.session.rows(_PLANS, kb=view.kb_id, low=low, high=high, at=at)
    if not plans:
        return []
    steps: dict[int | None, list[Execution]] = defaultdict(list)
    reader = ExecutionReader(store, view)
    for step in reader.of_plans(plans[0][0], plans[-1][0]):
        steps[step.plan_id].append(step)
    return [_recorded_plan(store, row, steps[row[0]]) for row in plans]


def _recorded_plan(store: Store, row: Row, steps: Iterable[Execution]) -> RecordedPlan:
    """Make a plan of a row of `_PLANS`."""
    id_, since, revision, digest, planner, version, objective, value, status = row
    with reading_rows("plan", f"plan {id_!r}"):
        said = (planner, version, objective, None if value is None else Decimal(value), status)
    given = partial(read_given, store)
    return RecordedPlan(id_, since, revision, digest, *said, tuple(steps), given)


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
            raise PlanError(f"the plan is a Plan, as Plan.read(text) returns it, not {shown(plan)}")
        # A past state never changes, so its text is written without a lock.
        said = (
            plan.domain_pddl if domain_pddl is None else domain_pddl,
            plan.problem_pddl if problem_pddl is None else problem_pddl,
        )
        of_planner = planner or plan.engine or None, planner_version
        made = None
        while made is None:
            head = head_revision(State(self._store))
            definition = self._define(plan, head, said, of_planner, objective, value)
            made = self._store.write(partial(self._record, definition=definition, head=head))
        return made

    def _define(
        self,
        plan: Plan,
        head: int,
        said: Kept,
        of_planner: tuple[str | None, str | None],
        objective: str | None,
        value: Decimal | int | None,
    ) -> PlanDefinition:
        """Check a plan, and find what to store; its id is not known yet."""
        revision = self._state_of(plan, head)
        digest, kept = self._compare(plan, revision, said)
        metric, steps = self._store.read_definitions(
            lambda known: (_metric(known), check_steps(known, revision, plan)), revision
        )
        measured = _objective(plan, metric, objective)
        if value is None and measured is not None:
            value = plan.value
        name, version = of_planner
        return PlanDefinition(
            0,
            revision,
            digest,
            storable_text(name, "the planner's name", PlanError),
            storable_text(version, "the planner's version", PlanError),
            storable_text(measured, "the objective", PlanError),
            _exact_text(value, "the objective's value"),
            storable_text(_status(plan), "the plan's status", PlanError),
            *kept,
            steps,
        )

    def _state_of(self, plan: Plan, head: int) -> int:
        """Find the revision of the state that a plan was made from."""
        state = State(self._store)
        at = head if plan.revision is None else plan.revision
        if at > head and plan.problem_hash is not None:
            raise PlanError(self._elsewhere(at))
        revision = state_at(state, at)
        if revision == 0:
            raise PlanError(
                f"the plan was made from knowledge base {self._store.name!r} before its first "
                "revision; commit the knowledge that the planner needs, and plan again"
            )
        return revision

    def _elsewhere(self, revision: int) -> str:
        return (
            f"the planner was not given revision {revision} of knowledge base "
            f"{self._store.name!r}: the plan is of a branch, of another knowledge base or of "
            "the uncommitted state of a transaction; record it where it was made, plan again here, "
            "or pass the planner's input as domain_pddl and problem_pddl, and the revision of this "
            "knowledge base in the plan"
        )

    def _compare(self, plan: Plan, revision: int, said: Kept) -> tuple[str, Kept]:
        """Hash the planner's input, and find which of its texts to store."""
        for text, role in zip(said, ("domain_pddl", "problem_pddl"), strict=True):
            storable_text(text, role, PlanError)
        written = _write_given(self._store, revision)
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

    def _record(
        self, transaction: Transaction, definition: PlanDefinition, head: int
    ) -> RecordedPlan | None:
        """Record a plan; return None if a name was erased after the revision `head`."""
        if transaction.head.definition_revision > head:
            erased = read_position(transaction.session, transaction.kb_id).erased
            if erased is not None and erased > head:
                return None  # The plan may have that name.
        if definition.revision < transaction.head.archived_revision:
            # It was moved since the problem was written.
            refuse_archived_revision(self._store, definition.revision)
        plan = definition._replace(id=transaction.number_plan())
        rows = plan_rows(transaction.kb_id, transaction.number, plan)
        transaction.records.add(Change(ASSERTED, PLAN, plan.text), rows)
        steps = [
            unstarted(self._store.name, (plan.id, n), step.start, step.duration, step.text)
            for n, step in enumerate(plan.steps)
        ]
        return _recorded_plan(self._store, (plan.id, transaction.number, *plan[1:8]), steps)

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
        store = self._store
        return store.read_in_snapshot(lambda view: _read_plans(store, view, id_), self._at)

    @override
    def set_status(self, step: Execution, *, status: Outcome) -> bool:
        self._check_writable()
        one_of(status, STEP_OUTCOMES, "the status", PlanError)
        key_of(step)

        def work(transaction: Transaction) -> bool:
            transaction.refuse_period("the status of a step", "set it in another transaction")
            return set_outcome(transaction, step, status)

        return self._store.write(work)


def _status(plan: Plan) -> str | None:
    """Return the status, and of several engines what became of each."""
    said = plan.runs if len(plan.runs) > 1 else ()
    return "; ".join(filter(None, (plan.status, *map(str, said)))) or None


def _objective(plan: Plan, metric: str | None, stated: str | None) -> str | None:
    """Return the metric that a planner was given: the state's, a part of it, or none."""
    if stated is not None:
        return stated
    if plan.problem_pddl is None or (metric is not None and not plan.ignored):
        return metric
    given = _GIVEN_METRIC.search(plan.problem_pddl)
    return None if given is None else given[1]


def _metric(definitions: Definitions) -> str | None:
    stored = read_formulas(definitions, METRIC)
    return stored[0].text.removeprefix("(:metric ").removesuffix(")") if stored else None


def _exact_text(number: Decimal | int | None, role: str) -> str | None:
    """Write a number as exact decimal text."""
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float | Decimal):
        raise PlanError(f"{role} is {shown(number)}, expected a number or None")
    try:
        return number_text(number)
    except InvalidKnowledgeError as error:
        raise PlanError(f"{role}: {error}") from error
