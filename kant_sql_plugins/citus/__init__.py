"""Citus: a store's tables over the nodes of a cluster, and the command that puts them there."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .distribution import Distribution, distribute

__all__ = ["Distribution", "distribute"]


def __getattr__(name: str) -> object:
    # On first need: the help of `kant-sql db` starts without SQLAlchemy.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import distribution

    return getattr(distribution, name)
