"""PDDL types."""

from __future__ import annotations

from sqlalchemy import BigInteger, ForeignKeyConstraint, Index, Integer
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
from .types import LongText


class TypeRow(Identity, Base):
    """A type, for ever."""

    __tablename__ = "type"
    __table_args__ = identity_args()


class TypeVersionRow(Version, Base):
    """A type's place in the hierarchy, for a time."""

    __tablename__ = "type_version"
    __table_args__ = (
        *version_args("type"),
        ForeignKeyConstraint(["kb_id", "parent_id"], ["type.kb_id", "type.id"]),
    )

    type_id: Mapped[int] = owner_column()
    parent_id: Mapped[int | None] = mapped_column(
        BigInteger, comment="the type above it; NULL: right under the root"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class TypeParentRow(Base):
    """A further parent of a type whose parent is declared with `either`."""

    __tablename__ = "type_parent"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "type_id", "since"],
            ["type_version.kb_id", "type_version.type_id", "type_version.since"],
        ),
        ForeignKeyConstraint(["kb_id", "parent_id"], ["type.kb_id", "type.id"]),
        Index("ix_type_parent_parent", "kb_id", "parent_id"),
    )

    kb_id: Mapped[int] = kb_column()
    type_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 1: the first is in the version",
    )
    parent_id: Mapped[int] = mapped_column(BigInteger)
