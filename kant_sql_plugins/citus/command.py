"""`kant-sql db distribute`."""

from __future__ import annotations

from typing import Annotated

import typer

from kant_sql.cli.common import AsJson, Url, option
from kant_sql.cli.output import plural, write_json


def distribute(
    url: Url,
    shards: Annotated[
        int | None,
        option(
            "How many shards each table has; otherwise as the server sets citus.shard_count.",
            metavar="N",
            min=1,
        ),
    ] = None,
    undo: Annotated[bool, option("Bring all tables back to the coordinator.", "--undo")] = False,
    as_sql: Annotated[bool, option("Only write the SQL; change nothing.", "--sql")] = False,
    as_json: AsJson = False,
) -> None:
    """Distribute the tables over a Citus cluster.

    The command is atomic, and does not change distributed tables. Make a backup first.
    """
    from .distribution import distribute as distribute_tables
    from .distribution import script

    done = distribute_tables(url, shards=shards, undo=undo, dry_run=as_sql)
    if as_json:
        document = done._asdict()
        if not as_sql:
            del document["statements"], document["views"]
        write_json(document)
    elif as_sql:
        typer.echo("-- Make a backup first.")
        typer.echo("".join(f"{line};\n" for line in script(done)), nl=False)
    elif done.shards:
        over = f"{plural(done.shards, 'shard')} on {', '.join(done.nodes)}"
        typer.echo(f"{plural(len(done.tables), 'table')} distributed over {over}")
    else:
        typer.echo(f"{plural(len(done.tables), 'table')} brought back")
