"""`kant-sql query`, `holds`, `goals`, `when` and `rules`: conditions on a state and on the past."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from ..dto import formulas as f
from ..errors import InvalidKnowledgeError, UnknownNameError, UnsupportedConstructError, printable
from ..knowledge.canonical import time_text
from ..knowledge.sayings import COMMITTED
from ..pddl.lexer import Source, decode, load
from . import common as c
from .documents import STANDARD_INPUT, read_bytes
from .history import write_revision
from .output import FAILED, NOT_JUDGED, Printer, write_each, write_json

if TYPE_CHECKING:
    from datetime import datetime

    from ..history.revisions import Revision
    from ..knowledge_base import KnowledgeBase
    from ..reasoning.ask import Answers
    from ..reasoning.failures import FailedCondition
    from ..reasoning.rules import Verdict
    from ..reasoning.when import Held

_CONDITION = c.CommandWords("[URL] CONDITION", "sqlite:///robot.db '(robot_at ?r wp1)'")
_Words = Annotated[
    list[str], _CONDITION.argument("a condition in PDDL, such as '(robot_at ?r wp1)'.")
]
_Parameters = Annotated[
    str | None,
    c.option(
        "Types of the variables, such as '(?r - robot ?w - wp)'; default: those of the atoms.",
        metavar="PDDL",
    ),
]


def query(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    parameters: _Parameters = None,
    fix: c.Fixed = None,
    limit: Annotated[int | None, c.most("Show only the first N.")] = None,
    sql: Annotated[
        bool, c.option("Write the SQL statement with its values instead.", "--sql")
    ] = False,
    as_json: Annotated[bool, c.json_lines("answer")] = False,
) -> None:
    """Find the objects for which a condition holds.

    Its free variables are the columns.
    """
    url, (condition,) = _CONDITION.split(words)
    fixed = c.parse_fixed(fix)

    def find(state: KnowledgeBase) -> Answers | str:
        answers = state.query(condition, parameters=parameters, limit=limit, **fixed)
        if sql:
            return answers.sql
        # Read from the state on first use.
        len(answers)
        return answers

    name, _, found = c.ask_state(url, kb, at, valid, find)
    if isinstance(found, str):
        if as_json:
            write_json(knowledge_base=name, sql=found)
        else:
            typer.echo(f"{found.rstrip().removesuffix(';')};")
    elif as_json:
        for answer in found.to_dicts():
            write_json(answer)
    elif not found.columns:
        Printer().line("holds" if found else "does not hold")
    else:
        Printer().table("answers", [f"?{column}" for column in found.columns], list(found))


def holds(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    fix: c.Fixed = None,
    as_json: c.AsJson = False,
) -> int:
    """Exit with 0 if a condition holds, and with 1 if not.

    With free variables, it holds if it holds for some objects.
    """
    url, (condition,) = _CONDITION.split(words)
    fixed = c.parse_fixed(fix)
    name, revision, does_hold = c.ask_state(
        url, kb, at, valid, lambda state: state.holds(condition, **fixed)
    )
    if as_json:
        write_json(knowledge_base=name, revision=revision, condition=condition, holds=does_hold)
    else:
        Printer().line("holds" if does_hold else "does not hold")
    return 0 if does_hold else FAILED


class _Goal(NamedTuple):
    """A goal or a preference of a state, and whether it holds."""

    pddl: str
    holds: bool
    is_preference: bool
    preference: str | None  # the name of a preference


def goals(
    url: c.Url, kb: c.Name = None, at: c.At = None, valid: c.Valid = None, as_json: c.AsJson = False
) -> int:
    """Show which goals hold; exit with 1 if one does not.

    Preferences do not count. It also shows the value of the metric.
    """
    name, revision, answer = c.ask_state(
        url,
        kb,
        at,
        valid,
        lambda state: (list(_goals(state)), state.unsatisfied(), _metric(state)),
    )
    found, unsatisfied, (metric, value, lack) = answer
    if as_json:
        write_json(
            knowledge_base=name,
            revision=revision,
            is_reached=not unsatisfied,
            goals=found,
            unsatisfied=unsatisfied,
            metric=metric and {"pddl": str(metric), "value": value, "error": lack},
        )
    else:
        _write_goals(Printer(), found, unsatisfied)
        if metric is not None:
            said = lack if value is None else f"{value:f}"
            printer = Printer()
            printer.line()
            printer.line(
                f"metric: {metric.optimization} {metric.expression}: {printable(said or '')}"
            )
    return FAILED if unsatisfied else 0


def _goals(state: KnowledgeBase) -> Iterator[_Goal]:
    """Take conjunctions of goals apart, and judge each."""
    pending: list[tuple[f.Formula, tuple[tuple[f.TypedName, ...], ...]]]
    pending = [(goal, ()) for goal in reversed(state.goals.get_all())]
    while pending:
        node, variables = pending.pop()
        has_preference = f.mentions(f.Preference, node)
        if isinstance(node, f.And):
            pending += [(one, variables) for one in reversed(node.formulas)]
        elif isinstance(node, f.Forall) and has_preference:
            pending.append((node.formula, (*variables, node.variables)))
        else:
            formula = node.formula if isinstance(node, f.Preference) else node
            for each in reversed(variables):
                formula = f.Forall(each, formula)
            name = node.name if isinstance(node, f.Preference) else None
            yield _Goal(str(formula), state.holds(formula), has_preference, name)


def _metric(state: KnowledgeBase) -> tuple[f.Metric | None, Decimal | None, str | None]:
    """Return the metric, its value, and why it has none."""
    metric = state.pddl.metric.get()
    try:
        return metric, state.pddl.metric_value(), None
    except (InvalidKnowledgeError, UnsupportedConstructError) as error:
        return metric, None, str(error)


def _write_goals(
    printer: Printer, found: Iterable[_Goal], unsatisfied: Iterable[FailedCondition]
) -> None:
    kinds: dict[bool, list[list[str]]] = {False: [], True: []}
    for goal in found:
        row = [goal.pddl, "holds" if goal.holds else "does not hold"]
        kinds[goal.is_preference].append([goal.preference or "", *row][not goal.is_preference :])
    printer.table("goals", ["goal", "now"], kinds[False])
    if kinds[True]:
        printer.table("preferences", ["preference", "goal", "now"], kinds[True])
    parts = list(unsatisfied)
    if parts:
        printer.line()
        printer.line(f"unsatisfied ({len(parts)})", "bold")
        write_failed(printer, parts)


def write_failed(printer: Printer, parts: Iterable[FailedCondition], indent: str = "") -> None:
    """Write the failed conditions, and the revisions that retracted facts."""
    for part in parts:
        printer.line(f"{indent}{part}")
        if part.retracted is not None:
            _write_end(printer, "retracted in", part.retracted, f"{indent}  ")


def _write_end(
    printer: Printer, what: str, revision: Revision, indent: str, time: datetime | None = None
) -> None:
    """Write the revision at the beginning or end of a period, or of the saying about it."""
    if time is not None and time != revision.committed_at:
        printer.line(f"{indent}{'at' if what == 'in' else what} {time_text(time)}")
        what = "  said in"
    write_revision(printer, f"{what} ", revision, indent)


def when(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    since: c.Since = None,
    until: c.Until = None,
    parameters: _Parameters = None,
    fix: c.Fixed = None,
    clock: c.Clock = "committed",
    as_json: Annotated[bool, c.json_lines("period")] = False,
) -> None:
    """Show when a condition held, and the revisions at both ends.

    The periods are those of all objects of its free variables, the earliest first.
    """
    url, (condition,) = _CONDITION.split(words)
    fixed = c.parse_fixed(fix)
    first, last = c.parse_range(since, until)
    with c.open_state(url, kb, at) as (_, state):
        given = {"clock": clock, **fixed}
        periods = state.when(condition, since=first, until=last, parameters=parameters, **given)
        write_each(periods, as_json, partial(_write_held, condition), is_spaced=True)
        if not periods and not as_json:
            Printer().line("at no time")


def _write_held(condition: str, printer: Printer, held: Held) -> None:
    """Write a period: its objects, its beginning and its end."""
    names = " ".join(f"?{name}={object_}" for name, object_ in held.binding.items())
    printer.line(names or condition, "bold")
    if held.since is None:
        printer.line("  held before")
    else:
        _write_end(printer, "from", held.since, "  ", held.since_time)
    if held.until is None:
        printer.line("  holds at the end")
    else:
        _write_end(printer, "until", held.until, "  ", held.until_time)


_RULES = c.CommandWords(
    "[URL] [FILE|PDDL]", "sqlite:///robot.db '(always (not (robot_at rb1 wp1)))'"
)


def rules(
    words: Annotated[
        list[str] | None,
        _RULES.argument(
            "a file of constraints (- is standard input), or one such as "
            "'(always (robot_at rb1 wp1))'; default: those of the domain and the problem.",
        ),
    ] = None,
    kept: Annotated[bool, c.option("Judge the kept rules instead.", "--kept")] = False,
    save: Annotated[str | None, c.option("Keep the rule, by this name.", metavar="NAME")] = None,
    refuse: Annotated[
        bool, c.option("With --save: refuse each transaction that would violate it.", "--refuse")
    ] = False,
    delete: Annotated[str | None, c.option("Delete the kept rule NAME.", metavar="NAME")] = None,
    actor: c.Actor = None,
    kb: c.Name = None,
    at: c.At = None,
    since: c.Since = None,
    until: c.Until = None,
    clock: Annotated[
        str,
        c.option(
            "The clock: 'committed' (default), 'observed' if it is known, or 'valid' for the "
            "states that were true.",
            metavar="CLOCK",
        ),
    ] = "committed",
    as_json: c.AsJson = False,
) -> int:
    """Judge the past by rules; exit with 1 if one is violated.

    Exits with 3 if none is violated, but one was not judged: no state of the range has all its
    names. Rules are trajectory constraints of PDDL 3.0. Preferences do not count.
    """
    url, given = _RULES.split(words)
    source = next(map(rules_source, given), None)
    if refuse and save is None:
        raise typer.BadParameter("needs --save", param_hint="--refuse")
    of_range = bool(since or until or clock != COMMITTED)
    if save is not None or delete is not None:
        if of_range or kept or at or as_json or (given and save is None):
            hint = "--save and --delete"
            raise typer.BadParameter("these judge nothing; leave out the rest", param_hint=hint)
        with c.open_to_read(url, kb, actor) as (_, knowledge_base):
            return _change_kept(knowledge_base, save, delete, source, refuse)
    if actor is not None:
        raise typer.BadParameter("needs --save or --delete", param_hint="--actor")
    if kept and (given or of_range):
        raise typer.BadParameter(
            "judges each rule since it was saved; leave out RULES, --since, --until and --clock",
            param_hint="--kept",
        )
    first, last = c.parse_range(since, until)
    with c.open_state(url, kb, at) as (name, state):
        if kept:
            found = state.rules.standing()
        else:
            found = state.pddl.check_rules(source, since=first, until=last, clock=clock)
    if as_json:
        ends = {"first": found.first, "last": found.last}
        write_json(knowledge_base=name, **ends, is_satisfied=found.is_satisfied, rules=found)
    else:
        _write_verdicts(Printer(), found, "" if kept else "; --kept judges those of the store")
    if found.is_satisfied:
        return 0
    hard = any(not one.is_preference for one in found.violated)
    return FAILED if hard else NOT_JUDGED


def _change_kept(
    kb: KnowledgeBase, save: str | None, delete: str | None, source: Source | None, refuse: bool
) -> int:
    """Keep a rule, or delete one; return the exit code."""
    if delete is not None and not kb.rules.delete(delete):
        raise UnknownNameError(f"no rule {delete!r} is kept; see: kant-sql rules --kept")
    if save is not None:
        text = "" if source is None else load(source).code
        kb.rules.save(save, text, on_violation="refuse" if refuse else "report")
    return 0


def rules_source(given: str) -> Source:
    """Return rules from a text, a file, or standard input."""
    if given == STANDARD_INPUT:
        return decode(*read_bytes(given))
    return given if given.lstrip()[:1] in ("(", ";") else Path(given)


def _write_verdicts(printer: Printer, verdicts: Sequence[Verdict], others: str) -> None:
    """Write each verdict, and the revision that violates the rule."""
    if not verdicts:
        printer.line(f"there are no rules{others}")
    for verdict in verdicts:
        kind = "preference" if verdict.is_preference else "rule"
        style = "green" if verdict.is_satisfied else "red"
        name = "" if verdict.name is None else f"{printable(verdict.name)}: "
        printer.line(f"{verdict.verdict} {kind}: {name}{verdict.rule}", style)
        if verdict.revision is not None:
            _write_end(printer, "in", verdict.revision, "  ", verdict.valid_at)
        elif verdict.valid_at is not None:
            printer.line(f"  at {time_text(verdict.valid_at)}")
