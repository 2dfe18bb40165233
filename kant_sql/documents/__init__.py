"""Whole domains and problems: load them, write them, plan."""

from __future__ import annotations

from .exchange import Loaded, Mode

__all__ = ["Loaded", "Mode"]
