"""Rules about the past: trajectory constraints of PDDL 3.0, held against what was recorded.

The states of a range of revisions are a trajectory, each state at the time of its revision, and the
first one at time 0. Only revisions that touch what the rules mention are judged, and those next to
a time in a rule: between them, no verdict can change.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from decimal import Decimal
from operator import itemgetter
from typing import Any, NamedTuple

from .. import html
from ..arguments import one_of
from ..dao.formula import read_formula, read_formulas
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidKnowledgeError
from ..history.moments import VALID, find_bounds, find_valid_range
from ..history.revisions import FIRST_MOMENT, LAST_MOMENT, Revision, read_numbered
from ..knowledge.definitions import CONSTRAINT, DOMAIN_CONSTRAINT, Definitions
from ..knowledge.sayings import COMMITTED, OBSERVED
from ..knowledge.symbols import symbols_of
from ..moment_text import When
from ..pddl.given import read_rules
from ..pddl.lexer import STRING, Source, Text
from ..pddl.lexer import load as load_text
from ..sql.dialects.base import Session
from ..sql.periods import stream_times
from ..sql.valid_periods import ValidRange
from ..store.state import State
from ..store.store import Store
from .evaluate import Conditions
from .sweep import Range, Sweep, Visit, read_at_last, read_range, revision_text
from .trajectory import Moment, Rule, rules_of
from .valid_sweep import ValidPast, ValidSweep, check_range, instant_at, read_past


@dataclass(frozen=True)
class Verdict(html.OneRow):
    """Whether the recorded history keeps a rule.

    Attributes:
        rule: the rule as PDDL text, with objects for the variables of quantifiers around it.
        is_satisfied: whether it was judged, and is kept.
        is_preference: whether it is a preference.
        preference: the name of the preference; None for another rule, or without a name.
        revision: the first revision that violates it, with who made it, when and why; None if none
            does. With `kb.watch_rules`, the revision that decided.
        time: its time in seconds from the first revision of the range; None without one.
        valid_at: on the clock of valid times, the time of the violation; `revision` is the last
            one about that state, None if it is before the range.
        is_judged: whether some state of the range has its names.
        is_pending: whether it is violated unless a later revision fulfils it.
        name: the name of a kept rule.
    """

    _json_ = (
        *("rule", "verdict", "is_satisfied", "is_preference", "preference", "revision", "time"),
        *("valid_at", "name"),
    )

    rule: str
    is_satisfied: bool
    is_preference: bool = False
    preference: str | None = None
    revision: Revision | None = None
    time: Decimal | None = None
    is_judged: bool = True
    is_pending: bool = False
    name: str | None = None
    valid_at: datetime | None = None

    @property
    def verdict(self) -> str:
        """The verdict in words: `kept`, `violated`, `pending` or `not judged`."""
        if not self.is_judged:
            return "not judged"
        if self.is_pending:
            return "pending"
        return "kept" if self.is_satisfied else "violated"

    def _html_row_(self) -> html.Row:
        revision = self.revision
        return {
            "name": self.name,
            "rule": self.rule,
            "verdict": self.verdict,
            "preference": self.preference or ("without a name" if self.is_preference else None),
            "revision": None if revision is None else revision.number,
            "committed at": None if revision is None else revision.committed_at,
            "actor": None if revision is None else revision.actor,
            "reason": None if revision is None else revision.reason,
            "source": None if revision is None else revision.source_text,
        }

    def __str__(self) -> str:
        if not self.is_judged:
            return f"{self.rule} is not judged: no state of the range has all its names"
        said = f"{self.rule} is {self.verdict}"
        if self.valid_at is not None:
            said += f" at {self.valid_at.isoformat(timespec='seconds')}"
        since = "" if self.revision is None else f" in revision {revision_text(self.revision)}"
        return f"{said}{since}"


class Verdicts(html.Listing[Verdict]):
    """The verdicts of rules, in the order of the rules.

    Attributes:
        first: the first revision of the range; 0 in an empty range.
        last: the last one.
    """

    def __init__(self, verdicts: Iterable[Verdict], *, first: int, last: int) -> None:
        super().__init__(verdicts, "verdict")
        self.first = first
        self.last = last

    @property
    def is_satisfied(self) -> bool:
        """Whether all rules were judged and are kept; preferences do not count."""
        return all(one.is_satisfied or one.is_preference for one in self)

    @property
    def violated(self) -> list[Verdict]:
        """The rules and preferences that are violated."""
        return [one for one in self if one.verdict == VIOLATED]

    @property
    def not_judged(self) -> list[Verdict]:
        """The rules and preferences whose names had no meaning in the range."""
        return [one for one in self if not one.is_judged]

    @property
    def worst_first(self) -> list[Verdict]:
        """All of them: first those that are violated, pending, or not judged."""
        return sorted(self, key=lambda one: WORDS.index(one.verdict))

    @property
    def violated_preferences(self) -> Mapping[str, int]:
        """How often each preference is violated; those without a name count as `anonymous`."""
        names = (one.preference or "anonymous" for one in self.violated if one.is_preference)
        return dict(Counter(names))

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the verdicts as dictionaries, for tables and JSON.

        Returns:
            For each one `rule`, `verdict`, `is_satisfied`, `is_preference`, `preference`, and of
            the first violation `revision`, `committed_at`, `observed_at`, `actor`, `reason`,
            `source`, `time` and `valid_at`; None without one.
        """
        own = "rule", "verdict", "is_satisfied", "is_preference", "preference"
        ends = "committed_at", "observed_at", "actor", "reason", "source"
        return [
            {
                **{name: getattr(one, name) for name in own},
                "revision": None if one.revision is None else one.revision.number,
                **{name: getattr(one.revision, name, None) for name in ends},
                "time": one.time,
                "valid_at": one.valid_at,
            }
            for one in self
        ]

    def __str__(self) -> str:
        return "\n".join(map(str, self)) or "there are no rules"

    def __repr__(self) -> str:
        return f"<{len(self)} verdicts, {len(self.violated)} of violations>"

    def _repr_html_(self) -> str:
        return html.listing(self.worst_first, "verdict")


Rules = Source | f.Formula | Sequence[f.Formula | str]
KEPT, VIOLATED, PENDING = "kept", "violated", "pending"
# The worst first.
WORDS = (VIOLATED, PENDING, "not judged", KEPT)
_MICROSECOND = timedelta(microseconds=1)


def check_rules(
    state: State,
    rules: Rules | None = None,
    *,
    since: When | None = None,
    until: When | None = None,
    clock: str = "committed",
) -> Verdicts:
    """Judge the recorded history by trajectory constraints of PDDL 3.0.

    The states of the range are the trajectory: each one at the time of its revision, in seconds
    from the first revision of the range, whose state is the initial one. The semantics is that
    of Gerevini, Haslum, Long, Saetti and Dimopoulos (Artificial Intelligence 173, 2009).
    A rule is judged in the states that have its names; without any, it is not judged, and not
    satisfied. A quantifier around a rule makes one rule for each object, which is judged in the
    states that have the object.

    Args:
        rules: constraints and preferences: a path, PDDL text such as
            `(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))`, formulas, or None
            for those of the domain and the problem.
        since: the first revision, or the earliest time of commit; both inclusive.
        until: the last revision, or the latest time of commit; both inclusive.
        clock: `committed`, or `observed` for the times of observations, if they are given. A time
            before that of an earlier revision counts as that one. Or `valid` for the states that
            were true, as known in this state: then `since` and `until` are such times, and the
            states are those between them, from the first known one.

    Returns:
        The verdicts, in the order of the rules.

    Raises:
        PddlError: a rule is not well-formed, or no state had all the names in the rules.
        UnsupportedConstructError: PDDL 3.0 gives a rule no meaning, as to nested modalities.
        SourceError: the file cannot be read.
        InvalidArgumentError: there is no such clock.
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        ArchivedError: a part of the range was moved to an archive.

    Examples:
        >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
        >>> for verdict in kb.pddl.check_rules("(always (not (robot_at rb1 wp2)))"):
        ...     print(verdict.is_satisfied, verdict.revision.number, verdict.revision.actor)
        False 2 perception
    """
    store, upto = state
    if one_of(clock, (COMMITTED, OBSERVED, VALID), "the clock") == VALID:
        return _check_valid(state, rules, find_valid_range(state, since, until))
    bounds = find_bounds(state, since, until)
    constraints, definitions = read_constraints(store, rules, upto)

    def work(session: Session, kb_id: int | None) -> Verdicts:
        if kb_id is None or bounds.high < bounds.low:
            return Verdicts([*_not_judged(constraints)], first=0, last=0)
        span = read_range(session, kb_id, bounds)
        judge = Judge(kb_id, constraints, definitions, clock)
        judge.follow(session, span)
        return Verdicts(judge.conclude(session), first=span.low, last=span.high)

    return store.query_in_snapshot(work)


def _check_valid(state: State, rules: Rules | None, span: ValidRange) -> Verdicts:
    past = read_past(state.store, span)
    constraints, _ = read_constraints(state.store, rules, state.at, past.definitions)

    def work(session: Session, kb_id: int | None) -> Verdicts:
        if kb_id is None or not span.known:
            return Verdicts([*_not_judged(constraints)], first=0, last=0)
        check_range(session, kb_id, span)
        judge = Judge(kb_id, constraints, past.definitions, VALID)
        judge.follow_valid(session, past)
        first = min(span.before + 1, span.known)
        return Verdicts(judge.conclude(session), first=first, last=span.known)

    return state.store.query_in_snapshot(work)


def read_constraints(
    store: Store, rules: Rules | None, upto: int | None, known: Definitions | None = None
) -> tuple[tuple[f.Formula, ...], Definitions]:
    """Read the rules: those that are given, with known or the latest names, or the store's."""
    if rules is None:
        definitions = store.read_definitions(lambda known: known, upto)
        own = [
            read_formula(definitions, each)
            for section in (DOMAIN_CONSTRAINT, CONSTRAINT)
            for each in read_formulas(definitions, section)
        ]
        return tuple(own), definitions  # type: ignore[arg-type]
    if isinstance(rules, f.Node):
        text = Text(STRING, whole=str(rules))
    elif isinstance(rules, Sequence) and not isinstance(rules, str):
        text = Text(STRING, whole="\n".join(map(str, rules)))
    else:
        text = load_text(rules)
    if known is not None:
        return read_rules(text, symbols=symbols_of(known)), known
    return read_at_last(store, text.code, lambda symbols: read_rules(text, symbols=symbols), upto)


class _Decided(NamedTuple):
    """A verdict on a rule that a state decided; without a word, the verdict so far."""

    rule: Rule
    moment: Moment | None
    verdict: str | None = None


def _verdict(rule: Rule, last: Moment) -> str:
    """Return the verdict on a rule if the last state is the end; `pending` if it is not."""
    if rule.violation is not None:
        return VIOLATED
    return PENDING if rule.is_open(last) else KEPT


_Key = tuple[int, str, tuple[tuple[str, str], ...]]


@dataclass(eq=False)
class Judge:
    """Judges constraints by the states of a range."""

    kb_id: int
    constraints: Sequence[f.Formula]
    definitions: Definitions
    clock: str = COMMITTED
    name: str | None = None
    watches: bool = False

    def __post_init__(self) -> None:
        nodes = f.walk(*self.constraints)
        numbers = (number for one in nodes if isinstance(one, f.Modal) for number in one.numbers)
        self._bounds = sorted({number.value for number in numbers})
        # The rules, each with the order of its constraint, and its own.
        self._known: dict[_Key, tuple[tuple[int, int], Rule]] = {}
        # The constraints that had a meaning in some world.
        self._meant: set[int] = set()
        # The rules that have a meaning in the present world.
        self._live: list[Rule] = []
        self._last: dict[int, Moment] = {}
        self._conditions: Conditions | None = None
        # The revisions that were judged, by the index of their moments.
        self._judged = array("q")
        self._sweep: Sweep | None = None
        self._visit: Visit | None = None
        self._first: int = 0
        self._begin: datetime | None = None
        self._before = Decimal(-1)
        # The verdict on each rule, and when another one came.
        self._verdict: dict[int, str | None] = {}
        self._decided: list[_Decided] = []

    @property
    def last(self) -> int:
        """The last revision that was judged; 0 before the first."""
        return self._range.high if self._first else 0

    def follow(self, session: Session, span: Range) -> None:
        """Judge the states of a range; another one begins where the last one ended."""
        self._session, self._range = session, span
        self._first = self._first or span.low
        self._judge(self._moments())

    def follow_valid(self, session: Session, past: ValidPast) -> None:
        """Judge the states of a range of valid times."""
        self._session = session
        self._judge(self._valid_moments(past))

    def _judge(self, moments: Iterable[tuple[Decimal, int, Visit]]) -> None:
        for time, revision, following in moments:
            visit = self._visit
            if following is not visit:
                if visit is None or following.world is not visit.world:
                    self._enter(following)
                self._visit = following
            self._observe(Moment(len(self._judged), time))
            self._judged.append(revision)

    def conclude(self, session: Session) -> list[Verdict]:
        """Judge the trajectory after its last state."""
        for _, rule in self._known.values():
            for monitor in rule.monitors:
                monitor.conclude(self._last[id(rule)])
        return self.standing(session)

    @property
    def cited(self) -> set[int]:
        """The revisions that are read for the verdicts so far."""
        found = (rule.violation for _, rule in self._known.values())
        return {self._first, *(self._judged[one.index] for one in found if one is not None)}

    def standing(
        self, session: Session, revisions: Mapping[int, Revision] | None = None
    ) -> list[Verdict]:
        """Return the verdicts so far, in the order of the rules; `revisions` has those cited."""
        self._session = session
        rules = sorted(self._known.values())
        decided = [_Decided(rule, rule.violation) for _, rule in rules]
        verdicts = self._verdicts(decided, revisions)
        found = [(order[0], verdict) for (order, _), verdict in zip(rules, verdicts, strict=True)]
        for number, constraint in enumerate(self.constraints):
            if number not in self._meant:
                found += [(number, verdict) for verdict in _not_judged([constraint], self.name)]
        return [verdict for _, verdict in sorted(found, key=itemgetter(0))]

    def decided(self) -> list[Verdict]:
        """Return the verdicts that came since the last call."""
        found, self._decided = self._decided, []
        return self._verdicts(found)

    def _observe(self, now: Moment) -> None:
        conditions = self._conditions
        assert conditions is not None
        for rule in self._live:
            self._last[id(rule)] = now
            for monitor in rule.monitors:
                monitor.observe(now, conditions.holds)
            verdict = _verdict(rule, now) if self.watches else None
            if self._verdict.get(id(rule)) != verdict:
                self._verdict[id(rule)] = verdict
                self._decided.append(_Decided(rule, now, verdict))

    def _enter(self, visit: Visit) -> None:
        """Find the rules that have a meaning in a world; those for new objects begin here."""
        world = visit.world
        self._conditions = Conditions(world)
        self._live = []
        symbols = symbols_of(visit.definitions)
        for number, constraint in enumerate(self.constraints):
            try:
                read = read_rules(str(constraint), symbols=symbols)
            except InvalidKnowledgeError:
                continue
            self._meant.add(number)
            for rule in (rule for one in read for rule in rules_of(one, world.range_of)):
                binding = tuple(sorted((fold(name), one) for name, one in rule.binding.items()))
                key = number, fold(str(rule.formula)), binding
                _, own = self._known.setdefault(key, ((number, len(self._known)), rule))
                self._live.append(own)

    # Moments.

    def _moments(self) -> Iterator[tuple[Decimal, int, Visit]]:
        """Yield the time and the number of each revision to judge, and its state."""
        session, kb_id, span = self._session, self.kb_id, self._range
        known = self.constraints, self.definitions
        sweep = self._sweep = Sweep(session, kb_id, *known, span, False, self._sweep)
        return self._timed(sweep) if self._bounds else self._untimed(sweep)

    def _untimed(self, sweep: Sweep) -> Iterator[tuple[Decimal, int, Visit]]:
        """Yield the first revision, those that touch what the rules mention, and the last one."""
        present, revision = sweep.begin(), self._range.low
        if present is not None and sweep.following != revision:
            yield Decimal(0), revision, present
        while sweep.following is not None:
            present = sweep.step()
            revision = present.revision
            yield Decimal(0), revision, present
        if present is not None and revision != self._range.high:
            yield Decimal(0), self._range.high, present

    def _timed(self, sweep: Sweep) -> Iterator[tuple[Decimal, int, Visit]]:
        """Yield those revisions, and those on both sides of the times of rules."""
        session, kb_id, (low, high, _) = self._session, self.kb_id, self._range
        present = sweep.begin()
        yielded = low - 1
        for number, committed, observed in stream_times(session, kb_id, low, high):
            moment = self._moment(committed, observed)
            self._begin = self._begin or moment
            # Observations may come late; a trajectory does not go back.
            before, time = self._before, max(self._before, _seconds(self._begin, moment))
            passes = self._passes(before, time)
            if passes and present is not None and yielded < number - 1:
                yield before, number - 1, present
            is_next = sweep.following == number
            if is_next:
                present = sweep.step()
            if present is not None and (passes or is_next or number in (low, high)):
                yielded = number
                yield time, number, present
            self._before = time

    def _valid_moments(self, past: ValidPast) -> Iterator[tuple[Decimal, int, Visit]]:
        """Yield the first time, those at which something changes, and the last one."""
        session, span = self._session, past.span
        ends = read_numbered(session, self.kb_id, {1, span.known})
        sweep = ValidSweep(session, self.kb_id, self.constraints, past, False)
        present = sweep.begin()
        begin, end = span.since, span.until
        if begin == FIRST_MOMENT:
            begin = min(ends[1].committed_at, sweep.next_time or LAST_MOMENT)
        if end == LAST_MOMENT:
            end = max(begin, ends[span.known].committed_at)
        self._begin = time = begin
        if sweep.next_time != begin:
            yield Decimal(0), 0, present
        while sweep.following is not None:
            time, revision = instant_at(sweep.following)
            present = sweep.step()
            # The last state of a time stays.
            if sweep.next_time != time:
                yield _seconds(begin, time), revision, present
        if time < end:
            yield _seconds(begin, end), span.known, present

    def _passes(self, before: Decimal, time: Decimal) -> bool:
        """Return whether a time of a rule lies between two times, or at one of them alone."""
        bounds = self._bounds
        reached = bisect_right(bounds, time) > bisect_right(bounds, before)
        return reached or bisect_left(bounds, time) > bisect_left(bounds, before)

    def _moment(self, committed: datetime, observed: datetime | None) -> datetime:
        return observed if self.clock == OBSERVED and observed is not None else committed

    # Verdicts.

    def _verdicts(
        self, found: Sequence[_Decided], revisions: Mapping[int, Revision] | None = None
    ) -> list[Verdict]:
        if not found:
            return []
        if revisions is None:
            numbers = {self._judged[one.moment.index] for one in found if one.moment is not None}
            numbers = {self._first, *numbers} - {0}
            revisions = read_numbered(self._session, self.kb_id, numbers)
        is_valid = self.clock == VALID
        verdicts = []
        for rule, moment, said in found:
            revision, time, valid_at = None, None, None
            if moment is not None:
                # On the clock of valid times, none has said what was so before the range.
                revision = revisions.get(self._judged[moment.index])
                time = moment.time
                if not self._bounds and not is_valid:
                    time = self._since(
                        revisions[self._first], revisions[self._judged[moment.index]]
                    )
                if is_valid and self._begin is not None:
                    valid_at = self._begin + int(time * 1_000_000) * _MICROSECOND
            word = said or _verdict(rule, self._last[id(rule)])
            own = (rule.is_soft, rule.preference, revision, time)
            rest: dict[str, Any] = {"is_pending": word == PENDING, "name": self.name}
            verdicts.append(Verdict(str(rule), word == KEPT, *own, **rest, valid_at=valid_at))
        return verdicts

    def _since(self, begin: Revision, revision: Revision) -> Decimal:
        moments = [self._moment(one.committed_at, one.observed_at) for one in (begin, revision)]
        return max(Decimal(0), _seconds(*moments))


def _not_judged(
    constraints: Iterable[f.Formula], rule_name: str | None = None
) -> Iterator[Verdict]:
    """Yield the verdicts on constraints whose names no state has."""
    for constraint in constraints:
        if isinstance(constraint, f.And):
            yield from _not_judged(constraint.formulas, rule_name)
            continue
        inner: f.Formula = constraint
        while isinstance(inner, f.Forall):
            inner = inner.formula
        name = inner.name if isinstance(inner, f.Preference) else None
        is_soft = isinstance(inner, f.Preference)
        yield Verdict(str(constraint), False, is_soft, name, is_judged=False, name=rule_name)


def _seconds(first: datetime, moment: datetime) -> Decimal:
    return Decimal((moment - first) // _MICROSECOND) / 1_000_000
