"""Which backend a URL's dialect has."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

from sqlalchemy import URL, Connection, make_url
from sqlalchemy.exc import ArgumentError

from ..errors import InvalidUrlError
from .backend import Backend

BACKENDS = ("sqlite", "postgresql")


def dialect_name(url: str) -> str:
    """Read which dialect a database URL names.

    Args:
        url: the URL, for example `sqlite:///robot.db`.

    Returns:
        The dialect's name, without a driver: `sqlite`, `postgresql` ...

    Raises:
        InvalidUrlError: the text is no database URL.
    """
    return parse_url(url).get_backend_name()


def parse_url(url: str) -> URL:
    """Read a database URL.

    Args:
        url: the URL; `postgres://`, which PostgreSQL's own tools accept too, is `postgresql://`.

    Returns:
        The URL.

    Raises:
        InvalidUrlError: the text is no database URL.
    """
    parsed = _parse(url)
    if parsed is None:
        raise InvalidUrlError(
            "this is not a database URL; write sqlite:///robot.db for a file, sqlite:// for a "
            "store in memory, or postgresql://user@host/database"
        )
    if parsed.password is not None and "@" in f"{parsed.host}{parsed.database}":
        # Its second half would pass for the host, and be shown.
        raise InvalidUrlError("an @ in the password of a database URL is written as %40")
    name, plus, driver = parsed.drivername.partition("+")
    return parsed.set(drivername=f"postgresql{plus}{driver}") if name == "postgres" else parsed


def _parse(url: object) -> URL | None:
    """Parse a URL; None if it is none. The parser's own error may hold a password."""
    try:
        # What no driver could be given is no URL either.
        if not isinstance(url, str) or "\0" in url or not url.encode():
            return None
        return make_url(url)
    except (ArgumentError, ValueError):
        return None


def backend_name(url: str) -> str:
    """Read which backend a database URL names.

    Args:
        url: the URL.

    Returns:
        The dialect's name.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
    """
    name = dialect_name(url)
    if name not in BACKENDS:
        known = " and ".join(BACKENDS)
        raise InvalidUrlError(f"{name}: no backend of this name; there are {known}")
    return name


def create_backend(url: str) -> Backend:
    """Make the backend that a database URL names.

    Args:
        url: the URL.

    Returns:
        The backend; nothing is connected yet.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
    """
    if backend_name(url) == "sqlite":
        from .sqlite import SqliteBackend

        return SqliteBackend(parse_url(url))
    from .postgresql import PostgresqlBackend

    return PostgresqlBackend(parse_url(url))


def roles_set_aside(connection: Connection) -> AbstractContextManager[None]:
    """Take what belongs to roles out of the way of a migration, and set it anew behind it.

    Args:
        connection: a connection of the tables' owner, in a transaction.

    Returns:
        The context manager; it does nothing where there are no roles.
    """
    if connection.dialect.name != "postgresql":
        return nullcontext()
    from .postgresql_roles import roles_set_aside as set_aside

    return set_aside(connection)
