"""Names and keys, as the live database has them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import pytest
from sqlalchemy import Inspector, inspect

import kant_sql
from kant_sql.sql.tables.base import VERSION_TABLE
from tests.migrations.test_golden import connected

LONGEST = 63  # PostgreSQL cuts longer names off.


class Named(NamedTuple):
    """A constraint or an index."""

    prefix: str
    table: str
    name: str | None
    columns: list[str]
    target: Sequence[str] = ()

    def follows_the_convention(self) -> bool:
        return re.fullmatch(rf"{self.prefix}_{self.table}(_\w+)?", self.name or "") is not None


def read_named(inspector: Inspector) -> Iterator[Named]:
    for table in inspector.get_table_names():
        if table == VERSION_TABLE:
            continue
        key: Any = inspector.get_pk_constraint(table)
        yield Named("pk", table, key["name"], key["constrained_columns"])
        for foreign in inspector.get_foreign_keys(table):
            columns = foreign["constrained_columns"], foreign["referred_columns"]
            yield Named("fk", table, foreign["name"], *columns)
        for unique in inspector.get_unique_constraints(table):
            yield Named("uq", table, unique["name"], unique["column_names"])
        for check in inspector.get_check_constraints(table):
            yield Named("ck", table, check["name"], [])
        for index in inspector.get_indexes(table):
            prefix = "uq" if index["unique"] else "ix"
            yield Named(prefix, table, index["name"], [str(name) for name in index["column_names"]])


@pytest.fixture
def named(empty_url: str) -> list[Named]:
    kant_sql.upgrade(empty_url)
    with connected(empty_url) as connection:
        return list(read_named(inspect(connection)))


def test_every_constraint_and_index_has_a_name_of_the_convention(named: list[Named]) -> None:
    assert {item.prefix for item in named} == {"pk", "fk", "uq", "ck", "ix"}
    assert [item for item in named if not item.follows_the_convention()] == []


def test_no_name_is_longer_than_postgresql_keeps(named: list[Named]) -> None:
    assert [item for item in named if len(item.name or "") > LONGEST] == []


def test_every_key_and_index_starts_with_the_knowledge_base(named: list[Named]) -> None:
    """So that a fleet's store can be distributed by it, with the same schema."""
    others = [item for item in named if item.columns and item.columns[0] != "kb_id"]
    # An auditor asks for these; the index is a hash on PostgreSQL, which takes one column alone.
    asked = {"ix_proposition_text", "ix_function_value_text"}
    asked |= {"ix_object_name", "ix_predicate_name", "ix_function_name"}
    # It has the knowledge base, which distribution needs; see `PropositionVersionRow`.
    last = "uq_proposition_version_live"
    assert [item.columns for item in others if item.name == last] == [["proposition_id", "kb_id"]]
    assert {item.name for item in others} == {
        *("pk_knowledge_base", "uq_knowledge_base_name", last),
        *asked,
    }


ADDED = {"archive", "promotion", "verification", "erasure"}


def test_every_foreign_key_stays_in_its_knowledge_base(named: list[Named]) -> None:
    leading = {item.target[0] for item in named if item.prefix == "fk"}
    to_knowledge_base = {item.table for item in named if [*item.target] == ["id"]}
    assert leading == {"kb_id", "id"}
    identities = {"type", "object", "predicate", "function", "action", "formula", "rule"}
    identities |= {"document"}
    assert to_knowledge_base == {"head", "revision", "plan", *ADDED, *identities}
