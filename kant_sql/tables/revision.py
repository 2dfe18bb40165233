"""A revision: one committed transaction of one knowledge base."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKeyConstraint, Index, Integer
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, kb_column
from .types import CanonicalJson, LongText, UtcTime


class RevisionRow(Base):
    """Who changed the knowledge base, when and why; `docs/hash.md` says what `hash` covers."""

    __tablename__ = "revision"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        CheckConstraint("number > 0", name="number_positive"),
        Index("ix_revision_committed_at", "kb_id", "committed_at"),
    )

    kb_id: Mapped[int] = kb_column()
    number: Mapped[int] = mapped_column(
        BigInteger, primary_key=True, autoincrement=False, comment="1, 2, 3 ... without gaps"
    )
    committed_at: Mapped[datetime] = mapped_column(UtcTime, comment="UTC, never going back")
    actor: Mapped[str | None] = mapped_column(LongText, comment="the component that wrote")
    reason: Mapped[str | None] = mapped_column(LongText)
    source: Mapped[Any | None] = mapped_column(
        CanonicalJson, comment="what the caller knows: sensor, plan step ..."
    )
    form: Mapped[int] = mapped_column(Integer, comment="version of the form that was hashed")
    hash: Mapped[str] = mapped_column(LongText, comment="SHA-256, chained to the revision before")
    observed_at: Mapped[datetime | None] = mapped_column(
        UtcTime, comment="UTC, when what it says was sensed; NULL: not said"
    )
