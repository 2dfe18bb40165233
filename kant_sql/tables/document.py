"""The domain and the problem as documents: what they are called, and in which order they say it."""

from __future__ import annotations

from sqlalchemy import CheckConstraint, ForeignKeyConstraint, Integer, String
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
from .types import LongText, ShortText


class DocumentRow(Identity, Base):
    """The domain, or the problem, for ever: there is one of each."""

    __tablename__ = "document"
    __table_args__ = (
        *identity_args(),
        CheckConstraint("key IN ('domain', 'problem')", name="domain_or_problem"),
    )


class DocumentVersionRow(Version, Base):
    """What a document was called, for a time."""

    __tablename__ = "document_version"
    __table_args__ = (*version_args("document"),)

    document_id: Mapped[int] = owner_column()
    title: Mapped[str] = mapped_column(ShortText, comment="the name in its define form")
    domain: Mapped[str | None] = mapped_column(ShortText, comment="a problem's domain")
    text: Mapped[str] = mapped_column(LongText, comment="all of it on one line")


class DocumentItemRow(Base):
    """A place in a document: what stands there is live elsewhere, or the place is empty."""

    __tablename__ = "document_item"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "document_id", "since"],
            ["document_version.kb_id", "document_version.document_id", "document_version.since"],
        ),
    )

    kb_id: Mapped[int] = kb_column()
    document_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = mapped_column(
        String(24), primary_key=True, sort_order=-70, comment="requirement, type, goal ..."
    )
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60, comment="from 0"
    )
    name: Mapped[str] = mapped_column(
        LongText, comment="the element's name; for a goal that is a ground atom, its text"
    )
