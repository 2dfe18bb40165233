"""Archives: what was moved out of this store, and where to."""

from __future__ import annotations

from sqlalchemy import BigInteger, ForeignKeyConstraint, Index
from sqlalchemy.orm import Mapped, mapped_column

from .base import Base, kb_column, owner_column
from .plan import AT_COMMIT, REVISION
from .types import LongText


class ArchiveRow(Base):
    """A move of closed versions into another store."""

    __tablename__ = "archive"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        ForeignKeyConstraint(["kb_id", "revision"], REVISION, name="fk_archive_upto"),
        Index("ix_archive_since", "kb_id", "since"),
        Index("ix_archive_revision", "kb_id", "revision"),
    )

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    since: Mapped[int] = mapped_column(
        BigInteger, sort_order=-80, comment="recorded in this revision"
    )
    revision: Mapped[int] = mapped_column(
        BigInteger, comment="the versions that ended up to this revision were moved"
    )
    target: Mapped[str] = mapped_column(LongText, comment="where to: a URL without its password")
    versions: Mapped[int] = mapped_column(BigInteger, comment="how many were moved")
    rest: Mapped[str] = mapped_column(
        LongText, comment="SHA-256 of what this store keeps of the revisions up to there"
    )
    text: Mapped[str] = mapped_column(LongText, comment="all of it in canonical form")
