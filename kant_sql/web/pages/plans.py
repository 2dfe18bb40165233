"""The pages of recorded plans: all of them, one with its steps, and what its planner was given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

from fastapi import Query, Request
from fastapi.responses import PlainTextResponse, Response

from ...acts import Execution
from ...errors import ArchivedError, PlanError, UnknownNameError
from ...history.plan_pages import PlansPage, Stretch, read_plans_page, read_stretches
from ...history.revisions import Revision, Version
from ...knowledge_base import KnowledgeBase, state_of
from ...plans import RecordedPlan
from ...sql.executions import RUNNING, read_outcome
from ..registry import KbName, Offset, Pages
from ..stores import OpenStore, answer

PAGES = Pages("plans")

# How many steps a page has, and how many revisions of a step.
STEPS, REVISIONS = 200, 20
# How much of a text is on a page.
LONGEST_SHOWN = 20_000

PlanId = Annotated[int, Query(description="The plan's id.")]
BeforePlan = Annotated[
    int | None, Query(ge=1, le=2**62, description="Only plans with a smaller id: the next page.")
]
Part = Annotated[Literal["domain", "problem"], Query(description="Which of the two texts.")]


@dataclass(frozen=True)
class StepOutcomes:
    """A step, each status that it had, and the last revisions that anybody made while it ran.

    `meanwhile` has these, from the one that started it up to the one that ended it, of `total`.
    `revisions` has the first of those that name this step.
    """

    _json_ = "*step", "outcomes", "meanwhile", "total"

    step: Execution
    outcomes: tuple[Version, ...]
    meanwhile: list[Revision]
    total: int


class PlanPage(NamedTuple):
    """A recorded plan with a page of its steps; `total` counts them all."""

    plan: RecordedPlan
    recorded: Revision
    steps: list[StepOutcomes]
    total: int
    offset: int
    next: int | None


class GivenPage(NamedTuple):
    """A planner's input: the texts, or why they cannot be regenerated.

    A long text is cut; `/api/given.pddl?part=domain` or `part=problem` has all of it.
    """

    plan: int
    problem_hash: str
    domain: str | None
    problem: str | None
    is_cut: bool
    note: str | None


@PAGES.page("/plans", "plans.html", rows=["plans"])
def plans(kb: KnowledgeBase, before: BeforePlan = None) -> PlansPage:
    """List the recorded plans, newest first, with the outcomes of their steps."""
    return read_plans_page(state_of(kb), before)


@PAGES.page("/plan", "plan.html", rows=["steps"])
def plan(kb: KnowledgeBase, id: PlanId, offset: Offset = 0) -> PlanPage:
    """Show a plan: its steps, who set the outcome of each, and the revisions made meanwhile."""
    found = _find(kb, id)
    end, total = offset + STEPS, len(found.steps)
    shown = found.steps[offset:end]
    (recorded,) = kb.store.revisions(after=found.recorded_in - 1, limit=1)
    steps = [
        StepOutcomes(
            replace(step, revisions=step.revisions[:REVISIONS]),
            step.outcomes,
            run.newest,
            run.total,
        )
        for step, run in zip(shown, _runs(kb, shown), strict=True)
    ]
    plan = replace(found, steps=())
    return PlanPage(plan, recorded, steps, total, offset, end if end < total else None)


@PAGES.page("/given", "given.html")
def given(kb: KnowledgeBase, id: PlanId) -> GivenPage:
    """Show the domain and the problem that the planner of a plan was given, as PDDL."""
    found = _find(kb, id)
    texts: dict[str, str] = {}
    note = None
    try:
        texts = _texts(found)
    except (ArchivedError, PlanError) as error:
        note = str(error)
    return GivenPage(
        id,
        found.problem_hash,
        texts["domain"][:LONGEST_SHOWN] if texts else None,
        texts["problem"][:LONGEST_SHOWN] if texts else None,
        any(len(text) > LONGEST_SHOWN for text in texts.values()),
        note,
    )


@PAGES.api.get("/given.pddl", include_in_schema=False)
async def given_file(request: Request, id: PlanId, part: Part, kb_name: KbName = None) -> Response:
    """Return one of the texts that the planner of a plan was given, as a file."""
    store: OpenStore = request.app.state.store

    def work() -> str:
        with store.knowledge_base(store.choose(kb_name)) as kb:
            return _texts(_find(kb, id))[part]

    name = f'attachment; filename="plan-{id}-{part}.pddl"'
    return PlainTextResponse(await answer(request, work), headers={"Content-Disposition": name})


def _find(kb: KnowledgeBase, id_: int) -> RecordedPlan:
    found = kb.plans.get(id_)
    if found is None:
        raise UnknownNameError(f"this knowledge base has no plan {id_}; its plans are listed")
    return found


def _runs(kb: KnowledgeBase, steps: Sequence[Execution]) -> list[Stretch]:
    """Read the revisions that were made while each of some steps ran."""
    firsts = {step.id: step.outcomes[0] for step in steps if step.outcomes}
    begun = {id_: one for id_, one in firsts.items() if read_outcome(one.text).outcome == RUNNING}
    bounds = [(one.since.number, one.until.number if one.until else None) for one in begun.values()]
    runs = dict(zip(begun, read_stretches(state_of(kb), bounds, REVISIONS), strict=True))
    return [runs.get(step.id, Stretch([], 0)) for step in steps]


def _texts(plan: RecordedPlan) -> dict[str, str]:
    return {"domain": plan.domain_pddl(), "problem": plan.problem_pddl()}
