"""Executions as trajectories, for programs that learn models of actions.

The form is that of SAM learners (Juba, Le and Stern, Safe Learning of Lifted Action Models, 2021)
and of the package `pddl-plus-parser`: `((:init FACT ...) (operator: (ACT)) (:state FACT ...) ...)`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from os import PathLike
from typing import NamedTuple

from sqlalchemy import text

import kant_sql
from kant_sql.dao.interfaces import Progress
from kant_sql.dto.lexical import NUMBER
from kant_sql.errors import InvalidArgumentError
from kant_sql.export.files import Exported, Folder, folder_name, new_export, refuse_valid_clock
from kant_sql.export.snapshot import KnowledgeBaseState, StoreSnapshot, Window
from kant_sql.knowledge.sayings import COMMITTED
from kant_sql.moment_text import When
from kant_sql.sql.audit_views import BOUNDS
from kant_sql.sql.dialects.base import Row
from kant_sql.sql.executions import RUNNING, SUCCEEDED, id_text, read_outcome
from kant_sql.sql.query import Query

FORMAT = "trajectory"
_VALUE = re.compile(r"\(= \(.*\) (\S+)\)")
_CHANGES = Query(
    text(
        "SELECT revision, sign, kind, text, plan_id, plan_step FROM audit_change WHERE kb_id = :kb"
        " AND kind IN ('fact', 'value', 'execution', 'plan step')"
        " AND revision BETWEEN :low AND :high ORDER BY revision, sign DESC, kind, text"
    ).bindparams(*BOUNDS)
)
_HELD = [
    Query(
        text(
            f"SELECT text FROM {view} WHERE kb_id = :kb AND since < :low"
            f" AND COALESCE(until >= :low, TRUE){condition}"
        ).bindparams(BOUNDS[0])
    )
    for view, condition in (("audit_fact", " AND kind = 'fact'"), ("audit_value", ""))
]
_ACTS = Query(text("SELECT plan_id, position, text FROM execution WHERE kb_id = :kb"))


class Transition(NamedTuple):
    """An act that succeeded, and the states before and after it, as texts."""

    before: frozenset[str]
    act: str
    after: frozenset[str]


def export_trajectories(
    url: str,
    *,
    to: str | PathLike[str],
    knowledge_base: str | None = None,
    names: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    since: When | None = None,
    until: When | None = None,
    replace: bool = False,
    progress: Progress | None = None,
    clock: str = COMMITTED,
) -> Exported:
    """Write the executions that succeeded, each between the states before and after it.

    Each knowledge base has a folder with `domain.pddl`, `problem.pddl`, which has the objects, and
    `1.trajectory`, `2.trajectory` ...: another begins where something else changed the state
    meanwhile. What cannot be told apart is left out: executions during which others wrote facts or
    values, and several in one revision. So are acts that are no actions of the domain, and values
    that are no numbers.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        knowledge_base: the one whose executions they are; None for all of the store.
        names: must be None: states are whole.
        elements: must be None.
        since: only what began in this revision or at this aware time or later.
        until: only what ended up to this revision or time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the number of revisions done, and the number in total.
        clock: must be `committed`: it is of what was known and done.

    Returns:
        What was written; the rows of a trajectory are its executions.

    Raises:
        InvalidArgumentError: the folder has other files, or names or elements are given,
            or the clock is `valid`.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    if names is not None or elements is not None:
        raise InvalidArgumentError("a trajectory has whole states; leave names and elements out")
    refuse_valid_clock(clock, "a trajectory is")
    with new_export(url, FORMAT, to, knowledge_base, since, until, replace, progress) as export:
        for state, window in export.each():
            _write_documents(url, export.folder, state)
            transitions = _read_transitions(export.snapshot, state, window)
            for number, chain in enumerate(_chains(transitions), 1):
                path = f"{folder_name(state.name)}/{number}.{FORMAT}"
                with export.folder.new_file(path, state, "executions") as made:
                    for made.rows, line in enumerate(chain):
                        made.file.write(line.encode())
                    made.file.write(b")\n")
    return export.exported


def _write_documents(url: str, folder: Folder, state: KnowledgeBaseState) -> None:
    """Write the domain and the objects as they are at the end."""
    with kant_sql.connect(url, knowledge_base=state.name, read_only=True) as kb:
        past = kb.at(state.revision)
        for name, written in (("domain", past.domain_pddl()), ("problem", past.problem_pddl())):
            path = f"{folder_name(state.name)}/{name}.pddl"
            with folder.new_file(path, state, name) as made:
                made.file.write(written.encode())


def _chains(transitions: Iterable[Transition]) -> Iterator[Iterator[str]]:
    """Yield the lines of each trajectory: that of the first state, then one for each act.

    The lines are read before the next trajectory is asked for.
    """
    following: list[Transition] = []
    rest = iter(transitions)

    def lines(now: Transition | None) -> Iterator[str]:
        assert now is not None
        yield f"((:init {_state_text(now.before)})\n"
        while now is not None:
            yield f"(operator: {now.act})\n(:state {_state_text(now.after)})\n"
            then = next(rest, None)
            if then is not None and then.before != now.after:
                following.append(then)
                return
            now = then

    first = next(rest, None)
    while first is not None:
        yield lines(first)
        first = following.pop() if following else None


def _state_text(state: frozenset[str]) -> str:
    return " ".join(sorted(state))


def _read_transitions(
    snapshot: StoreSnapshot, state: KnowledgeBaseState, window: Window
) -> Iterator[Transition]:
    """Read the executions that succeeded, if nothing else can have changed the state meanwhile."""
    session, kb = snapshot.session, snapshot.ids[state.name]
    acts = {id_text((row[0], row[1])): row[2] for row in session.rows(_ACTS, kb=kb)}
    # Of what was before, a part may be in the archive.
    low = max(window[0], state.archived + 1)
    held = [row[0] for query in _HELD for row in session.rows(query, kb=kb, low=low)]
    now = frozenset(filter(_is_shown, held))
    # The states before those that run; None where others changed something since.
    running: dict[str, frozenset[str] | None] = {}
    changes = session.stream(_CHANGES, kb=kb, low=low, high=window[1])
    for _, group in groupby(changes, key=lambda row: row[0]):
        revision, before = _Changes([*group]), now
        now = (now - revision.facts["-"]) | revision.facts["+"]
        running |= dict.fromkeys(filter(revision.disturbs, running))
        for id_, outcome in revision.outcomes:
            begun = None if revision.disturbs(id_) else before
            if id_ in revision.ended:
                begun = running.pop(id_, None)
            if outcome == RUNNING:
                running[id_] = begun
            # A word that is no name of the domain is quoted.
            elif outcome == SUCCEEDED and begun is not None and '"' not in acts[id_]:
                yield Transition(begun, acts[id_], now)


class _Changes:
    """What one revision changed.

    Attributes:
        facts: the facts and values that it asserted and retracted, by sign.
        outcomes: the ids of executions, with the outcomes that it gave them.
        ended: the ids of executions that had an outcome before.
    """

    def __init__(self, rows: Iterable[Row]) -> None:
        self.facts: dict[str, set[str]] = {"+": set(), "-": set()}
        self.outcomes: list[tuple[str, str]] = []
        self.ended: set[str] = set()
        self._own: set[str] = set()
        for _, sign, kind, said, plan_id, position in rows:
            if plan_id is not None:
                self._own.add(id_text((plan_id, position)))
            if kind not in ("fact", "value"):
                told = read_outcome(said)
                self._own.add(told.id)
                if sign == "+":
                    self.outcomes.append((told.id, told.outcome))
                else:
                    self.ended.add(told.id)
            elif _is_shown(said):
                self.facts[sign].add(said)

    def disturbs(self, id_: str) -> bool:
        """Whether something else than an execution may have changed the state."""
        return any(self.facts.values()) and self._own != {id_}


def _is_shown(said: str) -> bool:
    """Whether learners read a fact or value: of values, numbers."""
    value = _VALUE.fullmatch(said)
    return value is None or NUMBER.fullmatch(value[1]) is not None
