"""`kant-sql db`, `kbs`, `anchor`, `verify`, `archive` and `views`: administering a store."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from contextlib import closing
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InvalidMetadataError, KantSqlError, printable
from ..json_documents import verification_document
from ..knowledge.canonical import time_text
from .common import (
    DEFAULT_NAME,
    JSON_OPTION,
    Actor,
    AnchorFile,
    AsJson,
    Name,
    Reason,
    Url,
    choose,
    json_lines,
    leaving_nothing,
    open_to_read,
    option,
    parse_when,
    split_url,
    words_argument,
)
from .output import FAILED, Document, Printer, bar, plural, write_json

if TYPE_CHECKING:
    from ..history.anchors import Anchor
    from ..history.archive.archive import Archived
    from ..history.verify.findings import Finding
    from ..history.verify.verify import Verification
    from ..sql.inventory import Inventory
    from ..sql.predicate_views import PredicateView

_NAMES_SHOWN = 10

db = typer.Typer(help="Create, migrate and check the tables.", rich_markup_mode=None)


@db.command()
def upgrade(url: Url, as_json: AsJson = False) -> None:
    """Create the tables, or migrate them to the newest version.

    Stored data is kept.
    """
    from ..sql import schema

    with leaving_nothing(url):
        schema.upgrade(url)
    _write_version(url, as_json)


_DOWNGRADE_USAGE, _DOWNGRADE_EXAMPLE = "[URL] REV", "sqlite:///robot.db base"


@db.command(context_settings={"ignore_unknown_options": True})
def downgrade(
    words: Annotated[
        list[str],
        words_argument(
            _DOWNGRADE_USAGE,
            "the version to go back to: its number, -1 for one back, or base, which drops the "
            "tables with all data.",
        ),
    ],
    yes: Annotated[bool, option("Do not ask before revisions are lost.", "--yes")] = False,
    as_json: AsJson = False,
) -> None:
    """Migrate the tables back to an earlier version.

    Asks first if revisions would be lost; only base drops any.
    """
    from ..sql import schema
    from ..sql.catalog import revision_counts

    url, (revision,) = split_url(words, _DOWNGRADE_USAGE, _DOWNGRADE_EXAMPLE, needs_scheme=False)
    if schema.current(url) is None:
        # Raises the error that names the remedy.
        schema.check(url)
    # Refuse an unknown version before asking.
    target = schema.earlier_version(url, revision)
    lost = revision_counts(url) if target == schema.BASE else {}
    if lost and not yes:
        _ask_to_lose(lost, as_json)
    schema.downgrade(url, revision=target or revision)
    _write_version(url, as_json, {"lost_revisions": sum(lost.values())})


def _ask_to_lose(lost: dict[str, int], as_json: bool) -> None:
    """Ask whether to drop revisions; raise if there is no terminal or the answer is no."""
    names = [f"{printable(name)} ({count})" for name, count in lost.items()]
    more = "" if len(names) <= _NAMES_SHOWN else f" and {len(names) - _NAMES_SHOWN} more"
    what = (
        f"all tables are dropped, and with them {plural(sum(lost.values()), 'revision')} of "
        f"{plural(len(lost), 'knowledge base')}, for ever: {', '.join(names[:_NAMES_SHOWN])}{more}"
    )
    streams = sys.stdin, sys.stderr
    if as_json or not all(stream and stream.isatty() for stream in streams):
        raise KantSqlError(f"{what}; nothing was changed: to do this without a question, add --yes")
    # On standard error, because the version goes to standard output.
    sys.stderr.write(f"{what}. Go on? [y/N] ")
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise KantSqlError("nothing was changed")


@db.command()
def current(url: Url, as_json: AsJson = False) -> None:
    """Show the version of the tables, or "none"."""
    from ..sql import schema

    schema.require_store(url)
    _write_version(url, as_json)


@db.command()
def check(url: Url, as_json: AsJson = False) -> None:
    """Exit with 1 if the tables are missing or outdated."""
    from ..sql import schema

    schema.check(url)
    _write_version(url, as_json)


@db.command()
def sql(url: Url, as_json: AsJson = False) -> None:
    """Write the SQL that creates the tables.

    Of the URL, only the dialect is used.
    """
    from ..sql import schema

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
        option(
            "Create three more roles that see and write only this knowledge base.",
            "--kb",
            metavar="NAME",
        ),
    ] = None,
    dry_run: Annotated[bool, option("Only write the SQL; change nothing.", "--dry-run")] = False,
    as_json: AsJson = False,
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
        for name in ("writer", "reader", "auditor", "schema"):
            value = getattr(made, name)
            if value is not None:
                printer.line(f"{name:8} {value}")
        for statement in made.remaining:
            typer.echo(f"this user may not run, but its owner: {statement};", err=True)


def _write_version(url: str, as_json: bool, more: Mapping[str, object] | None = None) -> None:
    from ..sql import schema

    version = schema.current(url)
    if as_json:
        write_json({"version": version, "newest": schema.VERSIONS[-1], **(more or {})})
    else:
        typer.echo(version or "none")


def kbs(url: Url, as_json: AsJson = False) -> None:
    """List the knowledge bases: last revisions, facts and goals."""
    from ..sql.inventory import Catalog

    with closing(Catalog(url)) as catalog:
        found = list(catalog.every())
    if as_json:
        write_json(
            {
                "knowledge_bases": [
                    {**one._asdict(), "committed_at": time_text(one.committed_at)} for one in found
                ]
            }
        )
        return
    rows = [
        (
            printable(one.name),
            str(one.revision),
            time_text(one.committed_at),
            f"over {one.facts}" if one.has_more_facts else str(one.facts),
            _goals(one),
            printable(one.actor or ""),
            printable(one.reason or ""),
        )
        for one in found
    ]
    columns = "knowledge base", "revision", "last change", "facts", "goals", "actor", "reason"
    Printer().table("knowledge bases", columns, rows)


def _goals(one: Inventory) -> str:
    """Say how many goals are reached; 'kant-sql goals' tells where counting does not."""
    if one.reached is None:
        return "?"
    return f"{one.reached} of {one.goals}" if one.goals else ""


def anchor(
    url: Url, as_json: Annotated[bool, option("The same: one JSON document.", JSON_OPTION)] = False
) -> None:
    """Write the head of every knowledge base, to keep elsewhere.

    The output is a small JSON document. 'kant-sql verify --anchor FILE' compares a store with it.
    """
    from ..knowledge_base import connect
    from ..sql.catalog import knowledge_bases

    # Raises if the store is missing, where connecting would create it.
    names = knowledge_bases(url)
    with connect(url, knowledge_base=names[0] if names else DEFAULT_NAME) as knowledge_base:
        typer.echo(knowledge_base.anchor().text())


def verify(
    url: Url,
    kb: Name = None,
    verify_all: Annotated[bool, option("All knowledge bases.", "--all")] = False,
    anchor: AnchorFile = None,
    as_json: Annotated[bool, json_lines("knowledge base")] = False,
) -> int:
    """Verify that the history is intact.

    Recomputes every hash from the tables, compares columns with texts, indexes with their tables,
    and the structure with what the migrations create. Reports findings by revision. Exits with 0
    if there are none, and 1 otherwise.
    """
    from ..history.anchors import parse_anchor

    if kb is not None and verify_all:
        raise typer.BadParameter("give --kb or --all, not both", param_hint="--all")
    anchored = None if anchor is None else parse_anchor(anchor.read_bytes())
    printer, is_intact = Printer(), True
    for number, name in enumerate(_chosen(url, kb, verify_all, anchored)):
        # The structure is common to all knowledge bases.
        verification = _verify(url, name, anchored, structure=number == 0)
        is_intact &= verification.is_intact
        if as_json:
            write_json(verification_document(verification))
        else:
            _write_verification(printer, verification, anchored is not None)
    return 0 if is_intact else FAILED


def _verify(url: str, name: str, anchor: Anchor | None, structure: bool) -> Verification:
    from ..history.verify.findings import Finding
    from ..history.verify.verify import Verification
    from ..knowledge_base import connect

    try:
        with connect(url, knowledge_base=name) as knowledge_base, bar(name) as progress:
            return knowledge_base.verify(anchor, progress=progress, structure=structure)
    except InvalidMetadataError as error:
        # A name that the library never writes; the others are verified all the same.
        return Verification(name, 0, 0, (Finding(None, "knowledge_base", str(error)),))


def _chosen(url: str, name: str | None, verify_all: bool, anchor: Anchor | None) -> list[str]:
    """Choose the knowledge bases to verify, with those that are anchored and gone."""
    from ..sql.catalog import every_name

    names = every_name(url)
    heads = () if anchor is None else anchor.heads
    gone = [head.knowledge_base for head in heads if head.knowledge_base not in names]
    if verify_all:
        return [*names, *gone]
    if gone and (name in gone or (name is None and not names)):
        return gone
    return [choose(name, names), *gone]


def _write_verification(printer: Printer, verification: Verification, has_anchor: bool) -> None:
    name = printable(verification.knowledge_base)
    counts = f"{verification.revisions} revisions, {verification.changes} changes"
    for finding in verification.findings:
        printer.line(f"{name}: {printable(_finding_text(finding))}", "red")
    if verification.is_intact:
        printer.line(f"{name}: intact ({counts})", "green")
    else:
        findings = plural(len(verification.findings), "finding")
        printer.line(f"{name}: {findings} ({counts})", "bold red")
    for archive in verification.archives:
        printer.line(f"{name}: {printable(archive)}")
    if has_anchor and verification.anchored is None:
        printer.line(f"{name}: the anchor says nothing of it", "yellow")


def _finding_text(finding: Finding) -> str:
    place = "" if finding.revision is None else f"revision {finding.revision}: "
    table = "" if finding.table is None else f"{finding.table}: "
    return f"{place}{table}{finding.message}"


_Before = Annotated[
    str,
    option(
        "Move versions that ended before this: a time in ISO 8601 (UTC unless a zone is given), "
        "such as '90 days ago', or a revision's number.",
        metavar="REV|TIME",
    ),
]
_Target = Annotated[
    str, option("The other store; a missing SQLite file is created.", metavar="URL")
]


def archive(
    url: Url,
    before: _Before,
    to: _Target,
    kb: Name = None,
    dry_run: Annotated[bool, option("Only count.", "--dry-run")] = False,
    actor: Actor = None,
    reason: Reason = None,
    as_json: AsJson = False,
) -> None:
    """Move versions that ended before a time to another store.

    That store then answers questions about them.
    """
    when = parse_when(before, "--before")
    with (
        open_to_read(url, kb) as (name, knowledge_base),
        leaving_nothing(to),
        bar(name) as progress,
    ):
        done = knowledge_base.archive(
            when, to=to, dry_run=dry_run, reason=reason, actor=actor, progress=progress
        )
    if as_json:
        write_json({"knowledge_base": name, "dry_run": dry_run, **done._asdict()})
    else:
        _write_archived(Printer(), name, done, dry_run)


def _write_archived(printer: Printer, name: str, done: Archived, dry_run: bool) -> None:
    kb = f"knowledge base {printable(name)}"
    if not done.versions:
        printer.line(f"{kb}: nothing is here that ended up to revision {done.upto}")
        return
    verb = "to move" if dry_run else f"moved in revision {done.revision}"
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
    url: Url,
    kb: Annotated[
        str | None, option("The knowledge base; default: all.", "--kb", metavar="NAME")
    ] = None,
    drop: Annotated[bool, option("Drop the views that this command created.", "--drop")] = False,
    dry_run: Annotated[
        bool, option("Only write the SQL; change nothing.", "--sql", "--dry-run")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Create a view per predicate, or update the views."""
    from ..sql.predicate_views import drop_views, update_views

    changes = (drop_views if drop else update_views)(url, knowledge_base=kb, dry_run=dry_run)
    if as_json:
        write_json({"views": [_view_document(change, dry_run) for change in changes]})
    elif dry_run:
        statements = (statement for change in changes for statement in change.statements)
        typer.echo("".join(f"{statement};\n" for statement in statements), nl=False)
    else:
        _write_views(changes)


def _view_document(change: PredicateView, dry_run: bool) -> Document:
    document = change._asdict()
    if not dry_run:
        del document["statements"]
    return document


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
