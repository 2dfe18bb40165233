"""How Alembic runs the migrations: from the library, the command line, or plain `alembic`."""

from __future__ import annotations

import logging
import os
from contextlib import nullcontext

from alembic import context
from alembic.runtime.migration import MigrationInfo
from sqlalchemy import Connection

from kant_sql.sql.dialects import backend_class, backend_name, create_backend
from kant_sql.sql.schema import DROPPED_VIEWS, drop_generated_views, report_dropped_views
from kant_sql.sql.tables import Base
from kant_sql.sql.tables.base import VERSION_TABLE

config = context.config
logger = logging.getLogger("kant_sql.schema")


def find_url() -> str:
    """Find the database URL: from the caller, `-x url=`, or the environment.

    Returns:
        The URL.
    """
    url = (
        config.attributes.get("url")
        or context.get_x_argument(as_dictionary=True).get("url")
        or os.environ.get("KANT_SQL_URL")
    )
    if not url:
        raise SystemExit("no database: set KANT_SQL_URL, or run alembic -x url=URL ...")
    return str(url)


def changes_version() -> bool:
    """Tell whether the tables' version is to change.

    Returns:
        False for a command that only looks, and when the version is the one that is wanted.
    """
    try:
        wanted = context.get_revision_argument()
    except KeyError:
        return False
    return bool(wanted != context.get_context().get_current_revision())


def log_step(ctx: object, step: MigrationInfo, heads: object, run_args: object) -> None:
    """Log that the tables went from one version to another; not yet committed.

    Args:
        ctx: where it ran.
        step: the migration.
        heads: the versions that the tables have now.
        run_args: what it was given.
    """
    before, after = (
        ", ".join(versions) or "no tables"
        for versions in (step.source_revision_ids, step.destination_revision_ids)
    )
    place = f"{config.attributes['label']}: " if "label" in config.attributes else ""
    logger.info("%smigrating from %s to %s", place, before, after)


def run_online(connection: Connection) -> None:
    """Run the migrations on a connection that is in a transaction.

    Args:
        connection: the connection.
    """
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        version_table=VERSION_TABLE,
        include_object=lambda item, name, kind, reflected, _: (
            kind != "table" or not reflected or name in Base.metadata.tables
        ),
        # SQLite has transactional DDL too, once the driver begins nothing of its own.
        transactional_ddl=True,
        transaction_per_migration=False,
        on_version_apply=log_step,
    )
    backend = backend_class(connection.dialect.name)
    with backend.roles_set_aside(connection) if changes_version() else nullcontext():
        if changes_version():
            # A table that has views cannot be changed.
            config.attributes[DROPPED_VIEWS] = drop_generated_views(connection, backend.views)
        context.run_migrations()
    if not context.get_context().get_current_heads():
        # Alembic would leave its own table behind: a store that went back to base has none.
        connection.exec_driver_sql(f"DROP TABLE IF EXISTS {VERSION_TABLE}")


def run_offline(url: str) -> None:
    """Write the SQL of the migrations.

    Args:
        url: the database URL; only its dialect matters.
    """
    context.configure(
        dialect_name=backend_name(url),
        target_metadata=Base.metadata,
        version_table=VERSION_TABLE,
        literal_binds=True,
        transactional_ddl=True,
    )
    with context.begin_transaction():
        context.run_migrations()


if context.is_offline_mode():
    run_offline(find_url())
elif (given := config.attributes.get("connection")) is not None:
    run_online(given)
else:
    backend = create_backend(find_url())
    with backend.migration_connection() as own:
        run_online(own)
    report_dropped_views(config)
    backend.close()
