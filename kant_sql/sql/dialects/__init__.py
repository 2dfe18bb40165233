"""The backends, by database URL."""

from __future__ import annotations

import os
import re
from importlib import import_module

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from ...errors import InvalidUrlError
from .base import Backend

# By the name in the URL; imported on first use.
BACKENDS = {
    "sqlite": "kant_sql.sql.dialects.sqlite:SqliteBackend",
    "postgresql": "kant_sql.sql.dialects.postgresql:PostgresqlBackend",
}


def dialect_name(url: str) -> str:
    """Return the dialect that a database URL names."""
    return parse_url(url).get_backend_name()


def parse_url(url: str) -> URL:
    """Read a database URL; the path of an existing file means its SQLite store."""
    parsed = _parse(url)
    if parsed is None:
        # Only a path is shown: other text may contain a password.
        is_path = isinstance(url, str) and re.fullmatch(r"[\w./-]+", url)
        given = repr(url) if is_path else "this"
        raise InvalidUrlError(
            f"{given} is not a database URL, nor the path of an existing file; write "
            "sqlite:///robot.db for a new file, sqlite:// for a store in memory, or "
            "postgresql://user@host/database"
        )
    if parsed.password is not None and "@" in f"{parsed.host}{parsed.database}":
        # The second half of a password would pass for the host, and be shown.
        raise InvalidUrlError("an @ in the password of a database URL is written as %40")
    name, plus, driver = parsed.drivername.partition("+")
    return parsed.set(drivername=f"postgresql{plus}{driver}") if name == "postgres" else parsed


def _parse(url: object) -> URL | None:
    """Parse a URL; None if it is not one. The parser's own error may contain a password."""
    try:
        # A URL that no driver accepts is not a URL either.
        if not isinstance(url, str) or "\0" in url or not url.encode():
            return None
        if "://" not in url and os.path.isfile(url):
            return URL.create("sqlite", database=url)
        return None if "%00" in url else make_url(url)
    except (ArgumentError, ValueError):
        return None


def backend_name(url: str) -> str:
    """Return the backend that a database URL names."""
    name = dialect_name(url)
    if name not in BACKENDS:
        known = " or ".join(BACKENDS)
        raise InvalidUrlError(
            f"{name}: this needs the store itself, whose URL begins with {known}; of another DAO "
            "family there is only what kant_sql.connect(URL) opens"
        )
    return name


def backend_class(name: str) -> type[Backend]:
    """Import a backend."""
    module, _, attribute = BACKENDS[name].partition(":")
    found: type[Backend] = getattr(import_module(module), attribute)
    return found


def create_backend(url: str, *, read_only: bool = False, connections: int | None = None) -> Backend:
    """Create the backend that a database URL names."""
    made = backend_class(backend_name(url))
    return made(parse_url(url), read_only=read_only, connections=connections)
