"""Compiles soft goals away (Keyder and Geffner, 2009), for planners that only support costs."""

from __future__ import annotations

from .compilation import compile_soft_goals

__all__ = ["compile_soft_goals"]
