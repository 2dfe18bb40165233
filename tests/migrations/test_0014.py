"""Migration 0014 adds indexes of what was said; rows and what was true stay as they were."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, record, rows_of
from tests.migrations.test_0011 import RECTANGLES, write_0010
from tests.migrations.test_golden import digest_of
from tests.support.pages import ask


def test_sayings_are_found_by_their_arguments_until_the_version_before_is_back(make: Make) -> None:
    url = make(write_0010)
    kant_sql.upgrade(url, revision="0013")
    before, periods = rows_of(url), ask(url, RECTANGLES)
    kant_sql.upgrade(url, revision="0014")
    assert (rows_of(url), digest_of(url)) == (before, record("0014", url))
    assert ask(url, RECTANGLES) == periods != []
    kant_sql.operations.downgrade(url, revision="0013")
    assert (rows_of(url), digest_of(url)) == (before, record("0013", url))
