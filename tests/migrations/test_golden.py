"""The schema that the migrations make: the one on record, and the one that the models describe.

Of the last version, the record is its text; of each version, a digest, for it never changes again.
When a migration is added, this command writes both; read what changed before you commit it:

    KANT_SQL_TEST_GOLDEN=write python -m pytest tests/migrations/test_golden.py
"""

from __future__ import annotations

import io
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, create_engine, make_url, text

import kant_sql
from kant_sql.sql.dialects import postgresql_structure
from kant_sql.sql.dialects import sqlite as sqlite_structure
from kant_sql.sql.schema import VERSIONS, current, migrations_folder, upgrade_sql
from kant_sql.sql.tables.base import VERSION_TABLE, with_dialects

pytestmark = pytest.mark.usefixtures("real_migrations")

FOLDER = migrations_folder() / "golden"
DIGESTS = FOLDER / "versions.txt"
DESCRIBE = {"sqlite": sqlite_structure.describe, "postgresql": postgresql_structure.describe}
WRITE = os.environ.get("KANT_SQL_TEST_GOLDEN") == "write"


@contextmanager
def connected(url: str) -> Iterator[Connection]:
    drivers = {"postgresql": "postgresql+psycopg"}
    named = make_url(url)
    engine = create_engine(named.set(drivername=drivers.get(named.drivername, named.drivername)))
    with engine.begin() as connection:
        yield connection
    engine.dispose()


def dump_of(url: str, without: Collection[str] = ()) -> str:
    """The schema as text; `without` has tables to leave out, or `views` for all views."""
    with connected(url) as connection:
        found = [
            *DESCRIBE[connection.dialect.name](
                lambda sql: [tuple(row) for row in connection.execute(text(sql))]
            )
        ]
    return "".join(
        f"{each.text}\n"
        for each in found
        if each.relation not in without
        and not ("views" in without and each.head.startswith("CREATE VIEW"))
    )


def test_a_store_that_is_created_is_one_that_was_migrated(tmp_path: Path) -> None:
    created, migrated = (f"sqlite:///{tmp_path / name}.db" for name in ("created", "migrated"))
    kant_sql.connect(created).close()
    kant_sql.upgrade(migrated)
    assert dump_of(created) == dump_of(migrated)
    assert current(created) == current(migrated) == VERSIONS[-1]


def digest_of(url: str) -> str:
    return sha256(dump_of(url).encode()).hexdigest()


def digests() -> dict[str, str]:
    """The digests on record, by dialect and version."""
    lines = DIGESTS.read_text(encoding="utf-8").splitlines()
    return {name: digest for digest, name in map(str.split, lines)}


def test_the_schema_of_the_last_version_is_the_one_on_record(empty_url: str) -> None:
    kant_sql.upgrade(empty_url)
    live, dialect = dump_of(empty_url), make_url(empty_url).get_backend_name()
    record = FOLDER / f"{dialect}.sql"
    if WRITE:
        record.write_text(live, encoding="utf-8")
        known = digests() | {f"{dialect}-{VERSIONS[-1]}": digest_of(empty_url)}
        lines = (f"{digest}  {name}\n" for name, digest in sorted(known.items()))
        DIGESTS.write_text("".join(lines), encoding="utf-8")
    assert live == record.read_text(encoding="utf-8"), (
        f"the migrations make another schema than {record} says. If that is meant, run "
        "KANT_SQL_TEST_GOLDEN=write python -m pytest tests/migrations/test_golden.py"
    )


@pytest.mark.more
@pytest.mark.parametrize("version", VERSIONS)
def test_the_schema_of_no_version_changes(empty_url: str, version: str) -> None:
    kant_sql.upgrade(empty_url, revision=version)
    name = f"{make_url(empty_url).get_backend_name()}-{version}"
    assert digest_of(empty_url) == digests()[name], (
        f"migrations that have landed are frozen, and {name} is another schema than it was"
    )


def test_the_models_make_the_schema_that_the_migrations_make(
    empty_url: str, second_empty_url: str
) -> None:
    kant_sql.upgrade(empty_url)
    with connected(second_empty_url) as connection:
        with_dialects().create_all(connection)
    # The models have no views.
    assert dump_of(second_empty_url) == dump_of(empty_url, without=[VERSION_TABLE, "views"])


def test_the_sql_that_is_written_offline_makes_the_same_schema(
    empty_url: str, second_empty_url: str
) -> None:
    kant_sql.upgrade(empty_url)
    out = io.StringIO()
    upgrade_sql(second_empty_url, out)
    with connected(second_empty_url) as connection:
        driver: Any = connection.connection.driver_connection
        if connection.dialect.name == "sqlite":
            driver.executescript(out.getvalue())
        else:
            driver.autocommit = True
            driver.execute(out.getvalue())
    assert dump_of(second_empty_url) == dump_of(empty_url)
