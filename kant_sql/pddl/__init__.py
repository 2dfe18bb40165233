"""PDDL text and documents: read, inspect and write them."""
# ruff: noqa: I001

from __future__ import annotations

from typing import TYPE_CHECKING

from ..dto.formulas import (
    And as And,
    Arithmetic as Arithmetic,
    Assign as Assign,
    Atom as Atom,
    Comparison as Comparison,
    Constant as Constant,
    ContinuousTime as ContinuousTime,
    Count as Count,
    Derived as Derived,
    Equal as Equal,
    Exists as Exists,
    Fluent as Fluent,
    Forall as Forall,
    Formula as Formula,
    Imply as Imply,
    IsViolated as IsViolated,
    Metric as Metric,
    Modal as Modal,
    Node as Node,
    Not as Not,
    Number as Number,
    Or as Or,
    Preference as Preference,
    Timed as Timed,
    TimedLiteral as TimedLiteral,
    TypedName as TypedName,
    Variable as Variable,
    When as When,
)
from ..later import asked_for
from .document import (
    Action as Action,
    Domain as Domain,
    Function as Function,
    FunctionValue as FunctionValue,
    PddlWarning as PddlWarning,
    Predicate as Predicate,
    Problem as Problem,
)
from .lexer import Position as Position, Source as Source, Text as Text
from .writer import write as write

if TYPE_CHECKING:
    from .reader import read as read, read_domain as read_domain, read_problem as read_problem
    from .requirements import used_requirements as used_requirements

_HOMES = {
    ".reader": ("read", "read_domain", "read_problem"),
    ".requirements": ("used_requirements",),
}
# The imported classes, other names, and lazy imports.
_CLASSES = [name for name, value in globals().items() if isinstance(value, type)]
_READERS = [name for names in _HOMES.values() for name in names]
__all__ = sorted([*_CLASSES, "Formula", "Source", "write", *_READERS])  # noqa: PLE0605

if not TYPE_CHECKING:
    __getattr__ = asked_for(__name__, _HOMES)
