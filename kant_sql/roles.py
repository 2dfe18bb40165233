"""The roles of a database: who may write, who may read, and who may only look at the views."""

from __future__ import annotations

from contextlib import closing

from .arguments import flag, optional_text
from .backends import Roles, create_backend
from .errors import InvalidArgumentError
from .retry import retrying
from .schema import check


def create_roles(url: str, *, knowledge_base: str | None = None, dry_run: bool = False) -> Roles:
    """Create the roles of a PostgreSQL database, or bring them up to date.

    `kant_sql_writer` adds revisions and cannot change what is past, `kant_sql_reader` reads tables
    and views, `kant_sql_auditor` reads the views. Users get these rights as members of the roles.

    Args:
        url: the database URL, of the owner of the tables.
        knowledge_base: a knowledge base for which to create three more roles, which see and write
            nothing of others.
        dry_run: whether to change nothing, and only give the statements.

    Returns:
        The three roles that were asked for, the statements for all of them, and those that only
        the database's owner or a superuser may run.

    Raises:
        KantSqlError: there is no such knowledge base.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreBusyError: somebody keeps a table locked, which the message names; nothing was changed.
        StoreError: the database has no roles, as SQLite, or refused; nothing was changed.
    """
    optional_text(knowledge_base, "knowledge_base")
    flag(dry_run, "dry_run", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        if backend.no_roles is None:
            check(url)
        return retrying(backend, lambda: backend.create_roles(knowledge_base, dry_run))
