"""What aries has to be told before it starts."""

from __future__ import annotations

import tempfile
from pathlib import Path


def engine_parameters(name: str) -> dict[str, str]:
    """Give the parameters that an engine of unified-planning is created with.

    Args:
        name: the engine's name.

    Returns:
        For aries, which splits the path of its program at spaces, a path without any.
    """
    if name != "aries":
        return {}
    from up_aries.solver import _find_executable

    found = _find_executable()
    if " " not in found:
        return {}
    link = Path(tempfile.mkdtemp(prefix="aries-"), "aries")
    link.symlink_to(found)
    return {"executable": str(link)}
