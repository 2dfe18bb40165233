"""PDDL text and what it says: read it, look at it as a document, write it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..dto.formulas import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Count,
    Derived,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    IsViolated,
    Metric,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
)
from ..later import asked_for
from .document import Action, Domain, Function, FunctionValue, PddlWarning, Predicate, Problem
from .lexer import Position, Source, Text
from .writer import write

if TYPE_CHECKING:
    from .reader import read, read_domain, read_problem
    from .requirements import used_requirements
else:
    homes = {
        ".reader": ("read", "read_domain", "read_problem"),
        ".requirements": ("used_requirements",),
    }
    __getattr__ = asked_for(__name__, homes)

__all__ = [
    "Action",
    "And",
    "Arithmetic",
    "Assign",
    "Atom",
    "Comparison",
    "Constant",
    "ContinuousTime",
    "Count",
    "Derived",
    "Domain",
    "Equal",
    "Exists",
    "Fluent",
    "Forall",
    "Formula",
    "Function",
    "FunctionValue",
    "Imply",
    "IsViolated",
    "Metric",
    "Modal",
    "Node",
    "Not",
    "Number",
    "Or",
    "PddlWarning",
    "Position",
    "Predicate",
    "Preference",
    "Problem",
    "Source",
    "Text",
    "Timed",
    "TimedLiteral",
    "TypedName",
    "Variable",
    "When",
    "read",
    "read_domain",
    "read_problem",
    "used_requirements",
    "write",
]
