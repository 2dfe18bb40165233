"""The past: revisions, and what each of them changed."""

from __future__ import annotations

from .revisions import (
    LogEntry,
    Revision,
    head_revision,
    read_log,
    read_revisions,
    revision_at,
)

__all__ = ["LogEntry", "Revision", "head_revision", "read_log", "read_revisions", "revision_at"]
