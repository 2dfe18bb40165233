"""`kant-sql load`, `dump` and `check`: PDDL files into the store, out of it, and without one."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from ..errors import KantSqlError, SchemaMissingError, SourceError, UnknownRevisionError, printable
from ..pddl import PddlWarning
from ..pddl.cursor import Diagnostics
from ..pddl.forms import DOMAIN, PROBLEM, Form, Scanner
from ..pddl.lexer import Text, decode, read_file
from ..pddl.reader import CheckedDocument, CheckReport, Diagnostic
from ..pddl.reader import check as check_files
from . import common as c
from .output import Document, Printer, bar, is_terminal, plural, printable_lines, write_json

if TYPE_CHECKING:
    from ..dao.interfaces import Progress
    from ..documents.exchange import Mode
    from ..history.revisions import Revision
    from ..knowledge_base import KnowledgeBase

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
        bool, c.option("Treat deviations from the standard as errors.", "--strict")
    ] = False,
    as_json: c.AsJson = False,
) -> None:
    """Report all errors and warnings in PDDL files.

    Exits with 1 if there are errors.
    """
    report = check_files(
        [read_bytes(file) if file == STANDARD_INPUT else Path(file) for file in files]
    )
    errors = sum(finding.is_error or strict for finding in report.findings)
    if as_json:
        findings = [_finding_document(finding, strict) for finding in report.findings]
        write_json(documents=report.documents, findings=findings)
    else:
        _write_report(report, strict)
    if errors:
        raise KantSqlError(f"{plural(errors, 'error')} in {plural(len(files), 'file')}")


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


def _finding_document(finding: Diagnostic, strict: bool) -> Document:
    return {
        "source": finding.source,
        "line": finding.line,
        "column": finding.column,
        "severity": _severity(finding, strict),
        "message": finding.message,
    }


def _severity(finding: Diagnostic, strict: bool) -> str:
    return "error" if finding.is_error or strict else "warning"


_WORDS = c.CommandWords("[URL] FILE...", "sqlite:///robot.db domain.pddl problem.pddl")
# The share of the commit in the time of a long load.
_COMMIT = 0.2
# Full names of kinds that the log abbreviates.
_LABELS = {
    "derived": "derived predicate",
    "initial": "initial literal",
    "timed": "timed initial literal",
    "value": "function value",
}


def load(
    words: Annotated[
        list[str],
        _WORDS.argument(
            "the PDDL files: a domain, in one file or several, a problem, or both; - is standard "
            "input.",
        ),
    ],
    kb: c.Target = c.DEFAULT_NAME,
    merge: Annotated[
        bool,
        c.option(
            "Keep elements that the files do not mention, instead of retracting them.", "--merge"
        ),
    ] = False,
    strict: Annotated[
        bool, c.option("Refuse deviations from the standard, instead of warning.", "--strict")
    ] = False,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> None:
    """Load a domain, a problem or both, in one revision or none."""
    from ..knowledge_base import connect

    url, paths = _WORDS.split(words)
    inputs = read_inputs(paths)
    if not inputs.domains:
        # A problem needs a domain: without one, no store is created for it.
        _require_domain(kb, url, paths)
    mode: Mode = "merge" if merge else "replace"
    with c.leaving_nothing(url), connect(url, knowledge_base=kb) as knowledge_base:
        warnings, made = _store(knowledge_base, inputs, mode, strict, actor, reason)
        if as_json:
            write_json(_load_document(kb, knowledge_base, made, warnings))
            return
        sys.stderr.writelines(f"{printable(str(warning))}\n" for warning in warnings)
        _write_load(kb, knowledge_base, made)


class Inputs(NamedTuple):
    """The PDDL texts to load."""

    domains: tuple[Text, ...]  # together, the domain
    problem: Text | None
    files: tuple[dict[str, str], ...]  # path and hash of each, as JSON data


def read_inputs(paths: Sequence[str]) -> Inputs:
    """Read files, and find the domains and the problem in them."""
    domains: list[Text] = []
    problems: list[Text] = []
    files = []
    for path in paths:
        name, data = read_bytes(path)
        text = decode(name, data)
        forms = Scanner(Diagnostics(strict=False), text).scan()
        kinds = {form.kind for form in forms}
        if DOMAIN in kinds:
            domains.append(_without(text, forms, PROBLEM))
        if PROBLEM in kinds:
            problems.append(_without(text, forms, DOMAIN))
        # A path may have bytes that are not text.
        shown = os.fsencode(name).decode("utf-8", "backslashreplace")
        files.append({"path": shown, "sha256": hashlib.sha256(data).hexdigest()})
    if len(problems) > 1:
        first, second = problems[:2]
        raise KantSqlError(f"{first.name} and {second.name} each have a problem: load one of them")
    return Inputs(tuple(domains), problems[0] if problems else None, tuple(files))


def _without(text: Text, forms: Sequence[Form], kind: str) -> Text:
    """Return a text without the forms of a kind, which would cause warnings."""
    ends = [*(form.head.start for form in forms[1:]), len(text.code)]
    parts = [(form.head.start, end) for form, end in zip(forms, ends, strict=True)]
    unwanted = [part for form, part in zip(forms, parts, strict=True) if form.kind == kind]
    return text.without(unwanted) if unwanted else text


def _require_domain(kb: str, url: str, paths: Sequence[str]) -> None:
    """Check that the knowledge base exists: otherwise it cannot have the problem's domain."""
    from ..sql.catalog import written_names

    remedy = f"give the file of the domain, too, before {', '.join(paths)}"
    try:
        names = written_names(url)
    except SchemaMissingError as error:
        raise KantSqlError(f"a problem needs its domain: {remedy}; {error}") from error
    if not names:
        raise KantSqlError(f"a problem needs its domain, and the store has none: {remedy}")
    c.choose(kb, names)


def _store(
    knowledge_base: KnowledgeBase,
    inputs: Inputs,
    mode: Mode,
    strict: bool,
    actor: str | None,
    reason: str | None,
) -> tuple[Iterable[PddlWarning], Revision | None]:
    """Store the texts in one revision; return it with the warnings."""
    source = {"files": list(inputs.files)}
    warnings: list[PddlWarning] = []
    size = sum(len(text.code) for text in inputs.domains)
    whole = size + (0 if inputs.problem is None else len(inputs.problem.code))
    with (
        bar("loading") as progress,
        knowledge_base.transaction(actor=actor, reason=reason, source=source),
    ):
        before = knowledge_base.revision
        if inputs.domains:
            part = _part(progress, 0, size, whole)
            warnings += knowledge_base.load_domain(
                *inputs.domains, mode=mode, strict=strict, progress=part
            )[1]
        if inputs.problem is not None:
            part = _part(progress, size, whole, whole)
            warnings += knowledge_base.load_problem(
                inputs.problem, mode=mode, strict=strict, progress=part
            )[1]
    made = knowledge_base.store.revisions(after=before, limit=1)
    # If nothing has changed, the next revision may be another writer's.
    own = [one for one in made if (one.actor, one.reason, one.source) == (actor, reason, source)]
    return dict.fromkeys(warnings), own[0] if own else None


def _write_load(name: str, knowledge_base: KnowledgeBase, made: Revision | None) -> None:
    printer = Printer()
    if made is None:
        number = knowledge_base.revision
        printer.line(f"knowledge base {name}, revision {number}: nothing has changed", "bold")
        return
    printer.line(f"knowledge base {name}, revision {made.number}", "bold")
    asserted, retracted = _counts(knowledge_base, made)
    for sign, style, counts in (("+", "green", asserted), ("-", "red", retracted)):
        if counts:
            summary = ", ".join(plural(count, label) for label, count in counts.items())
            printer.line(f"{sign} {summary}", style)


def _load_document(
    name: str, knowledge_base: KnowledgeBase, made: Revision | None, warnings: Iterable[PddlWarning]
) -> Document:
    """Return the result of a load as JSON data."""
    asserted, retracted = _counts(knowledge_base, made)
    return {
        "knowledge_base": name,
        "revision": None if made is None else made.number,
        "head": knowledge_base.revision if made is None else made.number,
        "asserted": asserted,
        "retracted": retracted,
        "warnings": list(warnings),
    }


def _counts(knowledge_base: KnowledgeBase, made: Revision | None) -> list[dict[str, int]]:
    """Count the elements that a revision asserted and retracted, by kind."""
    if made is None:
        return [{}, {}]
    (entry,) = knowledge_base.at(made.number).log(limit=1)
    kinds = [(change.sign, _LABELS.get(change.kind, change.kind)) for change in entry.changes]
    return [
        dict(sorted(Counter(kind for of, kind in kinds if of == sign).items())) for sign in "+-"
    ]


def _part(progress: Progress | None, begin: int, end: int, whole: int) -> Progress | None:
    """Map the progress of one document to that of the load, including the commit."""
    if progress is None:
        return None
    return lambda done, of: progress(
        int((begin + (end - begin) * done / max(1, of)) * (1 - _COMMIT)), max(1, whole)
    )


def dump(
    url: c.Url,
    kb: c.Name = None,
    at: c.At = None,
    valid: c.Valid = None,
    domain: Annotated[bool, c.option("Write only the domain.", "--domain")] = False,
    problem: Annotated[bool, c.option("Write only the problem.", "--problem")] = False,
    as_json: c.AsJson = False,
) -> None:
    """Write the domain and the problem as PDDL.

    'kant-sql load' accepts both in one file.
    """
    with c.open_state(url, kb, at, valid) as (name, state):
        if at is not None and not state.revision:
            raise UnknownRevisionError(
                f"--at {at} is before the first revision of knowledge base {name!r}, so there is "
                "nothing to write; give a later one"
            )
        texts = {"domain": state.domain_pddl()} if domain or not problem else {}
        if problem or not domain:
            texts["problem"] = state.problem_pddl()
        revision = state.revision
    if as_json:
        both = {"domain": None, "problem": None, **texts}
        write_json(knowledge_base=name, revision=revision, **both)
        return
    text = "\n".join(texts.values())
    if is_terminal():
        text = printable_lines(text)
    # In UTF-8 whatever the terminal's encoding, because planners read UTF-8.
    sys.stdout.buffer.write(text.encode())
