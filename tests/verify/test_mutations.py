"""Verification finds each change of the tables."""

from __future__ import annotations

import pytest

from tests.support.pages import Page
from tests.support.profile import PROFILE
from tests.verify.bare import TABLES, Bare
from tests.verify.mutations import ERASED, UNCOVERED, Mutation, mutations

UNUSED = "a name without a version is part of no state; archives leave such names"
ORIGIN = "the origin of a replica is not part of its history"
ORIGIN_COLUMNS = "origin", "origin_revision", "origin_committed_at", "heard_at"
# Changes that verification cannot detect, and why; `docs/verify.md` has the same table.
UNDETECTED = {
    **{("head", column): ORIGIN for column in ORIGIN_COLUMNS},
    ("head", "next_id"): "any number above all assigned ids is valid, because some may be unused",
    ("proposition", "is_goal"): "if all versions are in an archive, which has the right value",
    **{
        (table, "insert"): UNUSED
        for table in ("type", "object", "predicate", "function", "action", "formula", "rule")
    },
}


def is_found(bare: Bare, mutation: Mutation) -> bool:
    with bare.tampering():
        mutation.apply(bare)
        return not bare.is_intact()


def test_the_story_has_a_row_in_each_table(full: Bare) -> None:
    """So that each column of a new table is among the mutations."""
    assert {table for table in TABLES if not full.rows(table)} <= UNCOVERED | ERASED


@pytest.mark.more
def test_every_column_of_every_table_and_every_row_that_is_deleted_or_doubled(full: Bare) -> None:
    with full.tampering():
        assert full.findings() == []
        chosen = list(mutations(full))
    # On PostgreSQL a statement takes longer, and what checks is the same.
    is_sample = full.session.placeholder != "?" and PROFILE.rows_step > 1
    if is_sample:
        chosen = chosen[:: PROFILE.rows_step]
    missed = {(each.table, each.column) for each in chosen if not is_found(full, each)}
    if is_sample:
        assert missed <= UNDETECTED.keys()
    else:
        assert missed == {*UNDETECTED}, sorted(missed ^ UNDETECTED.keys())


@pytest.mark.more
def test_the_docs_list_what_is_not_detected() -> None:
    text = Page("verify.md").text
    for (table, column), reason in UNDETECTED.items():
        assert f"| `{table}` | `{column}` | {reason} |" in text
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) == len(UNDETECTED)
