"""The DAOs: `interfaces.py` has the abstract ones, and each PDDL element a module."""

from __future__ import annotations

from .interfaces import (
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

__all__ = [
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
