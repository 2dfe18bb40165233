"""Locks of those who change tables, views or rights on PostgreSQL. None of them waits without end.

Who changes the schema first locks the table of the version, in a mode that needs more than the
right to read: a reader's login can neither take that lock nor keep others from it. The tables
themselves are locked last, when all that is to be done is known, and for each attempt only briefly:
an open transaction that has read a table keeps it from being changed for as long as it likes, and
whoever comes after the one who waits for it has to wait as well.
"""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import Connection, text

from ..tables import Base
from .postgresql_names import Names

VERSION_TABLE = "kant_sql_version"
# Nobody else is held up by who waits for another migration.
WAIT_FOR_SCHEMA = "10min"
# All others queue behind who waits for a table.
WAIT_FOR_TABLE = "500ms"

SCHEMA_OF_TABLES = text(
    "SELECT n.nspname FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE c.oid = to_regclass('{VERSION_TABLE}')"
)
_TABLES = text("SELECT tablename FROM pg_tables WHERE schemaname = :schema")
# Whose rights do not suffice to see when another's transaction began sees the rest.
_HOLDERS = text(
    "SELECT a.pid, a.usename, nullif(a.application_name, ''), "
    "extract(epoch FROM clock_timestamp() - a.xact_start)::bigint "
    "FROM pg_stat_activity AS a WHERE a.pid <> pg_backend_pid() AND EXISTS ("
    "SELECT FROM pg_locks AS l JOIN pg_class AS c ON c.oid = l.relation "
    "WHERE l.pid = a.pid AND l.granted AND l.database = a.datid "
    "AND a.datname = current_database() AND c.relname = ANY(:names)) "
    "ORDER BY a.xact_start NULLS LAST, a.pid LIMIT 3"
)


def lock_schema(run: Callable[[str], bool]) -> None:
    """Wait until nobody else changes the schema; then wait for tables only briefly.

    Args:
        run: runs a statement in the open transaction; gives whether its first row says true.
    """
    run(f"SET LOCAL lock_timeout = '{WAIT_FOR_SCHEMA}'")
    # Of two who create it, which is what a migration begins with, one waits and tries again.
    if run(f"SELECT to_regclass('{VERSION_TABLE}') IS NOT NULL"):
        run(f"LOCK TABLE {VERSION_TABLE} IN SHARE UPDATE EXCLUSIVE MODE")
    run(f"SET LOCAL lock_timeout = '{WAIT_FOR_TABLE}'")


def lock_tables(connection: Connection) -> None:
    """Lock all tables against everybody, before the first of them is changed.

    Args:
        connection: a connection of the tables' owner, in a transaction.
    """
    names = Names(connection.scalar(SCHEMA_OF_TABLES) or "public")
    there = {row[0] for row in connection.execute(_TABLES, {"schema": names.schema})}
    # Writers begin with the head: once it is held, none is in the middle of other tables.
    wanted = [name for name in ("head", *sorted(Base.metadata.tables)) if name in there]
    if wanted:
        listed = ", ".join(map(names.relation, dict.fromkeys(wanted)))
        connection.exec_driver_sql(f"LOCK TABLE {listed}")


def holders(connection: Connection) -> str:
    """Say who has tables locked.

    Args:
        connection: a connection to the database, in a transaction of its own.

    Returns:
        Up to three of them, the oldest first; empty when there are none any more.
    """
    names = [*Base.metadata.tables, VERSION_TABLE]
    return "; ".join(_shown(*row) for row in connection.execute(_HOLDERS, {"names": names}))


def _shown(pid: int, user: str | None, program: str | None, seconds: int | None) -> str:
    called = f" ({program})" if program else ""
    since = "" if seconds is None else f", in a transaction for {seconds} s"
    return f"process {pid} of user {user}{called}{since}"
