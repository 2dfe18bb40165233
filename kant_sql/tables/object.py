"""PDDL objects."""

from __future__ import annotations

from sqlalchemy import BigInteger, ForeignKeyConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, Identity, Version, identity_args, owner_column, version_args
from .types import LongText


class ObjectRow(Identity, Base):
    """An object, for ever."""

    __tablename__ = "object"
    __table_args__ = identity_args()


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
