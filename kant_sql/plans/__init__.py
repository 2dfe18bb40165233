"""Recorded plans: what was planned from which state, and the outcome of each step."""

from __future__ import annotations

from .interfaces import PlanDao, RecordedPlan, RecordedStep, StepStatus

__all__ = ["PlanDao", "RecordedPlan", "RecordedStep", "StepStatus"]
