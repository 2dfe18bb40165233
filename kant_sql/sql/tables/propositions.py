"""PDDL propositions: facts and goals."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    ForeignKeyConstraint,
    Index,
    Integer,
    UniqueConstraint,
    false,
    text,
)
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    LIVE,
    Base,
    LongText,
    Version,
    fork_column,
    kb_column,
    lookup_index,
    owner_column,
    partial_index,
    version_args,
)


class PropositionRow(Base):
    """A ground atom as a fact or as a goal, interned once for ever."""

    __tablename__ = "proposition"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "predicate_id"], ["predicate.kb_id", "predicate.id"]),
        UniqueConstraint(
            "kb_id", "is_goal", "predicate_id", "arguments", name="uq_proposition_atom"
        ),
        lookup_index("proposition", "text"),
    )

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    predicate_id: Mapped[int] = mapped_column(BigInteger)
    is_goal: Mapped[bool] = mapped_column(Boolean)
    arguments: Mapped[str] = mapped_column(
        LongText, comment="the ids of its objects in order, by spaces: the key that interns it"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class PropositionArgumentRow(Base):
    """An argument of a ground atom."""

    __tablename__ = "proposition_argument"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "proposition_id"], ["proposition.kb_id", "proposition.id"]),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        Index("ix_proposition_argument_object", "kb_id", "object_id", "proposition_id"),
    )

    kb_id: Mapped[int] = kb_column()
    proposition_id: Mapped[int] = owner_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, comment="from 0"
    )
    object_id: Mapped[int] = mapped_column(BigInteger)


def _goal_index(name: str, *columns: str) -> Index:
    # SQLite uses a partial index only where a query repeats its very condition: this is how
    # SQLAlchemy writes a boolean column for it.
    return Index(name, *columns, sqlite_where=text("is_goal = 1"), postgresql_where=text("is_goal"))


class PropositionVersionRow(Version, Base):
    """When a fact held, or a goal stood: one thin row for each time."""

    __tablename__ = "proposition_version"
    __table_args__ = (
        *version_args("proposition", has_parts=False),
        ForeignKeyConstraint(["kb_id", "predicate_id"], ["predicate.kb_id", "predicate.id"]),
        # `until` is in the index so that it covers what is read of a predicate now.
        partial_index(
            "ix_proposition_version_now",
            "kb_id",
            "predicate_id",
            "proposition_id",
            "until",
            where=LIVE,
        ),
        Index(
            "ix_proposition_version_history",
            "kb_id",
            "predicate_id",
            "fork",
            "since",
            "until",
            "proposition_id",
        ),
        # Goals are few among many facts, and those that stand few among those that ever did.
        _goal_index("ix_proposition_version_goal", "kb_id", "until", "since", "proposition_id"),
        _goal_index(
            "ix_proposition_version_goal_history",
            "kb_id",
            "fork",
            "since",
            "until",
            "proposition_id",
        ),
        # Finds the latest goals without reading facts.
        _goal_index("ix_proposition_version_goal_since", "kb_id", "since"),
    )

    proposition_id: Mapped[int] = owner_column()
    predicate_id: Mapped[int] = mapped_column(BigInteger)
    is_goal: Mapped[bool] = mapped_column(Boolean, server_default=false())
    fork: Mapped[int] = fork_column()
