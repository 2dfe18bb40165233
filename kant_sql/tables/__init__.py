"""The tables: mapped classes, one module for each PDDL element."""

from __future__ import annotations

from .action import (
    ActionNodeRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    ActionRow,
    ActionTermRow,
    ActionVariableRow,
    ActionVariableTypeRow,
    ActionVersionRow,
)
from .archive import ArchiveRow
from .base import Base
from .document import DocumentItemRow, DocumentRow, DocumentVersionRow
from .formula import (
    FormulaNodeRow,
    FormulaRow,
    FormulaTermRow,
    FormulaVariableRow,
    FormulaVariableTypeRow,
    FormulaVersionRow,
)
from .function import (
    FunctionParameterRow,
    FunctionParameterTypeRow,
    FunctionRow,
    FunctionTypeRow,
    FunctionValueArgumentRow,
    FunctionValueRow,
    FunctionValueVersionRow,
    FunctionVersionRow,
)
from .knowledge_base import HeadRow, KnowledgeBaseRow
from .object import ObjectRow, ObjectTypeRow, ObjectVersionRow
from .plan import (
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    RevisionPlanStepRow,
)
from .predicate import (
    PredicateParameterRow,
    PredicateParameterTypeRow,
    PredicateRow,
    PredicateVersionRow,
)
from .proposition import PropositionArgumentRow, PropositionRow, PropositionVersionRow
from .revision import RevisionRow
from .type import TypeParentRow, TypeRow, TypeVersionRow

__all__ = [
    "ActionNodeRow",
    "ActionParameterRow",
    "ActionParameterTypeRow",
    "ActionRow",
    "ActionTermRow",
    "ActionVariableRow",
    "ActionVariableTypeRow",
    "ActionVersionRow",
    "ArchiveRow",
    "Base",
    "DocumentItemRow",
    "DocumentRow",
    "DocumentVersionRow",
    "FormulaNodeRow",
    "FormulaRow",
    "FormulaTermRow",
    "FormulaVariableRow",
    "FormulaVariableTypeRow",
    "FormulaVersionRow",
    "FunctionParameterRow",
    "FunctionParameterTypeRow",
    "FunctionRow",
    "FunctionTypeRow",
    "FunctionValueArgumentRow",
    "FunctionValueRow",
    "FunctionValueVersionRow",
    "FunctionVersionRow",
    "HeadRow",
    "KnowledgeBaseRow",
    "ObjectRow",
    "ObjectTypeRow",
    "ObjectVersionRow",
    "PlanRow",
    "PlanStepArgumentRow",
    "PlanStepRow",
    "PlanStepVersionRow",
    "PredicateParameterRow",
    "PredicateParameterTypeRow",
    "PredicateRow",
    "PredicateVersionRow",
    "PropositionArgumentRow",
    "PropositionRow",
    "PropositionVersionRow",
    "RevisionPlanStepRow",
    "RevisionRow",
    "TypeParentRow",
    "TypeRow",
    "TypeVersionRow",
]
