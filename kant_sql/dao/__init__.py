"""The DAOs: `*interfaces.py` say what they do, and each PDDL element has a module."""

from __future__ import annotations

from .fluent_interfaces import PddlFunctionDao, PddlFunctionValueDao
from .formula_interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    FormulaDao,
    GoalDao,
    InitialLiteralDao,
    MetricDao,
    TimedInitialLiteralDao,
)
from .interfaces import (
    Dao,
    NamedDao,
    PddlActionDao,
    PddlEventDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlProcessDao,
    PddlPropositionDao,
    PddlTypeDao,
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
    "TimedInitialLiteralDao",
]
