"""Citus: a store's tables over the nodes of a cluster, and the command that puts them there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kant_sql.later import asked_for

if TYPE_CHECKING:
    from .distribution import Distribution, distribute
else:
    # On first use: the help of `kant-sql db` starts without SQLAlchemy.
    __getattr__ = asked_for(__name__, {".distribution": ("Distribution", "distribute")})

__all__ = ["Distribution", "distribute"]
