"""What was said of a time that is over, and what an erasure leaves.

Revisions get a seed, from which form 2 of their hash derives its salts.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")
WITHOUT_ROWID = {"proposition_saying", "function_value_saying", "replacement"}
SEED = "16 random bytes that the salts of its texts are made of; NULL: form 1, or erased"


def upgrade() -> None:
    """Bring the tables to this version."""
    op.add_column("revision", sa.Column("seed", sa.LargeBinary(), nullable=True, comment=SEED))
    for made in _tables():
        _first()._create(made)


def downgrade() -> None:
    """Bring the tables back to the version before."""
    if context.get_revision_argument() is not None:
        _refuse_to_lose()
    for made in reversed(_tables()):
        op.execute(sa.schema.DropTable(made))
    op.drop_column("revision", "seed")


def _refuse_to_lose() -> None:
    """Refuse where a revision is hashed in a form that the version before does not know."""
    if context.is_offline_mode():
        raise CommandError("a downgrade below 0010 looks for revisions: run it without --sql")
    count = op.get_bind().scalar(sa.text("SELECT count(*) FROM revision WHERE form > 1"))
    if count:
        raise CommandError(
            f"version {down_revision} cannot verify revisions of form 2 ({count}); nothing was "
            "changed"
        )


def _first() -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision("0001").module


def _tables() -> list[sa.Table]:
    """Make the new tables, as the first version makes its own."""
    first: Any = _first()
    before = {*first.METADATA.tables}
    _sayings(first)
    _erasures(first)
    made = [table for table in first.METADATA.sorted_tables if table.name not in before]
    for table in made:
        # The first version creates and drops all that are there.
        first.METADATA.remove(table)
        table.dialect_options["sqlite"]["with_rowid"] = table.name not in WITHOUT_ROWID
    return made


def _saying(first: Any, element: str, owner: str, *columns: Any, **last: Any) -> None:
    table = f"{element}_saying"
    first._table(
        table,
        first._key(f"{element}_id"),
        first._key("since", comment="said in this revision"),
        first._column("valid_from", UTC_TIME, "UTC, where the period begins"),
        first._column("valid_until", UTC_TIME, "UTC, where it is over"),
        first._column(f"{owner}_id"),
        *columns,
        first._column("fork", comment="of its seconds since the year 1, as of a version"),
        first._text("canonical PDDL, with the period"),
        first._reference(f"{element}_id", element),
        first._to_revision("since", at_commit=True),
        sa.CheckConstraint("valid_from < valid_until", name="period"),
        first._index(table, "valid", f"{owner}_id", "fork", "valid_from"),
        first._index(table, "since", "since"),
        *last.values(),
    )


def _sayings(first: Any) -> None:
    optional = first._optional
    _saying(
        *(first, "proposition", "predicate"),
        first._column("holds", sa.Boolean(), "whether it held"),
        optional("first_object_id", comment="its first argument; NULL: it has none"),
        optional("second_object_id", comment="its second argument; NULL: it has fewer"),
    )
    _saying(
        *(first, "function_value", "function"),
        optional("value", LONG_TEXT, "the number, as exact decimal text"),
        optional("number", sa.Double(), "the number, as near as a double comes"),
        optional("object_id", comment="the object that it was"),
        object=first._reference("object_id", "object"),
        number=sa.CheckConstraint("(value IS NULL) = (number IS NULL)", name="number_of_value"),
        value=sa.CheckConstraint("value IS NULL OR object_id IS NULL", name="value_or_object"),
        index=first._partial(
            *("function_value_saying", "object", "object_id"), where="object_id IS NOT NULL"
        ),
    )


def _erasures(first: Any) -> None:
    column, optional = first._column, first._optional
    first._record(
        *("erasure", "upto"),
        column("revision", comment="in revisions up to this one"),
        column("kind", sa.String(16), "object, or actor, reason or source of revisions"),
        optional("element_id", comment="the object; NULL: texts of revisions"),
        column("pseudonym", LONG_TEXT, "what is there now"),
        column("parts", comment="how many texts were erased"),
        column("digest", LONG_TEXT, "SHA-256 of their commitments, and of what took their places"),
    )
    first._table(
        "commitment",
        first._key("number", comment="the revision"),
        first._place(
            "position",
            "among its changes, from 0; -1 source, -2 reason, -3 actor; -4: all, of form 1",
        ),
        column("sign", sa.String(1), "+ asserted, - retracted; empty: no change"),
        column("kind", sa.String(20), "of the change, or actor, reason, source, revision"),
        column("owner_id", comment="the element; of an execution, its plan; 0: no change"),
        column("place", sa.Integer(), "of an execution, its position; else 0"),
        optional("salt", sa.LargeBinary(), "of what is kept; NULL: erased"),
        optional("commitment", LONG_TEXT, "of what is erased; NULL: that of the text"),
        optional("erasure_id", comment="what erased it; NULL: it is kept"),
        first._to_revision("number"),
        sa.CheckConstraint("(salt IS NULL) <> (erasure_id IS NULL)", name="kept_or_erased"),
        sa.CheckConstraint(
            "(commitment IS NULL) = (erasure_id IS NULL)", name="commitment_of_erased"
        ),
        first._partial("commitment", "erasure", "erasure_id", where="erasure_id IS NOT NULL"),
    )
    erased = ("kb_id", "number", "position")
    first._table(
        "replacement",
        first._key("number", comment="the revision"),
        first._place("position", "as in commitment"),
        first._key("erasure_id", comment="what erased it"),
        optional(
            "salt", sa.LargeBinary(), "of the text that is there now; NULL: it was replaced again"
        ),
        optional("commitment", LONG_TEXT, "to what was there; NULL: to the text that is there now"),
        sa.ForeignKeyConstraint(erased, [f"commitment.{name}" for name in erased]),
        sa.CheckConstraint("(salt IS NULL) <> (commitment IS NULL)", name="salt_or_commitment"),
        first._index("replacement", "erasure", "erasure_id"),
    )
