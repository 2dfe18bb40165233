"""Reasoning on an SQL store, of the present or of the past."""

from __future__ import annotations

from ..dao.base import SqlDao
from .interfaces import Reasoning


class SqlReasoning(SqlDao, Reasoning):
    """Reasoning on an SQL store, of the present or of the past."""

    # Ask.

    # Explain.

    # Act.

    # Plans.

    # The past.

    # What if.
