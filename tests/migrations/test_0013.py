"""Migration 0013 adds a table for requests, which goes again with what is in it."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, rows_of, run_script, written

WRITTEN = "INSERT INTO request VALUES (1, 'of a key', 12, 'of a request', '[true]')"


def test_requests_have_a_table_until_the_version_before_comes_back(make: Make) -> None:
    url = make(written("store"))
    kant_sql.upgrade(url, revision="0012")
    before = rows_of(url)
    kant_sql.upgrade(url, revision="0013")
    run_script(url, WRITTEN)
    assert rows_of(url).keys() - before.keys() == {"request"}
    kant_sql.operations.downgrade(url, revision="0012")
    assert rows_of(url) == before
