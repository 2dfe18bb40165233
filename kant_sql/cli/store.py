"""`kant-sql db`, `kbs`, `anchor`, `backup`, `archive`, `views` and `export`: the whole store."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import KantSqlError, few_of, printable
from ..knowledge.canonical import time_text
from . import common as c
from .output import Printer, bar, json_text, plural, write_json

if TYPE_CHECKING:
    from ..export import Exported, PluggedFormat
    from ..history.archive.archive import Archived
    from ..sql.inventory import Inventory
    from ..sql.predicate_views import PredicateView

_NAMES_SHOWN = 10


db = c.command_group("kant_sql.commands.db", "Create, migrate and check the tables.")


@db.command()
def upgrade(url: c.Url, as_json: c.AsJson = False) -> None:
    """Create the tables, or migrate them to the newest version.

    Your data stays.
    """
    from ..sql import schema

    with c.leaving_nothing(url):
        schema.upgrade(url)
    _write_version(url, as_json)


_DOWNGRADE = c.CommandWords("[URL] REV", "sqlite:///robot.db base")


@db.command(context_settings={"ignore_unknown_options": True})
def downgrade(
    words: Annotated[
        list[str],
        _DOWNGRADE.argument(
            "the version to go back to: its number, -1 for one back, or base, which drops the "
            "tables with all data.",
        ),
    ],
    yes: Annotated[bool, c.option("Do not ask before revisions are lost.", "--yes")] = False,
    as_json: c.AsJson = False,
) -> None:
    """Migrate the tables back to an earlier version.

    It asks for confirmation if you would lose revisions; only base drops any.
    """
    from ..sql import schema
    from ..sql.catalog import revision_counts

    url, (revision,) = _DOWNGRADE.split(words)
    if schema.current(url) is None:
        # This raises the error that names the remedy.
        schema.check(url)
    # Refuse an unknown version before asking.
    target = schema.earlier_version(url, revision)
    lost = revision_counts(url) if target == schema.BASE else {}
    if lost and not yes:
        _ask_to_lose(lost, as_json)
    schema.downgrade(url, revision=target or revision)
    _write_version(url, as_json, {"lost_revisions": sum(lost.values())})


def _ask_to_lose(lost: dict[str, int], as_json: bool) -> None:
    """Ask for confirmation to drop revisions; raise without a terminal, or if the answer is no."""
    names = [f"{printable(name)} ({count})" for name, count in lost.items()]
    what = (
        f"this drops all tables and {plural(sum(lost.values()), 'revision')} of "
        f"{plural(len(lost), 'knowledge base')}: {few_of(names, _NAMES_SHOWN, ', ')}"
    )
    streams = sys.stdin, sys.stderr
    if as_json or not all(stream and stream.isatty() for stream in streams):
        raise KantSqlError(f"{what}; nothing was changed; add --yes to do it")
    # On standard error, because the version goes to standard output.
    sys.stderr.write(f"{what}. Go on? [y/N] ")
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise KantSqlError("nothing was changed")


@db.command()
def current(url: c.Url, as_json: c.AsJson = False) -> None:
    """Show the version of the tables, or "none"."""
    from ..sql import schema

    schema.require_store(url)
    _write_version(url, as_json)


@db.command()
def check(url: c.Url, as_json: c.AsJson = False) -> None:
    """Exit with 1 if tables are missing, outdated or misplaced."""
    from ..sql import schema

    schema.check(url)
    schema.check_placement(url)
    _write_version(url, as_json)


@db.command()
def sql(url: c.Url, as_json: c.AsJson = False) -> None:
    """Write the SQL that creates the tables.

    It uses only the URL's dialect, and does not connect.
    """
    from ..sql import schema

    if not as_json:
        schema.upgrade_sql(url, sys.stdout)
        return
    text = io.StringIO()
    schema.upgrade_sql(url, text)
    write_json(version=schema.VERSIONS[-1], sql=text.getvalue())


@db.command()
def roles(
    url: c.Url,
    kb: Annotated[
        str | None,
        c.option(
            "Create four more roles that see and write only this knowledge base.",
            metavar="NAME",
        ),
    ] = None,
    dry_run: Annotated[bool, c.option("Only write the SQL; change nothing.", "--dry-run")] = False,
    as_json: c.AsJson = False,
) -> None:
    """Create the PostgreSQL roles, or update them."""
    from ..sql.schema import create_roles

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
        for name in ("writer", "reader", "auditor", "eraser", "schema"):
            value = getattr(made, name)
            if value is not None:
                printer.line(f"{name:8} {value}")
        if made.writer is None:
            typer.echo(
                "no writer: the row policies of a distributed table cannot look up other rows; "
                "let writers connect as the owner",
                err=True,
            )
        for statement in made.remaining:
            typer.echo(f"this user may not run, but its owner: {statement};", err=True)


def _write_version(url: str, as_json: bool, more: Mapping[str, object] | None = None) -> None:
    from ..sql import schema

    version = schema.current(url)
    if as_json:
        write_json(more, version=version, newest=schema.VERSIONS[-1])
    else:
        typer.echo(version or "none")


def kbs(url: c.Url, as_json: c.AsJson = False) -> None:
    """List the knowledge bases: last revisions, facts, origins."""
    from ..sql.inventory import knowledge_bases

    found = knowledge_bases(url)
    if as_json:
        write_json(knowledge_bases=found)
        return
    columns: dict[str, Callable[[Inventory], str]] = {
        "knowledge base": lambda one: printable(one.name),
        "revision": lambda one: "" if one.revision is None else str(one.revision),
        "last change": lambda one: time_text(one.committed_at) if one.committed_at else "",
        "facts": lambda one: f"over {one.facts}" if one.has_more_facts else str(one.facts),
        "goals": _goals,
        "actor": lambda one: printable(one.actor or ""),
        "reason": lambda one: printable(one.reason or ""),
    }
    if any(one.source is not None for one in found):
        columns["source"] = lambda one: "" if one.source is None else json_text(one.source)
    if any(one.origin is not None for one in found):
        columns |= {"origin": lambda one: printable(one.origin or ""), "behind": _behind}
    if any(one.verified_revision is not None for one in found):
        columns["verified"] = _verified
    if any(one.error is not None for one in found):
        columns["error"] = lambda one: printable(one.error or "")
    rows = [[write(one) for write in columns.values()] for one in found]
    Printer().table("knowledge bases", list(columns), rows)


def _behind(one: Inventory) -> str:
    """Return how many revisions and how much time a replica is behind."""
    if not one.behind:
        return "" if one.behind is None else "0"
    return f"{one.behind}" if one.lag is None else f"{one.behind}, {one.lag:,.0f} s"


def _verified(one: Inventory) -> str:
    """Return the last verified revision, and when it was verified."""
    if one.verified_revision is None or one.verified_at is None:
        return "not yet"
    return f"up to {one.verified_revision} at {time_text(one.verified_at)}"


def _goals(one: Inventory) -> str:
    """Return how many goals are reached; 'kant-sql goals' evaluates the ones shown as `?`."""
    if one.reached is None:
        return "?"
    return f"{one.reached} of {one.goals}" if one.goals else ""


def anchor(
    url: c.Url,
    as_json: Annotated[bool, c.option("Same output: one JSON document.", c.JSON_OPTION)] = False,
) -> None:
    """Write the head of every knowledge base, to keep elsewhere.

    The output is a small JSON document. 'kant-sql verify --anchor FILE' compares a store with it.
    """
    from ..knowledge_base import connect
    from ..sql.catalog import written_names

    # Raises if the store is missing; connecting would create it.
    names = written_names(url)
    with connect(url, knowledge_base=names[0] if names else c.DEFAULT_NAME) as knowledge_base:
        typer.echo(knowledge_base.store.anchor().text())


_BACKUP = c.CommandWords("[URL] FILE", "sqlite:///robot.db monday.db")


def backup(
    words: Annotated[
        list[str],
        _BACKUP.argument("the new file; an existing one is never overwritten."),
    ],
    as_json: c.AsJson = False,
) -> None:
    """Copy an SQLite store into a file, while others write.

    The copy is the whole store at one moment. Back up a server with its own program.
    """
    from ..sql.catalog import backup as backup_store

    url, (file,) = _BACKUP.split(words)
    with c.signals_raise(), bar("backup") as progress:
        made = backup_store(url, file, progress=progress)
    if as_json:
        write_json(made)
        return
    revisions = [f"{printable(name)} at revision {last}" for name, last in made.revisions.items()]
    Printer().line(f"{printable(str(made.file))}: {made.bytes:,} bytes; {', '.join(revisions)}")


_Before = Annotated[
    str,
    c.option(
        "Move versions that ended before this: a time in ISO 8601 (UTC unless a zone is given), "
        "such as '90 days ago', or a revision's number.",
        metavar="REV|TIME",
    ),
]
_Target = Annotated[
    str, c.option("The other store; a missing SQLite file is created.", metavar="URL")
]


def archive(
    url: c.Url,
    before: _Before,
    to: _Target,
    kb: c.Name = None,
    dry_run: Annotated[bool, c.option("Count only; change nothing.", "--dry-run")] = False,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> None:
    """Move versions that ended before a time to another store.

    That store then answers questions about them.
    """
    when = c.parse_when(before, "--before")
    with (
        c.open_to_read(url, kb) as (name, knowledge_base),
        c.leaving_nothing(to),
        bar(name) as progress,
    ):
        done = knowledge_base.store.archive(
            when, to=to, dry_run=dry_run, reason=reason, actor=actor, progress=progress
        )
    if as_json:
        write_json(done, knowledge_base=name, dry_run=dry_run)
    else:
        _write_archived(Printer(), name, done, dry_run)


def _write_archived(printer: Printer, name: str, done: Archived, dry_run: bool) -> None:
    kb = f"knowledge base {printable(name)}"
    if not done.versions:
        printer.line(f"{kb}: no version ended up to revision {done.upto}")
        return
    verb = "would move" if dry_run else f"moved in revision {done.revision}"
    total = sum(done.versions.values())
    versions = plural(total, "version")
    printer.line(
        f"{kb}: {versions} that ended up to revision {done.upto} {verb} to "
        f"{printable(done.target)}",
        "bold",
    )
    rows = [[table, str(number)] for table, number in done.versions.items()]
    printer.table("versions", ["table", "versions"], rows)


def views(
    url: c.Url,
    kb: Annotated[str | None, c.option("The knowledge base; default: all.", metavar="NAME")] = None,
    drop: Annotated[bool, c.option("Drop the views that this command created.", "--drop")] = False,
    dry_run: Annotated[
        bool, c.option("Only write the SQL; change nothing.", "--sql", "--dry-run")
    ] = False,
    as_json: c.AsJson = False,
) -> None:
    """Create a view per predicate, or update the views."""
    from ..sql.predicate_views import drop_views, update_views

    changes = (drop_views if drop else update_views)(url, knowledge_base=kb, dry_run=dry_run)
    if as_json:
        documents = [change._asdict() for change in changes]
        for document in documents if not dry_run else ():
            del document["statements"]
        write_json(views=documents)
    elif dry_run:
        statements = (statement for change in changes for statement in change.statements)
        typer.echo("".join(f"{statement};\n" for statement in statements), nl=False)
    else:
        _write_views(changes)


def _write_views(changes: list[PredicateView]) -> None:
    rows = [
        (
            change.name,
            change.change,
            printable(change.knowledge_base or ""),
            printable(change.predicate or ""),
        )
        for change in changes
    ]
    Printer().table("views", ("view", "change", "knowledge base", "predicate"), rows)


_FORMATS = ("parquet", "csv", "jsonl")


def export(
    url: c.Url,
    to: Annotated[Path, c.option("The folder to write; created if it is missing.", metavar="DIR")],
    format: Annotated[
        str,
        c.option(
            "parquet, csv or jsonl: the views for auditors; one that a plugin adds: facts and "
            "values over time.",
            metavar="FORMAT",
        ),
    ] = _FORMATS[0],
    kb: Annotated[str | None, c.option("The knowledge base; default: all.", metavar="NAME")] = None,
    view: Annotated[
        list[str] | None,
        c.option("Write only this view, such as fact; you can repeat this.", metavar="NAME"),
    ] = None,
    predicate: Annotated[
        list[str] | None,
        c.option(
            "For a plugin's format: only this predicate or function; repeatable.",
            metavar="NAME",
        ),
    ] = None,
    element: Annotated[
        list[str] | None,
        c.option(
            "For a plugin's format: only this fact or fluent, such as '(robot_at rb1 wp1)'; "
            "repeatable.",
            metavar="TEXT",
        ),
    ] = None,
    since: c.Since = None,
    until: c.Until = None,
    clock: c.Clock = "committed",
    replace: Annotated[
        bool, c.option("Replace an earlier export in the folder.", "--replace")
    ] = False,
    as_json: c.AsJson = False,
) -> None:
    """Write audit views, or facts and values over time, to files.

    It reads one consistent state, even if others write meanwhile.
    """
    from ..export import export_store

    plugged = _plugged_format(format)
    for given, name in ((predicate, "--predicate"), (element, "--element")):
        if given and plugged is None:
            raise typer.BadParameter(f"this is not for {format}", param_hint=name)
    if clock != "committed" and plugged is None:
        what = f"{format} has both clocks, as columns of the views fact_valid and value_valid"
        raise typer.BadParameter(what, param_hint="--clock")
    if view and plugged is not None:
        raise typer.BadParameter(f"{format} has no views", param_hint="--view")
    common: dict[str, Any] = {
        "to": to,
        "knowledge_base": kb,
        "since": c.parse_optional(since, "--since"),
        "until": c.parse_optional(until, "--until"),
        "replace": replace,
    }
    with bar(f"export {kb or ''}".strip()) as progress:
        if plugged is None:
            done = export_store(url, format=format, views=view, progress=progress, **common)
        else:
            if clock != "committed":
                common["clock"] = clock
            done = plugged(url, names=predicate, elements=element, progress=progress, **common)
    if as_json:
        write_json(done)
    else:
        _write_exported(Printer(), done)


def _plugged_format(format: str) -> PluggedFormat | None:
    """Find a format of a plugin; None for one of the library."""
    if format in _FORMATS:
        return None
    from ..export import PLUGGED_FORMATS

    c.require_word(format, (*_FORMATS, *PLUGGED_FORMATS.names()), "--format")
    return PLUGGED_FORMATS.get(format)


def _write_exported(printer: Printer, done: Exported) -> None:
    what = "rows" if done.format in _FORMATS else "messages"
    total = sum(file.rows for file in done.files)
    printer.line(
        f"{printable(done.folder)}: {plural(len(done.files), 'file')} with {total} {what}", "bold"
    )
    for state in done.knowledge_bases:
        archived = f", archived up to {state.archived}" if state.archived else ""
        printer.line(
            f"{printable(state.name)}: revision {state.revision} of {state.committed_at}{archived}"
        )
    rows = [[printable(file.path), str(file.rows), str(file.bytes)] for file in done.files]
    printer.table("files", ["file", what, "bytes"], rows)
