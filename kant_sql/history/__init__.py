"""The past: revisions, what each of them changed, and whether they are what was written."""

from __future__ import annotations

from .anchors import Anchor, AnchoredHead, parse_anchor
from .archiving import Archived
from .interfaces import Element, History, When
from .methods import HistoryMethods
from .moments import head_revision, revision_at, state_at
from .revisions import LogEntry, Revision
from .sql_history import SqlHistory
from .verifying import Finding, Progress, Verification
from .versions import Version

__all__ = [
    "Anchor",
    "AnchoredHead",
    "Archived",
    "Element",
    "Finding",
    "History",
    "HistoryMethods",
    "LogEntry",
    "Progress",
    "Revision",
    "SqlHistory",
    "Verification",
    "Version",
    "When",
    "head_revision",
    "parse_anchor",
    "revision_at",
    "state_at",
]
