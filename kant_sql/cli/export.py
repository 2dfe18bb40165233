"""`kant-sql export`: the audit's views, or state transitions, as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import printable
from .common import AsJson, Since, Until, Url, option, parse_optional
from .output import Printer, bar, plural, write_json

if TYPE_CHECKING:
    from ..export import Exported

_FORMATS = ("parquet", "csv", "jsonl", "mcap")


def export(
    url: Url,
    to: Annotated[Path, option("The folder; it is created if it is missing.", metavar="DIR")],
    format: Annotated[
        str,
        option(
            "parquet, csv or jsonl: the views for auditors; mcap: transitions of facts and values, "
            "for Foxglove.",
            metavar="|".join(_FORMATS),
        ),
    ] = _FORMATS[0],
    kb: Annotated[
        str | None, option("The knowledge base; default: all.", "--kb", metavar="NAME")
    ] = None,
    view: Annotated[
        list[str] | None,
        option("Only this view, as fact; may be given several times.", metavar="NAME"),
    ] = None,
    predicate: Annotated[
        list[str] | None,
        option(
            "mcap: only this predicate or function; may be given several times.", metavar="NAME"
        ),
    ] = None,
    element: Annotated[
        list[str] | None,
        option(
            "mcap: only this fact or fluent, as '(robot_at rb1 wp1)'; may be given several times.",
            metavar="TEXT",
        ),
    ] = None,
    since: Since = None,
    until: Until = None,
    replace: Annotated[bool, option("Replace the export in the folder.", "--replace")] = False,
    as_json: AsJson = False,
) -> None:
    """Write the audit views, or state transitions, to files.

    Reads one consistent state, whatever is written meanwhile.
    """
    from ..export import export_store, export_transitions

    _check_options(format, view, predicate, element)
    common: dict[str, Any] = {
        "to": to,
        "knowledge_base": kb,
        "since": parse_optional(since, "--since"),
        "until": parse_optional(until, "--until"),
        "replace": replace,
    }
    with bar(f"export {kb or ''}".strip()) as progress:
        if format == "mcap":
            done = export_transitions(
                url, names=predicate, elements=element, progress=progress, **common
            )
        else:
            done = export_store(url, format=format, views=view, progress=progress, **common)
    if as_json:
        write_json(done)
    else:
        _write_exported(Printer(), done)


def _check_options(
    format: str,
    view: list[str] | None,
    predicate: list[str] | None,
    element: list[str] | None,
) -> None:
    if format not in _FORMATS:
        raise typer.BadParameter(
            f"{format!r}: expected one of {', '.join(_FORMATS)}", param_hint="--format"
        )
    if format == "mcap" and view:
        raise typer.BadParameter("views are not for mcap", param_hint="--view")
    for given, name in ((predicate, "--predicate"), (element, "--element")):
        if given and format != "mcap":
            raise typer.BadParameter("this is for --format mcap only", param_hint=name)


def _write_exported(printer: Printer, done: Exported) -> None:
    what = "messages" if done.format == "mcap" else "rows"
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
