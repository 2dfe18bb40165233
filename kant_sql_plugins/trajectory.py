"""Executions as trajectories, for programs that learn action models.

The format is that of SAM learners (Juba, Le and Stern, Safe Learning of Lifted Action Models, 2021)
and of the package `pddl-plus-parser`: `((:init FACT ...) (operator: (ACT)) (:state FACT ...) ...)`.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, groupby, islice
from operator import itemgetter
from os import PathLike
from typing import Any, NamedTuple

from sqlalchemy import text

import kant_sql
from kant_sql.dao.interfaces import Progress
from kant_sql.dto.elements import value_text
from kant_sql.dto.lexical import NUMBER
from kant_sql.errors import InvalidArgumentError
from kant_sql.export.files import Exported, Folder, folder_name, new_export
from kant_sql.export.snapshot import KnowledgeBaseState, Window
from kant_sql.history.moments import is_valid_clock
from kant_sql.history.revisions import LARGEST, read_numbered
from kant_sql.knowledge.sayings import COMMITTED
from kant_sql.knowledge_base import KnowledgeBase, state_of
from kant_sql.moment_text import When
from kant_sql.reasoning.valid_sweep import ValidPast, read_past
from kant_sql.reasoning.world import World
from kant_sql.sql.audit_views import BOUNDS
from kant_sql.sql.dialects.base import Row, Session
from kant_sql.sql.executions import EXECUTION, RUNNING, SUCCEEDED, id_text, read_outcome
from kant_sql.sql.periods import Subjects, Touch
from kant_sql.sql.query import Query
from kant_sql.sql.rows import FACT
from kant_sql.sql.valid_periods import Instant

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
# For the clock of valid times: the times of acts, and the revisions that belong to one act.
_DONE = Query(
    text(
        "SELECT plan_id, position, text, started_at, ended_at FROM audit_execution"
        f" WHERE kb_id = :kb AND outcome = '{SUCCEEDED}' ORDER BY plan_id, position"
    )
)
_OF_ONE = Query(
    text(
        "SELECT number, min(plan_id), min(position) FROM ("
        "SELECT number, plan_id, position FROM revision_execution WHERE kb_id = :kb"
        " UNION SELECT since, plan_id, position FROM execution_version WHERE kb_id = :kb"
        ") AS own GROUP BY number HAVING count(*) = 1"
    )
)


class Transition(NamedTuple):
    """A successful act, and the states before and after it, as texts."""

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
    """Write the successful executions, each between the states before and after it.

    Each knowledge base has a folder with `domain.pddl`, `problem.pddl`, which has the objects, and
    `1.trajectory`, `2.trajectory` ...: a new one begins where something else changed the state.
    Ambiguous executions are left out: those during which others wrote facts or values, and several
    in one revision. So are acts that are not actions of the domain, and values that are not
    numbers.

    With the clock of valid times, acts are at their reported beginnings and ends, and states are
    what was true then, as known now. Left out are executions during which other statements made
    something true or untrue, and those before the first revision and all periods.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        knowledge_base: the knowledge base; None for all of the store.
        names: must be None: states are whole.
        elements: must be None.
        since: only executions that began in this revision or at this aware time, or later.
        until: only executions that ended up to this revision or time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the number of finished revisions, and their total.
        clock: `committed`, or `valid` for what was true: then `since` and `until` are valid times,
            and a revision stands for the time of its commit.

    Returns:
        The written files; the rows of a trajectory are its executions.

    Raises:
        InvalidArgumentError: the folder has other files, names or elements are given, there is no
            such clock, or the range ends before it begins.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    if names is not None or elements is not None:
        raise InvalidArgumentError("a trajectory has whole states; leave names and elements out")
    is_valid = is_valid_clock(clock)
    given = to, knowledge_base, since, until, replace, progress, clock
    with new_export(url, FORMAT, *given) as export:
        snapshot = export.snapshot
        for state, window in export.each():
            session, kb_id = snapshot.session, snapshot.ids[state.name]
            with kant_sql.connect(url, knowledge_base=state.name, read_only=True) as kb:
                _write_documents(kb, export.folder, state)
                if is_valid:
                    span = snapshot.valid_range(state, since, until)
                    found = _read_true(session, kb_id, read_past(state_of(kb).store, span))
                else:
                    found = _read_known(session, kb_id, state, window)
            acts = {id_text((row[0], row[1])): row[2] for row in session.rows(_ACTS, kb=kb_id)}
            transitions = _transitions(acts, *found)
            for number, lines in enumerate(_chains(transitions), 1):
                path = f"{folder_name(state.name)}/{number}.{FORMAT}"
                with export.folder.new_file(path, state, "executions") as made:
                    for made.rows, line in enumerate(lines):
                        made.file.write(line.encode())
                    made.file.write(b")\n")
    return export.exported


def _write_documents(kb: KnowledgeBase, folder: Folder, state: KnowledgeBaseState) -> None:
    """Write the domain and the objects at the end."""
    past = kb.at(state.revision)
    for name, written in (("domain", past.domain_pddl()), ("problem", past.problem_pddl())):
        path = f"{folder_name(state.name)}/{name}.pddl"
        with folder.new_file(path, state, name) as made:
            made.file.write(written.encode())


def _chains(transitions: Iterable[Transition]) -> Iterator[Iterator[str]]:
    """Yield the lines of each trajectory: one for the first state, then one for each act.

    Read the lines before you take the next trajectory.
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


def _read_known(
    session: Session, kb: int, state: KnowledgeBaseState, window: Window
) -> tuple[Iterable[str], Iterable[Row]]:
    """Read the facts and values before a range of revisions, and the changes in it."""
    # A part of the earlier ones may be in the archive.
    low = max(window[0], state.archived + 1)
    held = [row[0] for query in _HELD for row in session.rows(query, kb=kb, low=low)]
    return held, session.stream(_CHANGES, kb=kb, low=low, high=window[1])


def _read_true(
    session: Session, kb: int, past: ValidPast
) -> tuple[Iterable[str], Iterable[tuple[Any, ...]]]:
    """Read what was true right before a range of times, and the changes in it, as `_CHANGES`."""
    defined = past.definitions
    owners = [tuple([one.id for one in of]) for of in (defined.predicates, defined.functions)]
    held, changes = past.read(session, kb, Subjects(predicates=owners[0], functions=owners[1]))
    ahead = [*islice(changes, 1)]
    # Nothing is known before this.
    first = min([read_numbered(session, kb, [1])[1].committed_at, *(at.time for at, _ in ahead)])
    begin, end = max(past.span.since, first), past.span.until
    acts: list[tuple[Any, ...]] = []
    for plan_id, position, act, *times in session.rows(_DONE, kb=kb):
        began, ended = map(session.to_time, times)
        # At one time, acts begin before all changes, and end after them.
        for at, number, sign, outcome in (
            (began, 0, "+", RUNNING),
            (ended, LARGEST, "-", RUNNING),
            (ended, LARGEST, "+", SUCCEEDED),
        ):
            if begin <= at <= end:
                said = f"(:execution {id_text((plan_id, position))} {act} {outcome})"
                acts.append((Instant(at, number), sign, EXECUTION, said, None, None))
    own = {row[0]: row[1:] for row in session.rows(_OF_ONE, kb=kb)}
    write, by = partial(_text, World(defined)), itemgetter(0)
    facts = (
        (at, "-" if one.is_end else "+", FACT, write(one), *own.get(at.revision, (None, None)))
        for at, one in chain(ahead, changes)
    )
    return map(write, held), heapq.merge(sorted(acts, key=by), facts, key=by)


def _text(world: World, touch: Touch) -> str:
    said, value = world.text((touch.is_fact, touch.owner), touch.objects), touch.value
    (shown,) = world.names([value]) if isinstance(value, int) else (value,)
    return said if touch.is_fact else value_text(said, str(shown))


def _transitions(
    acts: Mapping[str, str], held: Iterable[str], changes: Iterable[Row]
) -> Iterator[Transition]:
    """Return the successful executions during which nothing else can have changed the state.

    The changes are grouped by revision, or by revision at each time.
    """
    now = frozenset(filter(_is_shown, held))
    # The states before running executions; None if others have changed something since.
    running: dict[str, frozenset[str] | None] = {}
    for _, group in groupby(changes, key=itemgetter(0)):
        revision, before = _Changes([*group]), now
        now = (now - revision.facts["-"]) | revision.facts["+"]
        running |= dict.fromkeys(filter(revision.disturbs, running))
        for id_, outcome in revision.outcomes:
            begun = None if revision.disturbs(id_) else before
            if id_ in revision.ended:
                begun = running.pop(id_, None)
            if outcome == RUNNING:
                running[id_] = begun
            # A name that is not in the domain is quoted.
            elif outcome == SUCCEEDED and begun is not None and '"' not in acts[id_]:
                yield Transition(begun, acts[id_], now)


class _Changes:
    """The changes of one revision.

    Attributes:
        facts: the asserted and retracted facts and values, by sign.
        outcomes: the ids of executions, with their new outcomes.
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
        """Whether anything but this execution may have changed the state."""
        return any(self.facts.values()) and self._own != {id_}


def _is_shown(said: str) -> bool:
    """Whether learners read a fact or value: only numeric values."""
    value = _VALUE.fullmatch(said)
    return value is None or NUMBER.fullmatch(value[1]) is not None
