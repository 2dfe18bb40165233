"""Sessions through a connection pooler in transaction mode, such as PgBouncer.

Such a pooler gives a client one of the server's connections for each transaction. What is set for a
session (SET, LISTEN, PREPARE) therefore reaches whoever gets that connection next, and is lost to
the client itself. Sessions here set everything for one transaction.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

from sqlalchemy import URL

from ...errors import InvalidUrlError
from .base import url_label

# The option of a URL that says what stands before the server.
OPTION = "pooler"
# What a connection's record calls whether a pooler answers.
IS_POOLED = "is_pooled"


class Pooler(Enum):
    """What a URL says about a pooler; without the option, each connection finds out."""

    UNKNOWN = ""
    SESSION = "session"
    TRANSACTION = "transaction"


def read_pooler(url: URL) -> Pooler:
    """Read what a URL says about a pooler."""
    value = url.query.get(OPTION, "")
    try:
        pooler = Pooler(value)
    except ValueError:
        raise InvalidUrlError(
            f"{url_label(url)}: {OPTION}={value} is unknown; write {OPTION}=transaction for a "
            f"pooler that gives a connection for a transaction, or {OPTION}=session"
        ) from None
    if pooler is Pooler.TRANSACTION and "options" in url.query:
        raise InvalidUrlError(
            f"{url_label(url)}: options= are of a session, which {OPTION}=transaction has "
            "not; use ALTER ROLE ... SET or ALTER DATABASE ... SET on the server"
        )
    return pooler


def settle(connection: Any, pooler: Pooler, settings: dict[str, str]) -> bool:
    """Set a new connection up; return whether each of its transactions may get another session."""
    if pooler is not Pooler.TRANSACTION:
        calls = ", ".join(
            f"set_config('{key}', '{value}', false)" for key, value in settings.items()
        )
        # One statement asks and sets: what is set on a pooled session reaches other clients. A
        # pooler invents the number of the process, which is half of the key to cancel a statement.
        is_direct = f"pg_backend_pid() = {connection.info.backend_pid:d}"
        where = "" if pooler is Pooler.SESSION else f" WHERE {is_direct}"
        if connection.execute(f"SELECT {calls}{where}").fetchone() is not None:
            return False
    # Another client would find what is prepared for this one, under the same name.
    connection.prepare_threshold = None
    return True


def local(settings: dict[str, str]) -> str:
    """Write the statements that set something for one transaction."""
    return "".join(f"; SET LOCAL {key} = '{value}'" for key, value in settings.items())
