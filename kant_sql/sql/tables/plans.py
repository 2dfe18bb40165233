"""Plans: what was to be done, planned from which state, and what became of each step."""

from __future__ import annotations

from typing import Any

from sqlalchemy import CheckConstraint, ForeignKeyConstraint, Index, Integer, String
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    AT_COMMIT,
    REVISION,
    Base,
    VersionRow,
    kb_column,
    key_column,
    owner_column,
    partial_index,
    position_column,
    reference,
    version_args,
)

_GIVEN = "what the planner was given, if it is not what the store writes"


class Record:
    """What is recorded once, about an earlier revision."""

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    since: Mapped[int] = mapped_column(sort_order=-80, comment="recorded in this revision")
    text: Mapped[str] = mapped_column(sort_order=10, comment="all of it in canonical form")


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

    revision: Mapped[int] = mapped_column(comment="the state that it was planned from")
    problem_hash: Mapped[str] = mapped_column(
        comment="SHA-256 of the domain and then the problem that the planner was given"
    )
    planner: Mapped[str | None]
    planner_version: Mapped[str | None]
    objective: Mapped[str | None] = mapped_column(comment="what the plan is to make small or large")
    value: Mapped[str | None] = mapped_column(
        comment="what the objective comes to, as exact decimal text"
    )
    status: Mapped[str | None] = mapped_column(comment="what the planner says of it")
    domain_pddl: Mapped[str | None] = mapped_column(comment=_GIVEN)
    problem_pddl: Mapped[str | None] = mapped_column(comment=_GIVEN)


class PlanStepRow(Base):
    """A step of a plan."""

    __tablename__ = "plan_step"
    __table_args__ = (
        reference("plan_id", "plan"),
        reference("action_id", "action"),
        Index("ix_plan_step_action", "kb_id", "action_id"),
    )

    kb_id: Mapped[int] = kb_column()
    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = position_column()
    start: Mapped[str | None] = mapped_column(
        comment="seconds from the plan's beginning, as exact decimal text"
    )
    duration: Mapped[str | None] = mapped_column(
        comment="seconds, as exact decimal text; NULL: an instant"
    )
    action_id: Mapped[int]
    text: Mapped[str] = mapped_column(comment="canonical PDDL, without times")


class PlanStepArgumentRow(Base):
    """An argument of a step's action."""

    __tablename__ = "plan_step_argument"
    __table_args__ = (
        _to_step(),
        reference("object_id", "object"),
        Index("ix_plan_step_argument_object", "kb_id", "object_id"),
    )

    kb_id: Mapped[int] = kb_column()
    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = position_column(comment=None)
    argument: Mapped[int] = position_column(-50)
    object_id: Mapped[int]


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

    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = position_column(-85, None)
    status: Mapped[str] = mapped_column(String(16), comment="started, succeeded, failed or aborted")
    text: Mapped[str] = mapped_column(comment="which step of which plan, and its status")


class RevisionPlanStepRow(Base):
    """The step of a plan that was running when a revision was made."""

    __tablename__ = "revision_plan_step"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        _to_step(),
        Index("ix_revision_plan_step_step", "kb_id", "plan_id", "position", "number"),
    )

    kb_id: Mapped[int] = kb_column()
    number: Mapped[int] = key_column(-90, "the revision")
    plan_id: Mapped[int]
    position: Mapped[int] = mapped_column(Integer, comment="the step's")
