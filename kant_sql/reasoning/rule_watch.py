"""Watched rules: each verdict comes with the commit that decides it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from threading import Lock

from ..arguments import seconds
from ..dto import formulas as f
from ..history.follow import refuse_unwatchable, watch_until
from ..history.moments import find_bounds, head_revision, last_before
from ..knowledge.definitions import Definitions
from ..knowledge.symbols import symbols_of
from ..moment_text import When
from ..pddl.given import read_rules
from ..sql.dialects.base import Row, Session
from ..sql.periods import read_ends_of_rules, read_kept_rules
from ..store.snapshot import read_position, refuse_archived
from ..store.state import State
from ..store.store import Store
from .rules import (
    Judge,
    Rules,
    Verdict,
    Verdicts,
    conclude,
    judge_together,
    read_constraints,
    stand,
    verdicts,
)
from .sweep import Range, Sweep

_TEXT = re.compile(r"\(:rule (\S+) :on-violation \S+ (.*)\)", re.DOTALL)


def watch_rules(
    state: State,
    rules: Rules | None = None,
    *,
    after: When | None = None,
    since: When | None = None,
    timeout: float | None = None,
) -> Iterator[Verdict]:
    """Follow rules: each verdict comes with the commit that decides it.

    It is the verdict of `check_rules` up to that revision, but `pending` if a later one can fulfil
    the rule, such as `(sometime ...)` before it held. A violated rule stays violated. A rule is
    judged by each revision's changes, and none is left out: resume with `after`, as for `watch`.

    Args:
        rules: as for `check_rules`; None for the rules that the store keeps (`kb.rules`), each
            judged from the revision that saved it to the one that redefines or deletes it.
        after: only verdicts after this revision, given as for `kb.at`; None for the present head.
        since: the first revision to judge given rules by; None for the first of all.
        timeout: seconds to wait for each new revision before it ends; None for no limit.

    Returns:
        The changed verdicts, with the revision that decided each.

    Raises:
        PddlError, UnsupportedConstructError, SourceError, ArchivedError: as `check_rules`.
        UnknownRevisionError, ReadOnlyError, InvalidTimeoutError, StoreError: as `kb.watch`.

    Examples:
        >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
        >>> rule = "(at-most-one (?w - wp) (robot_at rb1 ?w))"
        >>> for verdict in kb.watch_rules(rule, after=0, timeout=0):
        ...     print(verdict.verdict, verdict.revision.number)
        kept 1
        violated 2
    """
    seconds(timeout)
    watcher = watcher_of(state, rules, after, since)

    def follow() -> Iterator[Verdict]:
        while (head := watch_until(state, watcher.last, timeout)) is not None:
            yield from watcher.follow(head)

    return follow()


@dataclass(frozen=True, eq=False)
class _Asked:
    """Rules to judge from a revision on, with the name if it is a kept rule."""

    low: int
    constraints: tuple[f.Formula, ...]
    definitions: Definitions
    name: str | None = None

    def judge(self, *, watches: bool) -> Judge:
        """Begin to judge."""
        return Judge(self.constraints, name=self.name, watches=watches)


class RuleWatcher:
    """Judges rules as revisions come: the given rules, or the kept ones."""

    def __init__(
        self, store: Store, last: int, rules: Rules | None = None, since: When | None = None
    ) -> None:
        """Begin after a revision."""
        self.last = last  # the last revision whose verdicts were returned
        self._store, self._rules = store, rules
        self._low = 1 if rules is None else find_bounds(State(store), since, None).low
        # The rules, by their rows if they are kept; given rules have an empty row.
        self._asked: dict[Row, _Asked] = {} if rules is None else self._read_given(rules)
        self._judges: dict[_Asked, Judge] = {}
        self._sweep: Sweep | None = None
        self._erased: int | None = 0  # the last erasure; 0 before the first look
        self._lock = Lock()

    def stand(self, state: State) -> Verdicts:
        """Judge the revisions up to a state; return the verdicts on all rules so far."""
        # Within a transaction, do not wait: the other thread may wait for its connection.
        if not self._lock.acquire(blocking=self._store.current() is None):
            return RuleWatcher(self._store, 0).stand(state)
        try:
            return self._stand(state)
        finally:
            self._lock.release()

    def _stand(self, state: State) -> Verdicts:
        # With the lock: a head read before it may be older than another thread's.
        head = head_revision(state)
        if head < self.last:
            # Somebody restored the store to an earlier state.
            self.last, self._judges, self._sweep = 0, {}, None
        self._judge(head)

        def work(session: Session, kb_id: int) -> list[Verdict]:
            return stand(session, kb_id, [*self._judges.values()])

        none: list[Verdict] = []
        return Verdicts(self._store.query_known(work, none), first=min(head, 1), last=head)

    def within(self, low: int, high: int) -> list[Verdict]:
        """Judge a whole range by the rules that are kept at its end, each since its last save."""
        judges = {one: one.judge(watches=False) for one in self._read_kept(high)}

        def work(session: Session, kb_id: int) -> list[Verdict]:
            archived = read_position(session, kb_id).archived
            _judge_upto(session, kb_id, judges, Range(low, high, archived), None)
            return conclude(session, kb_id, [*judges.values()])

        return self._store.query_known(work, [])

    def follow(self, head: int) -> list[Verdict]:
        """Judge the revisions up to a new head; return the verdicts that they decided."""
        # A rule that was deleted meanwhile is judged for as long as it was kept.
        read = partial(read_ends_of_rules, after=self.last + 1, high=head)
        ends: list[int] = self._store.query_known(read, []) if self._rules is None else []
        upto = [*(number - 1 for number in ends), head]
        return [verdict for high in upto for verdict in self._judge(high)]

    def _judge(self, head: int) -> list[Verdict]:
        """Judge the rules that are kept at a head, or the given ones."""
        self._heed()
        asked = [*self._asked.values()] if self._rules is not None else self._read_kept(head)

        def work(session: Session, kb_id: int) -> list[Verdict]:
            # After an error, the next call starts from the beginning.
            before, self._judges = self._judges, {}
            sweep, self._sweep = self._sweep, None
            archived = read_position(session, kb_id).archived
            judges = {one: before.get(one) or one.judge(watches=True) for one in asked}
            for high in (self.last, head):
                for judge in judges.values():
                    judge.take()
                sweep = _judge_upto(session, kb_id, judges, Range(1, high, archived), sweep)
            self._judges, self._sweep, self.last = judges, sweep, head
            found = verdicts(session, kb_id, {one: one.take() for one in judges.values()})
            return sorted(found, key=lambda one: one.revision.number if one.revision else 0)

        return self._store.query_known(work, [])

    def _heed(self) -> None:
        """Begin again after an erasure: what was read before has the erased names."""
        erased = self._store.query(read_position).erased
        if self._erased not in (0, erased):
            self._judges, self._sweep = {}, None
            self._asked = {} if self._rules is None else self._read_given(self._rules)
        self._erased = erased

    def _read_given(self, rules: Rules) -> dict[Row, _Asked]:
        return {(): _Asked(self._low, *read_constraints(self._store, rules, None))}

    def _read_kept(self, head: int) -> list[_Asked]:
        """Read the rules that are kept at a revision."""
        read = partial(read_kept_rules, at=head)
        found: list[Row] = self._store.query_known(read, [])
        rows = [tuple(row) for row in found]
        new = [row for row in rows if row not in self._asked]
        if new:
            # Their names are defined as long as they are kept.
            known = self._store.read_definitions(lambda known: known, head)
            self._asked |= {row: self._read(known, *row[1:]) for row in new}
        self._asked = {row: self._asked[row] for row in rows}
        return [*self._asked.values()]

    @staticmethod
    def _read(known: Definitions, since: int, text: str) -> _Asked:
        found = _TEXT.fullmatch(text)
        assert found is not None
        return _Asked(since, read_rules(found[2], symbols=symbols_of(known)), known, found[1])


def kept_within(state: State, low: int, high: int) -> list[Verdict]:
    """Judge a range by the rules that are kept at its end, each since its last save."""
    return RuleWatcher(state.store, 0).within(low, high)


def _judge_upto(
    session: Session, kb_id: int, judges: Mapping[_Asked, Judge], span: Range, before: Sweep | None
) -> Sweep | None:
    """Judge the revisions of a range that each judge has not seen, with shared statements."""
    low, high, archived = span
    begins = [
        (judge, max(low, one.low, judge.last + 1, archived if one.name else 0))
        for one, judge in judges.items()
    ]
    due = [(judge, low) for judge, low in begins if low <= high]
    if not due:
        return before
    begin = min(low for _, low in due)
    refuse_archived(session, kb_id, begin, archived)
    newest = max((one.definitions for one in judges), key=lambda each: each.revision or 0)
    return judge_together(session, kb_id, due, newest, Range(begin, high, archived), before)


def watcher_of(
    state: State, rules: Rules | None, after: When | None, since: When | None
) -> RuleWatcher:
    """Begin to watch rules."""
    refuse_unwatchable(state)
    begin = head_revision(state) if after is None else last_before(state, after)
    return RuleWatcher(state.store, begin, rules, since)


def standing(state: State) -> Verdicts:
    """Judge the rules that are kept, each from the revision that saved it.

    The next call continues from there: it reads the changes since.

    Returns:
        The verdicts so far: `kept`, `violated`, `pending` if a later revision can fulfil the
        rule, or `not judged`.

    Examples:
        >>> _ = kb.rules.save("away", "(sometime (not (robot_at rb1 wp1)))")
        >>> print(kb.rules.standing())
        (sometime (not (robot_at rb1 wp1))) is pending
    """
    store, at = state
    watcher = RuleWatcher(store, 0)
    if at is None:
        watcher = store.remembered.setdefault(RuleWatcher, watcher)
    return watcher.stand(state)
