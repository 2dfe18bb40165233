"""A knowledge base, and the head that its writers lock."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, ForeignKeyConstraint, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, kb_column
from .types import LongText, ShortText, UtcTime


class KnowledgeBaseRow(Base):
    """The identity of a knowledge base: one robot's, or one mission's."""

    __tablename__ = "knowledge_base"
    __table_args__ = (UniqueConstraint("name"),)

    id: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    name: Mapped[str] = mapped_column(ShortText)


class HeadRow(Base):
    """Where a knowledge base stands. A writer locks this row, so it is apart from the identity."""

    __tablename__ = "head"
    __table_args__ = (ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),)

    kb_id: Mapped[int] = kb_column()
    revision: Mapped[int] = mapped_column(BigInteger, comment="the last revision; 0: none yet")
    definition_revision: Mapped[int] = mapped_column(
        BigInteger, comment="the last revision that changed anything but propositions"
    )
    next_id: Mapped[int] = mapped_column(BigInteger, comment="the id that the next element gets")
    hash: Mapped[str | None] = mapped_column(LongText, comment="of the last revision")
    committed_at: Mapped[datetime | None] = mapped_column(UtcTime, comment="of the last revision")
    archived_revision: Mapped[int] = mapped_column(
        BigInteger,
        server_default=text("0"),
        comment="what ended up to this revision is in an archive; 0: nothing is",
    )
