"""What follows from what is stored: conditions, actions, plans, and rules about the past."""

from __future__ import annotations

from .ask import Answers, Binding
from .steps import Step, UpActionInstance

__all__ = ["Answers", "Binding", "Step", "UpActionInstance"]
