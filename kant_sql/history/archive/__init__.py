"""Archives: versions that ended long ago, moved into another store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...later import asked_for

if TYPE_CHECKING:
    from . import archive as archive
else:
    __getattr__ = asked_for(__name__)
