"""Planning on documents, by unified-planning (an extra) or programs; imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for
from .plan import EngineRun, Plan, PlanStep, problem_hash

if TYPE_CHECKING:
    from .from_up import from_unified_planning
    from .solving import Judged, solve
    from .to_up import to_unified_planning
else:
    homes = {
        ".from_up": ("from_unified_planning",),
        ".solving": ("Judged", "solve"),
        ".to_up": ("to_unified_planning",),
    }
    __getattr__ = asked_for(__name__, homes)

__all__ = [
    "EngineRun",
    "Judged",
    "Plan",
    "PlanStep",
    "from_unified_planning",
    "problem_hash",
    "solve",
    "to_unified_planning",
]
