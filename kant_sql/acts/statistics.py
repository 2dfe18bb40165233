"""Statistics of executions: counts, success rates and durations of each action."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import sqrt
from operator import attrgetter
from typing import Any, Literal, get_args

from sqlalchemy import Select, and_, case, func, literal_column, select

from .. import html
from ..arguments import one_of, shown, storable_text
from ..dao.text import refuse_unknown_actor
from ..errors import InvalidArgumentError
from ..history.confirmations import read_unconfirmed
from ..history.revisions import at_most
from ..moment_text import When
from ..sql import tables as t
from ..sql.executions import OUTCOMES, of_execution
from ..sql.query import Query, Seconds, constant, first_rows, integer
from ..sql.rows import KB, looked_up, table_of
from ..store.snapshot import View
from ..store.state import State
from .executions import began, find_outcomes, had_outcome
from .recording import ExecutionReader, parse_id, parse_words

Grouping = Literal["action", "argument", "arguments", "actor"]
GROUPINGS = get_args(Grouping)
# The quantile of the normal distribution that leaves 2.5 % on each side.
Z = 1.959963984540054


def wilson(succeeded: int, count: int) -> tuple[float, float] | None:
    """Return the 95 % interval of a rate (Wilson, 1927); None without cases."""
    if not count:
        return None
    rate, square = succeeded / count, Z * Z
    middle = rate + square / (2 * count)
    half = Z * sqrt((rate * (1 - rate) + square / (4 * count)) / count)
    low, high = ((middle + sign * half) / (1 + square / count) for sign in (-1, 1))
    return max(low, 0.0), min(high, 1.0)


@dataclass(frozen=True)
class Statistics:
    """Figures about the executions of one group.

    Attributes:
        action: the action, or the name of an act without PDDL; None if not grouped by it.
        argument: an object or another word among the arguments; None if not grouped by it.
        arguments: all arguments together; None if not grouped by them.
        actor: who began them; None if not grouped by it, or if no actor was given.
        count: the number of executions, including refused ones.
        running: the number still running.
        succeeded: the number that succeeded.
        failed: the number that failed.
        aborted: the number that were aborted.
        refused: the number that were refused, and so not begun.
        mean: the mean duration of those that succeeded or failed, in seconds; None without any. An
            act that ended before it began, by two clocks, has no duration.
        median: their median duration, in seconds.
        percentile_95: the 95th percentile of their durations, in seconds.
        codes: the number of failures with each code, the most frequent first.
        unconfirmed: the number of their effects that hold and that no other actor has confirmed.
    """

    _json_ = (
        *("action", "argument", "arguments", "actor", "count", "running", "succeeded", "failed"),
        *("aborted", "refused", "success_rate", "interval", "mean", "median", "percentile_95"),
        *("codes", "unconfirmed"),
    )

    action: str | None
    argument: str | None
    arguments: tuple[str, ...] | None
    actor: str | None
    count: int
    running: int
    succeeded: int
    failed: int
    aborted: int
    refused: int
    mean: float | None
    median: float | None
    percentile_95: float | None
    codes: Mapping[str, int] = field(hash=False)
    unconfirmed: int = 0

    @property
    def success_rate(self) -> float | None:
        """The share of successes among those that succeeded or failed; None without any."""
        decided = self.succeeded + self.failed
        return self.succeeded / decided if decided else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % confidence interval of the success rate, by Wilson; None without any."""
        return wilson(self.succeeded, self.succeeded + self.failed)

    def __str__(self) -> str:
        if self.arguments is not None:
            return f"({' '.join((self.action or '', *self.arguments))})"
        said = (self.action, self.argument, self.actor)
        return " ".join(one for one in said if one is not None)

    def _html_row_(self) -> html.Row:
        interval = self.interval
        return {
            "of": str(self),
            **{name: getattr(self, name) for name in ("count", *OUTCOMES)},
            "success rate": self.success_rate,
            "95 % interval": None if interval is None else "{:.3f} to {:.3f}".format(*interval),
            "mean (s)": self.mean,
            "median (s)": self.median,
            "95 % within (s)": self.percentile_95,
            "unconfirmed effects": self.unconfirmed,
            "codes": tuple(f"{code}: {count}" for code, count in self.codes.items()),
        }


def statistics(
    state: State,
    *,
    by: Iterable[Grouping] = ("action",),
    actor: str | None = None,
    since: When | None = None,
    until: When | None = None,
    limit: int | None = None,
) -> list[Statistics]:
    """Count executions and outcomes in groups, with success rates and durations.

    Args:
        by: `action`; `argument`, which counts an execution for each of its arguments; `arguments`,
            for all arguments together, with their action; `actor`, who began it. Empty: one group
            of all.
        actor: only executions that this actor began.
        since: only outcomes from this revision or time on, as for `kb.executions.get_all`.
        until: only outcomes up to this revision or time.
        limit: the maximum number of groups; None for all.

    Returns:
        The groups, those with the most executions first.

    Raises:
        UnknownNameError: there never was such an actor.
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        InvalidArgumentError: `by` names something else.

    Examples:
        >>> for code in (None, None, "E4"):
        ...     outcome = "failed" if code else "succeeded"
        ...     _ = kb.executions.report("dock", outcome=outcome, code=code)
        >>> [dock] = kb.statistics()
        >>> (dock.count, round(dock.success_rate, 2), dock.codes)
        (3, 0.67, {'E4': 1})
    """
    wanted = _checked(by)
    storable_text(actor, "actor")
    most = at_most(limit)
    low, high = find_outcomes(state, since, until)
    given: dict[str, Any] = {"low": low, "high": high}
    given |= {} if actor is None else {"actor": actor}
    given |= {} if state.at is None else {"at": state.at}
    key, group = (wanted, actor is not None, state.at is not None), attrgetter(*GROUPINGS)

    def read(view: View) -> list[Statistics]:
        if view.kb_id is None:
            return []
        codes: dict[tuple[Any, ...], dict[str, int]] = defaultdict(dict)
        for *names, code, count in view.session.rows(_codes(*key), kb=view.kb_id, **given):
            codes[tuple(names)][code] = count
        rows = view.session.rows(_groups(*key), kb=view.kb_id, size=most, **given)
        made = [_made(wanted, row, codes) for row in rows if row[len(wanted)]]
        # In the same snapshot: another one may have other names.
        waiting = _unconfirmed(state, view, wanted, actor, low, high) if made else {}
        return [replace(one, unconfirmed=waiting.get(group(one), 0)) for one in made]

    found = state.store.read_in_snapshot(read, state.at)
    if actor is not None and not found:
        refuse_unknown_actor(state.store, actor)
    return html.Listing(found, "group")


def _unconfirmed(
    state: State, view: View, wanted: Sequence[str], actor: str | None, low: int, high: int
) -> Mapping[tuple[Any, ...], int]:
    """Count the unconfirmed facts of each group of acts."""
    facts = Counter(act for version in read_unconfirmed(state, view) for act in version.acts)
    keys = [key for key in map(parse_id, facts) if key is not None]
    counted: Counter[tuple[Any, ...]] = Counter()
    for act in ExecutionReader(state.store, view).listed(keys).values():
        if actor not in (None, act.actor) or not low <= (act.revision or high) <= high:
            continue
        whole = "arguments" in wanted
        for word in {*act.arguments} if "argument" in wanted else [None]:
            key = act.action if whole or "action" in wanted else None, word
            rest = act.arguments if whole else None, act.actor if "actor" in wanted else None
            counted[*key, *rest] += facts[act.id]
    return counted


def _checked(by: Iterable[str]) -> tuple[str, ...]:
    if isinstance(by, str) or not isinstance(by, Iterable):
        raise InvalidArgumentError(f"by is {shown(by)}, expected a list such as ['action']")
    given = {one_of(one, GROUPINGS, "what statistics are grouped by") for one in by}
    if "arguments" in given:
        # Their text begins with the action.
        given -= {"action"}
    return tuple(name for name in GROUPINGS if name in given)


def _made(
    wanted: Sequence[str], row: Sequence[Any], codes: Mapping[tuple[Any, ...], dict[str, int]]
) -> Statistics:
    names = tuple(row[: len(wanted)])
    said: dict[str, Any] = {**dict.fromkeys(GROUPINGS), **dict(zip(wanted, names, strict=True))}
    if "arguments" in wanted:
        said["action"], *words = parse_words(said["arguments"])
        said["arguments"] = tuple(words)
    return Statistics(
        **said, **dict(zip(_MEASURED, row[len(names) :], strict=True)), codes=codes.get(names, {})
    )


_NOW, _IDENTITY = table_of(t.ExecutionVersionRow), table_of(t.ExecutionRow)
_ARGUMENT, _REVISION = table_of(t.ExecutionArgumentRow), table_of(t.RevisionRow)
_MEASURED = ("count", *OUTCOMES, "mean", "median", "percentile_95")
_PLACES = {
    "mean": "avg(seconds)",
    "median": "avg(CASE WHEN place IN ((timed + 1) / 2, (timed + 2) / 2) THEN seconds END)",
    "percentile_95": "max(CASE WHEN place = (95 * timed + 99) / 100 THEN seconds END)",
}


def _name_of(kind: str, id_: Any) -> Any:
    named = t.TABLES[kind].c
    return looked_up(named.name, named.id, id_)


def _outcomes(wanted: Sequence[str], of_actor: bool, is_past: bool) -> Any:
    """Write the outcomes with their group columns."""
    now = _NOW.c
    columns = [now[name] for name in ("plan_id", "position", "since", "outcome", "code")]
    columns += [now.started_at, now.ended_at, began().label("began")]
    rows = select(*columns).where(now.kb_id == KB, now.since <= integer("high"))
    rows = rows.where(*had_outcome(["actor"] if of_actor else [], is_past))
    if "action" in wanted:
        name = _name_of("action", of_execution(_IDENTITY.c.action_id, now))
        said = func.coalesce(name, of_execution(_IDENTITY.c.name, now))
        rows = rows.add_columns(said.label("action"))
    if "arguments" in wanted:
        rows = rows.add_columns(of_execution(_IDENTITY.c.text, now).label("arguments"))
    if "argument" in wanted:
        rows = _with_each_argument(rows)
    return rows.subquery("had")


def _with_each_argument(rows: Select[Any]) -> Select[Any]:
    """Repeat each execution for each distinct argument."""
    own, before = _ARGUMENT.c, _ARGUMENT.alias("earlier").c
    of_execution = own.plan_id == _NOW.c.plan_id, own.position == _NOW.c.position
    earlier: Select[Any] = select(constant(1)).where(
        *(before[name] == value for name, value in (("kb_id", KB), ("plan_id", own.plan_id))),
        *(before.position == own.position, before.argument < own.argument),
        func.coalesce(before.object_id, constant(0)) == func.coalesce(own.object_id, constant(0)),
        func.coalesce(before.value, constant("")) == func.coalesce(own.value, constant("")),
    )
    said = func.coalesce(_name_of("object", own.object_id), own.value)
    rows = rows.add_columns(said.label("argument"))
    return rows.where(own.kb_id == KB, *of_execution, ~earlier.correlate(_ARGUMENT).exists())


def _committed(number: Any, column: str = "committed_at") -> Any:
    return looked_up(_REVISION.c[column], _REVISION.c.number, number)


def _named(had: Any, wanted: Sequence[str]) -> list[Any]:
    """Select the group columns of outcomes."""
    names = [_committed(had.began, "actor") if one == "actor" else had[one] for one in wanted]
    return [one.label(name) for one, name in zip(names, wanted, strict=True)]


def _once(rows: Select[Any], name: str) -> Any:
    """Compute rows once: SQLite would look each value up wherever the statement names it."""
    return rows.cte(name).prefix_with("MATERIALIZED").c


def _measured(wanted: Sequence[str], of_actor: bool, is_past: bool) -> Any:
    """Write the outcomes with the seconds of those that succeeded or failed."""
    had = _outcomes(wanted, of_actor, is_past).c
    begin = func.coalesce(had.started_at, _committed(had.began)).label("begin")
    end = func.coalesce(had.ended_at, _committed(had.since)).label("end_")
    ended = _once(select(*_named(had, wanted), had.outcome, begin, end), "ended")
    is_decided = ended.outcome.in_([constant("succeeded"), constant("failed")])
    # A component's clock may be ahead of the database's; then there is no duration.
    is_timed = and_(is_decided, ended.begin <= ended.end_)
    seconds = case((is_timed, Seconds(ended.begin, ended.end_))).label("seconds")
    return _once(select(*(ended[name] for name in wanted), ended.outcome, seconds), "lasted")


@cache
def _groups(wanted: tuple[str, ...], of_actor: bool, is_past: bool) -> Query:
    """Select the figures of each group, the largest first."""
    lasted = _measured(wanted, of_actor, is_past)
    keys = [lasted[name] for name in wanted]
    place = func.row_number().over(
        partition_by=[*keys, lasted.seconds.is_(None)], order_by=lasted.seconds
    )
    timed = func.count(lasted.seconds).over(partition_by=keys)
    columns = [*keys, lasted.outcome, lasted.seconds, place.label("place"), timed.label("timed")]
    placed = select(*columns).subquery("placed").c
    names = [placed[name] for name in wanted]
    count = func.count().label("executions")
    figures = [f"count(CASE WHEN outcome = '{each}' THEN 1 END)" for each in OUTCOMES]
    figures += _PLACES.values()
    rows = select(*names, count, *map(literal_column, figures)).select_from(placed.outcome.table)
    rows = rows.group_by(*names).order_by(count.desc(), *names)
    return Query(first_rows(rows, integer("size")))


@cache
def _codes(wanted: tuple[str, ...], of_actor: bool, is_past: bool) -> Query:
    """Count the codes of the failures of each group, the most frequent first."""
    had = _outcomes(wanted, of_actor, is_past).c
    coded = select(*_named(had, wanted), had.code).where(had.code.is_not(None)).subquery("coded").c
    keys = [*(coded[name] for name in wanted), coded.code]
    count = func.count()
    return Query(select(*keys, count).group_by(*keys).order_by(count.desc(), coded.code))
