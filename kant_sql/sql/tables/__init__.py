"""The tables: of revisions, named elements, propositions and values of functions, and plans."""

from __future__ import annotations

from . import definitions as definitions
from .atoms import (
    FunctionValueArgumentRow,
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionArgumentRow,
    PropositionRow,
    PropositionVersionRow,
)
from .base import Base
from .plans import (
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    RevisionPlanStepRow,
)
from .revisions import ArchiveRow, HeadRow, KnowledgeBaseRow, RevisionRow

__all__ = [
    "TABLES",
    "ArchiveRow",
    "Base",
    "FunctionValueArgumentRow",
    "FunctionValueRow",
    "FunctionValueVersionRow",
    "HeadRow",
    "KnowledgeBaseRow",
    "PlanRow",
    "PlanStepArgumentRow",
    "PlanStepRow",
    "PlanStepVersionRow",
    "PropositionArgumentRow",
    "PropositionRow",
    "PropositionVersionRow",
    "RevisionPlanStepRow",
    "RevisionRow",
]

# By name. Those of named elements have no class.
TABLES = Base.metadata.tables
