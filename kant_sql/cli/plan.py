"""`kant-sql plan` and `plans`: plans from what is known, now or then, and those on record."""

from __future__ import annotations

from collections import Counter
from decimal import Decimal
from typing import Annotated

import typer

from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase, connect
from ..planning import Plan, PlanStep
from ..plans import RecordedPlan
from .output import AsJson, Printer, printable, write_json
from .stores import Name, Url, open_state
from .times import At

_NOT_STARTED = "not started"


def plan(
    url: Url,
    kb: Name = None,
    at: At = None,
    engine: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            show_default=False,
            help="The engine, as unified-planning names it, for example pyperplan; when not "
            "given, those that are installed are tried.",
        ),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", min=0, show_default=False, help="How long to wait for a plan."
        ),
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Record the plan, as a new revision.")
    ] = False,
    actor: Annotated[
        str | None,
        typer.Option(metavar="NAME", show_default=False, help="With --record: who records it."),
    ] = None,
    reason: Annotated[
        str | None, typer.Option(metavar="TEXT", show_default=False, help="With --record: why.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find a plan from the state to the goal.

    It is written in the format of the validator VAL.
    """
    if not record and (actor is not None or reason is not None):
        raise typer.BadParameter("these go with --record", param_hint="--actor and --reason")
    with open_state(url, kb, at) as (name, state):
        found = state.plan(engine=engine, timeout=timeout)
    recorded = _record(url, name, found, actor, reason) if record else None
    if as_json:
        more = (
            {} if recorded is None else {"plan": recorded.id, "recorded_in": recorded.recorded_in}
        )
        write_json({"knowledge_base": name} | _document(found) | more)
        return
    printer = Printer()
    printer.line(f"; revision {found.revision}")
    printer.line(f"; {found.status} by {found.engine}")
    if recorded is not None:
        printer.line(f"; plan {recorded.id}, recorded in revision {recorded.recorded_in}")
    for step in found.steps:
        printer.line(printable(str(step)))


def _record(
    url: str, name: str, found: Plan, actor: str | None, reason: str | None
) -> RecordedPlan:
    """Record a plan, and give it as it is then."""
    with connect(url, knowledge_base=name) as knowledge_base:
        with knowledge_base.transaction(actor=actor, reason=reason):
            id_ = knowledge_base.plans.record(found).id
        recorded = knowledge_base.plans.get(id_)
    if recorded is None:
        raise KantSqlError(f"plan {id_} in knowledge base {name!r} is gone")
    return recorded


def plans(
    url: Url,
    kb: Name = None,
    at: At = None,
    id_: Annotated[
        int | None,
        typer.Option("--plan", metavar="ID", show_default=False, help="Only this one: its steps."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each plan.")
    ] = False,
) -> None:
    """List the plans on record, and what became of them.

    The oldest plan comes first.
    """
    with open_state(url, kb, at) as (name, state):
        found = state.plans.get_all() if id_ is None else [_get(state, name, id_)]
        if as_json:
            for one in found:
                write_json({"knowledge_base": name} | _recorded_document(one))
        elif id_ is None:
            columns = "plan", "recorded in", "planned from", "planner", "status", "steps"
            Printer().table("plans", columns, [_row(one) for one in found])
        else:
            _write_recorded(Printer(), found[0])


def _get(state: KnowledgeBase, name: str, id_: int) -> RecordedPlan:
    one = state.plans.get(id_)
    if one is None:
        raise KantSqlError(
            f"there is no plan {id_} in knowledge base {name!r}; see: kant-sql plans"
        )
    return one


def _row(one: RecordedPlan) -> tuple[str, ...]:
    counts = Counter(step.status or _NOT_STARTED for step in one.steps)
    steps = ", ".join(f"{count} {status}" for status, count in counts.items())
    return (
        str(one.id),
        str(one.recorded_in),
        str(one.revision),
        printable(one.planner or ""),
        printable(one.status or ""),
        steps or "none",
    )


def _write_recorded(printer: Printer, one: RecordedPlan) -> None:
    printer.line(
        f"plan {one.id}, recorded in revision {one.recorded_in}, planned from revision "
        f"{one.revision}",
        "bold",
    )
    said = {"planner": one.planner, "version": one.planner_version, "status": one.status}
    for what, text in said.items():
        if text is not None:
            printer.line(f"  {what}: {printable(text)}")
    if one.value is not None:
        printer.line(f"  {printable(one.objective or 'value')}: {one.value:f}")
    rows = [
        (str(step.position), printable(str(step)), step.status or _NOT_STARTED)
        for step in one.steps
    ]
    printer.table("steps", ("step", "action", "status"), rows)


def _recorded_document(one: RecordedPlan) -> dict[str, object]:
    return {
        "plan": one.id,
        "recorded_in": one.recorded_in,
        "revision": one.revision,
        "problem_hash": one.problem_hash,
        "planner": one.planner,
        "planner_version": one.planner_version,
        "objective": one.objective,
        "value": _number(one.value),
        "status": one.status,
        "steps": [
            {
                "position": step.position,
                "start": _number(step.start),
                "action": step.action,
                "arguments": list(step.arguments),
                "duration": _number(step.duration),
                "status": step.status,
                "revisions": list(step.revisions),
            }
            for step in one.steps
        ],
    }


def _document(found: Plan) -> dict[str, object]:
    return {
        "revision": found.revision,
        "engine": found.engine,
        "status": found.status,
        "steps": [_step(step) for step in found.steps],
    }


def _step(step: PlanStep) -> dict[str, object]:
    return {
        "start": _number(step.start),
        "action": step.action,
        "arguments": list(step.arguments),
        "duration": _number(step.duration),
    }


def _number(number: Decimal | None) -> str | None:
    return None if number is None else f"{number:f}"
