"""`kant-sql export`: the audit's views as files, or a format of a plugin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import printable
from .common import AsJson, Since, Until, Url, option, parse_optional
from .output import Printer, bar, plural, write_json

if TYPE_CHECKING:
    from ..export import Exported, PluggedFormat

_FORMATS = ("parquet", "csv", "jsonl")


def export(
    url: Url,
    to: Annotated[Path, option("The folder to write; created if it is missing.", metavar="DIR")],
    format: Annotated[
        str,
        option(
            "parquet, csv or jsonl: the views for auditors; one that a plugin adds: facts and "
            "values over time.",
            metavar="FORMAT",
        ),
    ] = _FORMATS[0],
    kb: Annotated[
        str | None, option("The knowledge base; default: all.", "--kb", metavar="NAME")
    ] = None,
    view: Annotated[
        list[str] | None,
        option("Write only this view, such as fact; you can repeat this.", metavar="NAME"),
    ] = None,
    predicate: Annotated[
        list[str] | None,
        option(
            "Of a plugin's format: only this predicate or function; you can repeat this.",
            metavar="NAME",
        ),
    ] = None,
    element: Annotated[
        list[str] | None,
        option(
            "Of a plugin's format: only this fact or fluent, as '(robot_at rb1 wp1)'; may be given "
            "several times.",
            metavar="TEXT",
        ),
    ] = None,
    since: Since = None,
    until: Until = None,
    replace: Annotated[
        bool, option("Replace an earlier export in the folder.", "--replace")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write the audit views, or facts and values over time, to files.

    Reads one consistent state, whatever is written meanwhile.
    """
    from ..export import export_store

    plugged = _plugged_format(format)
    for given, name in ((predicate, "--predicate"), (element, "--element")):
        if given and plugged is None:
            raise typer.BadParameter(f"this is not for {format}", param_hint=name)
    if view and plugged is not None:
        raise typer.BadParameter(f"{format} has no views", param_hint="--view")
    common: dict[str, Any] = {
        "to": to,
        "knowledge_base": kb,
        "since": parse_optional(since, "--since"),
        "until": parse_optional(until, "--until"),
        "replace": replace,
    }
    with bar(f"export {kb or ''}".strip()) as progress:
        if plugged is None:
            done = export_store(url, format=format, views=view, progress=progress, **common)
        else:
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

    found = PLUGGED_FORMATS.get(format)
    if found is None:
        known = ", ".join((*_FORMATS, *PLUGGED_FORMATS.names()))
        raise typer.BadParameter(f"{format!r}: expected one of {known}", param_hint="--format")
    return found


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
