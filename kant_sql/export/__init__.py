"""Writing what a store has to files: the audit's views with types, and state transitions.

The files are of one consistent state. pyarrow and mcap, of the extra `data`, are imported on first
use.
"""

from __future__ import annotations

from .files import FORMATS, Exported, ExportedFile
from .snapshot import KnowledgeBaseState, open_reader
from .transitions import export_transitions
from .views import export_store

__all__ = [
    "FORMATS",
    "Exported",
    "ExportedFile",
    "KnowledgeBaseState",
    "export_store",
    "export_transitions",
    "open_reader",
]
