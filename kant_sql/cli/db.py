"""`kant-sql db`: the tables and their migrations."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Mapping
from typing import Annotated

import typer

from .. import schema
from ..catalog import revision_counts
from ..errors import KantSqlError
from ..roles import create_roles
from .output import AsJson, Printer, plural, printable, write_json
from .stores import URL_VARIABLE, Url, leaving_nothing

_NAMES_SHOWN = 10

db = typer.Typer(help="Create, migrate and check the tables.", rich_markup_mode=None)


@db.command()
def upgrade(url: Url, as_json: AsJson = False) -> None:
    """Create the tables, or bring them up to date.

    What is stored survives.
    """
    with leaving_nothing(url):
        schema.upgrade(url)
    _write_version(url, as_json)


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
    yes: Annotated[
        bool, typer.Option("--yes", help="Do not ask before revisions are lost for ever.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Bring the tables back to an earlier version.

    Asks first when revisions would be lost: only base drops any.
    """
    url, revision = _url_and_revision(words)
    if schema.current(url) is None:
        # Says what is missing, and how to get it.
        schema.check(url)
    # What cannot be done is refused before anybody is asked.
    target = schema.earlier_version(url, revision)
    lost = revision_counts(url) if target == schema.BASE else {}
    if lost and not yes:
        _ask_to_lose(lost, as_json)
    schema.downgrade(url, revision=target or revision)
    _write_version(url, as_json, {"lost_revisions": sum(lost.values())})


def _ask_to_lose(lost: dict[str, int], as_json: bool) -> None:
    """Ask whether revisions may be lost; raise when nobody can be asked, or the answer is no."""
    names = [f"{printable(name)} ({count})" for name, count in lost.items()]
    more = "" if len(names) <= _NAMES_SHOWN else f" and {len(names) - _NAMES_SHOWN} more"
    what = (
        f"all tables are dropped, and with them {plural(sum(lost.values()), 'revision')} of "
        f"{plural(len(lost), 'knowledge base')}, for ever: {', '.join(names[:_NAMES_SHOWN])}{more}"
    )
    streams = sys.stdin, sys.stderr
    if as_json or not all(stream and stream.isatty() for stream in streams):
        raise KantSqlError(f"{what}; nothing was changed: to do this without a question, add --yes")
    # On standard error, where the version that is written in the end is not mixed with it.
    sys.stderr.write(f"{what}. Go on? [y/N] ")
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise KantSqlError("nothing was changed")


@db.command()
def current(url: Url, as_json: AsJson = False) -> None:
    """Tell the version of the tables, or "none"."""
    schema.require_store(url)
    _write_version(url, as_json)


@db.command()
def check(url: Url, as_json: AsJson = False) -> None:
    """Exit with 1 when the tables are missing or not up to date."""
    schema.check(url)
    _write_version(url, as_json)


@db.command()
def sql(url: Url, as_json: AsJson = False) -> None:
    """Write the SQL that creates the tables.

    Only the URL's dialect matters.
    """
    if not as_json:
        schema.upgrade_sql(url, sys.stdout)
        return
    text = io.StringIO()
    schema.upgrade_sql(url, text)
    write_json({"version": schema.VERSIONS[-1], "sql": text.getvalue()})


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
    as_json: AsJson = False,
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


def _write_version(url: str, as_json: bool, more: Mapping[str, object] | None = None) -> None:
    version = schema.current(url)
    if as_json:
        write_json({"version": version, "newest": schema.VERSIONS[-1], **(more or {})})
    else:
        typer.echo(version or "none")


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
