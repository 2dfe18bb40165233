"""Moving what ended long ago into another store."""

from __future__ import annotations

from .leaving import Leaving, compare, count, first_of
from .removing import refuse_without_right, remove
from .replicating import replicate
from .target import Target, check_same, open_target, read_archived_revision

__all__ = [
    "Leaving",
    "Target",
    "check_same",
    "compare",
    "count",
    "first_of",
    "open_target",
    "read_archived_revision",
    "refuse_without_right",
    "remove",
    "replicate",
]
