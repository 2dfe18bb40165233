"""Plans: what was to be done, planned from which state, and what became of each step."""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKeyConstraint, Index, Integer, String
from sqlalchemy.orm import Mapped, mapped_column

from .base import CLOSED, LIVE, Base, LongText, Version, kb_column, owner_column, partial_index

AT_COMMIT: dict[str, Any] = {"deferrable": True, "initially": "DEFERRED"}
REVISION = ["revision.kb_id", "revision.number"]
_STEP = ["plan_step.kb_id", "plan_step.plan_id", "plan_step.position"]


class PlanRow(Base):
    """A plan, for ever."""

    __tablename__ = "plan"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        ForeignKeyConstraint(["kb_id", "revision"], REVISION, name="fk_plan_problem"),
        Index("ix_plan_since", "kb_id", "since"),
        Index("ix_plan_revision", "kb_id", "revision"),
    )

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    since: Mapped[int] = mapped_column(
        BigInteger, sort_order=-80, comment="recorded in this revision"
    )
    revision: Mapped[int] = mapped_column(BigInteger, comment="the state that it was planned from")
    problem_hash: Mapped[str] = mapped_column(
        LongText, comment="SHA-256 of the domain and then the problem that the planner was given"
    )
    planner: Mapped[str | None] = mapped_column(LongText)
    planner_version: Mapped[str | None] = mapped_column(LongText)
    objective: Mapped[str | None] = mapped_column(
        LongText, comment="what the plan is to make small or large"
    )
    value: Mapped[str | None] = mapped_column(
        LongText, comment="what the objective comes to, as exact decimal text"
    )
    status: Mapped[str | None] = mapped_column(LongText, comment="what the planner says of it")
    domain_pddl: Mapped[str | None] = mapped_column(
        LongText, comment="what the planner was given, if it is not what the store writes"
    )
    problem_pddl: Mapped[str | None] = mapped_column(
        LongText, comment="what the planner was given, if it is not what the store writes"
    )
    text: Mapped[str] = mapped_column(LongText, comment="all of it in canonical form")


class PlanStepRow(Base):
    """A step of a plan."""

    __tablename__ = "plan_step"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "plan_id"], ["plan.kb_id", "plan.id"]),
        ForeignKeyConstraint(["kb_id", "action_id"], ["action.kb_id", "action.id"]),
        Index("ix_plan_step_action", "kb_id", "action_id"),
    )

    kb_id: Mapped[int] = kb_column()
    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-80, comment="from 0"
    )
    start: Mapped[str | None] = mapped_column(
        LongText, comment="seconds from the plan's beginning, as exact decimal text"
    )
    duration: Mapped[str | None] = mapped_column(
        LongText, comment="seconds, as exact decimal text; NULL: an instant"
    )
    action_id: Mapped[int] = mapped_column(BigInteger)
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL, without times")


class PlanStepArgumentRow(Base):
    """An argument of a step's action."""

    __tablename__ = "plan_step_argument"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "plan_id", "position"], _STEP),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        Index("ix_plan_step_argument_object", "kb_id", "object_id"),
    )

    kb_id: Mapped[int] = kb_column()
    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-80
    )
    argument: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-70, comment="from 0"
    )
    object_id: Mapped[int] = mapped_column(BigInteger)


class PlanStepVersionRow(Version, Base):
    """What became of a step, for a time; a step without a row was not started."""

    __tablename__ = "plan_step_version"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "plan_id", "position"], _STEP),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        ForeignKeyConstraint(["kb_id", "until"], REVISION, **AT_COMMIT),
        CheckConstraint("since < until", name="since_before_until"),
        CheckConstraint("status IN ('started', 'succeeded', 'failed', 'aborted')", name="status"),
        partial_index(
            "uq_plan_step_version_live", "kb_id", "plan_id", "position", where=LIVE, unique=True
        ),
        Index("ix_plan_step_version_since", "kb_id", "since"),
        partial_index("ix_plan_step_version_until", "kb_id", "until", where=CLOSED),
    )

    plan_id: Mapped[int] = owner_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-85
    )
    status: Mapped[str] = mapped_column(String(16), comment="started, succeeded, failed or aborted")
    text: Mapped[str] = mapped_column(LongText, comment="which step of which plan, and its status")


class RevisionPlanStepRow(Base):
    """The step of a plan that was running when a revision was made."""

    __tablename__ = "revision_plan_step"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "number"], REVISION),
        ForeignKeyConstraint(["kb_id", "plan_id", "position"], _STEP),
        Index("ix_revision_plan_step_step", "kb_id", "plan_id", "position", "number"),
    )

    kb_id: Mapped[int] = kb_column()
    number: Mapped[int] = mapped_column(
        BigInteger, primary_key=True, autoincrement=False, comment="the revision"
    )
    plan_id: Mapped[int] = mapped_column(BigInteger)
    position: Mapped[int] = mapped_column(Integer, comment="the step's")
