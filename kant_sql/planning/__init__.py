"""Planning through unified-planning, on documents; an extra, imported when it is used."""

from __future__ import annotations

from .from_up import from_unified_planning
from .plan import Plan, PlanStep, problem_hash, solve
from .to_up import to_unified_planning

__all__ = [
    "Plan",
    "PlanStep",
    "from_unified_planning",
    "problem_hash",
    "solve",
    "to_unified_planning",
]
