"""The databases: one module for each dialect, and the only place where dialects differ."""

from __future__ import annotations

from .backend import Backend
from .cursor import Row
from .query import IdsQuery, Query, StoreClock, StorePlace, first_rows, in_list, in_rows
from .registry import backend_name, create_backend, dialect_name, roles_set_aside
from .roles import Roles
from .session import Session
from .waiting import Listener

__all__ = [
    "Backend",
    "IdsQuery",
    "Listener",
    "Query",
    "Roles",
    "Row",
    "Session",
    "StoreClock",
    "StorePlace",
    "backend_name",
    "create_backend",
    "dialect_name",
    "first_rows",
    "in_list",
    "in_rows",
    "roles_set_aside",
]
