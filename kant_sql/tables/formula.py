"""Formulas that stand on their own: derived predicates, goals, constraints, the metric ..."""

from __future__ import annotations

from sqlalchemy import CheckConstraint, String
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, Identity, Version, identity_args, owner_column, version_args
from .expression import (
    ExpressionNode,
    ExpressionTerm,
    ExpressionVariable,
    ExpressionVariableType,
    node_args,
    term_args,
    variable_args,
    variable_type_args,
)
from .types import LongText

_KINDS = "('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', 'metric')"


class FormulaRow(Identity, Base):
    """A formula, for ever; its name is the SHA-256 of its section and its text, in hexadecimal."""

    __tablename__ = "formula"
    __table_args__ = identity_args()


class FormulaVersionRow(Version, Base):
    """When a formula stood."""

    __tablename__ = "formula_version"
    __table_args__ = (
        *version_args("formula"),
        CheckConstraint(f"section IN {_KINDS}", name="section"),
    )

    formula_id: Mapped[int] = owner_column()
    section: Mapped[str] = mapped_column(
        String(24), comment="the part of the domain or the problem that it stands in"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class FormulaNodeRow(ExpressionNode, Base):
    """A node of a formula."""

    __tablename__ = "formula_node"
    __table_args__ = node_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaVariableRow(ExpressionVariable, Base):
    """A variable that a rule or a quantifier of a formula binds."""

    __tablename__ = "formula_variable"
    __table_args__ = variable_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaVariableTypeRow(ExpressionVariableType, Base):
    """A type that such a variable allows: one row, or several for `either`."""

    __tablename__ = "formula_variable_type"
    __table_args__ = variable_type_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaTermRow(ExpressionTerm, Base):
    """A term of a node of a formula."""

    __tablename__ = "formula_term"
    __table_args__ = term_args("formula", has_parameters=False)

    formula_id: Mapped[int] = owner_column()
