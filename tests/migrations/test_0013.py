"""Migration 0013 adds a table for requests: what was stored stays, and the table goes again."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, record, rows_of, run_script
from tests.migrations.test_0011_and_0012 import write_0011
from tests.migrations.test_golden import digest_of

WRITTEN = "INSERT INTO request VALUES (1, 'of a key', 12, 'of a request', '[true]')"


def write_0012(url: str) -> None:
    """Create a store of version 0012."""
    write_0011(url)
    kant_sql.upgrade(url, revision="0012")


def test_requests_have_a_table_until_the_version_before_comes_back(make: Make) -> None:
    url = make(write_0012)
    before = rows_of(url)
    kant_sql.upgrade(url, revision="0013")
    assert (rows_of(url), digest_of(url)) == (before, record("0013", url))
    run_script(url, WRITTEN)
    assert rows_of(url).keys() - before.keys() == {"request"}
    kant_sql.operations.downgrade(url, revision="0012")
    assert (rows_of(url), digest_of(url)) == (before, record("0012", url))
