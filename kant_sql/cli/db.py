"""`kant-sql db`: the tables and their migrations."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from .. import schema
from ..roles import create_roles
from .output import Printer, write_json
from .stores import URL_VARIABLE, Url

db = typer.Typer(help="Create, migrate and check the tables.", rich_markup_mode=None)


@db.command()
def upgrade(url: Url) -> None:
    """Create the tables, or bring them up to date.

    What is stored survives.
    """
    schema.upgrade(url)
    _write_version(url)


@db.command(context_settings={"ignore_unknown_options": True})
def downgrade(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="[URL] REV",
            show_default=False,
            help=f"The database URL [env var: {URL_VARIABLE}], and the version to go back to: "
            "its number, -1 for one back, or base, which drops the tables and all that they hold.",
        ),
    ],
) -> None:
    """Bring the tables back to an earlier version."""
    url, revision = _url_and_revision(words)
    if schema.current(url) is None:
        # Says what is missing, and how to get it.
        schema.check(url)
    schema.downgrade(url, revision=revision)
    _write_version(url)


@db.command()
def current(url: Url) -> None:
    """Tell the version of the tables, or "none"."""
    schema.require_store(url)
    _write_version(url)


@db.command()
def check(url: Url) -> None:
    """Exit with 1 when the tables are missing or not up to date."""
    schema.check(url)
    _write_version(url)


@db.command()
def sql(url: Url) -> None:
    """Write the SQL that creates the tables.

    Only the URL's dialect matters.
    """
    schema.upgrade_sql(url, sys.stdout)


@db.command()
def roles(
    url: Url,
    kb: Annotated[
        str | None,
        typer.Option(
            "--kb",
            metavar="NAME",
            show_default=False,
            help="Create three more that see and write only this knowledge base.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only write the SQL; nothing is changed.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Create the roles of PostgreSQL, or bring them up to date."""
    made = create_roles(url, knowledge_base=kb, dry_run=dry_run)
    if as_json:
        document = made._asdict()
        if not dry_run:
            del document["statements"]
        write_json(document)
    elif dry_run:
        typer.echo("".join(f"{statement};\n" for statement in made.statements), nl=False)
        typer.echo("".join(f"-- {statement};\n" for statement in made.remaining), nl=False)
    else:
        printer = Printer()
        for name in ("writer", "reader", "auditor", "schema"):
            value = getattr(made, name)
            if value is not None:
                printer.line(f"{name:8} {value}")
        for statement in made.remaining:
            typer.echo(f"this user may not run, but its owner: {statement};", err=True)


def _write_version(url: str) -> None:
    typer.echo(schema.current(url) or "none")


def _url_and_revision(words: list[str]) -> tuple[str, str]:
    url = os.environ.get(URL_VARIABLE)
    if len(words) == 1 and url and "://" not in words[0]:
        words = [url, *words]
    if len(words) != 2 or not all(words):
        raise typer.BadParameter(
            f"give a URL (or set {URL_VARIABLE}) and a version, such as: sqlite:///robot.db base",
            param_hint="[URL] REV",
        )
    return words[0], words[1]
