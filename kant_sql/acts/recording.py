"""Records executions and their outcomes in a transaction, and reads them at a revision."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from functools import partial
from typing import Any, NamedTuple

from sqlalchemy import literal_column, select

from ..arguments import shown
from ..errors import PlanError, reading_rows
from ..history.revisions import LARGEST, Revision, Version, read_numbered, why_of
from ..sql import tables as t
from ..sql.dialects.base import Row
from ..sql.executions import (
    ABORTED,
    FAILED,
    NO_PLAN,
    REFUSED,
    RUNNING,
    SUCCEEDED,
    VERSIONS,
    Key,
    begun_at,
    id_text,
    of_execution,
)
from ..sql.query import Query, constant, in_list, integer
from ..sql.rows import KB, table_of
from ..store.snapshot import View
from ..store.store import Store
from ..store.transaction import Transaction
from . import Execution, Outcome

# The next outcomes of each outcome; None: not started.
_NEXT: dict[str | None, tuple[str, ...]] = {
    None: (RUNNING, ABORTED),
    RUNNING: (SUCCEEDED, FAILED, ABORTED),
}
_SHOWN = {
    None: "was not started",
    RUNNING: "is running",
    SUCCEEDED: "has succeeded",
    FAILED: "has failed",
    ABORTED: "was aborted",
    REFUSED: "was refused",
}
# The outcomes of a step of a plan.
STEP_OUTCOMES = (RUNNING, SUCCEEDED, FAILED, ABORTED)
_WORD = re.compile(r'"(?:[^"\\]|\\.)*"|[^\s()"]+')
_ID = re.compile(r"([1-9]\d{0,17})(?:\.(0|[1-9]\d{0,8}))?")


class Said(NamedTuple):
    """The details of an outcome."""

    code: str | None = None  # the code of a failure
    message: str | None = None  # the message of a failure, or the conditions that did not hold
    started_at: datetime | None = None  # when it began, if not at the commit
    ended_at: datetime | None = None  # when it ended, likewise


NOTHING = Said()


def key_of(execution: Execution) -> Key:
    """Return the key of an execution: the id of its plan and its position, or its own id."""
    if not isinstance(execution, Execution):
        raise PlanError(
            "expected an execution, as kb.executions has them, or a step of a recorded plan, as "
            f"kb.plans.record(plan).steps has them, not {shown(execution)}"
        )
    if execution.plan_id is None or execution.position is None:
        return NO_PLAN, int(execution.id)
    return execution.plan_id, execution.position


def parse_id(given: object) -> Key | None:
    """Read the id of an execution; return None if the text is not one."""
    if isinstance(given, int) and not isinstance(given, bool):
        return (NO_PLAN, given) if given > 0 else None
    found = _ID.fullmatch(given) if isinstance(given, str) else None
    if found is None:
        return None
    first, second = found.groups()
    return (NO_PLAN, int(first)) if second is None else (int(first), int(second))


def check_execution(transaction: Transaction, execution: Execution) -> None:
    """Refuse an execution of another knowledge base."""
    role = f"{execution.place}, {execution},"
    if execution.knowledge_base != transaction.name:
        raise PlanError(
            f"{role} is of knowledge base {execution.knowledge_base!r}, not of "
            f"{transaction.name!r}; use that one, or record it here"
        )
    found = transaction.find_execution(key_of(execution))
    if found is None:
        raise PlanError(
            f"{role} is not in knowledge base {transaction.name!r}: its transaction was not "
            "committed, or it is of another store; record it first"
        )
    if parse_words(found) != [execution.action, *execution.arguments]:
        raise PlanError(
            f"{role} is {found} in knowledge base {transaction.name!r}: it is of another store, "
            "or a name was erased; read it again, or record it here"
        )


def set_outcome(
    transaction: Transaction, execution: Execution, outcome: str, said: Said = NOTHING
) -> bool:
    """Set the next outcome of an execution; return False if it already has this outcome."""
    check_execution(transaction, execution)
    key = key_of(execution)
    before = transaction.executions.now(key)
    now = None if before is None else before.outcome
    if now == outcome:
        return False
    if outcome not in _NEXT.get(now, ()):
        raise PlanError(
            f"{execution.place}, {execution}, {_SHOWN[now]}, so it cannot be {outcome!r} next"
        )
    if before is not None and said.started_at is None:
        # It may replace the outcome before, or remain when that one is archived.
        said = said._replace(started_at=begun_at(before.text))
    transaction.executions.set(key, outcome, *check_order(said))
    return True


def check_order(said: Said) -> Said:
    """Refuse an end before the beginning."""
    begun, ended = said.started_at, said.ended_at
    if begun is not None and ended is not None and ended < begun:
        raise PlanError(
            f"it ended at {ended.isoformat()}, before it began at {begun.isoformat()}; give both "
            "times by one clock"
        )
    return said


def _reads(mapped: type[t.Base], order: int, *names: str, known_from: str) -> dict[str, Query]:
    """Select columns of the executions of some plans, of one key, or of a list of keys."""
    columns = table_of(mapped).c
    read = [columns[name] for name in ("plan_id", "position", *names)]
    known = columns[known_from]
    query = select(*read).where(columns.kb_id == KB).order_by(*read[:order])
    of_plans = columns.plan_id.between(integer("low"), integer("high"))
    one = columns.plan_id == integer("plan"), columns.position == integer("position")
    # Without statistics, PostgreSQL would read everything that began up to this revision.
    upto = known + literal_column("0") <= integer("at")
    position = in_list(columns.position, "positions")
    return {
        "plans": Query(query.where(of_plans, upto)),
        "one": Query(query.where(*one, upto)),
        "listed": Query(query.where(in_list(columns.plan_id, "plans"), position, upto)),
    }


# The text has the exact names: looking up each would take longer than all the rest.
_EXECUTIONS = _reads(t.ExecutionRow, 2, "since", "start", "duration", "text", known_from="since")
_OUTCOMES = _reads(
    t.ExecutionVersionRow,
    3,
    *("since", "until", "kind", "outcome", "text", "code", "message", "started_at", "ended_at"),
    known_from="since",
)
_REVISIONS = _reads(t.RevisionExecutionRow, 3, "number", known_from="number")


class _Held(NamedTuple):
    """A row of `execution_version`, as of a revision."""

    since: int
    until: int | None
    kind: str
    outcome: Outcome
    text: str
    code: str | None
    message: str | None
    started_at: Any
    ended_at: Any


class ExecutionReader:
    """Reads executions at one revision."""

    def __init__(self, store: Store, view: View) -> None:
        self._name = store.name
        self._session = view.session
        self._kb_id = view.kb_id
        self._at = LARGEST if view.at is None else view.at

    def of_plans(self, low: int, high: int) -> Iterator[Execution]:
        """Yield the steps of plans, in order."""
        return self._read("plans", low=low, high=high)

    def one(self, key: Key) -> Execution | None:
        """Read an execution by its key."""
        return next(self._read("one", plan=key[0], position=key[1]), None)

    def listed(self, keys: Collection[Key]) -> dict[Key, Execution]:
        """Read executions by their keys."""
        if not keys:
            return {}
        lists = {
            name: self._session.list_value([*dict.fromkeys(key[n] for key in keys)])
            for n, name in enumerate(("plans", "positions"))
        }
        wanted = {*keys}
        found = ((key_of(one), one) for one in self._read("listed", wanted, **lists))
        return {key: one for key, one in found if key in wanted}

    def _rows(self, query: Query, given: dict[str, Any]) -> list[Row]:
        if self._kb_id is None:
            return []
        return self._session.rows(query, kb=self._kb_id, at=self._at, **given)

    def _read(
        self, scope: str, wanted: Collection[Key] | None = None, **given: Any
    ) -> Iterator[Execution]:
        held: dict[Key, list[_Held]] = defaultdict(list)
        for plan_id, position, since, until, *said in self._rows(_OUTCOMES[scope], given):
            ended = None if until is None or until > self._at else until
            held[plan_id, position].append(_Held(since, ended, *said))
        links: dict[Key, list[int]] = defaultdict(list)
        for plan_id, position, number in self._rows(_REVISIONS[scope], given):
            links[plan_id, position].append(number)
        rows = self._rows(_EXECUTIONS[scope], given)
        if wanted is not None:
            rows = [row for row in rows if (row[0], row[1]) in wanted]
        numbers = {n for each in held.values() for one in each for n in one[:2] if n is not None}
        numbers |= {row[2] for row in rows if row[0] == NO_PLAN}
        known = read_numbered(self._session, self._kb_id or 0, numbers)
        for plan_id, position, *row in rows:
            key = (plan_id, position)
            with reading_rows("execution", f"execution {id_text(key)}"):
                made = self._made(key, row, held[key], known, tuple(links[key]))
            yield made

    def _made(
        self,
        key: Key,
        row: list[Any],
        held: list[_Held],
        known: dict[int, Revision],
        links: tuple[int, ...],
    ) -> Execution:
        recorded, start, duration, text = row
        now = held[-1] if held and held[-1].until is None else None
        first = held[0] if held else None
        # The first outcome of an execution may be in an archive; its revision stays.
        begun = recorded if key[0] == NO_PLAN else first and first.since
        began = known.get(begun or 0)
        said = now or first
        ended = None if now is None or now.outcome == RUNNING else known.get(now.since)
        outcomes = tuple(
            Version(one.kind, one.text, known[one.since], known.get(one.until or 0))
            for one in held
            # An uncommitted revision is not in the table yet.
            if one.since in known
        )
        actor, reason, source = why_of(began)
        return replace(
            unstarted(self._name, key, start, duration, text),
            outcome=now and now.outcome,
            code=now and now.code,
            text=now and now.message,
            started_at=self._time(said and said.started_at, began),
            ended_at=self._time(now and now.ended_at, ended),
            actor=actor,
            reason=reason,
            source=source,
            outcomes=outcomes,
            revisions=tuple(sorted({*links, *(one.since.number for one in outcomes)})),
        )

    def _time(self, said: Any, revision: Revision | None) -> datetime | None:
        """Return the reported time, or that of a revision."""
        if said is not None:
            return self._session.to_time(said)
        return None if revision is None else revision.committed_at


def parse_words(text: str) -> list[str]:
    """Read the text of an execution; no name has a space, a quote or a parenthesis."""
    if '"' not in text:
        return text[1:-1].split(" ")
    return [json.loads(one) if one[0] == '"' else one for one in _WORD.findall(text)]


def unstarted(name: str, key: Key, start: str | None, duration: str | None, text: str) -> Execution:
    """Make an execution without an outcome."""
    plan_id, position = key
    is_step = plan_id != NO_PLAN
    action, *arguments = parse_words(text)
    return Execution(
        id=id_text(key),
        plan_id=plan_id if is_step else None,
        position=position if is_step else None,
        start=_decimal(start),
        action=action,
        arguments=tuple(arguments),
        duration=_decimal(duration),
        knowledge_base=name,
        references=tuple(one[0] != '"' for one in _WORD.findall(text)),
    )


def _decimal(text: str | None) -> Decimal | None:
    return None if text is None else Decimal(text)


def read_execution(store: Store, key: Key) -> Execution:
    """Read an execution as it is now."""

    def work(view: View) -> Execution:
        now = ExecutionReader(store, view).one(key)
        assert now is not None
        return now

    return store.read_in_snapshot(work)


_IDENTITY = table_of(t.ExecutionRow)
_ACTION = of_execution(_IDENTITY.c.action_id, VERSIONS.c)
# Few are running, among all that ever had an outcome.
RUNNING_NOW = Query(
    select(VERSIONS.c.plan_id, VERSIONS.c.position, _ACTION)
    .where(VERSIONS.c.kb_id == KB, VERSIONS.c.until.is_(None))
    .where(VERSIONS.c.outcome == constant(RUNNING))
    .order_by(VERSIONS.c.plan_id, VERSIONS.c.position)
)


def running_executions(store: Store) -> list[Execution]:
    """Read the running executions of actions."""
    return store.read_in_snapshot(partial(read_running, store))


def read_running(store: Store, view: View) -> list[Execution]:
    """Read the running executions of actions in a state."""
    if view.kb_id is None:
        return []
    rows = view.session.rows(RUNNING_NOW, kb=view.kb_id)
    # Reports of components without PDDL are not actions.
    keys = [(plan_id, position) for plan_id, position, action in rows if action is not None]
    found = ExecutionReader(store, view).listed(keys)
    return [found[key] for key in keys if key in found]
