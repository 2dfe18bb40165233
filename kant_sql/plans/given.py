"""What a planner was given: kept only where it is not what the store writes of a revision."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import bindparam, select

from ..backends import Query
from ..documents import SqlExchange
from ..errors import PlanError
from ..history import state_at
from ..knowledge.loading import KB
from ..planning import problem_hash
from ..store import Store
from ..tables import PlanRow
from ..view import View
from .interfaces import Given, RecordedPlan

_KEPT = Query(
    select(PlanRow.domain_pddl, PlanRow.problem_pddl).where(
        PlanRow.kb_id == KB, PlanRow.id == bindparam("plan")
    )
)


class Kept(NamedTuple):
    """The texts that are kept of what a planner was given.

    Attributes:
        domain: the domain's; None when it is what the store writes.
        problem: the problem's; likewise.
    """

    domain: str | None
    problem: str | None


def write_given(store: Store, revision: int) -> Given:
    """Write the domain and the problem of a revision.

    Args:
        store: the store.
        revision: the revision, whose state is in the store.

    Returns:
        Both texts.
    """
    exchange = SqlExchange(store, revision)
    return Given(exchange.domain_pddl(), exchange.problem_pddl())


class SqlGivenReader:
    """Gives again what the planner of a recorded plan was given, from an SQL store."""

    def __init__(self, store: Store) -> None:
        """Make it.

        Args:
            store: the store.
        """
        self._store = store

    def read(self, plan: RecordedPlan) -> Given:
        """Read what the planner was given."""
        domain, problem = self._kept(plan.id)
        if domain is None or problem is None:
            written = write_given(self._store, state_at(self._store, plan.revision))
            domain = written.domain if domain is None else domain
            problem = written.problem if problem is None else problem
        if problem_hash(domain, problem=problem) != plan.problem_hash:
            raise PlanError(
                f"plan {plan.id}: what the store holds of its problem, at revision "
                f"{plan.revision}, is not what the planner was given: the SHA-256 is not "
                f"{plan.problem_hash}; this version of the library writes PDDL in another way, or "
                "the tables were changed by hand, which verify() tells"
            )
        return Given(domain, problem)

    def _kept(self, plan_id: int) -> Kept:
        def work(view: View) -> Kept:
            row = view.session.first(_KEPT, kb=view.kb_id, plan=plan_id)
            if row is None:
                raise PlanError(
                    f"knowledge base {self._store.name!r} has no plan {plan_id}: the transaction "
                    "that recorded it was not committed"
                )
            return Kept(*row)

        return self._store.read_together(work)
