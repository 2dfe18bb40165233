"""Exports a store to files: the views for auditors, with types, and formats of plugins.

The files contain one consistent state. pyarrow, of the extra `data`, is imported on first use.
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
