"""The tables: mapped classes, one module for each PDDL element."""

from __future__ import annotations

from .action import (
    ActionExpressionRow,
    ActionExpressionTermRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    ActionRow,
    ActionVersionRow,
)
from .base import Base
from .knowledge_base import HeadRow, KnowledgeBaseRow
from .object import ObjectRow, ObjectVersionRow
from .predicate import (
    PredicateParameterRow,
    PredicateParameterTypeRow,
    PredicateRow,
    PredicateVersionRow,
)
from .proposition import PropositionArgumentRow, PropositionRow, PropositionVersionRow
from .revision import RevisionRow
from .type import TypeRow, TypeVersionRow

__all__ = [
    "ActionExpressionRow",
    "ActionExpressionTermRow",
    "ActionParameterRow",
    "ActionParameterTypeRow",
    "ActionRow",
    "ActionVersionRow",
    "Base",
    "HeadRow",
    "KnowledgeBaseRow",
    "ObjectRow",
    "ObjectVersionRow",
    "PredicateParameterRow",
    "PredicateParameterTypeRow",
    "PredicateRow",
    "PredicateVersionRow",
    "PropositionArgumentRow",
    "PropositionRow",
    "PropositionVersionRow",
    "RevisionRow",
    "TypeRow",
    "TypeVersionRow",
]
