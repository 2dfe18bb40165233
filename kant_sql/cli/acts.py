"""`kant-sql acts` and `statistics`: executions, their actors and outcomes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from ..errors import printable
from ..knowledge.canonical import time_text
from . import common as c
from .output import Printer, json_text, write_each

if TYPE_CHECKING:
    from ..acts import Execution
    from ..acts.statistics import Statistics

_STYLES = {"succeeded": "green", "failed": "red", "aborted": "red", "refused": "red"}
OUTCOMES = ("running", *_STYLES)


def acts(
    url: c.Url,
    kb: c.Name = None,
    limit: Annotated[int | None, c.most("Show only the N newest.")] = None,
    since: c.Since = None,
    until: c.Until = None,
    actor: Annotated[
        str | None, c.option("Show only executions that this actor began.", metavar="NAME")
    ] = None,
    action: Annotated[
        str | None, c.option("Show only executions of this action.", metavar="NAME")
    ] = None,
    object_: Annotated[
        str | None, c.option("Show only executions with this object.", "--object", metavar="NAME")
    ] = None,
    outcome: Annotated[
        str | None,
        c.option(f"Show only this outcome: {', '.join(OUTCOMES)}.", metavar="WORD"),
    ] = None,
    as_json: Annotated[bool, c.json_lines("execution")] = False,
) -> None:
    """Show executions: by whom, why, and with which outcome.

    It omits steps of plans that were not started and, with --until, acts that ended later.
    """
    if outcome is not None:
        c.require_word(outcome, OUTCOMES, "--outcome")
    first, last = c.parse_range(since, until)
    given: Any = {"action": action, "object": object_, "outcome": outcome, "actor": actor}
    with c.open_to_read(url, kb) as (name, knowledge_base):
        found = knowledge_base.executions.get_all(since=first, until=last, limit=limit, **given)
        write_each(found, as_json, _write, knowledge_base=name)


_GROUPINGS = ("action", "argument", "arguments", "actor")


def statistics(
    url: c.Url,
    kb: c.Name = None,
    by: Annotated[
        list[str] | None,
        c.option(
            f"Group by this: {', '.join(_GROUPINGS)}; repeat it. Default: action.",
            metavar="WORD",
        ),
    ] = None,
    limit: Annotated[int | None, c.most("Show only the N largest groups.")] = None,
    since: c.Since = None,
    until: c.Until = None,
    actor: Annotated[
        str | None, c.option("Count only executions that this actor began.", metavar="NAME")
    ] = None,
    as_json: Annotated[bool, c.json_lines("group")] = False,
) -> None:
    """Show how often actions succeeded, and how long they took.

    The success rate, with its 95 % interval (Wilson), covers executions that succeeded or failed.
    """
    for word in by or ():
        c.require_word(word, _GROUPINGS, "--by")
    first, last = c.parse_range(since, until)
    given: Any = {"by": by or ["action"], "actor": actor, "limit": limit}
    with c.open_to_read(url, kb) as (name, knowledge_base):
        groups = knowledge_base.statistics(since=first, until=last, **given)
        write_each(groups, as_json, _write_figures, knowledge_base=name)


def _write_figures(printer: Printer, group: Statistics) -> None:
    """Write the figures of a group."""
    printer.line(f"{printable(str(group)) or 'all'}: {group.count:,}", "bold")
    counts = ((getattr(group, outcome), outcome) for outcome in OUTCOMES)
    printer.line(f"  {', '.join(f'{count:,} {outcome}' for count, outcome in counts if count)}")
    if group.success_rate is not None and group.interval is not None:
        low, high = group.interval
        printer.line(f"  success: {group.success_rate:.1%} ({low:.1%} to {high:.1%})")
    if group.median is not None:
        printer.line(f"  seconds: {group.median:g}, 95 % within {group.percentile_95:g}")
    for code, count in group.codes.items():
        printer.line(f"  {printable(code)}: {count:,}")
    if group.unconfirmed:
        printer.line(f"  unconfirmed effects: {group.unconfirmed:,}")


def _write(printer: Printer, execution: Execution) -> None:
    """Write an execution with its details."""
    outcome = execution.outcome or ""
    act = printable(str(execution))
    printer.line(f"{execution.id}  {act}  {outcome}", _STYLES.get(outcome, "bold"))
    began = "" if execution.started_at is None else time_text(execution.started_at)
    ended = "" if execution.ended_at is None else time_text(execution.ended_at)
    printer.line(f"  {began}" if ended in ("", began) else f"  {began} to {ended}")
    said = {"actor": execution.actor, "reason": execution.reason}
    said |= {"code": execution.code, "text": execution.text}
    for what, text in said.items():
        if text is not None:
            printer.line(f"  {what}: {printable(text)}")
    if execution.source is not None:
        printer.line(f"  source: {json_text(execution.source)}")
