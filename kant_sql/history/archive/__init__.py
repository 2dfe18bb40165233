"""Archives: versions that ended long ago, moved into another store."""

from __future__ import annotations

from . import archive as archive
