"""The DAO of plans in an SQL store."""

from __future__ import annotations

from decimal import Decimal
from typing import NamedTuple

from ..arguments import shown, whole_number
from ..dao.base import SqlDao
from ..dao.formula import read_formulas
from ..errors import PlanError
from ..history import head_revision, state_at
from ..history.revisions import LARGEST, refuse_archived
from ..knowledge.changes import ASSERTED, PLAN, Change
from ..knowledge.definitions import Definitions
from ..knowledge.formula import METRIC
from ..knowledge.plan import PlanDefinition, StepDefinition, plan_rows
from ..planning import Plan, problem_hash
from ..transaction import Transaction
from .checking import check_steps, check_text, exact_text
from .given import Kept, SqlGivenReader, write_given
from .interfaces import Given, PlanDao, RecordedPlan, RecordedStep, StepStatus
from .reading import read_plans, to_decimal
from .steps import names_in, set_status


class _Said(NamedTuple):
    """What is said of a plan, in the order of `PlanDefinition`."""

    revision: int
    problem_hash: str
    planner: str | None
    planner_version: str | None
    objective: str | None
    value: str | None
    status: str | None
    domain_pddl: str | None
    problem_pddl: str | None
    steps: tuple[StepDefinition, ...]


class SqlPlanDao(SqlDao, PlanDao):
    """Plans in an SQL store."""

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
        """Record a plan."""
        self._check_writable()
        if not isinstance(plan, Plan):
            raise PlanError(f"what is recorded is a Plan of kant_sql, not {shown(plan)}")
        revision = self._state_of(plan)
        # What held at a revision never changes, so nobody has to wait while it is written.
        digest, kept = self._compare(plan, revision, domain_pddl, problem_pddl)
        metric, steps = self._store.read_definitions(
            lambda known: (_metric(known), check_steps(known, revision, plan)), revision
        )
        said = _Said(
            revision,
            digest,
            check_text(planner or plan.engine or None, "the planner's name"),
            check_text(planner_version, "the planner's version"),
            check_text(metric if objective is None else objective, "the objective"),
            exact_text(value, "the objective's value"),
            check_text(plan.status or None, "the plan's status"),
            *kept,
            steps,
        )
        return self._store.write(lambda transaction: self._record(transaction, said))

    def _state_of(self, plan: Plan) -> int:
        """Find the revision of the state that a plan was made from."""
        at = head_revision(self._store) if plan.revision is None else plan.revision
        revision = state_at(self._store, at)
        if revision == 0:
            raise PlanError(
                f"the plan was made from knowledge base {self._store.name!r} before its first "
                "revision; commit what the planner is to know, and plan again"
            )
        return revision

    def _compare(
        self, plan: Plan, revision: int, domain: str | None, problem: str | None
    ) -> tuple[str, Kept]:
        """Hash what the planner was given, and tell what of it has to be kept."""
        check_text(domain, "domain_pddl")
        check_text(problem, "problem_pddl")
        written = write_given(self._store, revision)
        given = Given(
            written.domain if domain is None else domain,
            written.problem if problem is None else problem,
        )
        digest = problem_hash(given.domain, problem=given.problem)
        if plan.problem_hash not in (None, digest):
            raise PlanError(
                "domain_pddl and problem_pddl are not what the planner was given, by its SHA-256"
                if domain is not None or problem is not None
                else f"the planner was not given the state of revision {revision}, but what an "
                "open transaction had made of it; give domain_pddl and problem_pddl as they were "
                "then"
            )
        return digest, Kept(*(a if a != b else None for a, b in zip(given, written, strict=True)))

    def _record(self, transaction: Transaction, said: _Said) -> RecordedPlan:
        if said.revision < transaction.head.archived_revision:
            # It was moved since the problem was written.
            refuse_archived(self._store, said.revision)
        plan = PlanDefinition(transaction.allocate(), *said)
        rows = plan_rows(transaction.kb_id, transaction.number, plan)
        transaction.records.add(Change(ASSERTED, PLAN, plan.text), rows)
        return self._recorded(plan, transaction.number)

    def _recorded(self, plan: PlanDefinition, number: int) -> RecordedPlan:
        steps = tuple(
            RecordedStep(
                plan.id,
                position,
                to_decimal(step.start),
                *names_in(step.text),
                to_decimal(step.duration),
                None,
                (),
                (),
                self._store.name,
            )
            for position, step in enumerate(plan.steps)
        )
        return RecordedPlan(
            plan.id,
            number,
            plan.revision,
            plan.problem_hash,
            plan.planner,
            plan.planner_version,
            plan.objective,
            to_decimal(plan.value),
            plan.status,
            steps,
            SqlGivenReader(self._store),
        )

    def get(self, id_: int) -> RecordedPlan | None:
        """Read a plan."""
        whole_number(id_, "the id of a plan", least=None, expected="a whole number")
        if not 0 < id_ <= LARGEST:
            return None
        plans = self._read(id_)
        return plans[0] if plans else None

    def get_all(self) -> list[RecordedPlan]:
        """Read all plans."""
        return self._read(None)

    def _read(self, id_: int | None) -> list[RecordedPlan]:
        given = SqlGivenReader(self._store)
        return self._store.read_together(
            lambda view: read_plans(view, self._store.name, given, id_), self._at
        )

    def set_status(self, step: RecordedStep, *, status: StepStatus) -> bool:
        """Say what becomes of a step."""
        self._check_writable()
        return self._store.write(lambda transaction: set_status(transaction, step, status))


def _metric(definitions: Definitions) -> str | None:
    stored = read_formulas(definitions, METRIC)
    return stored[0].text.removeprefix("(:metric ").removesuffix(")") if stored else None
