"""`kant-sql check`: errors and warnings in PDDL files, without a store."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..errors import KantSqlError, SourceError, printable
from ..pddl.forms import DOMAIN
from ..pddl.lexer import read_file
from ..pddl.reader import CheckedDocument, CheckReport, Diagnostic
from ..pddl.reader import check as check_files
from .common import AsJson, option
from .output import Document, Printer, plural, write_json

STANDARD_INPUT = "-"
_STDIN = "<stdin>"


def read_bytes(path: str) -> tuple[str, bytes]:
    """Return the name and the bytes of a file or of standard input."""
    name = _STDIN if path == STANDARD_INPUT else str(Path(path))
    return name, _read_stdin() if path == STANDARD_INPUT else read_file(name)


def _read_stdin() -> bytes:
    if not sys.stdin:
        # The process was started with standard input closed.
        raise SourceError(errno.EBADF, os.strerror(errno.EBADF), _STDIN)
    try:
        return sys.stdin.buffer.read()
    except OSError as error:
        number = error.errno or errno.EIO
        raise SourceError(number, os.strerror(number), _STDIN) from error


def check(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE...",
            show_default=False,
            help="PDDL files, each domain before its problems; - is standard input.",
        ),
    ],
    strict: Annotated[
        bool, option("Treat deviations from the standard as errors.", "--strict")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Report all errors and warnings in PDDL files.

    Exits with 1 if there are errors.
    """
    report = check_files([_source(file) for file in files])
    errors = sum(finding.is_error or strict for finding in report.findings)
    if as_json:
        write_json(_report_document(report, strict))
    else:
        _write_report(report, strict)
    if errors:
        raise KantSqlError(f"{plural(errors, 'error')} in {plural(len(files), 'file')}")


def _source(file: str) -> Path | tuple[str, bytes]:
    return read_bytes(file) if file == STANDARD_INPUT else Path(file)


def _write_report(report: CheckReport, strict: bool) -> None:
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
            printer.line(printable(f"{', '.join(checked.sources)}: {_result(checked)}"))


def _result(checked: CheckedDocument) -> str:
    text = f"{checked.kind} {checked.name}"
    if checked.kind == DOMAIN:
        return text
    if checked.domain is None:
        return f"{text}, checked without its domain; give the file of that, too"
    return f"{text}, checked against domain {checked.domain}"


def _report_document(report: CheckReport, strict: bool) -> Document:
    return {
        "documents": report.documents,
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


def _severity(finding: Diagnostic, strict: bool) -> str:
    return "error" if finding.is_error or strict else "warning"
