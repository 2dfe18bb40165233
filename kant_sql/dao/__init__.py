"""The DAOs: `interfaces.py` has the abstract ones, and each PDDL element a module."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for
from .interfaces import (
    AnyDao,
    ConstraintDao,
    Dao,
    DerivedPredicateDao,
    FormulaDao,
    GoalDao,
    InitialLiteralDao,
    MetricDao,
    NamedDao,
    PddlActionDao,
    PddlEventDao,
    PddlFunctionDao,
    PddlFunctionValueDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlProcessDao,
    PddlPropositionDao,
    PddlTypeDao,
    Progress,
    RedefinableDao,
    TimedInitialLiteralDao,
)

if TYPE_CHECKING:
    from . import action as action
    from . import formula as formula
    from . import function_value as function_value
    from . import proposition as proposition
    from . import signatures as signatures
    from . import type as type  # noqa: A004
else:
    __getattr__ = asked_for(__name__)

__all__ = [
    "AnyDao",
    "ConstraintDao",
    "Dao",
    "DerivedPredicateDao",
    "FormulaDao",
    "GoalDao",
    "InitialLiteralDao",
    "MetricDao",
    "NamedDao",
    "PddlActionDao",
    "PddlEventDao",
    "PddlFunctionDao",
    "PddlFunctionValueDao",
    "PddlObjectDao",
    "PddlPredicateDao",
    "PddlProcessDao",
    "PddlPropositionDao",
    "PddlTypeDao",
    "Progress",
    "RedefinableDao",
    "TimedInitialLiteralDao",
]
