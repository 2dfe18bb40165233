"""The DAOs: the abstract ones in `interfaces.py`, and a module for each PDDL element."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for
from .interfaces import *  # noqa: F403
from .interfaces import __all__ as __all__

if TYPE_CHECKING:
    from . import action as action
    from . import formula as formula
    from . import function_value as function_value
    from . import proposition as proposition
    from . import signatures as signatures
    from . import type as type  # noqa: A004
else:
    __getattr__ = asked_for(__name__)
