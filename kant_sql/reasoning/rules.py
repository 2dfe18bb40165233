"""Rules about the past: trajectory constraints of PDDL 3.0, judged on the recorded history.

The states of a range of revisions are a trajectory, each state at the time of its revision, and the
first one at time 0. Only revisions that touch elements of the rules are judged, and those next to a
time in a rule: between them, no verdict can change.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
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
from .trajectory import Moment, Monitor, Rule, rules_of
from .valid_sweep import ValidPast, ValidSweep, check_range, instant_at, read_past
from .world import World


@dataclass(frozen=True)
class Verdict(html.OneRow):
    """Whether the recorded history keeps a rule.

    Attributes:
        rule: the rule as PDDL text, with objects for the variables of quantifiers around it.
        is_satisfied: whether it was judged, and is kept.
        is_preference: whether it is a preference.
        preference: the name of the preference; None for another rule, or without a name.
        revision: the first revision that violates it, with its actor, time and reason; None if none
            does. With `kb.watch_rules`, the revision that decided.
        time: its time in seconds from the first revision of the range; None without one.
        valid_at: on the clock of valid times, the time of the violation; then `revision` is the
            last one about that state, None if it is before the range.
        is_judged: whether some state of the range has all its names.
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
        """All verdicts: first the violated, pending and not judged ones."""
        return sorted(self, key=lambda one: WORDS.index(one.verdict))

    @property
    def violated_preferences(self) -> Mapping[str, int]:
        """How often each preference is violated; those without a name count as `anonymous`."""
        names = (one.preference or "anonymous" for one in self.violated if one.is_preference)
        return dict(Counter(names))

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the verdicts as dictionaries, for tables and JSON.

        Returns:
            For each verdict `rule`, `verdict`, `is_satisfied`, `is_preference`, `preference`, and
            of the first violation `revision`, `committed_at`, `observed_at`, `actor`, `reason`,
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
# In order, the worst first.
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
    satisfied. A quantifier around a rule makes one rule for each object, judged in the states
    that have the object.

    Args:
        rules: constraints and preferences: a path, PDDL text such as
            `(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))`, formulas, or None
            for those of the domain and the problem.
        since: the first revision, or the earliest time of commit; both inclusive.
        until: the last revision, or the latest time of commit; both inclusive.
        clock: `committed`, or `observed` for the times of observations, if given. A time before
            that of an earlier revision counts as that one. Or `valid` for the states that were
            true, as known in this state: then `since` and `until` are such times, and the states
            are those between them, from the first known one.

    Returns:
        The verdicts, in the order of the rules.

    Raises:
        PddlError: a rule is not well-formed, or no state had all the names in the rules.
        UnsupportedConstructError: PDDL 3.0 gives a rule no meaning, such as nested modalities.
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
        judge = Judge(constraints, clock)
        judge_together(session, kb_id, [(judge, span.low)], definitions, span)
        found = conclude(session, kb_id, [judge])
        return Verdicts(found, first=span.low, last=span.high)

    return store.query_in_snapshot(work)


def _check_valid(state: State, rules: Rules | None, span: ValidRange) -> Verdicts:
    past = read_past(state.store, span)
    constraints, _ = read_constraints(state.store, rules, state.at, past.definitions)

    def work(session: Session, kb_id: int | None) -> Verdicts:
        if kb_id is None or not span.known:
            return Verdicts([*_not_judged(constraints)], first=0, last=0)
        check_range(session, kb_id, span)
        judge = Judge(constraints, VALID)
        _judge_valid(session, kb_id, judge, past)
        first = min(span.before + 1, span.known)
        return Verdicts(conclude(session, kb_id, [judge]), first=first, last=span.known)

    return state.store.query_in_snapshot(work)


def read_constraints(
    store: Store, rules: Rules | None, upto: int | None, known: Definitions | None = None
) -> tuple[tuple[f.Formula, ...], Definitions]:
    """Read the given rules, with known or the latest names, or the rules of the store."""
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


class Decided(NamedTuple):
    """A verdict on a rule, and the state that decided it, if one did."""

    rule: Rule
    verdict: str
    revision: int | None = None  # 0 for the state before a range of valid times
    time: Decimal = Decimal(0)


def _verdict(rule: Rule) -> str:
    """Return the verdict on a rule if the last state is the end; `pending` if it is not."""
    if rule.violation is not None:
        return VIOLATED
    return PENDING if rule.is_open else KEPT


# The times of a revision: of its commit, and of its observation.
_Times = tuple[datetime, datetime | None]
_Key = tuple[int, str, tuple[tuple[str, str], ...]]


@dataclass(eq=False)
class Judge:
    """Judges constraints by the states that it sees; if it watches, it notes each new verdict."""

    constraints: Sequence[f.Formula]
    clock: str = COMMITTED
    name: str | None = None
    watches: bool = False

    def __post_init__(self) -> None:
        nodes = f.walk(*self.constraints)
        numbers = (number for one in nodes if isinstance(one, f.Modal) for number in one.numbers)
        self.bounds = sorted({number.value for number in numbers})  # the times in its rules
        self.last = 0  # the last judged revision; 0 before the first
        # The rules, each with the number of its constraint, and its own number.
        self._known: dict[_Key, tuple[tuple[int, int], Rule]] = {}
        # The constraints that have had a meaning in some world.
        self._meant: set[int] = set()
        # The rules that have a meaning in the present world, with their monitors.
        self._live: list[tuple[Rule, list[Monitor]]] = []
        self._conditions: Conditions | None = None
        # The judged revisions, by the index of their moments.
        self._judged = array("q")
        self._world: World | None = None
        self._first = self._low = 0
        self.begin_at: datetime | None = None  # when its trajectory begins
        self._now = Decimal(-1) if self.bounds else Decimal(0)
        # The verdict on each rule, and the changes of verdicts.
        self._words: dict[int, str | None] = {}
        self._decided: list[Decided] = []

    # States.

    def begin(self, low: int) -> None:
        """Begin a range; the next one continues where the last one ended."""
        self._first, self._low = self._first or low, low

    def reach(self, number: int, times: _Times, before: Visit | None) -> bool:
        """Go on to the time of a revision; return whether it is next to a time in a rule.

        If so, judge the state before, too.
        """
        moment = self._moment(*times)
        self.begin_at = self.begin_at or moment
        # Observations may come late; a trajectory does not go back.
        earlier, self._now = self._now, max(self._now, _seconds(self.begin_at, moment))
        passes = self._passes(earlier, self._now)
        seen = max(self._low - 1, self._judged[-1] if self._judged else 0)
        if passes and before is not None and seen < number - 1:
            self.judge(earlier, number - 1, before)
        return passes

    def see(self, number: int, visit: Visit) -> None:
        """Judge the state of a revision, at the present time of the trajectory."""
        self.judge(self._now, number, visit)

    def judge(self, time: Decimal, revision: int, visit: Visit) -> None:
        """Judge a state."""
        if visit.world is not self._world:
            self._world = visit.world
            self._enter(visit)
        self._observe(Moment(len(self._judged), time), revision)
        self._judged.append(revision)

    def conclude(self) -> None:
        """Judge the trajectory after its last state."""
        for _, rule in self._known.values():
            for monitor in rule.monitors:
                monitor.conclude()

    def _observe(self, now: Moment, revision: int) -> None:
        conditions = self._conditions
        assert conditions is not None
        for rule, monitors in self._live:
            for monitor in monitors:
                monitor.observe(now, conditions.holds)
            if not self.watches:
                continue
            verdict = _verdict(rule)
            if self._words.get(id(rule)) != verdict:
                self._words[id(rule)] = verdict
                self._decided.append(Decided(rule, verdict, revision, now.time))

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
                self._live.append((own, own.meet(rule)))

    def _passes(self, before: Decimal, time: Decimal) -> bool:
        """Return whether a time of a rule lies between two times, or at only one of them."""
        bounds = self.bounds
        reached = bisect_right(bounds, time) > bisect_right(bounds, before)
        return reached or bisect_left(bounds, time) > bisect_left(bounds, before)

    def _moment(self, committed: datetime, observed: datetime | None) -> datetime:
        return observed if self.clock == OBSERVED and observed is not None else committed

    # Verdicts.

    def take(self) -> list[Decided]:
        """Return the new verdicts since the last call."""
        found, self._decided = self._decided, []
        return found

    def so_far(self) -> list[Decided | Verdict]:
        """Return the verdicts so far, also on unjudged rules, in the order of the rules."""
        found: list[tuple[int, Decided | Verdict]] = []
        for (number, _), rule in sorted(self._known.values()):
            at, word = rule.violation, _verdict(rule)
            end = () if at is None else (self._judged[at.index], at.time)
            found.append((number, Decided(rule, word, *end)))
        for number, constraint in enumerate(self.constraints):
            if number not in self._meant:
                found += [(number, one) for one in _not_judged([constraint], self.name)]
        return [one for _, one in sorted(found, key=itemgetter(0))]

    def cited(self, found: Sequence[Decided | Verdict]) -> set[int]:
        """Return the revisions to read for verdicts."""
        numbers = {one.revision or 0 for one in found if isinstance(one, Decided)}
        return {self._first, *numbers} - {0} if numbers else set()

    def verdict(self, one: Decided, revisions: Mapping[int, Revision]) -> Verdict:
        """Make a verdict with the revisions that it cites."""
        rule, word, number, seconds = one
        time, valid_at = None if number is None else seconds, None
        # On the clock of valid times, no revision stated what was true before the range.
        revision = None if number is None else revisions.get(number)
        if number is not None and self.clock == VALID:
            assert self.begin_at is not None
            valid_at = self.begin_at + int(seconds * 1_000_000) * _MICROSECOND
        elif number is not None and not self.bounds:
            ends = (revisions[each] for each in (self._first, number))
            moments = [self._moment(each.committed_at, each.observed_at) for each in ends]
            time = max(Decimal(0), _seconds(*moments))
        own = (rule.is_soft, rule.preference, revision, time)
        rest: dict[str, Any] = {"is_pending": word == PENDING, "name": self.name}
        return Verdict(str(rule), word == KEPT, *own, **rest, valid_at=valid_at)


def conclude(session: Session, kb_id: int, judges: Sequence[Judge]) -> list[Verdict]:
    """Judge trajectories after their last states."""
    for judge in judges:
        judge.conclude()
    return stand(session, kb_id, judges)


def stand(session: Session, kb_id: int, judges: Sequence[Judge]) -> list[Verdict]:
    """Read the verdicts of judges so far, also on unjudged rules, in the order of the rules."""
    return verdicts(session, kb_id, {one: one.so_far() for one in judges})


def verdicts(
    session: Session, kb_id: int, decided: Mapping[Judge, Sequence[Decided | Verdict]]
) -> list[Verdict]:
    """Make the verdicts from the decisions of judges; read the revisions in one statement."""
    cited = {number for judge, own in decided.items() for number in judge.cited(own)}
    revisions = read_numbered(session, kb_id, cited)
    return [
        one if isinstance(one, Verdict) else judge.verdict(one, revisions)
        for judge, own in decided.items()
        for one in own
    ]


# The states of a range.


def judge_together(
    session: Session,
    kb_id: int,
    judges: Sequence[tuple[Judge, int]],
    definitions: Definitions,
    span: Range,
    before: Sweep | None = None,
) -> Sweep:
    """Judge the states of a range by several judges, each from its own first revision.

    They share the statements, whose number does not grow with the judges. It returns the sweep
    with which the next range begins.
    """
    formulas = [one for judge, _ in judges for one in judge.constraints]
    sweep = Sweep(session, kb_id, formulas, definitions, span, False, before)
    concerned = defaultdict[tuple[bool, int], list[Judge]](list)
    for judge, low in judges:
        judge.begin(low)
        for owner in sweep.owners_of(judge.constraints):
            concerned[owner].append(judge)
    begun: set[Judge] = set()
    present = sweep.begin()
    for number, times in _moments(session, kb_id, judges, span, sweep):
        due = {judge for judge, low in judges if low == number}
        begun |= due
        due |= {one for one in begun if times and one.bounds and one.reach(number, times, present)}
        if sweep.following == number:
            present = sweep.step()
            touched = (judge for owner in sweep.touched for judge in concerned[owner])
            due |= begun.intersection(begun if sweep.is_redefined else touched)
        if present is not None:
            for judge in begun if number == span.high else due:
                judge.see(number, present)
    for judge, _ in judges:
        judge.last = span.high
    return sweep


def _moments(
    session: Session, kb_id: int, judges: Sequence[tuple[Judge, int]], span: Range, sweep: Sweep
) -> Iterator[tuple[int, _Times | None]]:
    """Yield the revisions to judge: all, with their times, or the changes and the ends."""
    if any(judge.bounds for judge, _ in judges):
        for number, committed, observed in stream_times(session, kb_id, span.low, span.high):
            yield number, (committed, observed)
        return
    for end in sorted({*(low for _, low in judges), span.high}):
        while sweep.following is not None and sweep.following < end:
            yield sweep.following, None
        yield end, None


def _judge_valid(session: Session, kb_id: int, judge: Judge, past: ValidPast) -> None:
    """Judge the first valid time, each time of a change, and the last one."""
    span = past.span
    ends = read_numbered(session, kb_id, {1, span.known})
    sweep = ValidSweep(session, kb_id, judge.constraints, past, False)
    present = sweep.begin()
    begin, end = span.since, span.until
    if begin == FIRST_MOMENT:
        begin = min(ends[1].committed_at, sweep.next_time or LAST_MOMENT)
    if end == LAST_MOMENT:
        end = max(begin, ends[span.known].committed_at)
    judge.begin_at = begin
    time = begin
    if sweep.next_time != begin:
        judge.judge(Decimal(0), 0, present)
    while sweep.following is not None:
        time, revision = instant_at(sweep.following)
        present = sweep.step()
        # Of several states at one time, only the last counts.
        if sweep.next_time != time:
            judge.judge(_seconds(begin, time), revision, present)
    if time < end:
        judge.judge(_seconds(begin, end), span.known, present)


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
