"""State transitions of facts and values as MCAP, for Foxglove and the tools of rosbags.

A channel is a lane of a timeline: the `value` of a message is the state from then on. A fact with
at most one argument, or chosen with all its arguments, is true or false. Otherwise, a lane has all
arguments but the last, which is its value: `/tiago/fact/robot_at/rb1` is `wp1`, then `wp2`. The
value of a fluent is its number or its object. `/tiago/plan/steps` has the running steps, and
between them the outcome of the last one: `(move rb1 wp1 wp2)`, then `failed: (move rb1 wp1 wp2)`.

With the clock of valid times, facts and values change when the truth changes, as known now.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain, groupby
from operator import attrgetter, itemgetter
from os import PathLike
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from sqlalchemy import BigInteger, bindparam, text

from kant_sql.arguments import expect_list, shown
from kant_sql.dao.base import batches
from kant_sql.dao.interfaces import Progress
from kant_sql.dto.lexical import NUMBER, fold
from kant_sql.errors import (
    InvalidArgumentError,
    StoreIntegrityError,
    UnknownNameError,
    needing,
    reading_rows,
)
from kant_sql.export.files import Exported, encoded, folder_name, new_export
from kant_sql.export.snapshot import KnowledgeBaseState, StoreSnapshot, Window
from kant_sql.history.moments import MICROSECOND, is_valid_clock, just_before
from kant_sql.history.revisions import read_numbered
from kant_sql.knowledge.canonical import time_text
from kant_sql.knowledge.sayings import COMMITTED
from kant_sql.moment_text import When
from kant_sql.pddl.cursor import hint
from kant_sql.sql.audit_views import BOUNDS
from kant_sql.sql.dialects.base import Row, Session
from kant_sql.sql.executions import EXECUTION, PLAN_STEP, RUNNING, id_text, read_outcome
from kant_sql.sql.periods import Subjects, Touch, read_names
from kant_sql.sql.query import Query
from kant_sql.sql.valid_periods import Instant, ValidRange, read_valid

if TYPE_CHECKING:
    from mcap.writer import Writer

FORMAT = "mcap"
CONTENT = "transitions"
# MCAP numbers channels with 16 bits; a viewer with so many channels is useless.
MOST_CHANNELS = 10_000
# The number of changes of valid times whose names are read together.
PAGE = 1_000
# The last time that MCAP can express, in microseconds, in the year 2554.
_LAST_TIME = (2**64 - 1) // 1_000

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_VALUE = re.compile(r"\(= (\(.*\)) (\S+)\)")
# Foxglove allows only one type per property; unknown values are left out.
_COMMON = {
    "text": ("string", "what holds from then on, as PDDL; empty: nothing does"),
    "revision": ("integer", "the revision that made it so"),
    "actor": ("string", "who wrote it"),
    "reason": ("string", "why"),
    "source": ("string", "what the writer said of its source, as JSON"),
    "observed_at": ("string", "when it was sensed"),
    "committed_at": ("string", "when it was written"),
}
_VALUES = {
    "boolean": "whether it holds",
    "string": "the last argument, or the fluent's object, or a step; of several, all; empty: none",
    "number": "the fluent's number; missing: it has none",
}


def export_transitions(
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
    """Write state transitions of facts and values to MCAP files, one for each knowledge base.

    Messages are JSON with a JSON schema. Their log time and publish time are that of the
    observation, if the writer gave it, or else of the commit: a viewer uses one of them, and shows
    sensed facts beside the robot's own recording of that time.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        knowledge_base: the knowledge base; None for all of the store.
        names: the names of predicates and functions; None for all, unless elements are given.
        elements: facts and fluents, as `(robot_at rb1 wp1)` and `(battery rb1)`, each in a channel.
        since: begin with the state before this revision or aware time. A revision belongs to one
            knowledge base, which you must name. Archived versions are missing.
        until: end with this revision or aware time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the number of finished revisions, and their total.
        clock: `committed`, or `valid` for when facts and values were true, as known now: then
            messages, `since` and `until` have valid times, and a revision stands for the time of
            its commit. Steps of plans stay at their revisions.

    Returns:
        The written files.

    Raises:
        InvalidArgumentError: the folder has other files, an element is not a ground atom, there are
            more than 10,000 channels, there is no such clock, or the range ends before it begins.
        UnknownNameError: there never was such a predicate or function.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        ExtraMissingError: mcap is not installed; it comes with the extra `mcap`.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    chosen = _Chosen(names, elements)
    is_valid = is_valid_clock(clock)
    _import_mcap()
    given = to, knowledge_base, since, until, replace, progress, clock
    with new_export(url, FORMAT, *given) as export:
        snapshot, done = export.snapshot, 0
        rows, ids = snapshot.session.rows, snapshot.ids
        kb_ids = [ids[state.name] for state, _ in export.windows]
        chosen.check([row[0] for kb_id in kb_ids for row in rows(_NAMES, kb=kb_id)])
        for state, window in export.each():
            path = f"{folder_name(state.name)}/{CONTENT}.{FORMAT}"
            with export.folder.new_file(path, state, CONTENT) as made:
                recording = _Recording(made.file, state, chosen)
                span = snapshot.valid_range(state, since, until) if is_valid else None
                for revision in recording.run(snapshot, window, span):
                    export.tell(done + revision)
                made.rows = recording.messages
            done += state.revision
    return export.exported


def _import_mcap() -> Any:
    with needing("this needs mcap, which is not installed; run: pip install 'kant-sql[mcap]'"):
        import mcap.writer
    return mcap.writer


class _Chosen:
    """The choice of facts and fluents."""

    def __init__(self, names: object, elements: object) -> None:
        self._names = [] if names is None else expect_list(names, str, "the names")
        texts = [] if elements is None else expect_list(elements, str, "the elements")
        self._folded = {fold(name) for name in self._names}
        self._elements = {_folded_words(text): text for text in texts}
        self.is_all = names is None and elements is None  # whether all are, with steps of plans

    def check(self, every: list[str]) -> None:
        """Refuse names that no predicate and no function ever had."""
        folded = {fold(name) for name in every}
        for name in [*self._names, *(words[0] for words in self._elements)]:
            if fold(name) not in folded:
                raise UnknownNameError(
                    f"there never was a predicate or function {shown(name)}{hint(name, every)}"
                )

    def has(self, name: str) -> bool:
        """Whether facts or fluents with a name may be chosen."""
        key = fold(name)
        return (
            self.is_all or key in self._folded or any(key == words[0] for words in self._elements)
        )

    def lanes(self, kind: str, words: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield the type and the words of each lane that shows an atom."""
        is_element = bool(self._elements) and tuple(map(fold, words)) in self._elements
        is_named = self.is_all or fold(words[0]) in self._folded
        if kind == "value":
            if is_element or is_named:
                yield "", tuple(words)
            return
        if is_element or (is_named and len(words) < 3):
            yield "boolean", tuple(words)
        if is_named and len(words) > 2:
            yield "string", tuple(words[:-1])


def _folded_words(text: str) -> tuple[str, ...]:
    words = text.strip()
    inner = words[1:-1].split()
    if not (words[:1] == "(" and words[-1:] == ")") or not inner or set("()?") & set(words[1:-1]):
        raise InvalidArgumentError(
            f"{shown(text)} is not an element; give a fact or a fluent, as '(robot_at rb1 wp1)' or "
            "'(battery rb1)'"
        )
    return tuple(map(fold, inner))


class _Lane:
    """A channel and its present values."""

    def __init__(self, channel: int, type_: str) -> None:
        self.channel = channel  # its number
        self.type = type_  # the JSON type of its value
        self.holds: dict[str, str] = {}  # the present values, each with its text
        self.last: _AuditedChange | None = None  # the last change

    def take(self, change: _AuditedChange, value: str) -> None:
        """Apply a change."""
        if change.sign == "+":
            self.holds[value] = change.text
        else:
            self.holds.pop(value, None)
        self.last = change

    def message(self) -> dict[str, object]:
        """Write the values, and who made the last change."""
        assert self.last is not None
        change, values = self.last, sorted(self.holds)
        observed = None if change.observed_at is None else time_text(change.observed_at)
        said = {
            "value": self._value(values),
            "text": " ".join(self.holds[value] for value in values),
            "revision": change.revision,
            "actor": change.actor,
            "reason": change.reason,
            "source": change.source,
            "observed_at": observed,
            "committed_at": time_text(change.committed_at),
        }
        return {key: value for key, value in said.items() if value is not None}

    def _value(self, values: list[str]) -> bool | str | float | None:
        if self.type == "boolean":
            return bool(values)
        if self.type == "string":
            return ", ".join(values)
        number = float(values[-1]) if values else math.nan
        return number if math.isfinite(number) else None


class _Recording:
    """Writes the transitions of one knowledge base."""

    def __init__(self, file: BinaryIO, state: KnowledgeBaseState, chosen: _Chosen) -> None:
        self.messages = 0  # the number of messages
        self._state = state
        self._chosen = chosen
        self._writer: Writer = _import_mcap().Writer(file)
        self._schemas: dict[str, int] = {}
        self._lanes: dict[tuple[str, ...], _Lane] = {}
        self._steps: dict[str, str] = {}

    def run(
        self, snapshot: StoreSnapshot, window: Window, span: ValidRange | None
    ) -> Iterator[int]:
        """Write all; yield each finished revision. With valid times, steps come last."""
        session, state = snapshot.session, self._state
        kb_id = snapshot.ids[state.name]
        self._writer.start(library="kant_sql")
        facts = {key: str(value) for key, value in state._asdict().items()}
        self._writer.add_metadata("kant_sql", facts)
        if self._chosen.is_all:
            rows = session.rows(_STEP_TEXTS, kb=kb_id)
            self._steps = {id_text((row[0], row[1])): row[2] for row in rows}
        # A part of the earlier versions may be in the archive.
        low, high = max(window[0], state.archived + 1 if state.archived else 1), window[1]
        if span is not None:
            self._write_true(session, kb_id, span)
            low, high = span.before + 1, span.high
        before = session.first(_TIME_OF, kb=kb_id, revision=low - 1)
        if before is not None:
            queries = _STATE if span is None else _STATE[-1:]
            held = chain.from_iterable(session.stream(each, kb=kb_id, low=low) for each in queries)
            self._write(self._take_all(_audited(session, held)), session.to_time(before[0]))
        # Oldest first; within a revision, ended versions first.
        found = session.stream(_CHANGES[span is not None], kb=kb_id, low=low, high=high)
        changes = _audited(session, found)
        for revision, group in groupby(changes, key=attrgetter("revision")):
            self._write(self._take_all(group), None)
            yield revision
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _write_true(self, session: Session, kb_id: int, span: ValidRange) -> None:
        """Write what was true right before a range of times, and the changes in it."""
        names: dict[bool, dict[int, str]] = {
            is_fact: dict(session.rows(query, kb=kb_id)) for is_fact, query in _OWNERS.items()
        }
        wanted = [
            tuple(id_ for id_, name in of.items() if self._chosen.has(name))
            for of in names.values()
        ]
        which = Subjects(predicates=wanted[0], functions=wanted[1])
        state, changes = read_valid(session, kb_id, which, span)
        begin = Instant(just_before(span.since), span.before)
        touches = chain(((begin, touch) for touch in state), changes)
        said = chain.from_iterable(
            _told(session, kb_id, names, page) for page in batches(touches, PAGE)
        )
        for time, group in groupby(said, key=itemgetter(0)):
            self._write(self._take_all(change for _, change in group), time)

    def _take_all(self, changes: Iterable[_AuditedChange]) -> Iterable[_Lane]:
        """Apply changes; return the lanes that they change."""
        touched: dict[int, _Lane] = {}
        for change in changes:
            touched |= {lane.channel: lane for lane in self._take(change)}
        return touched.values()

    def _take(self, change: _AuditedChange) -> list[_Lane]:
        """Apply a change to its lanes."""
        if change.kind in (EXECUTION, PLAN_STEP):
            return self._take_step(change)
        value, words = _read(change)
        found = []
        for wanted, key in self._chosen.lanes(change.kind, words):
            type_ = wanted or ("number" if NUMBER.fullmatch(value) else "string")
            lane = self._lane(change.kind, type_, key)
            lane.take(change, value)
            found.append(lane)
        return found

    def _take_step(self, change: _AuditedChange) -> list[_Lane]:
        """Apply an outcome of a step: the last ended one stays until another starts."""
        if change.sign == "-" or not self._chosen.is_all:
            return []
        id_, act, status = read_outcome(change.text)
        action = act or self._steps.get(id_, change.text)
        lane = self._lane("plan", "string", ("steps",))
        running = {said: text for said, text in lane.holds.items() if said.startswith("(")}
        running.pop(action, None)
        if status == RUNNING:
            running[action] = change.text
        lane.holds = running or {f"{status}: {action}": change.text}
        lane.last = change
        return [lane]

    def _lane(self, kind: str, type_: str, words: tuple[str, ...]) -> _Lane:
        if (kind, type_, *words) not in self._lanes:
            self._lanes[kind, type_, *words] = self._new_lane(kind, type_, words)
        return self._lanes[kind, type_, *words]

    def _new_lane(self, kind: str, type_: str, words: tuple[str, ...]) -> _Lane:
        if len(self._lanes) >= MOST_CHANNELS:
            raise InvalidArgumentError(
                f"knowledge base {shown(self._state.name)} has more than {MOST_CHANNELS:,} facts "
                "and fluents to show; choose some by names, or elements"
            )
        if type_ not in self._schemas:
            self._schemas[type_] = self._writer.register_schema(
                f"kant_sql.{type_}", "jsonschema", json.dumps(_schema(type_)).encode()
            )
        topic = "/".join(encoded(part) for part in (self._state.name, kind, *words))
        metadata = {"knowledge_base": self._state.name, "kind": kind, "words": " ".join(words)}
        channel = self._writer.register_channel(f"/{topic}", "json", self._schemas[type_], metadata)
        return _Lane(channel, type_)

    def _write(self, lanes: Iterable[_Lane], moment: datetime | None) -> None:
        """Write the values of lanes; at a moment, or at their last changes."""
        for lane in lanes:
            change = lane.last
            assert change is not None
            elapsed = (moment or change.observed_at or change.committed_at) - _EPOCH
            at = min(max(0, elapsed // MICROSECOND), _LAST_TIME) * 1_000  # in nanoseconds
            self._writer.add_message(
                lane.channel,
                log_time=at,
                data=json.dumps(lane.message(), ensure_ascii=False).encode(),
                publish_time=at,
                sequence=change.revision & 0xFFFFFFFF,
            )
            self.messages += 1


def _read(change: _AuditedChange) -> tuple[str, list[str]]:
    """Return the value of a change, and the words of its fact or fluent."""
    found = _VALUE.fullmatch(change.text) if change.kind == "value" else None
    if found is not None:
        return found[2], found[1][1:-1].split()
    words = change.text[1:-1].split()
    if change.kind != "fact" or not words:
        raise StoreIntegrityError(
            f"revision {change.revision}: {shown(change.text)} is neither a fact nor a value; "
            "'kant-sql verify' shows what was changed by hand"
        )
    return words[-1], words


def _schema(type_: str) -> dict[str, object]:
    properties = {"value": (type_, _VALUES[type_]), **_COMMON}
    return {
        "title": f"kant_sql.{type_}",
        "type": "object",
        "properties": {
            name: {"type": kind, "description": said} for name, (kind, said) in properties.items()
        },
        "required": ["text", "revision"],
    }


# Queries on the audit.

_WHO = "committed_at, observed_at, actor, reason, source"
# By whether they only read steps.
_CHANGES = {
    of_steps: Query(
        text(
            f"SELECT revision, sign, kind, text, {_WHO} FROM audit_change"
            f" WHERE kb_id = :kb AND kind IN ({kinds}'execution', 'plan step')"
            " AND revision BETWEEN :low AND :high ORDER BY revision, sign DESC, kind, text"
        ).bindparams(*BOUNDS)
    )
    for of_steps, kinds in ((False, "'fact', 'value', "), (True, ""))
}
_BEFORE = (
    " LEFT JOIN audit_revision AS r ON r.kb_id = v.kb_id AND r.revision = v.since"
    " WHERE v.kb_id = :kb AND v.since < :low AND COALESCE(v.until >= :low, TRUE)"
)
_HELD = "v.text, v.since_at, v.since_observed_at, v.asserted_by, v.asserted_reason, r.source FROM"
_RAN = f"v.text, r.{', r.'.join(_WHO.split(', '))} FROM"
_STATE = tuple(
    Query(text(f"SELECT v.since, '+', {rows} ORDER BY v.since, v.text").bindparams(BOUNDS[0]))
    for rows in (
        f"v.kind, {_HELD} audit_fact AS v{_BEFORE} AND v.kind = 'fact'",
        f"'value', {_HELD} audit_value AS v{_BEFORE}",
        f"v.kind, {_RAN} execution_version AS v{_BEFORE} AND v.outcome = 'running'",
    )
)
_STEP_TEXTS = Query(
    text("SELECT plan_id, position, text FROM execution WHERE kb_id = :kb AND plan_id > 0")
)
_NAMES = Query(
    text(
        "SELECT DISTINCT name FROM audit_definition WHERE kb_id = :kb"
        " AND kind IN ('predicate', 'function') ORDER BY name"
    )
)
_OWNERS = {
    is_fact: Query(text(f"SELECT id, name FROM {owner} WHERE kb_id = :kb"))
    for is_fact, owner in ((True, "predicate"), (False, "function"))
}
# The time of a revision's observation, or else of its commit.
_TIME_OF = Query(
    text(
        "SELECT COALESCE(observed_at, committed_at) FROM audit_revision"
        " WHERE kb_id = :kb AND revision = :revision"
    ).bindparams(bindparam("revision", type_=BigInteger))
)


class _AuditedChange(NamedTuple):
    """A change of a fact or a value, with its revision; the source is JSON text."""

    revision: int
    sign: str
    kind: str
    text: str
    committed_at: datetime
    observed_at: datetime | None
    actor: str | None
    reason: str | None
    source: str | None


def _audited(session: Session, rows: Iterable[Row]) -> Iterator[_AuditedChange]:
    for row in rows:
        with reading_rows("audit_change", f"revision {row[0]!r}"):
            change = _AuditedChange._make(row)
            observed = change.observed_at and session.to_time(change.observed_at)
            committed = session.to_time(change.committed_at)
        yield change._replace(committed_at=committed, observed_at=observed)


# Reads of valid times.


def _told(
    session: Session,
    kb_id: int,
    names: Mapping[bool, Mapping[int, str]],
    page: Sequence[tuple[Instant, Touch]],
) -> Iterator[tuple[datetime, _AuditedChange]]:
    """Yield changes of the truth as texts, each with its time and its revision."""
    touches = [touch for _, touch in page]
    ids = {id_ for touch in touches for id_ in touch.objects}
    ids |= {touch.value for touch in touches if isinstance(touch.value, int)}
    objects = read_names(session, kb_id, sorted(ids))
    told = read_numbered(session, kb_id, {touch.revision for touch in touches})
    for (time, _), touch in page:
        words = names[touch.is_fact][touch.owner], *(objects[id_] for id_ in touch.objects)
        said, value, by = f"({' '.join(words)})", touch.value, told[touch.revision]
        if not touch.is_fact:
            said = f"(= {said} {objects[value] if isinstance(value, int) else value})"
        kind, sign = "fact" if touch.is_fact else "value", "-" if touch.is_end else "+"
        who = by.committed_at, by.observed_at, by.actor, by.reason, by.source_text
        yield time, _AuditedChange(by.number, sign, kind, said, *who)
