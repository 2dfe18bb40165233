"""PDDL types."""

from __future__ import annotations

from sqlalchemy import BigInteger, ForeignKeyConstraint
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, Identity, Version, identity_args, owner_column, version_args
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
