"""Planning through unified-planning, on documents; an extra, imported when it is used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for
from .plan import Plan, PlanStep, problem_hash

if TYPE_CHECKING:
    from .from_up import from_unified_planning
    from .solving import solve
    from .to_up import to_unified_planning
else:
    homes = {
        ".from_up": ("from_unified_planning",),
        ".solving": ("solve",),
        ".to_up": ("to_unified_planning",),
    }
    __getattr__ = asked_for(__name__, homes)

__all__ = [
    "Plan",
    "PlanStep",
    "from_unified_planning",
    "problem_hash",
    "solve",
    "to_unified_planning",
]
