"""Plans: what was to be done, planned from which state, and what became of each step."""

from __future__ import annotations

from typing import Any

from sqlalchemy import CheckConstraint, ForeignKeyConstraint, Index, Integer, String

from .base import (
    AT_COMMIT,
    REVISION,
    Base,
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
    """What is recorded once, about an earlier revision."""

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


def _to_step() -> ForeignKeyConstraint:
    key = ("kb_id", "plan_id", "position")
    return ForeignKeyConstraint(key, [f"plan_step.{column}" for column in key])


class PlanRow(Record, Base):
    """A plan, for ever."""

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


class PlanStepRow(Base):
    """A step of a plan."""

    __tablename__ = "plan_step"
    __table_args__ = (
        reference("plan_id", "plan"),
        reference("action_id", "action"),
        Index("ix_plan_step_action", "kb_id", "action_id"),
    )

    kb_id = kb_column()
    plan_id = owner_column()
    position = position_column()
    start = optional(str, comment="seconds from the plan's beginning, as exact decimal text")
    duration = optional(str, comment="seconds, as exact decimal text; NULL: an instant")
    action_id = column(int)
    text = column(str, comment="canonical PDDL, without times")


class PlanStepArgumentRow(Base):
    """An argument of a step's action."""

    __tablename__ = "plan_step_argument"
    __table_args__ = (
        _to_step(),
        reference("object_id", "object"),
        Index("ix_plan_step_argument_object", "kb_id", "object_id"),
    )

    kb_id = kb_column()
    plan_id = owner_column()
    position = position_column(comment=None)
    argument = position_column(-50)
    object_id = column(int)


class PlanStepVersionRow(VersionRow, Base):
    """What became of a step, for a time; a step without a row was not started."""

    __tablename__ = "plan_step_version"
    __table_args__ = (
        _to_step(),
        *version_args("plan_step_version", "plan_id", "position"),
        CheckConstraint("status IN ('started', 'succeeded', 'failed', 'aborted')", name="status"),
        partial_index(
            "ix_plan_step_version_running",
            *("kb_id", "status", "plan_id", "position", "until"),
            where="until IS NULL AND status = 'started'",
        ),
    )

    plan_id = owner_column()
    position = position_column(-85, None)
    status = column(str, String(16), comment="started, succeeded, failed or aborted")
    text = column(str, comment="which step of which plan, and its status")


class RevisionPlanStepRow(Base):
    """The step of a plan that was running when a revision was made."""

    __tablename__ = "revision_plan_step"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        _to_step(),
        Index("ix_revision_plan_step_step", "kb_id", "plan_id", "position", "number"),
    )

    kb_id = kb_column()
    number = key_column(-90, "the revision")
    plan_id = column(int)
    position = column(int, Integer, comment="the step's")
