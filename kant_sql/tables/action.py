"""PDDL actions: parameters, and conditions, effects and durations as expression trees."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    CheckConstraint,
    ForeignKeyConstraint,
    Index,
    Integer,
    String,
)
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    Base,
    Identity,
    Version,
    identity_args,
    kb_column,
    owner_column,
    since_column,
    version_args,
)
from .parameter import Parameter, ParameterType, parameter_args, parameter_type_args
from .types import LongText

_NODE = ["kb_id", "action_id", "since", "section", "position"]


class ActionRow(Identity, Base):
    """An action, for ever."""

    __tablename__ = "action"
    __table_args__ = identity_args()


class ActionVersionRow(Version, Base):
    """An action's definition, for a time; its parts are rows of their own."""

    __tablename__ = "action_version"
    __table_args__ = (*version_args("action"),)

    action_id: Mapped[int] = owner_column()
    durative: Mapped[bool] = mapped_column(Boolean)
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class ActionParameterRow(Parameter, Base):
    """A parameter of one version of an action."""

    __tablename__ = "action_parameter"
    __table_args__ = parameter_args("action")

    action_id: Mapped[int] = owner_column()


class ActionParameterTypeRow(ParameterType, Base):
    """A type that an action's parameter allows: one row, or several for `either`."""

    __tablename__ = "action_parameter_type"
    __table_args__ = parameter_type_args("action")

    action_id: Mapped[int] = owner_column()


class ActionExpressionRow(Base):
    """A node of an expression tree of one version of an action, in preorder."""

    __tablename__ = "action_expression"
    __table_args__ = (
        ForeignKeyConstraint(_NODE[:3], [f"action_version.{column}" for column in _NODE[:3]]),
        ForeignKeyConstraint(
            [*_NODE[:4], "parent"], [f"action_expression.{column}" for column in _NODE]
        ),
        ForeignKeyConstraint(["kb_id", "predicate_id"], ["predicate.kb_id", "predicate.id"]),
        CheckConstraint("parent < position", name="preorder"),
        CheckConstraint("(parent IS NULL) = (position = 0)", name="one_root"),
        CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)", name="predicate_given"
        ),
        CheckConstraint("section IN ('duration', 'condition', 'effect')", name="section"),
        Index("ix_action_expression_predicate", "kb_id", "predicate_id"),
    )

    kb_id: Mapped[int] = kb_column()
    action_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = mapped_column(
        String(16), primary_key=True, sort_order=-70, comment="duration, condition or effect"
    )
    position: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 0, in preorder",
    )
    parent: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the node above; NULL: the root"
    )
    operator: Mapped[str] = mapped_column(
        String(32), comment="and, not, at start, over all, at end, =, predicate, variable, number"
    )
    predicate_id: Mapped[int | None] = mapped_column(BigInteger)
    value: Mapped[str | None] = mapped_column(
        LongText, comment="a number as exact decimal text, or a variable's name"
    )


class ActionExpressionTermRow(Base):
    """A term of a predicate node: a parameter of the action, or a constant."""

    __tablename__ = "action_expression_term"
    __table_args__ = (
        ForeignKeyConstraint(
            _NODE,
            [f"action_expression.{column}" for column in _NODE],
            name="fk_action_expression_term_node",
        ),
        ForeignKeyConstraint(
            [*_NODE[:3], "parameter"],
            [f"action_parameter.{column}" for column in [*_NODE[:3], "position"]],
            name="fk_action_expression_term_parameter",
        ),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        CheckConstraint("(parameter IS NULL) <> (object_id IS NULL)", name="parameter_or_object"),
        Index("ix_action_expression_term_object", "kb_id", "object_id"),
    )

    kb_id: Mapped[int] = kb_column()
    action_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = mapped_column(String(16), primary_key=True, sort_order=-70)
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60
    )
    term: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-50, comment="from 0"
    )
    parameter: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the action's parameter"
    )
    object_id: Mapped[int | None] = mapped_column(BigInteger, comment="the constant")
