"""Domains and problems as whole documents: loaded into a store, and built from it."""

from __future__ import annotations

from .exchange import SqlExchange
from .interfaces import Exchange, Loaded, Mode, State
from .methods import DocumentMethods

__all__ = ["DocumentMethods", "Exchange", "Loaded", "Mode", "SqlExchange", "State"]
