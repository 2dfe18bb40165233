"""kant_sql: the knowledge base that robots plan from and auditors can question."""

from __future__ import annotations

import logging
from importlib import import_module
from typing import TYPE_CHECKING

from . import dto, errors
from .dto import *  # noqa: F403
from .errors import *  # noqa: F403

if TYPE_CHECKING:
    from .documents.exchange import Loaded
    from .factory import DaoFactory, create_dao_factory
    from .history.anchors import Anchor, AnchoredHead, parse_anchor
    from .history.archive.archive import Archived
    from .history.gantt import PlanBar, StepBar
    from .history.replication.push import Pushed
    from .history.revisions import LogEntry, Revision
    from .history.timeline import Bar, Density, Lane, Timeline
    from .history.verify.findings import Finding
    from .history.verify.verify import Verification
    from .history.versions import Version
    from .knowledge_base import KnowledgeBase, connect
    from .knowledge_store import KnowledgeStore, open_store
    from .limits import Limit, limited
    from .planning import Plan, PlanStep
    from .plans.interfaces import RecordedPlan, RecordedStep
    from .reasoning.ask import Answers
    from .reasoning.complete import Completion
    from .reasoning.durative import BrokenInvariant
    from .reasoning.failures import FailedCondition
    from .reasoning.periods import Held, HeldPeriods
    from .reasoning.undo import Aborted
    from .reasoning.validate import FailedStep, Validation, ViolatedConstraint
    from .reasoning.verdicts import Verdict, Verdicts
    from .sql.backup import Backup, backup
    from .sql.changes import Change
    from .sql.dialects.base import Roles
    from .sql.inventory import Inventory, knowledge_bases
    from .sql.predicate_views import PredicateView, drop_views, update_views
    from .sql.schema import create_roles, downgrade, upgrade

__version__ = "0.2.0"

__all__ = [
    "Aborted",
    "Anchor",
    "AnchoredHead",
    "Answers",
    "Archived",
    "Backup",
    "Bar",
    "BrokenInvariant",
    "Change",
    "Completion",
    "DaoFactory",
    "Density",
    "FailedCondition",
    "FailedStep",
    "Finding",
    "Held",
    "HeldPeriods",
    "Inventory",
    "KnowledgeBase",
    "KnowledgeStore",
    "Lane",
    "Limit",
    "Loaded",
    "LogEntry",
    "Plan",
    "PlanBar",
    "PlanStep",
    "PredicateView",
    "Pushed",
    "RecordedPlan",
    "RecordedStep",
    "Revision",
    "Roles",
    "StepBar",
    "Timeline",
    "Validation",
    "Verdict",
    "Verdicts",
    "Verification",
    "Version",
    "ViolatedConstraint",
    "backup",
    "connect",
    "create_dao_factory",
    "create_roles",
    "downgrade",
    "drop_views",
    "knowledge_bases",
    "limited",
    "open_store",
    "parse_anchor",
    "update_views",
    "upgrade",
]
__all__ += dto.__all__
__all__ += errors.__all__

# The modules of the names that need SQLAlchemy, imported on first use: the command line checks
# files and prints its help without it.
_HOMES = {
    name: module
    for module, names in {
        ".documents.exchange": ("Loaded",),
        ".factory": ("DaoFactory", "create_dao_factory"),
        ".history.anchors": ("Anchor", "AnchoredHead", "parse_anchor"),
        ".history.archive.archive": ("Archived",),
        ".history.replication.push": ("Pushed",),
        ".history.revisions": ("LogEntry", "Revision"),
        ".history.gantt": ("PlanBar", "StepBar"),
        ".history.timeline": ("Bar", "Density", "Lane", "Timeline"),
        ".history.verify.findings": ("Finding",),
        ".history.verify.verify": ("Verification",),
        ".history.versions": ("Version",),
        ".knowledge_base": ("KnowledgeBase", "connect"),
        ".knowledge_store": ("KnowledgeStore", "open_store"),
        ".limits": ("Limit", "limited"),
        ".planning": ("Plan", "PlanStep"),
        ".plans.interfaces": ("RecordedPlan", "RecordedStep"),
        ".reasoning.ask": ("Answers",),
        ".reasoning.complete": ("Completion",),
        ".reasoning.durative": ("BrokenInvariant",),
        ".reasoning.failures": ("FailedCondition",),
        ".reasoning.undo": ("Aborted",),
        ".reasoning.validate": ("FailedStep", "Validation", "ViolatedConstraint"),
        ".reasoning.verdicts": ("Verdict", "Verdicts"),
        ".reasoning.periods": ("Held", "HeldPeriods"),
        ".sql.backup": ("Backup", "backup"),
        ".sql.changes": ("Change",),
        ".sql.dialects.base": ("Roles",),
        ".sql.inventory": ("Inventory", "knowledge_bases"),
        ".sql.predicate_views": ("PredicateView", "drop_views", "update_views"),
        ".sql.schema": ("create_roles", "downgrade", "upgrade"),
    }.items()
    for name in names
}
_SUBPACKAGES = frozenset(
    {
        "dao",
        "documents",
        "export",
        "factory",
        "history",
        "knowledge",
        "knowledge_base",
        "knowledge_store",
    }
    | {"pddl", "planning", "plans", "reasoning", "sql", "store"}
)

if not TYPE_CHECKING:
    # Type checkers see the imports above, and refuse unknown names.
    def __getattr__(name: str) -> object:
        """Import a public name, or a subpackage, on first use."""
        if name in _HOMES:
            value = globals()[name] = getattr(import_module(_HOMES[name], __name__), name)
            return value
        if name in _SUBPACKAGES:
            return import_module(f".{name}", __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """List the names that are imported, and those that can be."""
        return sorted({*globals(), *__all__})


# The log goes nowhere unless a program configures it.
logging.getLogger(__name__).addHandler(logging.NullHandler())
