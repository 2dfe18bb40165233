"""Whole domains and problems: load them, write them, plan with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for

if TYPE_CHECKING:
    from . import exchange as exchange
    from .exchange import Loaded, Mode
else:
    __getattr__ = asked_for(__name__, {".exchange": ("Loaded", "Mode")})

__all__ = ["Loaded", "Mode"]
