"""PDDL predicates and their parameters."""

from __future__ import annotations

from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    Base,
    Identity,
    Version,
    identity_args,
    lookup_index,
    owner_column,
    version_args,
)
from .parameter import Parameter, ParameterType, parameter_args, parameter_type_args
from .types import LongText


class PredicateRow(Identity, Base):
    """A predicate, for ever."""

    __tablename__ = "predicate"
    __table_args__ = (*identity_args(), lookup_index("predicate", "name"))


class PredicateVersionRow(Version, Base):
    """A predicate's definition, for a time; its parameters are rows of their own."""

    __tablename__ = "predicate_version"
    __table_args__ = (*version_args("predicate"),)

    predicate_id: Mapped[int] = owner_column()
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class PredicateParameterRow(Parameter, Base):
    """A parameter of one version of a predicate."""

    __tablename__ = "predicate_parameter"
    __table_args__ = parameter_args("predicate")

    predicate_id: Mapped[int] = owner_column()


class PredicateParameterTypeRow(ParameterType, Base):
    """A type that a predicate's parameter allows: one row, or several for `either`."""

    __tablename__ = "predicate_parameter_type"
    __table_args__ = parameter_type_args("predicate")

    predicate_id: Mapped[int] = owner_column()
