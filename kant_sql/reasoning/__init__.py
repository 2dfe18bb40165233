"""What follows from what is stored: conditions, actions, plans, and rules about the past."""

from __future__ import annotations

from .interfaces import Reasoning

__all__ = ["Reasoning"]
