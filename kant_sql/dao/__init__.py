"""The DAOs: `interfaces.py` says what they do, and each PDDL element has a module."""

from __future__ import annotations

from .fluent_interfaces import PddlFunctionDao, PddlFunctionValueDao
from .interfaces import (
    Dao,
    NamedDao,
    PddlActionDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlPropositionDao,
    PddlTypeDao,
)

__all__ = [
    "Dao",
    "NamedDao",
    "PddlActionDao",
    "PddlFunctionDao",
    "PddlFunctionValueDao",
    "PddlObjectDao",
    "PddlPredicateDao",
    "PddlPropositionDao",
    "PddlTypeDao",
]
