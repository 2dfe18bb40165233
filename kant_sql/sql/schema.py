"""The version of the tables, which only migrations change, and the roles of a database.

Alembic runs the migrations; it is imported on first use.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from sqlalchemy import Connection, column, inspect, select, table
from sqlalchemy.exc import DBAPIError

from ..arguments import expect, flag, optional_text, shown
from ..errors import (
    InvalidArgumentError,
    SchemaError,
    SchemaMissingError,
    SchemaOutdatedError,
    SchemaTooNewError,
    TableMissingError,
)
from .dialects import backend_name, create_backend
from .dialects.base import Backend, Roles, Session, retrying, unforked
from .dialects.structure import Statement, ViewDialect, parse_record
from .query import Query
from .tables.base import VERSION_TABLE

if TYPE_CHECKING:
    from alembic.config import Config


BASE = "base"
# Config attribute in which `migrations/env.py` counts the generated views that it dropped.
DROPPED_VIEWS = "dropped_views"
# Oldest first; the last is what this version of the library works on.
VERSIONS = (*(f"{number:04}" for number in range(1, 16)),)

_VERSION = Query(select(column("version_num")).select_from(table(VERSION_TABLE)))
# Alembic's context is a module global: one migration at a time in a process. A child process must
# not use its connection, either.
_MIGRATING = unforked()
logger = logging.getLogger("kant_sql.schema")


def ensure_schema(backend: Backend) -> None:
    """Check the tables' version with one SELECT, and create them in an empty SQLite store."""
    if backend.is_read_only:
        _require_store(backend)
        _judge(backend, _current(backend))
        return
    with backend.open_session() as session:
        version = _read_version(session)
        empty = version is None and backend.is_empty(session)
        if version is None and not empty:
            # Another process may have created the tables in between.
            version = _read_version(session)
    if empty:
        retrying(backend, lambda: _create(backend))
    else:
        _judge(backend, version)


def _create(backend: Backend) -> None:
    """Create the tables from the recorded schema: the migrations would take 0.3 s."""
    with _migrating(backend) as connection:
        if inspect(connection).has_table(VERSION_TABLE):
            # Another process has created them meanwhile.
            return
        for statement in recorded(backend.dialect.name):
            connection.exec_driver_sql(statement.text)
        connection.exec_driver_sql(f"INSERT INTO {VERSION_TABLE} VALUES ('{VERSIONS[-1]}')")
    logger.info("%s: created the tables of version %s", backend.label, VERSIONS[-1])


def recorded(dialect_name: str) -> list[Statement]:
    """Return the recorded schema of the migrations."""
    path = migrations_folder() / "golden" / f"{dialect_name}.sql"
    return parse_record(path.read_text(encoding="utf-8"))


def current(url: str) -> str | None:
    """Return the version of the tables. Neither this nor `check` creates anything."""
    with closing(create_backend(url)) as backend:
        return _current(backend)


def check(url: str) -> None:
    """Check that the tables have the version that this library needs."""
    with closing(create_backend(url)) as backend:
        _require_store(backend)
        _judge(backend, _current(backend))


def check_placement(url: str) -> None:
    """Check that all tables of a store on several servers are in their place."""
    with closing(create_backend(url)) as backend:
        fault = backend.layout_fault()
        if fault is not None:
            raise SchemaError(f"{backend.label}: {fault}")


def require_store(url: str) -> None:
    """Check that the database exists, with any content."""
    with closing(create_backend(url)) as backend:
        _require_store(backend)


def check_session(session: Session) -> None:
    """Check, in a session, that the tables have the version that this library needs."""
    _judge(session.backend, _read_version(session))


def upgrade(url: str, *, revision: str = "head") -> None:
    """Create the tables, or migrate them to a later version. Stored knowledge survives.

    Args:
        url: the database URL.
        revision: the version to reach.

    Raises:
        SchemaError: there is no such version, or the tables are newer than this library.
        StoreBusyError: a session, which the message names, holds a table's lock.
        StoreError: the database refused; nothing was changed.
    """
    expect(revision, str, "revision", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        _upgrade(backend, revision if revision == "head" else _later(backend, revision))


def downgrade(url: str, *, revision: str) -> None:
    """Migrate the tables back to an earlier version.

    Args:
        url: the database URL.
        revision: the version to go back to, or a number of versions such as `-1`; `base` drops the
            tables with all their content.

    Raises:
        SchemaError: there is no such version, it is later than the tables', or it cannot store some
            present elements; nothing was changed.
        StoreError: the database refused; nothing was changed.
    """
    from alembic import command

    expect(revision, str, "revision", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        target = _earlier(backend, revision)
        if target is not None:
            _migrate(backend, lambda config: command.downgrade(config, target))


def earlier_version(url: str, revision: str) -> str | None:
    """Return the version that `downgrade` would go back to."""
    with closing(create_backend(url)) as backend:
        return _earlier(backend, revision)


def upgrade_sql(url: str, out: TextIO) -> None:
    """Write the SQL that creates the tables, without a connection."""
    from alembic import command

    backend_name(url)
    config = alembic_config(out)
    config.attributes["url"] = url
    with _MIGRATING:
        command.upgrade(config, "head", sql=True)


def alembic_config(out: TextIO | None = None) -> Config:
    """Build Alembic's configuration for the migrations that ship with the library."""
    from alembic.config import Config

    config = Config(output_buffer=out or io.StringIO(), stdout=io.StringIO())
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


def drop_generated_views(connection: Connection, views: ViewDialect) -> int:
    """Drop all generated views and count them: a table that has a view cannot be changed."""
    names = sorted(views.list_generated(connection))
    for name in names:
        connection.exec_driver_sql(views.drop(name))
    return len(names)


def report_dropped_views(config: Config) -> None:
    """Log how many generated views a committed migration dropped."""
    if count := config.attributes.get(DROPPED_VIEWS):
        logger.warning(
            "%d views of predicates are dropped, for tables that have them cannot be changed; "
            "when the tables are up to date, create them again with: kant-sql views",
            count,
        )


def migrations_folder() -> Path:
    """Find the migrations: in the installed package, or beside it in a clone."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "migrations"
    return installed if installed.is_dir() else package.parent / "migrations"


def _require_store(backend: Backend) -> None:
    if not backend.exists():
        # Only a file can be missing. Its absolute path reveals a missing slash or a wrong folder.
        path = Path(str(backend.url.database)).absolute()
        raise SchemaMissingError(
            f"{backend.label}: no such file: {path}; check the path and its slashes"
        )


def _current(backend: Backend) -> str | None:
    if not backend.exists():
        return None
    with backend.open_session() as session:
        return _read_version(session)


def _earlier(backend: Backend, revision: str) -> str | None:
    """Find the version to go back to; None when the tables have it."""
    places, here = _places(backend)
    back = re.fullmatch(r"-([1-9]\d{0,3})", str(revision))
    there = here - int(back[1]) if back else _index(places, revision)
    if there is None or there < 0:
        raise _no_version(backend, revision, "go back to", places[: here + 1])
    if there > here:
        raise SchemaError(
            f"{backend.label}: the tables are of version {places[here]}, which is before "
            f"{revision}; nothing was changed"
        )
    return None if there == here else places[there]


def _later(backend: Backend, revision: str) -> str:
    """Find the version to migrate to."""
    places, here = _places(backend)
    on = re.fullmatch(r"\+([1-9]\d{0,3})", str(revision))
    there = here + int(on[1]) if on else _index(places, revision)
    if there is None or not 0 < there < len(places):
        raise _no_version(backend, revision, "go on to", places[max(1, here) :])
    return places[there]


def _places(backend: Backend) -> tuple[tuple[str, ...], int]:
    """Return all versions, and the position of the tables' version."""
    places, version = (BASE, *VERSIONS), _current(backend)
    if version is not None and version not in VERSIONS:
        _judge(backend, version)
    return places, places.index(version or BASE)


def _index(places: tuple[str, ...], revision: str) -> int | None:
    return places.index(revision) if revision in places else None


def _no_version(backend: Backend, revision: str, verb: str, places: tuple[str, ...]) -> SchemaError:
    return SchemaError(
        f"{backend.label}: there is no version {shown(revision)} to {verb}, only "
        f"{', '.join(places)}; nothing was changed"
    )


def _read_version(session: Session) -> str | None:
    try:
        row = session.first(_VERSION)
    except TableMissingError:
        return None
    return str(row[0]) if row else None


def _judge(backend: Backend, version: str | None) -> None:
    if version == VERSIONS[-1]:
        return
    command = f"kant-sql db upgrade '{backend.label}'"
    if version is None:
        raise SchemaMissingError(
            f"{backend.label}: there are no kant_sql tables in this database; "
            f"create them with: {command}"
        )
    if version in VERSIONS:
        raise SchemaOutdatedError(
            f"{backend.label}: the tables are of version {version}, this library needs "
            f"{VERSIONS[-1]}; make a copy, then run: {command}"
        )
    raise SchemaTooNewError(
        f"{backend.label}: the tables are of version {version}, this library knows up to "
        f"{VERSIONS[-1]}; install a newer kant-sql"
    )


def _upgrade(backend: Backend, revision: str) -> None:
    from alembic import command

    _migrate(backend, lambda config: command.upgrade(config, revision))


def _migrate(backend: Backend, run: Callable[[Config], None]) -> None:
    retrying(backend, lambda: _migrate_once(backend, run))


def _migrate_once(backend: Backend, run: Callable[[Config], None]) -> None:
    from alembic.util import CommandError

    config = alembic_config()
    try:
        with _migrating(backend) as connection:
            config.attributes["connection"] = connection
            config.attributes["label"] = backend.label
            run(config)
        # After the commit: a failed migration leaves the views unchanged.
        report_dropped_views(config)
    except CommandError as error:
        version = _current(backend)
        if version is not None and version not in VERSIONS:
            _judge(backend, version)
        raise SchemaError(f"{backend.label}: {error}") from error


@contextmanager
def _migrating(backend: Backend) -> Iterator[Connection]:
    """Open a migration's connection; translate errors of the driver, which SQLAlchemy wraps."""
    try:
        with _MIGRATING, backend.migration_connection() as connection:
            yield connection
    except DBAPIError as error:
        driver_error = error.orig if isinstance(error.orig, Exception) else error
        raise backend.translate_connect(driver_error) from error


def create_roles(url: str, *, knowledge_base: str | None = None, dry_run: bool = False) -> Roles:
    """Create the roles of a PostgreSQL database, or update them.

    `kant_sql_writer` adds revisions and cannot change past ones, `kant_sql_reader` reads tables and
    views, `kant_sql_auditor` reads views, `kant_sql_eraser` writes and may erase.
    Users get these rights as members of the roles.

    Args:
        url: the database URL of the owner of the tables.
        knowledge_base: one for which to create four more roles, limited to it.
        dry_run: whether to return the statements without running them.

    Returns:
        The four roles, the statements, and statements that only the database's owner or a superuser
        may run.

    Raises:
        KantSqlError: there is no such knowledge base.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreBusyError: a session, which the message names, holds a table's lock; nothing was
            changed.
        StoreError: the database has no roles (SQLite) or refused; nothing was changed.
    """
    optional_text(knowledge_base, "knowledge_base")
    flag(dry_run, "dry_run", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        if backend.no_roles is None:
            check(url)
        return retrying(backend, lambda: backend.create_roles(knowledge_base, dry_run))
