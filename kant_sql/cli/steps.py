"""`kant-sql why-not`, `applicable`, `apply` and `validate`: steps and plans in a state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import printable
from .asking import write_failed
from .common import (
    Actor,
    AsJson,
    At,
    Fixed,
    Name,
    Reason,
    ask_state,
    json_lines,
    open_state,
    open_to_read,
    option,
    parse_fixed,
    split_url,
    words_argument,
)
from .history import write_changes
from .output import FAILED, Printer, write_json
from .plans import get_recorded, read_plan

if TYPE_CHECKING:
    from ..reasoning.validate import Validation

_STEP_USAGE = "[URL] STEP"
_STEP_EXAMPLE = "sqlite:///robot.db '(move rb1 wp1 wp2)'"
_Step = Annotated[list[str], words_argument(_STEP_USAGE, "a step, such as '(move rb1 wp1 wp2)'.")]


def why_not(words: _Step, kb: Name = None, at: At = None, as_json: AsJson = False) -> None:
    """Show which conditions of a step do not hold.

    Of a durative action, its start counts, and what is over all right after it.
    """
    url, (step,) = split_url(words, _STEP_USAGE, _STEP_EXAMPLE)
    name, revision, failed = ask_state(url, kb, at, lambda state: state.why_not(step))
    if as_json:
        header = {"knowledge_base": name, "revision": revision, "step": step}
        write_json({**header, "is_applicable": not failed, "unsatisfied": failed})
        return
    printer = Printer()
    if failed:
        write_failed(printer, failed)
    else:
        printer.line(f"{step} is applicable")


_APPLICABLE_USAGE = "[URL] [ACTION]"


def applicable(
    words: Annotated[
        list[str] | None,
        words_argument(_APPLICABLE_USAGE, "the name of an action; default: all actions."),
    ] = None,
    kb: Name = None,
    at: At = None,
    fix: Fixed = None,
    limit: Annotated[
        int | None, option("Show only the first N.", "--limit", "-n", metavar="N", min=0)
    ] = None,
    as_json: Annotated[bool, json_lines("step")] = False,
) -> None:
    """List the steps that you can execute in a state.

    With --fix, actions that lack such a parameter are left out.
    """
    url, names = split_url(words or (), _APPLICABLE_USAGE, "sqlite:///robot.db move")
    fixed = parse_fixed(fix)
    _, _, steps = ask_state(
        url, kb, at, lambda state: list(state.applicable_actions(*names, limit=limit, **fixed))
    )
    printer = Printer()
    for step in steps:
        if as_json:
            document = {"action": step.action, "arguments": list(step.arguments)}
            write_json({**document, "step": str(step)})
        else:
            printer.line(printable(str(step)))


def apply(
    words: Annotated[
        list[str],
        words_argument(
            _STEP_USAGE, "a step, such as '(move rb1 wp1 wp2)', with its duration in brackets."
        ),
    ],
    kb: Name = None,
    actor: Actor = None,
    reason: Reason = None,
    as_json: AsJson = False,
) -> None:
    """Execute a step, as a new revision.

    Its conditions are checked, and its effects written. If a condition does not hold, nothing is
    written, and the exit code is 1.
    """
    url, (step,) = split_url(words, _STEP_USAGE, _STEP_EXAMPLE)
    with open_to_read(url, kb, actor) as (name, knowledge_base):
        made = knowledge_base.apply(step, reason=reason)
        changes = [] if made is None else knowledge_base.diff(made - 1, made)
    if as_json:
        document = {"knowledge_base": name, "step": step, "revision": made}
        write_json({**document, "changes": changes})
        return
    printer = Printer()
    if made is None:
        printer.line(f"knowledge base {name}: {step} changes nothing")
        return
    printer.line(f"knowledge base {name}, revision {made}: {step}", "bold")
    write_changes(printer, changes)


_PLAN_USAGE = "[URL] [FILE]"


def validate(
    words: Annotated[
        list[str] | None,
        words_argument(_PLAN_USAGE, "the file of a plan of any planner; - is standard input."),
    ] = None,
    kb: Name = None,
    at: At = None,
    id_: Annotated[
        int | None, option("Validate this recorded plan instead of a file.", "--plan", metavar="ID")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Execute a plan in memory; exit with 1 if it is not valid.

    Nothing is written.
    """
    url, files = split_url(words or (), _PLAN_USAGE, "sqlite:///robot.db sas_plan")
    if bool(files) == (id_ is not None):
        raise typer.BadParameter("give a file or --plan", param_hint="FILE")
    with open_state(url, kb, at) as (name, state):
        plan = read_plan(Path(files[0])) if id_ is None else get_recorded(state, name, id_)
        found = state.validate(plan)
        if as_json:
            write_json(_Validated(name, state.revision, found))
        else:
            _write_validation(Printer(), found)
    return 0 if found.valid else FAILED


@dataclass(frozen=True)
class _Validated:
    """A validation, and the state that the plan began in."""

    _json_ = "knowledge_base", "revision", "*validation"

    knowledge_base: str
    revision: int
    validation: Validation


def _write_validation(printer: Printer, found: Validation) -> None:
    first, *lines = str(found).splitlines()
    printer.line(first, "green" if found.valid else "red")
    for line in lines:
        printer.line(line)
