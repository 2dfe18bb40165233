"""Replication: the same revisions in another store."""

from __future__ import annotations

from . import calls as calls
