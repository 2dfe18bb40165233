"""unified-planning, which is an extra: all of the library but planning works without it."""

from __future__ import annotations

import importlib.util

from ..errors import PlannerMissingError


def require_unified_planning() -> None:
    """See to it that unified-planning can be imported.

    Raises:
        PlannerMissingError: it is not installed.
    """
    if importlib.util.find_spec("unified_planning") is None:
        raise PlannerMissingError(
            "planning needs unified-planning, which is not installed; "
            'run pip install "kant-sql[planning]"'
        )
