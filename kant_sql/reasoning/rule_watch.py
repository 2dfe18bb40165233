"""Rules that watch: a verdict comes with the commit that decides it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from threading import Lock

from ..arguments import seconds
from ..dto import formulas as f
from ..history.follow import refuse_unwatchable, watch_until
from ..history.moments import find_bounds, head_revision, last_before
from ..history.revisions import read_numbered
from ..knowledge.definitions import Definitions
from ..moment_text import When
from ..sql.dialects.base import Row, Session
from ..sql.periods import read_ends_of_rules, read_kept_rules
from ..store.snapshot import read_position, refuse_archived
from ..store.state import State
from ..store.store import Store
from .rules import Judge, Rules, Verdict, Verdicts, read_constraints
from .sweep import Range

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

    It is what `check_rules` would say if that revision were the last, but `pending` where a later
    one can make it good, as `(sometime ...)` before it held. What is violated stays so. No revision
    is left out: resume with `after`, as of `watch`. A rule is judged by what each revision changes.

    Args:
        rules: as for `check_rules`; None for those that are kept in the store (`kb.rules`), each
            judged from the revision that saved it to the one that redefines or deletes it.
        after: only verdicts after this revision, given as for `kb.at`; None for the present head.
        since: the first revision by which given rules are judged; None for the first of all.
        timeout: seconds to wait for each new revision, then it ends; None to wait without limit.

    Returns:
        The verdicts that are others than before, with the revision that decided each.

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
    """Rules that are judged from a revision on; the name of one that is kept."""

    low: int
    constraints: tuple[f.Formula, ...]
    definitions: Definitions
    name: str | None = None


class RuleWatcher:
    """Judges rules as revisions come: those that are given, or those that are kept."""

    def __init__(
        self, store: Store, last: int, rules: Rules | None = None, since: When | None = None
    ) -> None:
        """Begin after a revision."""
        self.last = last  # the last revision whose verdicts were returned
        self._store = store
        self._given: list[_Asked] | None = None
        if rules is not None:
            low = find_bounds(State(store), since, None).low
            self._given = [_Asked(low, *read_constraints(store, rules, None))]
        self._kept: dict[Row, _Asked] = {}
        self._judges: dict[_Asked, Judge] = {}
        self._lock = Lock()

    def stand(self, head: int) -> list[Verdict]:
        """Judge the revisions up to a head; return the verdicts on all rules so far."""
        with self._lock:
            if head < self.last:
                # The store was put back to an earlier state.
                self.last, self._judges = 0, {}
            self._judge(head)

            def work(session: Session, kb_id: int | None) -> list[Verdict]:
                judges = self._judges.values()
                cited = {number for one in judges for number in one.cited}
                # Of all at once, so that statements do not grow with rules.
                revisions = {} if kb_id is None else read_numbered(session, kb_id, cited)
                return [each for one in judges for each in one.standing(session, revisions)]

            return self._store.query_in_snapshot(work)

    def follow(self, head: int) -> list[Verdict]:
        """Judge the revisions up to a new head; return the verdicts that they decided."""
        # A rule that is gone by then is judged for as long as it was kept.
        read = partial(read_ends_of_rules, after=self.last + 1, high=head)
        ends: list[int] = [] if self._given is not None else self._store.query_known(read, [])
        upto = [*(number - 1 for number in ends), head]
        return [verdict for high in upto for verdict in self._judge(high)]

    def _judge(self, head: int) -> list[Verdict]:
        """Judge the rules that are kept at a head, or that are given."""
        asked = self._read_kept(head) if self._given is None else self._given

        def work(session: Session, kb_id: int | None) -> list[Verdict]:
            # After an error it starts from the beginning.
            before, self._judges = self._judges, {}
            judges: dict[_Asked, Judge] = {}
            found: list[Verdict] = []
            if kb_id is None:
                return []
            archived = read_position(session, kb_id).archived
            for one in asked:
                known = one.constraints, one.definitions
                judge = before.get(one) or Judge(kb_id, *known, name=one.name, watches=True)
                judges[one] = judge
                for high in (self.last, head):
                    judge.decided()
                    low = max(one.low, judge.last + 1, archived if one.name else 0)
                    if low <= high:
                        refuse_archived(session, kb_id, low, archived)
                        judge.follow(session, Range(low, high, archived))
                found += judge.decided()
            self._judges, self.last = judges, head
            return sorted(found, key=lambda one: one.revision.number if one.revision else 0)

        return self._store.query_in_snapshot(work)

    def _read_kept(self, head: int) -> list[_Asked]:
        """Read the rules that are kept at a revision."""
        rows: list[Row] = self._store.query_known(partial(read_kept_rules, at=head), [])
        before, self._kept = self._kept, {}
        for row in map(tuple, rows):
            self._kept[row] = before.get(row) or self._read(head, *row[1:])
        return [*self._kept.values()]

    def _read(self, head: int, since: int, text: str) -> _Asked:
        found = _TEXT.fullmatch(text)
        assert found is not None
        return _Asked(since, *read_constraints(self._store, found[2], head), found[1])


def watcher_of(
    state: State, rules: Rules | None, after: When | None, since: When | None
) -> RuleWatcher:
    """Begin to watch rules."""
    refuse_unwatchable(state)
    begin = head_revision(state) if after is None else last_before(state, after)
    return RuleWatcher(state.store, begin, rules, since)


def standing(state: State) -> Verdicts:
    """Judge the rules that are kept, each from the revision that saved it.

    The next call goes on from there: it reads what changed since.

    Returns:
        The verdicts so far: `kept`, `violated`, `pending` where a later revision can make it good,
        or `not judged`.

    Examples:
        >>> _ = kb.rules.save("away", "(sometime (not (robot_at rb1 wp1)))")
        >>> print(kb.rules.standing())
        (sometime (not (robot_at rb1 wp1))) is pending
    """
    store, at = state
    head = head_revision(state)
    watcher = RuleWatcher(store, 0)
    if at is None:
        watcher = store.remembered.setdefault(RuleWatcher, watcher)
    return Verdicts(watcher.stand(head), first=min(head, 1), last=head)
