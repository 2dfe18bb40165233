"""`kant-sql check`: what is wrong with PDDL files, without a store."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..errors import KantSqlError
from ..pddl.checking import Checked, Finding, Report
from ..pddl.checking import check as check_files
from ..pddl.forms import DOMAIN
from .files import STANDARD_INPUT, read_bytes
from .output import Printer, printable, write_json


def check(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE...",
            show_default=False,
            help="PDDL files: domains, each before the problems that are checked against it; - is "
            "standard input.",
        ),
    ],
    strict: Annotated[
        bool, typer.Option("--strict", help="Take for an error what violates the standard.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Tell all errors and warnings in PDDL files.

    Ends with 1 when there are errors.
    """
    report = check_files([_source(file) for file in files])
    errors = sum(finding.is_error or strict for finding in report.findings)
    if as_json:
        write_json(_document(report, strict))
    else:
        _write(report, strict)
    if errors:
        raise KantSqlError(f"{errors} error{'' if errors == 1 else 's'} in {_count(files)}")


def _source(file: str) -> Path | tuple[str, bytes]:
    return read_bytes(file) if file == STANDARD_INPUT else Path(file)


def _write(report: Report, strict: bool) -> None:
    printer = Printer()
    for finding in report.findings:
        place = [finding.source]
        if finding.line is not None:
            place += [str(finding.line), str(finding.column)]
        severity = _severity(finding, strict)
        style = "red" if severity == "error" else "yellow"
        printer.line(printable(f"{':'.join(place)}: {severity}: {finding.message}"), style)
    for checked in report.documents:
        if checked.is_read:
            printer.line(printable(f"{', '.join(checked.sources)}: {_said(checked)}"))


def _said(checked: Checked) -> str:
    text = f"{checked.kind} {checked.name}"
    if checked.kind == DOMAIN:
        return text
    if checked.domain is None:
        return f"{text}, checked without its domain; give the file of that, too"
    return f"{text}, checked against domain {checked.domain}"


def _document(report: Report, strict: bool) -> dict[str, object]:
    return {
        "documents": [checked._asdict() for checked in report.documents],
        "findings": [
            {
                "source": finding.source,
                "line": finding.line,
                "column": finding.column,
                "severity": _severity(finding, strict),
                "message": finding.message,
            }
            for finding in report.findings
        ],
    }


def _severity(finding: Finding, strict: bool) -> str:
    return "error" if finding.is_error or strict else "warning"


def _count(files: Sequence[str]) -> str:
    return "1 file" if len(files) == 1 else f"{len(files)} files"
