"""Knowledge bases, the heads that writers lock, revisions, archives and promotions."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import (
    CheckConstraint,
    ForeignKeyConstraint,
    Index,
    Integer,
    UniqueConstraint,
    text,
)

from .base import Base, CanonicalJson, ShortText, column, kb_column, key_column, optional
from .plans import Record, record_args


class KnowledgeBaseRow(Base):
    """The identity of a knowledge base: one robot's, or one mission's."""

    __tablename__ = "knowledge_base"
    __table_args__ = (UniqueConstraint("name"),)

    id = key_column(0)
    name = column(str, ShortText)


class HeadRow(Base):
    """The state of a knowledge base. Writers lock this row, so it is apart from the identity."""

    __tablename__ = "head"
    __table_args__ = (ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),)

    kb_id = kb_column()
    revision = column(int, comment="the last revision; 0: none yet")
    definition_revision = column(
        int, comment="the last revision that changed anything but propositions"
    )
    next_id = column(int, comment="the id that the next element gets")
    hash = optional(str, comment="of the last revision")
    committed_at = optional(datetime, comment="of the last revision")
    archived_revision = column(
        int,
        server_default=text("0"),
        comment="what ended up to this revision is in an archive; 0: nothing is",
    )
    origin = optional(
        str,
        comment="the store that it is replicated from: a URL without its password; "
        "NULL: written here",
    )
    origin_revision = optional(int, comment="the origin's last revision, as last heard of")
    origin_committed_at = optional(datetime, comment="UTC, of the origin's last revision")
    heard_at = optional(datetime, comment="UTC, when the origin was last heard of")


# The numbers of a head before the first revision. All else in it is NULL.
EMPTY_HEAD = {"revision": 0, "definition_revision": 0, "next_id": 1, "archived_revision": 0}


class RevisionRow(Base):
    """Who changed the knowledge base, when and why; `docs/hash.md` says what `hash` covers."""

    __tablename__ = "revision"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        CheckConstraint("number > 0", name="number_positive"),
        Index("ix_revision_committed_at", "kb_id", "committed_at"),
    )

    kb_id = kb_column()
    number = key_column(-90, "1, 2, 3 ... without gaps")
    committed_at = column(datetime, comment="UTC, never going back")
    actor = optional(str, comment="the component that wrote")
    reason = optional(str)
    source = optional(str, CanonicalJson, comment="what the caller knows: sensor, plan step ...")
    form = column(int, Integer, comment="version of the form that was hashed")
    hash = column(str, comment="SHA-256, chained to the revision before")
    observed_at = optional(datetime, comment="UTC, when what it says was sensed; NULL: not said")


class ArchiveRow(Record, Base):
    """A move of closed versions into another store."""

    __tablename__ = "archive"
    __table_args__ = record_args("archive", "upto")

    revision = column(int, comment="the versions that ended up to this revision were moved")
    target = column(str, comment="where to: a URL without its password")
    versions = column(int, comment="how many were moved")
    rest = column(str, comment="SHA-256 of what this store keeps of the revisions up to there")


class PromotionRow(Record, Base):
    """A replica that became a knowledge base of its own."""

    __tablename__ = "promotion"
    __table_args__ = record_args("promotion", "last")

    revision = column(int, comment="the last one that was replicated")
    origin = column(str, comment="where it was replicated from: a URL without its password")


class VerificationRow(Base):
    """Up to which revision a knowledge base was verified."""

    __tablename__ = "verification"
    __table_args__ = (ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),)

    kb_id = kb_column()
    revision = column(int, comment="verified up to this revision")
    hash = column(str, comment="of that revision, at that time")
    verified_at = column(datetime, comment="UTC, when that was")
    complete_at = optional(
        datetime,
        comment="UTC, when a verification that began at revision 1 last ended; NULL: none did",
    )
