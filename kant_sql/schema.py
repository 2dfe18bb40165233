"""The version of the tables: checked when a store is opened, changed only by migrations.

Alembic runs the migrations; it is imported only when one is to be run.
"""

from __future__ import annotations

import io
import logging
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from sqlalchemy import column, select, table
from sqlalchemy.exc import DBAPIError

from .arguments import expect, shown
from .backends import Backend, Query, Session, backend_name, create_backend
from .errors import (
    InvalidArgumentError,
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
BASE = "base"
# Where the migrations' environment leaves how many views of predicates it has dropped.
DROPPED_VIEWS = "dropped_views"
# Oldest first; the last is what this version of the library works on.
VERSIONS = ("0001", "0002", "0003", "0004", "0005", "0006")

_VERSION = Query(select(column("version_num")).select_from(table(VERSION_TABLE)))
_MIGRATING = threading.Lock()
logger = logging.getLogger(__name__)


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
    expect(revision, str, "revision", InvalidArgumentError)
    with _backend(url) as backend:
        _upgrade(backend, revision if revision == "head" else _later(backend, revision))


def downgrade(url: str, *, revision: str) -> None:
    """Bring the tables back to an earlier version.

    Args:
        url: the database URL.
        revision: the version to go back to, or as `-1` how many versions; `base` drops the tables
            and all that they hold.

    Raises:
        SchemaError: there is no such version, or it is later than the one that the tables have, or
            it has no place for something that is stored; nothing was changed.
        StoreError: the database refused; nothing was changed.
    """
    from alembic import command

    expect(revision, str, "revision", InvalidArgumentError)
    with _backend(url) as backend:
        target = _earlier(backend, revision)
        if target is not None:
            _migrate(backend, lambda config: command.downgrade(config, target))


def earlier_version(url: str, revision: str) -> str | None:
    """Tell which version `downgrade` would go back to. Nothing is changed.

    Args:
        url: the database URL.
        revision: as for `downgrade`.

    Returns:
        The version, or `base`; None when the tables are there already.

    Raises:
        SchemaError: there is no such version, or it is later than the one that the tables have.
        StoreError: the database cannot be opened.
    """
    with _backend(url) as backend:
        return _earlier(backend, revision)


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


def report_dropped_views(config: Config) -> None:
    """Log how many views of predicates a migration has dropped, when it is committed.

    Args:
        config: the configuration that the migration was run with.
    """
    if count := config.attributes.get(DROPPED_VIEWS):
        logger.warning(
            "%d views of predicates are dropped, for tables that have them cannot be changed; "
            "when the tables are up to date, make them anew with: kant-sql views",
            count,
        )


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


def _earlier(backend: Backend, revision: str) -> str | None:
    """Find the version to go back to; None when the tables are there already."""
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
    """Find the version to go on to."""
    places, here = _places(backend)
    on = re.fullmatch(r"\+([1-9]\d{0,3})", str(revision))
    there = here + int(on[1]) if on else _index(places, revision)
    if there is None or not 0 < there < len(places):
        raise _no_version(backend, revision, "go on to", places[max(1, here) :])
    return places[there]


def _places(backend: Backend) -> tuple[tuple[str, ...], int]:
    """Give all versions, and the position of the one that the tables have."""
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
        # Alembic keeps the migration under way in module globals: one at a time in a process.
        with _MIGRATING, backend.migration_connection() as connection:
            config.attributes["connection"] = connection
            config.attributes["label"] = backend.label
            run(config)
        # Only now: a migration that fails leaves the views as they were.
        report_dropped_views(config)
    except CommandError as error:
        version = _current(backend)
        if version is not None and version not in VERSIONS:
            _judge(backend, version)
        raise SchemaError(f"{backend.label}: {error}") from error
    except DBAPIError as error:
        driver_error = error.orig if isinstance(error.orig, Exception) else error
        raise backend.translate_connect(driver_error) from error
