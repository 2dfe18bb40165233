"""PDDL actions, processes and events: parameters, and their parts as expression trees."""

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
from .parameter import Parameter, ParameterType, parameter_args, parameter_type_args
from .types import LongText


class ActionRow(Identity, Base):
    """An action, for ever."""

    __tablename__ = "action"
    __table_args__ = identity_args()


class ActionVersionRow(Version, Base):
    """An action's definition, for a time; its parts are rows of their own."""

    __tablename__ = "action_version"
    __table_args__ = (*version_args("action"),)

    action_id: Mapped[int] = owner_column()
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")
    kind: Mapped[str] = mapped_column(
        String(16),
        server_default="action",
        comment="action, durative-action, process or event",
    )


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


class ActionNodeRow(ExpressionNode, Base):
    """A node of an action's duration, condition or effect."""

    __tablename__ = "action_node"
    __table_args__ = (
        *node_args("action"),
        CheckConstraint("section IN ('duration', 'condition', 'effect')", name="section"),
    )

    action_id: Mapped[int] = owner_column()


class ActionVariableRow(ExpressionVariable, Base):
    """A variable that a quantifier of an action binds."""

    __tablename__ = "action_variable"
    __table_args__ = variable_args("action")

    action_id: Mapped[int] = owner_column()


class ActionVariableTypeRow(ExpressionVariableType, Base):
    """A type that such a variable allows: one row, or several for `either`."""

    __tablename__ = "action_variable_type"
    __table_args__ = variable_type_args("action")

    action_id: Mapped[int] = owner_column()


class ActionTermRow(ExpressionTerm, Base):
    """A term of a node of an action."""

    __tablename__ = "action_term"
    __table_args__ = term_args("action", has_parameters=True)

    action_id: Mapped[int] = owner_column()
