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
from kant_sql.sql.tables.base import VERSION_TABLE, with_dialects

config = context.config
logger = logging.getLogger("kant_sql.schema")


def find_url() -> str:
    """Find the database URL: from the caller, `-x url=`, or the environment."""
    url = (
        config.attributes.get("url")
        or context.get_x_argument(as_dictionary=True).get("url")
        or os.environ.get("KANT_SQL_URL")
    )
    if not url:
        raise SystemExit("no database: set KANT_SQL_URL, or run alembic -x url=URL ...")
    return str(url)


def changes_version() -> bool:
    """Return whether the command changes the version of the tables."""
    try:
        wanted = context.get_revision_argument()
    except KeyError:
        return False
    return bool(wanted != context.get_context().get_current_revision())


def log_step(ctx: object, step: MigrationInfo, heads: object, run_args: object) -> None:
    """Log a migration from one version to another; it is not committed yet."""
    before, after = (
        ", ".join(versions) or "no tables"
        for versions in (step.source_revision_ids, step.destination_revision_ids)
    )
    place = f"{config.attributes['label']}: " if "label" in config.attributes else ""
    logger.info("%smigrating from %s to %s", place, before, after)


def run_online(connection: Connection) -> None:
    """Run the migrations on a connection that is in a transaction."""
    context.configure(
        connection=connection,
        target_metadata=with_dialects(),
        version_table=VERSION_TABLE,
        include_object=lambda item, name, kind, reflected, _: (
            kind != "table" or not reflected or name in Base.metadata.tables
        ),
        # SQLite has transactional DDL too, if the driver begins no transactions of its own.
        transactional_ddl=True,
        transaction_per_migration=False,
        on_version_apply=log_step,
    )
    backend = backend_class(connection.dialect.name)
    with backend.roles_set_aside(connection) if changes_version() else nullcontext():
        if changes_version():
            # A table with views cannot be changed.
            config.attributes[DROPPED_VIEWS] = drop_generated_views(connection, backend.views)
        with backend.migrating(connection, config.attributes.get("label", "this store")):
            context.run_migrations()
    if not context.get_context().get_current_heads():
        # A store at version base has no tables; Alembic would leave its own.
        connection.exec_driver_sql(f"DROP TABLE IF EXISTS {VERSION_TABLE}")


def run_offline(url: str) -> None:
    """Write the SQL of the migrations, in the dialect of a URL."""
    context.configure(
        dialect_name=backend_name(url),
        target_metadata=with_dialects(),
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
