"""kant_sql: the knowledge base that robots plan from and auditors can question.

These are the names that programs begin with; `docs/api/index.md` lists the other public modules.
"""
# ruff: noqa: I001

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from . import dto as dto, errors as errors
from .dto import *  # noqa: F403
from .errors import (
    ConflictError as ConflictError,
    DependantsError as DependantsError,
    DivergedError as DivergedError,
    InvalidArgumentError as InvalidArgumentError,
    InvalidKnowledgeError as InvalidKnowledgeError,
    KantSqlError as KantSqlError,
    NoPlanError as NoPlanError,
    NotApplicableError as NotApplicableError,
    OutcomeUnknownError as OutcomeUnknownError,
    PddlError as PddlError,
    PlanError as PlanError,
    ReadOnlyError as ReadOnlyError,
    SchemaError as SchemaError,
    StaleRevisionError as StaleRevisionError,
    StoreBusyError as StoreBusyError,
    StoreError as StoreError,
    StoreUnreachableError as StoreUnreachableError,
    UnknownNameError as UnknownNameError,
    UnknownRevisionError as UnknownRevisionError,
    UnsupportedConstructError as UnsupportedConstructError,
)
from .later import asked_for

if TYPE_CHECKING:
    from . import operations as operations
    from .acts import Execution as Execution
    from .documents.exchange import Loaded as Loaded
    from .factory import DaoFactory as DaoFactory, create_dao_factory as create_dao_factory
    from .history.window import (
        Bar as Bar,
        Density as Density,
        Lane as Lane,
        PlanBar as PlanBar,
        StepBar as StepBar,
    )
    from .history.corrections import Belief as Belief
    from .history.corrections import Correction as Correction
    from .history.merged import Merge as Merge, MergeConflict as MergeConflict
    from .history.merged import MergeSide as MergeSide
    from .history.revisions import LogEntry as LogEntry, Revision as Revision
    from .history.drawing import Timeline as Timeline
    from .history.revisions import Version as Version
    from .knowledge_base import (
        KnowledgeBase as KnowledgeBase,
        KnowledgeStore as KnowledgeStore,
        connect as connect,
        open_store as open_store,
    )
    from .limits import Limit as Limit, limited as limited
    from .planning import Plan as Plan, PlanStep as PlanStep
    from .plans import RecordedPlan as RecordedPlan
    from .reasoning.ask import Answers as Answers
    from .reasoning.complete import Completion as Completion
    from .reasoning.durative import Aborted as Aborted, BrokenInvariant as BrokenInvariant
    from .reasoning.execute import ExecutedPlan as ExecutedPlan
    from .reasoning.step_run import Durations as Durations
    from .reasoning.failures import FailedCondition as FailedCondition
    from .reasoning.links import CausalLink as CausalLink
    from .reasoning.memory import KnowledgeState as KnowledgeState
    from .reasoning.replan import PlanOptions as PlanOptions, Replanned as Replanned
    from .reasoning.rules import Verdict as Verdict, Verdicts as Verdicts
    from .reasoning.validate import (
        FailedStep as FailedStep,
        Validation as Validation,
        ViolatedConstraint as ViolatedConstraint,
    )
    from .reasoning.when import Held as Held, HeldPeriods as HeldPeriods
    from .sql.changes import Change as Change
    from .sql.schema import upgrade as upgrade

__version__ = "0.2.0"

# The module of each name that needs SQLAlchemy, imported on first use: the command line checks
# files and prints its help without it.
_HOMES = {
    ".acts": ["Execution"],
    ".documents.exchange": ["Loaded"],
    ".factory": ["DaoFactory", "create_dao_factory"],
    ".history.window": ["Bar", "Density", "Lane", "PlanBar", "StepBar"],
    ".history.corrections": ["Belief", "Correction"],
    ".history.merged": ["Merge", "MergeConflict", "MergeSide"],
    ".history.revisions": ["LogEntry", "Revision", "Version"],
    ".history.drawing": ["Timeline"],
    ".knowledge_base": ["KnowledgeBase", "KnowledgeStore", "connect", "open_store"],
    ".limits": ["Limit", "limited"],
    ".planning": ["Plan", "PlanStep"],
    ".plans": ["RecordedPlan"],
    ".reasoning.ask": ["Answers"],
    ".reasoning.complete": ["Completion"],
    ".reasoning.durative": ["Aborted", "BrokenInvariant"],
    ".reasoning.execute": ["ExecutedPlan"],
    ".reasoning.step_run": ["Durations"],
    ".reasoning.failures": ["FailedCondition"],
    ".reasoning.links": ["CausalLink"],
    ".reasoning.memory": ["KnowledgeState"],
    ".reasoning.replan": ["PlanOptions", "Replanned"],
    ".reasoning.rules": ["Verdict", "Verdicts"],
    ".reasoning.validate": ["FailedStep", "Validation", "ViolatedConstraint"],
    ".reasoning.when": ["Held", "HeldPeriods"],
    ".sql.changes": ["Change"],
    ".sql.schema": ["upgrade"],
}
# The classes that are imported above, and what is imported on first use.
_CLASSES = [name for name, value in globals().items() if isinstance(value, type)]
__all__ = sorted([*_CLASSES, *(name for names in _HOMES.values() for name in names)])  # noqa: PLE0605

if not TYPE_CHECKING:
    # Type checkers see the imports above, and refuse unknown names.
    __getattr__ = asked_for(__name__, _HOMES)

    def __dir__() -> list[str]:
        """List the public names."""
        return __all__


# The log goes nowhere unless a program configures it.
logging.getLogger(__name__).addHandler(logging.NullHandler())
