"""The version of the tables: checked when a store is opened, changed only by migrations.

Alembic runs the migrations; it is imported only when one is to be run.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from sqlalchemy import column, select, table
from sqlalchemy.exc import DBAPIError

from .backends import Backend, Query, Session, backend_name, create_backend
from .errors import (
    SchemaError,
    SchemaMissingError,
    SchemaOutdatedError,
    SchemaTooNewError,
    TableMissingError,
)
from .retry import retrying

if TYPE_CHECKING:
    from alembic.config import Config

VERSION_TABLE = "kant_sql_version"
# Oldest first; the last is what this version of the library works on.
VERSIONS = ("0001", "0002", "0003", "0004", "0005", "0006")

_VERSION = Query(select(column("version_num")).select_from(table(VERSION_TABLE)))
_MIGRATING = threading.Lock()


def ensure_schema(backend: Backend) -> None:
    """Check the tables' version with one SELECT, and create them in an empty SQLite store.

    Args:
        backend: the database.

    Raises:
        SchemaMissingError: there are no tables, and the store is not an empty SQLite one.
        SchemaOutdatedError: migrations are pending; the message names the command.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    with backend.open_session() as session:
        version = _read_version(session)
        empty = version is None and backend.is_empty(session)
        if version is None and not empty:
            # Another process may have created the tables between the two statements.
            version = _read_version(session)
    if empty:
        _upgrade(backend, "head")
    else:
        _judge(backend, version)


def current(url: str) -> str | None:
    """Tell the version of the tables. It creates nothing, nor does `check`.

    Args:
        url: the database URL.

    Returns:
        The version, or None when there are no tables.
    """
    with _backend(url) as backend:
        return _current(backend)


def check(url: str) -> None:
    """Check that the tables are of the version that this library works on.

    Args:
        url: the database URL.

    Raises:
        SchemaError: they are missing, outdated or too new; the message names the remedy.
    """
    with _backend(url) as backend:
        _require_store(backend)
        _judge(backend, _current(backend))


def require_store(url: str) -> None:
    """Check that there is a database, whatever is in it.

    Args:
        url: the database URL.

    Raises:
        SchemaMissingError: it names an SQLite file that does not exist.
    """
    with _backend(url) as backend:
        _require_store(backend)


def check_session(session: Session) -> None:
    """Check that the tables are of the version that this library works on, as a session sees them.

    Args:
        session: the database.

    Raises:
        SchemaError: they are missing, outdated or too new; the message names the remedy.
    """
    _judge(session.backend, _read_version(session))


def upgrade(url: str, *, revision: str = "head") -> None:
    """Create the tables, or bring them to a later version. What is stored survives.

    Args:
        url: the database URL.
        revision: the version to reach.

    Raises:
        SchemaError: there is no such version, or the tables are newer than this library.
        StoreBusyError: somebody keeps a table locked, which the message names.
        StoreError: the database refused; nothing was changed.
    """
    with _backend(url) as backend:
        _upgrade(backend, revision)


def downgrade(url: str, *, revision: str) -> None:
    """Bring the tables back to an earlier version.

    Args:
        url: the database URL.
        revision: the version to go back to; `base` drops the tables and all that they hold.

    Raises:
        SchemaError: there is no such version.
        StoreError: the database refused; nothing was changed.
    """
    from alembic import command

    with _backend(url) as backend:
        _migrate(backend, lambda config: command.downgrade(config, revision))


def upgrade_sql(url: str, out: TextIO) -> None:
    """Write the SQL that creates the tables, without a connection.

    Args:
        url: the database URL; only its dialect matters.
        out: where the SQL is written.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
    """
    from alembic import command

    backend_name(url)
    config = alembic_config(out)
    config.attributes["url"] = url
    with _MIGRATING:
        command.upgrade(config, "head", sql=True)


def alembic_config(out: TextIO | None = None) -> Config:
    """Make Alembic's configuration for the migrations that ship with the library.

    Args:
        out: where Alembic writes SQL; a buffer that is thrown away when not given.

    Returns:
        The configuration.
    """
    from alembic.config import Config

    config = Config(output_buffer=out or io.StringIO(), stdout=io.StringIO())
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


def migrations_folder() -> Path:
    """Find the migrations: in the installed package, or beside it in a clone.

    Returns:
        The folder.
    """
    package = Path(__file__).resolve().parent
    installed = package / "migrations"
    return installed if installed.is_dir() else package.parent / "migrations"


def _require_store(backend: Backend) -> None:
    if not backend.exists():
        # Only a file can be missing. Where it was looked for tells who has written one slash too
        # few, or is in another folder.
        path = Path(str(backend.url.database)).absolute()
        raise SchemaMissingError(
            f"{backend.label}: there is no such file, {path}; check the path and its slashes"
        )


def _current(backend: Backend) -> str | None:
    if not backend.exists():
        return None
    with backend.open_session() as session:
        return _read_version(session)


@contextmanager
def _backend(url: str) -> Iterator[Backend]:
    backend = create_backend(url)
    try:
        yield backend
    finally:
        backend.close()


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
        # Alembic keeps the migration under way in module globals: one at a time in a process.
        with _MIGRATING, backend.migration_connection() as connection:
            config.attributes["connection"] = connection
            config.attributes["label"] = backend.label
            run(config)
    except CommandError as error:
        version = _current(backend)
        if version is not None and version not in VERSIONS:
            _judge(backend, version)
        raise SchemaError(f"{backend.label}: {error}") from error
    except DBAPIError as error:
        driver_error = error.orig if isinstance(error.orig, Exception) else error
        raise backend.translate_connect(driver_error) from error
