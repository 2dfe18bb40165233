"""The nodes that conditions, effects, goals, constraints and metrics are built of: immutable data.

Each node is a construct of the language, under its name in the papers: PDDL 2.1 (Fox and Long,
2003), PDDL 2.2 (Edelkamp and Hoffmann, 2004), PDDL 3.0 (Gerevini and Long, 2005), PDDL 3.1
(Kovacs, 2011) and PDDL+ (Fox and Long, 2006). Nodes name predicates, functions and objects; they
are equal when they say the same in the same spelling. `str()` of a node is its PDDL text.
"""

from __future__ import annotations

from .conditions import (
    And,
    Atom,
    Comparison,
    Equal,
    Exists,
    Forall,
    Imply,
    Modal,
    Not,
    Or,
    Preference,
    Timed,
)
from .effects import Assign, Derived, Metric, TimedLiteral, When
from .node import Node
from .terms import (
    Arithmetic,
    Constant,
    ContinuousTime,
    Expression,
    Fluent,
    IsViolated,
    Number,
    Term,
    TypedName,
    Variable,
    typed_text,
    variables_text,
)

AT_START, OVER_ALL, AT_END = "at start", "over all", "at end"
TIMES = (AT_START, OVER_ALL, AT_END)
COMPARISONS = ("<", "<=", "=", ">=", ">")
ARITHMETIC = ("+", "-", "*", "/")
ASSIGNMENTS = ("assign", "increase", "decrease", "scale-up", "scale-down")
# How many numbers, and how many formulas, each modal operator takes.
MODALS = {
    "always": (0, 1),
    "sometime": (0, 1),
    "at-most-once": (0, 1),
    "sometime-after": (0, 2),
    "sometime-before": (0, 2),
    "within": (1, 1),
    "always-within": (1, 2),
    "hold-during": (2, 1),
    "hold-after": (1, 1),
}

Formula = (
    Atom
    | Equal
    | Comparison
    | Not
    | And
    | Or
    | Imply
    | Forall
    | Exists
    | Timed
    | Preference
    | Modal
    | When
    | Assign
)

__all__ = [
    "ARITHMETIC",
    "ASSIGNMENTS",
    "AT_END",
    "AT_START",
    "COMPARISONS",
    "MODALS",
    "OVER_ALL",
    "TIMES",
    "And",
    "Arithmetic",
    "Assign",
    "Atom",
    "Comparison",
    "Constant",
    "ContinuousTime",
    "Derived",
    "Equal",
    "Exists",
    "Expression",
    "Fluent",
    "Forall",
    "Formula",
    "Imply",
    "IsViolated",
    "Metric",
    "Modal",
    "Node",
    "Not",
    "Number",
    "Or",
    "Preference",
    "Term",
    "Timed",
    "TimedLiteral",
    "TypedName",
    "Variable",
    "When",
    "typed_text",
    "variables_text",
]
