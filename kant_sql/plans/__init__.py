"""Plans as episodes: what was planned from which state, and what became of it."""

from __future__ import annotations

from .interfaces import PlanDao, RecordedPlan, RecordedStep, StepStatus
from .sql_plan_dao import SqlPlanDao
from .steps import check_step, place_of

__all__ = [
    "PlanDao",
    "RecordedPlan",
    "RecordedStep",
    "SqlPlanDao",
    "StepStatus",
    "check_step",
    "place_of",
]
