"""`kant-sql plan`: a plan from what is known, now or at a moment of the past."""

from __future__ import annotations

from decimal import Decimal
from typing import Annotated

import typer

from ..planning import Plan, PlanStep
from .output import Printer, printable, write_json
from .stores import Name, Url, open_state
from .times import At


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
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Find a plan from the state to the goal.

    It is written in the format of the validator VAL.
    """
    with open_state(url, kb, at) as (name, state):
        found = state.plan(engine=engine, timeout=timeout)
    if as_json:
        write_json({"knowledge_base": name} | _document(found))
        return
    printer = Printer()
    printer.line(f"; revision {found.revision}")
    printer.line(f"; {found.status} by {found.engine}")
    for step in found.steps:
        printer.line(printable(str(step)))


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
