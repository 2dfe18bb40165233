"""The distribution of a store's tables over the nodes of a Citus cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

from ..arguments import flag, whole_number
from ..errors import InvalidArgumentError, SchemaError, StoreError
from .dialects import create_backend
from .dialects.base import Distribution, retrying
from .predicate_views import CHANGES_AT_ONCE, recreated_views, update_views
from .schema import check, view_queries


def distribute(
    url: str, *, shards: int | None = None, undo: bool = False, dry_run: bool = False
) -> Distribution:
    """Distribute the tables of a store over the nodes of a Citus cluster, or bring them together.

    All of it is one transaction, which no reader or writer may be in the way of. Tables that are
    distributed already stay as they are. Generated views are dropped, and created again afterwards.
    Make a backup first.

    Args:
        url: the URL of the database on the coordinator, of the owner of the tables.
        shards: how many shards each table has; None for the server's `citus.shard_count`.
        undo: whether to bring the tables together, in the coordinator's database.
        dry_run: whether to return the statements without running them.

    Returns:
        What is distributed how, and the statements that did it.

    Raises:
        InvalidArgumentError: the number of shards is no number from 1 on.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreBusyError: a session, which the message names, holds a table's lock; nothing was
            changed.
        StoreError: this is no coordinator of a cluster, or something is in the way of the
            distribution; the message names it, and nothing was changed.
    """
    if shards is not None:
        whole_number(shards, "shards", least=1, expected="a whole number of shards from 1 on")
    flag(undo, "undo", InvalidArgumentError)
    flag(dry_run, "dry_run", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        if backend.no_nodes is not None:
            raise StoreError(f"{backend.label}: nothing was changed: {backend.no_nodes}")
        check(url)
        views = view_queries(url)
        generated = recreated_views(url)

        def run() -> Distribution:
            return backend.distribute(shards, undo=undo, dry_run=dry_run, views=views)

        done = retrying(backend, run)
        if not done.statements:
            return done
        if not dry_run:
            for name in dict.fromkeys(view.knowledge_base for view in generated):
                update_views(url, knowledge_base=name)
        statements = (statement for view in generated for statement in view.statements)
        return done._replace(views=(*statements,))


def script(distribution: Distribution) -> Iterator[str]:
    """Yield the statements of a distribution with those that begin and end its transactions."""
    if distribution.statements:
        yield from ("BEGIN", *distribution.statements, "COMMIT")
    views = distribution.views
    for start in range(0, len(views), CHANGES_AT_ONCE):
        yield from ("BEGIN", *views[start : start + CHANGES_AT_ONCE], "COMMIT")


def check_distribution(url: str) -> None:
    """Check that, of a distributed store, all tables are distributed."""
    with closing(create_backend(url)) as backend:
        fault = backend.layout_fault()
        if fault is not None:
            raise SchemaError(f"{backend.label}: {fault}")
