"""Why a step is in a plan: what supports the conditions of steps, and the goal.

A causal link says that one step, or the state before the plan, makes a literal true that another
step needs (McAllester and Rosenblitt, Systematic Nonlinear Planning, 1991). A step supports what it
changes: asserting a fact that already holds supports nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal

from typing_extensions import override

from .. import html
from ..documents.exchange import read_task
from ..dto import formulas as f
from ..errors import PlanError
from ..history.moments import state_at
from ..knowledge.resolved import Resolver
from ..knowledge.rules import rules_of
from ..moment_text import When
from ..plans import RecordedPlan
from ..store.state import State
from .actions import Changes, Snap
from .uses import Literal, Uses, parts_used
from .validate import GivenPlan, PlanExecution, check_validated, read_any_plan, was_renamed
from .world import Row, Value


@dataclass(frozen=True)
class CausalLink:
    """The support of a literal in a step's condition, or in the goal.

    Attributes:
        supporter: the index in the plan of the step that made it true; None for the state before
            the plan, or a timed initial literal.
        literal: the fact or its negation as PDDL text; a fluent, negated if it has no value.
        position: the index of the step that needs it; None for the goal.
    """

    supporter: int | None
    literal: str
    position: int | None

    def __str__(self) -> str:
        by = "the state before" if self.supporter is None else f"step {self.supporter}"
        needs = "the goal" if self.position is None else f"step {self.position}"
        return f"{needs} needs {self.literal} from {by}"


class _Linking(PlanExecution):
    """Executes a plan, and records which step supports each needed literal."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.links: dict[CausalLink, None] = {}
        self._uses = Uses(self.world)
        # The step that last changed a fact (True) or a fluent.
        self._by: dict[tuple[bool, int, Row], int | None] = {}

    @override
    def _apply(self, literals: Sequence[Changes], snaps: Sequence[Snap]) -> None:
        by = dict[tuple[bool, int, Row], int | None]()
        for position, each in [
            *((None, one) for one in literals),
            *((snap.position, snap.changes) for snap in snaps),
        ]:
            by.update(((True, *fact), position) for fact in each.adds | each.deletes)
            by.update(((False, *fluent), position) for fluent in each.updates)
        for snap in snaps:
            self._need(snap, snap.time or f.AT_START)
        before = {each: self._now(*each) for each in by}
        super()._apply(literals, snaps)
        self._by.update(each for each in by.items() if self._now(*each[0]) != before[each[0]])

    def _now(self, is_fact: bool, owner: int, row: Row) -> Value | bool | None:
        """Return whether a fact holds, or the value of a fluent."""
        world = self.world
        return row in world.relation(owner, True).rows if is_fact else world.table(owner).get(row)

    @override
    def _pass(self, time: Decimal) -> None:
        for position, snap in self.running.items():
            self._need(snap, f.OVER_ALL)
            for effect in snap.schema.continuous:
                self._by.update(((False, *one), position) for one, _ in effect.rates(snap))
        super()._pass(time)

    def need_goal(self) -> None:
        """Record the support of the goal."""
        resolver = Resolver(self.world.definitions)
        for goal in self.problem.goal:
            self._link(self._uses.of(resolver.part(goal)), None)

    def _need(self, snap: Snap, time: str) -> None:
        action = snap.schema.action
        slots = [each.slot for each in action.parameters]
        for part in parts_used(action, time):
            self._link(self._uses.of(part, slots, snap.arguments, snap.duration), snap.position)

    def _link(self, used: Iterable[Literal], position: int | None) -> None:
        world, rules = self.world, rules_of(self.world.definitions)
        for is_fact, owner, row, holds in used:
            if is_fact and rules.of(owner) and not self._now(is_fact, owner, row):
                # The facts that it follows from are used, too.
                continue
            text = world.text((is_fact, owner), row)
            literal = text if holds else f"(not {text})"
            supporter = self._by.get((is_fact, owner, row))
            self.links[CausalLink(supporter, literal, position)] = None


def causal_links(state: State, plan: GivenPlan, *, at: When | None = None) -> list[CausalLink]:
    """Find why steps are in a plan: which step, or fact, supports which condition.

    The plan is executed in memory, as by `KnowledgeBase.validate`. Each literal that a satisfied
    condition uses, also negative, quantified or through derived predicates, is linked to the step
    that last changed it. A step that supports neither the goal nor another step is not needed.

    Args:
        plan: an executable plan, given as for `KnowledgeBase.validate`.
        at: its initial state, given as for `kb.at`; by default the state that a recorded plan was
            made from, and the present for another plan.

    Returns:
        The links, in the order in which steps need them; those of the goal come last.

    Raises:
        PlanError: a step cannot be executed; the error says why.
        UnsupportedConstructError, UnknownRevisionError, ArchivedError, InvalidKnowledgeError: as
            for `KnowledgeBase.validate`.
    """
    given = read_any_plan(state, plan)
    made = given.revision if at is None and isinstance(given, RecordedPlan) else None
    revision = state_at(state, at) if at is not None else made or state.at
    task = read_task(State(state.store, revision))
    check_validated(task.domain)
    run = _Linking(task.domain, task.problem, given.steps)
    failed = run.execute()
    if failed is not None:
        if was_renamed(state, plan, given):
            return causal_links(state, plan, at=at)
        raise PlanError(f"the plan cannot be executed: {failed}; see kb.validate")
    run.need_goal()
    return html.Listing(run.links, "causal link")
