"""The sections of a report: bounded, each with the number of omitted items."""

from __future__ import annotations

import shlex
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, Generic, NamedTuple, TypeVar

from ..acts import Execution
from ..dao.interfaces import Progress
from ..errors import StoreIntegrityError
from ..history.anchors import Anchor
from ..history.corrections import Correction
from ..history.drawing import Timeline, lane_key
from ..history.overview import ActorTally, Tally, read_tally
from ..history.revisions import LogEntry, Revision, Version
from ..history.verify.verify import Verification
from ..history.window import Bar, Lane
from ..knowledge.sayings import COMMITTED
from ..knowledge_base import KnowledgeBase, state_of
from ..moment_text import When
from ..plans import RecordedPlan
from ..reasoning import CauseLinks
from ..reasoning.failures import FailedCondition
from ..reasoning.rule_watch import kept_within
from ..reasoning.rules import Rules, Verdict, Verdicts

T = TypeVar("T")

# Lanes to examine, slices of their window, and the maximum of each section.
SEEN, SLICES = 200, 200
ACTORS, LANES, BARS, PLANS, STEPS, ACTS, RULES, GOALS, ENTRIES, CHANGES, FINDINGS = (
    20, 40, 300, 25, 100, 100, 200, 200, 300, 30, 200,
)  # fmt: skip
EFFECTS = 100
# For each fact: the depth of its consequences and origins, and their number.
DEPTH, LINKS = 5, 50
# Changes of all revisions together, of each an equal share.
SHOWN = 900


@dataclass(frozen=True)
class ReportSection:
    """A section: the omitted items, and the command that shows everything."""

    left_out: str | None
    command: str


@dataclass(frozen=True)
class ReportRows(ReportSection, Generic[T]):
    """A section that lists rows of one class."""

    rows: list[T]


@dataclass(frozen=True)
class ReportActs(ReportSection):
    """The acts, as of the end of the range."""

    acts: list[Execution]


class ReportCount(NamedTuple):
    """The number of changes of a kind."""

    kind: str
    asserted: int = 0
    retracted: int = 0


@dataclass(frozen=True)
class ReportSummary(ReportSection):
    """The subject of the report."""

    knowledge_base: str
    store: str
    made_at: datetime
    first: Revision | None
    last: Revision | None
    revisions: int
    changes: int
    actors: list[ActorTally]
    kinds: list[ReportCount]
    is_empty: bool


@dataclass(frozen=True)
class ReportStay:
    """When something held, and by whom."""

    _json_ = "kind", "text", "*bar"

    kind: str
    text: str
    bar: Bar


@dataclass(frozen=True)
class ReportStays(ReportSection):
    """The elements and their periods."""

    name: str
    stays: list[ReportStay]


@dataclass(frozen=True)
class ReportPlan:
    """A recorded plan, when and by whom it was recorded, and the number of omitted steps."""

    _json_ = "*plan", "recorded", "outcomes", "steps_left", "command"

    plan: RecordedPlan
    recorded: Revision | None
    outcomes: list[str]
    steps_left: int
    command: str


@dataclass(frozen=True)
class ReportRules(ReportSection):
    """The verdicts of rules, violations first."""

    verdicts: list[Verdict]
    violated: int
    not_judged: int
    count: int


@dataclass(frozen=True)
class ReportGoals(ReportSection):
    """The goals that are not reached."""

    revision: int
    goals: list[FailedCondition]
    count: int


@dataclass(frozen=True)
class ReportEffects(ReportSection):
    """The expected facts at the end of the range, and those contradicted within it."""

    unconfirmed: list[Version]
    contradicted: list[Version]


@dataclass(frozen=True)
class ReportEntry:
    """A revision, and the number of its omitted changes."""

    _json_ = "*entry", "changes_left", "command"

    entry: LogEntry
    changes_left: int
    command: str


@dataclass(frozen=True)
class ReportVerification(ReportSection):
    """The verdict of verification."""

    verification: Verification


@dataclass(frozen=True)
class ReportCauses(ReportSection):
    """The consequences and origins of a fact, as of the end of the range."""

    consequences: CauseLinks
    origins: CauseLinks


class ReportTimeline(NamedTuple):
    """A timeline of the lanes that changed most."""

    timeline: Timeline
    left: int  # the number of omitted lanes
    has_more: bool  # whether there are more lanes that were not examined


class ReportReader(NamedTuple):
    """Reads the sections of a report."""

    kb: KnowledgeBase
    # Its first and last revisions, or times of commit, as for `kb.log`, and the clock of timelines.
    range: tuple[When | None, When | None, str]
    tally: Tally  # the changes of its revisions

    @classmethod
    def of(
        cls, kb: KnowledgeBase, since: When | None, until: When | None, clock: str = COMMITTED
    ) -> ReportReader:
        """Find the range."""
        return cls(kb, (since, until, clock), read_tally(state_of(kb), since, until, ACTORS))

    @property
    def is_empty(self) -> bool:
        """Whether there is no revision in the range."""
        return self.tally.last < self.tally.first

    def command(self, *words: str) -> str:
        """Write the command that shows everything; the environment names the store."""
        return shlex.join(["kant-sql", *words, "--kb", self.kb.store.factory.name])

    def ranged(self, *words: str) -> str:
        """Write the command that shows everything in the range."""
        ends = ("--since", str(self.tally.first), "--until", str(self.tally.last))
        return self.command(*words, *ends)

    def summary(self) -> ReportSummary:
        """Summarize the report."""
        tally = self.tally
        kinds: dict[str, ReportCount] = {}
        for kind, sign, count in tally.changes:
            change: dict[str, Any] = {"asserted" if sign == "+" else "retracted": count}
            kinds[kind] = kinds.get(kind, ReportCount(kind))._replace(**change)
        left = tally.actors - sum(each.actor is not None for each in tally.busiest)
        archived = (
            f"versions that ended up to revision {tally.archived}, which are in an archive"
            if tally.archived >= tally.first and not self.is_empty
            else None
        )
        more = _left(left, "more actors with fewer revisions")
        left_out = "; ".join(filter(None, (more, archived))) or None
        return ReportSummary(
            left_out,
            self.ranged("log"),
            self.kb.store.factory.name,
            self.kb.store.factory.address,
            datetime.now(UTC),
            None if self.is_empty else self._revision(tally.first),
            None if self.is_empty else self._revision(tally.last),
            max(0, tally.last - tally.first + 1),
            sum(count for _, _, count in tally.changes),
            list(tally.busiest),
            list(kinds.values()),
            self.is_empty,
        )

    def _revision(self, number: int) -> Revision | None:
        try:
            found = self.kb.store.revisions(after=number - 1, limit=1)
        except StoreIntegrityError:
            # The log says so.
            return None
        return found[0] if found else None

    def timeline(self, name: str | None = None) -> ReportTimeline:
        """Read the timeline of the range, of all or of an object: the lanes that changed most."""
        since, until, clock = self.range
        shown: dict[str, Any] = {"object": name, "lanes": SEEN, "slices": SLICES, "clock": clock}
        found = self.kb.timeline(since, until=until, unchanged=name is not None, **shown)
        # Facts that may share a lane of the drawing stay together.
        activity: defaultdict[tuple[str, ...], tuple[int, int]] = defaultdict(lambda: (0, 0))
        for lane in found.lanes:
            before, own = activity[lane_key(lane)], _activity(lane, self.tally.first)
            activity[lane_key(lane)] = before[0] + own[0], max(before[1], own[1])
        busiest = sorted(activity, key=lambda key: activity[key], reverse=True)[:LANES]
        lanes = tuple(lane for lane in found.lanes if lane_key(lane) in busiest)
        left = len(found.lanes) - len(lanes)
        return ReportTimeline(replace(found, lanes=lanes), left, found.next is not None)

    def stays(self, shown: ReportTimeline, name: str = "") -> ReportStays:
        """List the versions of elements, oldest first."""
        timeline = shown.timeline
        found = [(bar.since_at, lane, bar) for lane in timeline.lanes for bar in lane.bars]
        found.sort(key=lambda one: one[0])
        dense = sum(density.count for lane in timeline.lanes for density in lane.densities)
        is_capped = any(each.is_capped for lane in timeline.lanes for each in lane.densities)
        left = max(0, len(found) - BARS) + dense
        said = []
        if left:
            said.append(f"{'more than ' * is_capped}{left:,} periods, the earlier or shorter ones")
        if shown.left:
            more = "more than " * shown.has_more
            said.append(f"{more}{shown.left:,} facts, goals and values that changed less")
        if timeline.folded:
            more = "at least " * timeline.has_more_folded
            said.append(f"{more}{timeline.folded:,} that never changed")
        words = ("--element", name) if name else ()
        left_out = " and ".join(said) or None
        stays = [_stay(lane, bar) for _, lane, bar in found[-BARS:]]
        return ReportStays(left_out, self.ranged("log", *words), name, stays)

    def plans(self, shown: ReportTimeline) -> ReportRows[ReportPlan]:
        """Read the plans that were made or carried out in the range, oldest first."""
        timeline = shown.timeline
        ids = [bar.id for bar in timeline.plans if bar.id is not None]
        left = max(0, len(ids) - PLANS)
        plans = [plan for id_ in ids[left:] if (plan := self.kb.plans.get(id_)) is not None]
        some = "earlier plans" if timeline.has_more_plans else None
        left_out = some or _left(left, "earlier plans")
        return ReportRows(left_out, self.command("plans"), [self._plan(plan) for plan in plans])

    def _plan(self, plan: RecordedPlan) -> ReportPlan:
        statuses = Counter(step.outcome or "not started" for step in plan.steps)
        return ReportPlan(
            replace(plan, steps=plan.steps[:STEPS]),
            self._revision(plan.recorded_in),
            [f"{count:,} {status}" for status, count in statuses.items()],
            max(0, len(plan.steps) - STEPS),
            self.command("plans", "--plan", str(plan.id)),
        )

    def acts(self) -> ReportActs:
        """Read the last acts that got their outcome in the range, oldest first."""
        then = self.kb.at(self.tally.last).executions
        found = [*then.get_all(since=self.tally.first, limit=ACTS + 1)]
        left_out = "earlier acts" if len(found) > ACTS else None
        return ReportActs(left_out, self.ranged("acts"), found[:ACTS][::-1])

    def rules(self, rules: Rules | None) -> ReportRules:
        """Judge the range by rules; by default those of the documents and the kept ones."""
        first, last = self.tally.first, self.tally.last
        found = [*self.kb.pddl.check_rules(rules, since=first, until=last)]
        if rules is None:
            found += kept_within(state_of(self.kb), first, last)
        verdicts = Verdicts(found, first=first, last=last)
        ordered = verdicts.worst_first
        command = self.ranged("rules", *(() if rules is None else ("RULES",)))
        return ReportRules(
            _left(len(ordered) - RULES, "more rules"),
            command,
            ordered[:RULES],
            len(verdicts.violated),
            len(verdicts.not_judged),
            len(verdicts),
        )

    def goals(self) -> ReportGoals:
        """Find the goals that were not reached at the end of the range."""
        last = self.tally.last
        found = self.kb.at(last).unsatisfied()
        left_out = _left(len(found) - GOALS, "more goals")
        command = self.command("goals", "--at", str(last))
        return ReportGoals(left_out, command, last, found[:GOALS], len(found))

    def effects(self) -> ReportEffects:
        """Read unconfirmed effects of acts, and contradicted ones."""
        first, last = self.tally.first, self.tally.last
        then = self.kb.at(last)
        lists = (
            then.unconfirmed(limit=EFFECTS + 1),
            then.contradicted(since=first, limit=EFFECTS + 1),
        )
        left_out = "more effects" if any(len(each) > EFFECTS for each in lists) else None
        command = self.command("unconfirmed", "--at", str(last))
        return ReportEffects(left_out, command, *(each[:EFFECTS] for each in lists))

    def corrections(self, shown: ReportTimeline) -> ReportRows[Correction]:
        """Find later corrections of beliefs about the range, up to now."""
        since, until = shown.timeline.since, shown.timeline.until
        found = self.kb.corrections(since=min(self.tally.first, self.kb.revision), limit=SEEN)
        own = [one for one in found if one.valid_until > since and one.valid_from <= until]
        left_out = "more corrections" if len(own) > EFFECTS or len(found) == SEEN else None
        command = self.command("corrections", "--since", str(self.tally.first))
        return ReportRows(left_out, command, own[:EFFECTS])

    def causes(self, fact: str) -> ReportCauses:
        """Find the consequences and origins of a fact."""
        then, how = self.kb.at(self.tally.last), {"depth": DEPTH, "limit": LINKS}
        found = then.consequences(fact, **how), then.origins(fact, **how)
        left_out = f"all but the nearest {LINKS} links" if any(f.has_more for f in found) else None
        command = self.command("consequences", fact, "--at", str(self.tally.last))
        return ReportCauses(left_out, command, *found)

    def log(self) -> ReportRows[ReportEntry]:
        """Read the last revisions of the range with their changes, oldest first."""
        first, last = self.tally.first, self.tally.last
        found = list(self.kb.log(first, until=last, limit=ENTRIES))[::-1]
        left_out = _left(last - first + 1 - len(found), "revisions", "the first ")
        share = max(1, min(CHANGES, SHOWN // max(1, len(found))))
        entries = [self._entry(one, share) for one in found]
        return ReportRows(left_out, self.ranged("log"), entries)

    def _entry(self, entry: LogEntry, share: int) -> ReportEntry:
        number = str(entry.revision.number)
        # Without the layout of an action's text.
        few = [one._replace(text=" ".join(one.text.split())) for one in entry.changes[:share]]
        return ReportEntry(
            replace(entry, changes=tuple(few)),
            max(0, len(entry.changes) - share),
            self.command("log", "--since", number, "--until", number),
        )

    def verify(self, anchor: Anchor | None, progress: Progress | None) -> ReportVerification:
        """Verify the whole knowledge base, and write its head for later verifications."""
        found = self.kb.store.verify(anchor, progress=progress)
        left_out = _left(len(found.findings) - FINDINGS, "more findings")
        some = replace(found, findings=found.findings[:FINDINGS])
        return ReportVerification(left_out, self.command("verify"), some)

    def anchor(self) -> str:
        """Write the anchor of this knowledge base alone."""
        made = self.kb.store.anchor()
        own = made.head(self.kb.store.factory.name)
        return made._replace(heads=() if own is None else (own,)).text()


def _activity(lane: Lane, first: int) -> tuple[int, int]:
    """Return how often and when last a lane changed in a range from a revision on."""
    ends = [end for bar in lane.bars for end in (bar.since, bar.until or 0) if end >= first]
    return len(ends) + sum(density.count for density in lane.densities), max(ends, default=0)


def _left(number: int, noun: str, which: str = "") -> str | None:
    """Write the number of omitted items; None if there are none."""
    return f"{which}{number:,} {noun}" if number > 0 else None


def _stay(lane: Lane, bar: Bar) -> ReportStay:
    text = lane.text if bar.value is None else f"(= {lane.text} {bar.value})"
    return ReportStay(lane.kind, text, bar)
