"""Whole domains and problems: load them, write them, plan."""

from __future__ import annotations

from .interfaces import Exchange, Loaded, Mode

__all__ = ["Exchange", "Loaded", "Mode"]
