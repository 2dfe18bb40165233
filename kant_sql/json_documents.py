"""Results of the library as JSON documents: what the command line writes and the web answers."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from typing import TYPE_CHECKING, Literal

from typing_extensions import TypedDict

from .knowledge.canonical import time_text

if TYPE_CHECKING:
    from datetime import datetime

    from .history.revisions import LogEntry, Revision
    from .history.verify.verify import Verification
    from .history.versions import Version
    from .planning import PlanStep
    from .plans.interfaces import RecordedPlan, RecordedStep
    from .reasoning.failures import FailedCondition
    from .reasoning.held import Held
    from .reasoning.verdicts import Verdict
    from .sql.changes import Change
    from .sql.inventory import Inventory


class PlanStepDocument(TypedDict):
    """The step of a recorded plan that was running."""

    plan: int
    position: int


class RevisionDocument(TypedDict):
    """A revision: who wrote, when and why. Times are in UTC, as 2026-03-02T14:03:00.000000Z."""

    number: int
    committed_at: str
    observed_at: str | None
    actor: str | None
    reason: str | None
    source: object
    plan_step: PlanStepDocument | None
    hash: str


class ChangeDocument(TypedDict):
    """An element that a revision asserted (`+`) or retracted (`-`)."""

    sign: str
    kind: str
    text: str


class LogEntryDocument(RevisionDocument):
    """A revision with its changes."""

    changes: list[ChangeDocument]


class VersionDocument(TypedDict):
    """An element from the revision that asserted it until the one that retracted it."""

    kind: str
    text: str
    since: RevisionDocument
    until: RevisionDocument | None


class StepDocument(TypedDict):
    """A step of a plan; `start` and `duration` are decimal seconds."""

    start: str | None
    action: str
    arguments: list[str]
    duration: str | None


class RecordedStepDocument(StepDocument):
    """A step of a recorded plan, with the revisions that were made while it ran."""

    position: int
    status: Literal["started", "succeeded", "failed", "aborted"] | None
    revisions: list[int]


class RecordedPlanDocument(TypedDict):
    """A recorded plan."""

    plan: int
    recorded_in: int
    revision: int
    problem_hash: str
    planner: str | None
    planner_version: str | None
    objective: str | None
    value: str | None
    status: str | None
    steps: list[RecordedStepDocument]


class FailedConditionDocument(TypedDict):
    """A condition that does not hold, and the revision that retracted it."""

    condition: str
    reason: str
    left: str | None
    right: str | None
    retracted: RevisionDocument | None


class HeldDocument(TypedDict):
    """A period in which a condition held; no `since` or `until` where the range cuts it off."""

    binding: dict[str, str]
    since: RevisionDocument | None
    until: RevisionDocument | None


class VerdictDocument(TypedDict):
    """Whether a rule is kept, and the revision that violates it."""

    rule: str
    verdict: str
    is_satisfied: bool
    is_preference: bool
    preference: str | None
    revision: RevisionDocument | None
    time: str | None


class FindingDocument(TypedDict):
    """Something that verification found."""

    revision: int | None
    table: str | None
    message: str


class VerificationDocument(TypedDict):
    """What was verified, and what is wrong."""

    knowledge_base: str
    revisions: int
    changes: int
    findings: list[FindingDocument]
    archives: list[str]
    anchored: int | None
    is_intact: bool
    continued_from: int | None
    continued_at: str | None
    complete_at: str | None
    is_kept: bool | None


class InventoryDocument(TypedDict):
    """A knowledge base: its head and who made it, what it has, its origin, how far it is verified.

    `goals` are atoms; `reached` says how many of them are facts, or is null where a goal is another
    condition or may follow from a rule. `has_more_facts` says that there are more facts than were
    counted. Of a replica, `behind` says how many revisions of its origin it lacks, and `lag` how
    much older its last one is, in seconds, as last heard of at `heard_at`. `error` says what is
    damaged of its name or its last revision, which is null then.
    """

    name: str
    revision: int | None
    committed_at: str | None
    actor: str | None
    reason: str | None
    source: object
    facts: int
    has_more_facts: bool
    goals: int
    reached: int | None
    origin: str | None
    origin_revision: int | None
    origin_committed_at: str | None
    heard_at: str | None
    behind: int | None
    lag: float | None
    verified_revision: int | None
    verified_at: str | None
    complete_at: str | None
    error: str | None


def inventory_document(one: Inventory) -> InventoryDocument:
    """Return what is in a knowledge base as JSON data."""
    return {
        "name": one.name,
        "revision": one.revision,
        "committed_at": _optional_time(one.committed_at),
        "actor": one.actor,
        "reason": one.reason,
        "source": one.source,
        "facts": one.facts,
        "has_more_facts": one.has_more_facts,
        "goals": one.goals,
        "reached": one.reached,
        "origin": one.origin,
        "origin_revision": one.origin_revision,
        "origin_committed_at": _optional_time(one.origin_committed_at),
        "heard_at": _optional_time(one.heard_at),
        "behind": one.behind,
        "lag": one.lag,
        "verified_revision": one.verified_revision,
        "verified_at": _optional_time(one.verified_at),
        "complete_at": _optional_time(one.complete_at),
        "error": one.error,
    }


def revision_document(revision: Revision) -> RevisionDocument:
    """Return a revision as JSON data."""
    step = revision.plan_step
    return {
        "number": revision.number,
        "committed_at": time_text(revision.committed_at),
        "observed_at": _optional_time(revision.observed_at),
        "actor": revision.actor,
        "reason": revision.reason,
        "source": revision.source,
        "plan_step": None if step is None else {"plan": step[0], "position": step[1]},
        "hash": revision.hash,
    }


def entry_document(entry: LogEntry) -> LogEntryDocument:
    """Return a revision with its changes as JSON data."""
    return {**revision_document(entry.revision), "changes": changes_document(entry.changes)}


def changes_document(changes: Iterable[Change]) -> list[ChangeDocument]:
    """Return changes as JSON data."""
    return [{"sign": sign, "kind": kind, "text": text} for sign, kind, text in changes]


def version_document(version: Version) -> VersionDocument:
    """Return a version as JSON data."""
    return {
        "kind": version.kind,
        "text": version.text,
        "since": revision_document(version.since),
        "until": _optional_revision(version.until),
    }


def step_document(step: PlanStep | RecordedStep) -> StepDocument:
    """Return a step as JSON data."""
    return {
        "start": _decimal(step.start),
        "action": step.action,
        "arguments": list(step.arguments),
        "duration": _decimal(step.duration),
    }


def recorded_step_document(step: RecordedStep) -> RecordedStepDocument:
    """Return a step of a recorded plan as JSON data."""
    return {
        "position": step.position,
        **step_document(step),
        "status": step.status,
        "revisions": list(step.revisions),
    }


def recorded_plan_document(plan: RecordedPlan) -> RecordedPlanDocument:
    """Return a recorded plan as JSON data."""
    return {
        "plan": plan.id,
        "recorded_in": plan.recorded_in,
        "revision": plan.revision,
        "problem_hash": plan.problem_hash,
        "planner": plan.planner,
        "planner_version": plan.planner_version,
        "objective": plan.objective,
        "value": _decimal(plan.value),
        "status": plan.status,
        "steps": [recorded_step_document(step) for step in plan.steps],
    }


def failed_document(part: FailedCondition) -> FailedConditionDocument:
    """Return what does not hold as JSON data."""
    return {
        "condition": part.text,
        "reason": part.reason,
        "left": _decimal(part.left),
        "right": _decimal(part.right),
        "retracted": _optional_revision(part.retracted),
    }


def held_document(held: Held) -> HeldDocument:
    """Return a period as JSON data."""
    return {
        "binding": dict(held.binding),
        "since": _optional_revision(held.since),
        "until": _optional_revision(held.until),
    }


def verdict_document(verdict: Verdict) -> VerdictDocument:
    """Return the verdict of a rule as JSON data."""
    return {
        "rule": verdict.text,
        "verdict": verdict.verdict,
        "is_satisfied": verdict.is_satisfied,
        "is_preference": verdict.is_preference,
        "preference": verdict.preference,
        "revision": _optional_revision(verdict.revision),
        "time": _decimal(verdict.time),
    }


def verification_document(verification: Verification) -> VerificationDocument:
    """Return the result of a verification as JSON data."""
    return {
        "knowledge_base": verification.knowledge_base,
        "revisions": verification.revisions,
        "changes": verification.changes,
        "findings": [
            {"revision": one.revision, "table": one.table, "message": one.message}
            for one in verification.findings
        ],
        "archives": list(verification.archives),
        "anchored": verification.anchored,
        "is_intact": verification.is_intact,
        "continued_from": verification.continued_from,
        "continued_at": _optional_time(verification.continued_at),
        "complete_at": _optional_time(verification.complete_at),
        "is_kept": verification.is_kept,
    }


def _optional_revision(revision: Revision | None) -> RevisionDocument | None:
    return None if revision is None else revision_document(revision)


def _optional_time(moment: datetime | None) -> str | None:
    return None if moment is None else time_text(moment)


def _decimal(number: Decimal | None) -> str | None:
    return None if number is None else f"{number:f}"
