"""The databases: one module for each dialect, and the only place where dialects differ."""

from __future__ import annotations

from .backend import Backend
from .query import Query, StoreClock, in_list, in_rows
from .registry import backend_name, create_backend, dialect_name
from .session import Row, Session

__all__ = [
    "Backend",
    "Query",
    "Row",
    "Session",
    "StoreClock",
    "backend_name",
    "create_backend",
    "dialect_name",
    "in_list",
    "in_rows",
]
