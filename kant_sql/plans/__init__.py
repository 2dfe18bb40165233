"""Recorded plans: the state that each was made from, its steps and their outcomes."""

from __future__ import annotations

from .interfaces import PlanDao, RecordedPlan, RecordedStep, StepStatus

__all__ = ["PlanDao", "RecordedPlan", "RecordedStep", "StepStatus"]
