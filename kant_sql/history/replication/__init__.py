"""Replication: the same revisions in another store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...later import asked_for

if TYPE_CHECKING:
    from . import calls as calls
else:
    __getattr__ = asked_for(__name__)
