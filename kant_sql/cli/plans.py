"""`kant-sql plan`, `plans`, `validate`, `why-not`, `applicable` and `apply`: plans and steps."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import KantSqlError, UnknownNameError, printable
from ..planning import Plan
from . import common as c
from .asking import write_failed
from .documents import STANDARD_INPUT, read_bytes
from .history import write_changes
from .output import FAILED, Document, Printer, write_json

if TYPE_CHECKING:
    from ..knowledge_base import KnowledgeBase
    from ..plans import RecordedPlan

_NOT_STARTED = "not started"


_Engine = Annotated[
    list[str] | None,
    c.option(
        "The engine: a name of unified-planning, for example pyperplan, a name of the file of "
        "engines, or a planner's command line with a name; default: each installed one in turn. "
        "Repeat it to run several side by side.",
        metavar="NAME",
    ),
]
_Best = Annotated[
    bool, c.option("Wait for all engines, and take the best plan, not the first.", "--best")
]
_Memory = Annotated[
    int | None, c.option("The most megabytes of a planner's process.", metavar="MB", min=1)
]
_Timeout = Annotated[float | None, c.seconds("Stop planning after this time.")]
_Strict = Annotated[
    bool, c.option("Fail rather than ignore a part of the metric or a preference.", "--strict")
]
_Costs = Annotated[
    str | None,
    c.option(
        "history: steps cost their expected time until success, instead of the metric.",
        metavar="WORD",
    ),
]
_Read = Annotated[
    Path | None,
    c.option(
        "Read the plan from a file that another planner wrote (- is standard input), instead of "
        "planning.",
        "--read",
        metavar="FILE",
    ),
]
_Record = Annotated[bool, c.option("Record the plan, as a new revision.", "--record")]
_RecordActor = Annotated[
    str | None, c.option("With --record: the actor of the revision.", "--actor", metavar="NAME")
]
_RecordReason = Annotated[
    str | None, c.option("With --record: the reason for the revision.", "--reason", metavar="TEXT")
]


def plan(
    url: c.Url,
    kb: c.Name = None,
    at: c.At = None,
    engine: _Engine = None,
    best: _Best = False,
    timeout: _Timeout = None,
    memory: _Memory = None,
    strict: _Strict = False,
    costs: _Costs = None,
    read: _Read = None,
    record: _Record = False,
    actor: _RecordActor = None,
    reason: _RecordReason = None,
    as_json: c.AsJson = False,
) -> None:
    """Find a plan from the state to the goal.

    The output has the format of the validator VAL.
    """
    if not record and (actor is not None or reason is not None):
        raise typer.BadParameter("these go with --record", param_hint="--actor and --reason")
    if costs not in (None, "history"):
        raise typer.BadParameter(f"{costs!r}: expected history", param_hint="--costs")
    of_planning = engine, best, costs, timeout is not None, memory is not None, strict
    if read is not None and any(of_planning):
        hint = "--engine, --best, --costs, --timeout, --memory and --strict"
        raise typer.BadParameter("these do not go with --read", param_hint=hint)
    with c.open_state(url, kb, at) as (name, state):
        if read is not None:
            found = replace(read_plan(read), revision=state.revision)
        else:
            several = engine is not None and len(engine) > 1
            by: Any = {"engines": engine} if several else {"engine": engine[0] if engine else None}
            by |= {"keep": "best"} if best else {}
            given = {"costs": costs, "memory": memory}
            by |= {name: value for name, value in given.items() if value is not None}
            found = state.plan(timeout=timeout, strict=strict, **by)
    recorded = _record(url, name, found, actor, reason) if record else None
    if as_json:
        write_json(_plan_document(found, recorded), knowledge_base=name)
    else:
        _write_plan(Printer(), found, recorded)


def read_plan(path: Path) -> Plan:
    """Read a plan from a file, or from standard input."""
    if str(path) != STANDARD_INPUT:
        return Plan.read(path)
    _, content = read_bytes(STANDARD_INPUT)
    # Text with a line end is not a path.
    return Plan.read(f"{content.decode('utf-8', 'surrogateescape')}\n")


def _record(
    url: str, name: str, found: Plan, actor: str | None, reason: str | None
) -> RecordedPlan:
    """Record a plan and read it back."""
    from ..knowledge_base import connect

    with connect(url, knowledge_base=name) as knowledge_base:
        with knowledge_base.transaction(actor=actor, reason=reason):
            id_ = knowledge_base.plans.record(found).id
        recorded = knowledge_base.plans.get(id_)
    if recorded is None:
        raise KantSqlError(f"plan {id_} in knowledge base {name!r} is gone")
    return recorded


def _write_plan(printer: Printer, found: Plan, recorded: RecordedPlan | None) -> None:
    printer.line(f"; revision {found.revision}")
    printer.line(
        f"; {found.status} by {printable(found.engine)}" if found.engine else f"; {found.status}"
    )
    for run in found.runs if len(found.runs) > 1 else ():
        printer.line(f"; {printable(str(run))}")
    for part in found.ignored:
        printer.line(f"; ignored: {printable(part)}")
    if recorded is not None:
        printer.line(f"; plan {recorded.id}, recorded in revision {recorded.recorded_in}")
    for step in found.steps:
        printer.line(printable(str(step)))


def _plan_document(found: Plan, recorded: RecordedPlan | None) -> Document:
    document: Document = {
        "revision": found.revision,
        "engine": found.engine,
        "status": found.status,
        "ignored": found.ignored,
        "steps": found.steps,
    }
    if len(found.runs) > 1:
        document["runs"] = found.runs
    if recorded is not None:
        document.update(plan=recorded.id, recorded_in=recorded.recorded_in)
    return document


_PLANS = c.CommandWords("[URL] [ID]", "sqlite:///robot.db 57")


def plans(
    words: Annotated[
        list[str] | None,
        _PLANS.argument("the number of a plan, which is shown with its steps."),
    ] = None,
    kb: c.Name = None,
    at: c.At = None,
    id_: Annotated[int | None, c.option("The same as ID.", "--plan", metavar="ID")] = None,
    links: Annotated[
        bool, c.option("Show what supports the conditions of a plan's steps.")
    ] = False,
    as_json: Annotated[bool, c.json_lines("plan")] = False,
) -> None:
    """List the recorded plans and the status of their steps."""
    url, ids = _PLANS.split(words)
    id_ = _parse_id(ids[0], id_) if ids else id_
    if links and id_ is None:
        raise typer.BadParameter("needs the number of a plan", param_hint="--links")
    with c.open_state(url, kb, at) as (name, state):
        found = state.plans.get_all() if id_ is None else [get_recorded(state, name, id_)]
        supports = state.pddl.causal_links(found[0]) if links else []
        if as_json:
            for one in found:
                write_json(one, knowledge_base=name, **({"links": supports} if links else {}))
        elif id_ is None:
            columns = "plan", "recorded in", "planned from", "planner", "status", "steps"
            Printer().table("plans", columns, [_recorded_row(one) for one in found])
        else:
            _write_recorded(Printer(), found[0])
            for link in supports:
                Printer().line(f"  {printable(str(link))}")


def _parse_id(text: str, other: int | None) -> int:
    """Parse the number of a plan; refuse one that `--plan` gives, too."""
    if not (text.isascii() and text.isdecimal() and other is None):
        raise typer.BadParameter(f"{text!r}: expected the number of one plan", param_hint="ID")
    return int(text)


def get_recorded(state: KnowledgeBase, name: str, id_: int) -> RecordedPlan:
    """Read a recorded plan; raise if there is none."""
    one = state.plans.get(id_)
    if one is None:
        raise UnknownNameError(
            f"there is no plan {id_} in knowledge base {name!r}; see: kant-sql plans"
        )
    return one


def _recorded_row(one: RecordedPlan) -> tuple[str, ...]:
    counts = Counter(step.outcome or _NOT_STARTED for step in one.steps)
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
    stated = {"planner": one.planner, "version": one.planner_version, "status": one.status}
    for what, text in stated.items():
        if text is not None:
            printer.line(f"  {what}: {printable(text)}")
    if one.value is not None:
        printer.line(f"  {printable(one.objective or 'value')}: {one.value:f}")
    rows = [
        (str(step.position), printable(str(step)), step.outcome or _NOT_STARTED)
        for step in one.steps
    ]
    printer.table("steps", ("step", "action", "status"), rows)


_STEP = c.CommandWords("[URL] STEP", "sqlite:///robot.db '(move rb1 wp1 wp2)'")
_Step = Annotated[list[str], _STEP.argument("a step, such as '(move rb1 wp1 wp2)'.")]


def why_not(
    words: _Step,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    as_json: c.AsJson = False,
) -> None:
    """Show which conditions of a step do not hold.

    For a durative action, it checks the conditions at start, and over all right after the start.
    """
    url, (step,) = _STEP.split(words)
    name, revision, failed = c.ask_state(url, kb, at, valid, lambda state: state.why_not(step))
    if as_json:
        asked = {"knowledge_base": name, "revision": revision, "step": step}
        write_json(**asked, is_applicable=not failed, unsatisfied=failed)
        return
    printer = Printer()
    if failed:
        write_failed(printer, failed)
    else:
        printer.line(f"{step} is applicable")


_ACTION = c.CommandWords("[URL] [ACTION]", "sqlite:///robot.db move")


def applicable(
    words: Annotated[
        list[str] | None,
        _ACTION.argument("the name of an action; default: all actions."),
    ] = None,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    fix: c.Fixed = None,
    limit: Annotated[int | None, c.most("Show only the first N.")] = None,
    as_json: Annotated[bool, c.json_lines("step")] = False,
) -> None:
    """List the steps that you can execute in a state.

    --fix omits actions without such a parameter.
    """
    url, names = _ACTION.split(words)
    fixed = c.parse_fixed(fix)
    _, _, steps = c.ask_state(
        url,
        kb,
        at,
        valid,
        lambda state: list(state.applicable_actions(*names, limit=limit, **fixed)),
    )
    printer = Printer()
    for step in steps:
        if as_json:
            write_json(action=step.action, arguments=step.arguments, step=str(step))
        else:
            printer.line(printable(str(step)))


def apply(
    words: Annotated[
        list[str],
        _STEP.argument("a step, such as '(move rb1 wp1 wp2)', with its duration in brackets."),
    ],
    kb: c.Name = None,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> None:
    """Execute a step, as a new revision.

    It checks the conditions and writes the effects. If a condition does not hold, it writes
    nothing, and exits with 1.
    """
    url, (step,) = _STEP.split(words)
    with c.open_to_read(url, kb, actor) as (name, knowledge_base):
        made = knowledge_base.apply(step, reason=reason)
        # Without a transaction, each act is a revision.
        assert made is not None
        changes = knowledge_base.diff(made - 1, made)
    if as_json:
        write_json(knowledge_base=name, step=step, revision=made, changes=changes)
        return
    printer = Printer()
    done = step if changes else f"{step} changes nothing"
    printer.line(f"knowledge base {name}, revision {made}: {done}", "bold")
    write_changes(printer, changes)


_FILE = c.CommandWords("[URL] [FILE]", "sqlite:///robot.db sas_plan")


def validate(
    words: Annotated[
        list[str] | None,
        _FILE.argument("the file of a plan of any planner; - is standard input."),
    ] = None,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    id_: Annotated[
        int | None,
        c.option("Validate this recorded plan instead of a file.", "--plan", metavar="ID"),
    ] = None,
    as_json: c.AsJson = False,
) -> int:
    """Execute a plan in memory; exit with 1 if it is not valid.

    It writes nothing.
    """
    url, files = _FILE.split(words)
    if bool(files) == (id_ is not None):
        raise typer.BadParameter("give a file or --plan", param_hint="FILE")
    with c.open_state(url, kb, at, valid) as (name, state):
        found = state.validate(read_plan(Path(files[0])) if id_ is None else id_)
        if as_json:
            write_json(found, knowledge_base=name, revision=state.revision)
        else:
            first, *lines = str(found).splitlines()
            printer = Printer()
            printer.line(first, "green" if found.valid else "red")
            for line in lines:
                printer.line(line)
    return 0 if found.valid else FAILED
