"""The past: revisions, their changes, and their verification."""

from __future__ import annotations

from ..dao.interfaces import Progress
from ..moment_text import When
from .anchors import Anchor, AnchoredHead, parse_anchor
from .archive.archive import Archived
from .elements import Element
from .revisions import LogEntry, Revision, RunningStep
from .verify.findings import Finding
from .verify.verify import Verification
from .versions import Version

__all__ = [
    "Anchor",
    "AnchoredHead",
    "Archived",
    "Element",
    "Finding",
    "LogEntry",
    "Progress",
    "Revision",
    "RunningStep",
    "Verification",
    "Version",
    "When",
    "parse_anchor",
]
