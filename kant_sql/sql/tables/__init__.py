"""The tables: of revisions, named elements, facts and values of functions, plans, executions."""

from __future__ import annotations

from . import named as named
from .atoms import ConfirmationRow as ConfirmationRow
from .atoms import FunctionValueArgumentRow as FunctionValueArgumentRow
from .atoms import FunctionValueRow as FunctionValueRow
from .atoms import FunctionValueSayingRow as FunctionValueSayingRow
from .atoms import FunctionValueVersionRow as FunctionValueVersionRow
from .atoms import PropositionArgumentRow as PropositionArgumentRow
from .atoms import PropositionRow as PropositionRow
from .atoms import PropositionSayingRow as PropositionSayingRow
from .atoms import PropositionVersionRow as PropositionVersionRow
from .base import Base as Base
from .revisions import EMPTY_HEAD as EMPTY_HEAD
from .revisions import ArchiveRow as ArchiveRow
from .revisions import CommitmentRow as CommitmentRow
from .revisions import ErasureRow as ErasureRow
from .revisions import ExecutionArgumentRow as ExecutionArgumentRow
from .revisions import ExecutionRow as ExecutionRow
from .revisions import ExecutionVersionRow as ExecutionVersionRow
from .revisions import HeadRow as HeadRow
from .revisions import KnowledgeBaseRow as KnowledgeBaseRow
from .revisions import PlanRow as PlanRow
from .revisions import PromotionRow as PromotionRow
from .revisions import ReplacementRow as ReplacementRow
from .revisions import RequestRow as RequestRow
from .revisions import RevisionExecutionRow as RevisionExecutionRow
from .revisions import RevisionRow as RevisionRow
from .revisions import VerificationRow as VerificationRow

# By name. Tables of named elements have no class.
TABLES = Base.metadata.tables
