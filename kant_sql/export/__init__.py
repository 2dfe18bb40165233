"""Writing what a store has to files: the audit's views with types, and formats of plugins.

The files are of one consistent state. pyarrow, of the extra `data`, is imported on first use.
"""

from __future__ import annotations

from .files import FORMATS, PLUGGED_FORMATS, Exported, ExportedFile, PluggedFormat, export_store
from .snapshot import KnowledgeBaseState, open_reader

__all__ = [
    "FORMATS",
    "PLUGGED_FORMATS",
    "Exported",
    "ExportedFile",
    "KnowledgeBaseState",
    "PluggedFormat",
    "export_store",
    "open_reader",
]
