"""PDDL objects."""

from __future__ import annotations

from sqlalchemy import BigInteger, Boolean, ForeignKeyConstraint, Index, Integer, false
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    Base,
    Identity,
    Version,
    identity_args,
    kb_column,
    lookup_index,
    owner_column,
    since_column,
    version_args,
)
from .types import LongText


class ObjectRow(Identity, Base):
    """An object, for ever."""

    __tablename__ = "object"
    __table_args__ = (*identity_args(), lookup_index("object", "name"))


class ObjectVersionRow(Version, Base):
    """An object's type, for a time."""

    __tablename__ = "object_version"
    __table_args__ = (
        *version_args("object"),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
    )

    object_id: Mapped[int] = owner_column()
    type_id: Mapped[int] = mapped_column(BigInteger)
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")
    is_constant: Mapped[bool] = mapped_column(
        Boolean, server_default=false(), comment="declared in the domain, not in the problem"
    )


class ObjectTypeRow(Base):
    """A further type of an object that is declared with `either`."""

    __tablename__ = "object_type"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "object_id", "since"],
            ["object_version.kb_id", "object_version.object_id", "object_version.since"],
        ),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index("ix_object_type_type", "kb_id", "type_id"),
    )

    kb_id: Mapped[int] = kb_column()
    object_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 1: the first is in the version",
    )
    type_id: Mapped[int] = mapped_column(BigInteger)
