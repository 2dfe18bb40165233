"""Knowledge bases, the heads that writers lock, revisions, plans, executions and other records."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import (
    CheckConstraint,
    ForeignKeyConstraint,
    Index,
    Integer,
    String,
    UniqueConstraint,
    text,
)

from .base import (
    AT_COMMIT,
    REVISION,
    Base,
    CanonicalJson,
    ShortText,
    VersionRow,
    column,
    kb_column,
    key_column,
    optional,
    owner_column,
    partial_index,
    position_column,
    reference,
    version_args,
)

_GIVEN = "what the planner was given, if it is not what the store writes"


class Record:
    """A record about an earlier revision."""

    kb_id = kb_column()
    id = owner_column()
    since = column(int, order=-80, comment="recorded in this revision")
    text = column(str, order=10, comment="all of it in canonical form")


def record_args(table: str, about: str) -> tuple[Any, ...]:
    """Return the constraints and indexes of a table of records."""
    return (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        ForeignKeyConstraint(["kb_id", "revision"], REVISION, name=f"fk_{table}_{about}"),
        Index(f"ix_{table}_since", "kb_id", "since"),
        Index(f"ix_{table}_revision", "kb_id", "revision"),
    )


def _to_execution() -> ForeignKeyConstraint:
    key = ("kb_id", "plan_id", "position")
    return ForeignKeyConstraint(key, [f"execution.{column}" for column in key])


class PlanRow(Record, Base):
    """A plan, which never changes."""

    __tablename__ = "plan"
    __table_args__ = record_args("plan", "problem")

    revision = column(int, comment="the state that it was planned from")
    problem_hash = column(
        str, comment="SHA-256 of the domain and then the problem that the planner was given"
    )
    planner = optional(str)
    planner_version = optional(str)
    objective = optional(str, comment="what the plan is to make small or large")
    value = optional(str, comment="what the objective comes to, as exact decimal text")
    status = optional(str, comment="what the planner says of it")
    domain_pddl = optional(str, comment=_GIVEN)
    problem_pddl = optional(str, comment=_GIVEN)


class ExecutionRow(Base):
    """A step of a plan, or an act without a plan."""

    __tablename__ = "execution"
    __has_rowid__ = False
    # No reference from `since`: that of its first version, or of its plan, is the same, and another
    # index would be a tenth of the cost of an act.
    __table_args__ = (
        reference("action_id", "action"),
        CheckConstraint("(action_id IS NULL) <> (name IS NULL)", name="action_or_name"),
        Index("ix_execution_action", "kb_id", "action_id"),
        partial_index("ix_execution_name", "kb_id", "name", where="name IS NOT NULL"),
    )

    kb_id = kb_column()
    plan_id = key_column(-90, "0: it is of no plan")
    position = position_column(comment="of a step: from 0; of no plan: the id")
    since = column(int, comment="recorded in this revision, with its plan if it has one")
    start = optional(str, comment="seconds from the plan's beginning, as exact decimal text")
    duration = optional(
        str, comment="seconds, as exact decimal text; NULL: an instant, or not known"
    )
    action_id = optional(int, comment="NULL: it is no action of the domain")
    name = optional(str, comment="what it is called that is no action of the domain")
    text = column(str, comment="action and arguments, without times; what is no PDDL is quoted")


class ExecutionArgumentRow(Base):
    """An argument of an execution's action."""

    __tablename__ = "execution_argument"
    __has_rowid__ = False
    __table_args__ = (
        _to_execution(),
        reference("object_id", "object"),
        CheckConstraint("(object_id IS NULL) <> (value IS NULL)", name="object_or_value"),
        Index("ix_execution_argument_object", "kb_id", "object_id"),
    )

    kb_id = kb_column()
    plan_id = owner_column()
    position = position_column(comment=None)
    argument = position_column(-50)
    object_id = optional(int, comment="NULL: it is no object of the knowledge base")
    value = optional(str, comment="what was said instead of an object")


class ExecutionVersionRow(VersionRow, Base):
    """An interval in which an execution had one outcome; a step without a row was not started."""

    __tablename__ = "execution_version"
    __has_rowid__ = False
    __table_args__ = (
        _to_execution(),
        *version_args("execution_version", "plan_id", "position", live=None),
        CheckConstraint(
            "outcome IN ('running', 'succeeded', 'failed', 'aborted', 'refused')", name="outcome"
        ),
        CheckConstraint("kind IN ('execution', 'plan step')", name="kind"),
        partial_index(
            "ix_execution_version_running",
            *("kb_id", "outcome", "plan_id", "position", "until"),
            where="until IS NULL AND outcome = 'running'",
        ),
    )

    plan_id = owner_column()
    position = position_column(-85, None)
    kind = column(str, String(16), comment="execution; plan step: written before version 0008")
    outcome = column(str, String(16), comment="running, succeeded, failed, aborted or refused")
    code = optional(str, comment="of a failure")
    message = optional(str, comment="what is said of a failure, or did not hold")
    started_at = optional(datetime, comment="UTC; NULL: when the revision was committed")
    ended_at = optional(datetime, comment="UTC; NULL: when the revision was committed")
    text = column(str, comment="which execution it is, and its outcome")


class RevisionExecutionRow(Base):
    """The running execution that the writer of a revision named."""

    __tablename__ = "revision_execution"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        _to_execution(),
        Index("ix_revision_execution_execution", "kb_id", "plan_id", "position", "number"),
    )

    kb_id = kb_column()
    number = key_column(-90, "the revision")
    plan_id = column(int)
    position = column(int, Integer)


class KnowledgeBaseRow(Base):
    """The identity of a knowledge base: one robot's, or one mission's."""

    __tablename__ = "knowledge_base"
    __table_args__ = (UniqueConstraint("name"),)

    id = key_column(0)
    name = column(str, ShortText)


class HeadRow(Base):
    """The head of a knowledge base. Writers lock this row, so it is separate from the identity."""

    __tablename__ = "head"
    __table_args__ = (ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),)

    kb_id = kb_column()
    revision = column(int, comment="the last revision; 0: none yet")
    definition_revision = column(
        int, comment="the last revision that changed anything but propositions"
    )
    next_id = column(int, comment="the id that the next element gets")
    hash = optional(str, comment="of the last revision")
    committed_at = optional(datetime, comment="of the last revision")
    archived_revision = column(
        int,
        server_default=text("0"),
        comment="what ended up to this revision is in an archive; 0: nothing is",
    )
    origin = optional(
        str,
        comment="the store that it is replicated from: a URL without its password; "
        "NULL: written here",
    )
    origin_revision = optional(int, comment="the origin's last revision, as last heard of")
    origin_committed_at = optional(datetime, comment="UTC, of the origin's last revision")
    heard_at = optional(datetime, comment="UTC, when the origin was last heard of")


# The numbers of a head before the first revision. The other columns are NULL.
EMPTY_HEAD = {"revision": 0, "definition_revision": 0, "next_id": 1, "archived_revision": 0}


class RevisionRow(Base):
    """Who changed the knowledge base, when and why; `docs/hash.md` specifies `hash`."""

    __tablename__ = "revision"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        CheckConstraint("number > 0", name="number_positive"),
        Index("ix_revision_committed_at", "kb_id", "committed_at"),
    )

    kb_id = kb_column()
    number = key_column(-90, "1, 2, 3 ... without gaps")
    committed_at = column(datetime, comment="UTC, never going back")
    actor = optional(str, comment="the component that wrote")
    reason = optional(str)
    source = optional(str, CanonicalJson, comment="what the caller knows: sensor, plan step ...")
    form = column(int, Integer, comment="version of the form that was hashed")
    hash = column(str, comment="SHA-256, chained to the revision before")
    observed_at = optional(datetime, comment="UTC, when what it says was sensed; NULL: not said")
    seed = optional(
        bytes,
        order=10,
        comment="16 random bytes that the salts of its texts are made of; NULL: form 1, or erased",
    )


class RequestRow(Base):
    """A request over HTTP that made a revision: a repetition gets the same answer."""

    __tablename__ = "request"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        Index("ix_request_number", "kb_id", "number"),
    )

    kb_id = kb_column()
    key = column(
        str,
        order=-90,
        primary_key=True,
        comment="SHA-256 of the token's id and of the key that the client chose",
    )
    number = column(int, comment="the revision that it made")
    digest = column(str, comment="SHA-256 of the client's key and request")
    results = column(str, comment="what its changes returned, as JSON: no names")


class ArchiveRow(Record, Base):
    """A move of closed versions into another store."""

    __tablename__ = "archive"
    __table_args__ = record_args("archive", "upto")

    revision = column(int, comment="the versions that ended up to this revision were moved")
    target = column(str, comment="where to: a URL without its password")
    versions = column(int, comment="how many were moved")
    rest = column(str, comment="SHA-256 of what this store keeps of the revisions up to there")


class PromotionRow(Record, Base):
    """A replica that became a knowledge base of its own."""

    __tablename__ = "promotion"
    __table_args__ = record_args("promotion", "last")

    revision = column(int, comment="the last one that was replicated")
    origin = column(str, comment="where it was replicated from: a URL without its password")


class ErasureRow(Record, Base):
    """An erasure: its revision has the actor and the reason; the erased texts are nowhere."""

    __tablename__ = "erasure"
    __table_args__ = record_args("erasure", "upto")

    revision = column(int, comment="in revisions up to this one")
    kind = column(str, String(16), comment="object, or actor, reason or source of revisions")
    element_id = optional(int, comment="the object; NULL: texts of revisions")
    pseudonym = column(str, comment="what is there now")
    parts = column(int, comment="how many texts were erased")
    digest = column(str, comment="SHA-256 of their commitments, and of what took their places")


class CommitmentRow(Base):
    """A part of a revision whose seed an erasure destroyed."""

    __tablename__ = "commitment"
    __table_args__ = (
        # To its revision only: a replica has rows of an erasure before the erasure itself.
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        CheckConstraint("(salt IS NULL) <> (erasure_id IS NULL)", name="kept_or_erased"),
        CheckConstraint("(commitment IS NULL) = (erasure_id IS NULL)", name="commitment_of_erased"),
        partial_index(
            "ix_commitment_erasure", "kb_id", "erasure_id", where="erasure_id IS NOT NULL"
        ),
    )

    kb_id = kb_column()
    number = key_column(-90, "the revision")
    position = position_column(
        comment="among its changes, from 0; -1 source, -2 reason, -3 actor; -4: all, of form 1"
    )
    sign = column(str, String(1), comment="+ asserted, - retracted; empty: no change")
    kind = column(str, String(20), comment="of the change, or actor, reason, source, revision")
    owner_id = column(int, comment="the element; of an execution, its plan; 0: no change")
    place = column(int, Integer, comment="of an execution, its position; else 0")
    salt = optional(bytes, comment="of what is kept; NULL: erased")
    commitment = optional(str, comment="of what is erased; NULL: that of the text")
    erasure_id = optional(int, comment="what erased it; NULL: it is kept")


class ReplacementRow(Base):
    """The replacement of an erased text; a later erasure may have replaced it again."""

    __tablename__ = "replacement"
    __has_rowid__ = False
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "number", "position"],
            ["commitment.kb_id", "commitment.number", "commitment.position"],
        ),
        CheckConstraint("(salt IS NULL) <> (commitment IS NULL)", name="salt_or_commitment"),
        Index("ix_replacement_erasure", "kb_id", "erasure_id"),
    )

    kb_id = kb_column()
    number = key_column(-90, "the revision")
    position = position_column(comment="as in commitment")
    erasure_id = key_column(-50, "what erased it")
    salt = optional(bytes, comment="of the text that is there now; NULL: it was replaced again")
    commitment = optional(str, comment="to what was there; NULL: to the text that is there now")


class VerificationRow(Base):
    """The last verified revision of a knowledge base."""

    __tablename__ = "verification"
    __table_args__ = (ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),)

    kb_id = kb_column()
    revision = column(int, comment="verified up to this revision")
    hash = column(str, comment="of that revision, at that time")
    verified_at = column(datetime, comment="UTC, when that was")
    complete_at = optional(
        datetime,
        comment="UTC, when a verification that began at revision 1 last ended; NULL: none did",
    )
