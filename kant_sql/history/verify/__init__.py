"""Verification: compares the tables with the chain of hashes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...later import asked_for

if TYPE_CHECKING:
    from . import verify as verify
else:
    __getattr__ = asked_for(__name__)
