"""`kant-sql load`: PDDL files become knowledge, in one revision."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Annotated

import typer

from ..catalog import knowledge_bases
from ..documents import Mode
from ..errors import KantSqlError, SchemaMissingError
from ..history import LogEntry, Progress, Revision
from ..knowledge_base import KnowledgeBase, connect
from ..pddl import PddlWarning
from .files import Inputs, read_inputs
from .output import AsJson, Printer, printable, write_json
from .progress import bar
from .stores import DEFAULT_NAME, URL_VARIABLE, choose, leaving_nothing, split_url

_USAGE = "[URL] FILE..."
_EXAMPLE = "sqlite:///robot.db domain.pddl problem.pddl"
# So much of the time of a long load is left when all is stored but not committed.
_COMMIT = 0.2
# What the log calls shortly.
_LABELS = {
    "derived": "derived predicate",
    "initial": "initial literal",
    "timed": "timed initial literal",
    "value": "function value",
}


def load(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar=_USAGE,
            show_default=False,
            help=f"The database URL [env var: {URL_VARIABLE}], and the PDDL files: a domain, which "
            "may be spread over several files, a problem, or both; - is standard input.",
        ),
    ],
    kb: Annotated[
        str, typer.Option("--kb", metavar="NAME", help="The knowledge base to write to.")
    ] = DEFAULT_NAME,
    merge: Annotated[
        bool,
        typer.Option("--merge", help="Keep what the files do not say; else it is retracted."),
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse what violates the standard; else warn of it.")
    ] = False,
    actor: Annotated[
        str | None, typer.Option(metavar="NAME", show_default=False, help="Who writes.")
    ] = None,
    reason: Annotated[
        str | None, typer.Option(metavar="TEXT", show_default=False, help="Why.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Load a domain, a problem or both, in one revision or not at all."""
    url, paths = split_url(words, _USAGE, _EXAMPLE)
    inputs = read_inputs(paths)
    if not inputs.domains:
        # A problem needs a domain: without one, no store is created for it.
        _choose_with_domain(kb, url, paths)
    with leaving_nothing(url), connect(url, knowledge_base=kb) as knowledge_base:
        warnings, made = _store(
            knowledge_base, inputs, "merge" if merge else "replace", strict, actor, reason
        )
        if as_json:
            write_json(_document(kb, knowledge_base, made, warnings))
            return
        sys.stderr.writelines(f"{printable(str(warning))}\n" for warning in warnings)
        _write_result(kb, knowledge_base, made)


def _choose_with_domain(kb: str, url: str, paths: Sequence[str]) -> None:
    """Check that there is a knowledge base that may have the domain of a problem."""
    remedy = f"give the file of the domain, too, before {', '.join(paths)}"
    try:
        names = knowledge_bases(url)
    except SchemaMissingError as error:
        raise KantSqlError(f"a problem needs its domain: {remedy}; {error}") from error
    if not names:
        raise KantSqlError(f"a problem needs its domain, and the store has none: {remedy}")
    choose(kb, names)


def _store(
    knowledge_base: KnowledgeBase,
    inputs: Inputs,
    mode: Mode,
    strict: bool,
    actor: str | None,
    reason: str | None,
) -> tuple[Iterable[PddlWarning], Revision | None]:
    """Store all that there is in one revision, and find that."""
    source = {"files": list(inputs.files)}
    warnings: list[PddlWarning] = []
    size = sum(len(text.code) for text in inputs.domains)
    whole = size + (0 if inputs.problem is None else len(inputs.problem.code))
    with (
        bar("loading") as told,
        knowledge_base.transaction(actor=actor, reason=reason, source=source),
    ):
        before = knowledge_base.revision
        if inputs.domains:
            warnings += knowledge_base.load_domain(
                *inputs.domains, mode=mode, strict=strict, progress=_part(told, 0, size, whole)
            )[1]
        if inputs.problem is not None:
            warnings += knowledge_base.load_problem(
                inputs.problem, mode=mode, strict=strict, progress=_part(told, size, whole, whole)
            )[1]
    made = knowledge_base.revisions(after=before, limit=1)
    # When nothing has changed, the next revision is somebody else's.
    own = [one for one in made if (one.actor, one.reason, one.source) == (actor, reason, source)]
    return dict.fromkeys(warnings), own[0] if own else None


def _write_result(name: str, knowledge_base: KnowledgeBase, made: Revision | None) -> None:
    printer = Printer()
    if made is None:
        number = knowledge_base.revision
        printer.line(f"knowledge base {name}, revision {number}: nothing has changed", "bold")
        return
    printer.line(f"knowledge base {name}, revision {made.number}", "bold")
    (entry,) = knowledge_base.at(made.number).log(limit=1)
    for sign, style in (("+", "green"), ("-", "red")):
        counts = _counts(entry, sign)
        if counts:
            said = ", ".join(
                f"{count} {label}{'' if count == 1 else 's'}" for label, count in counts.items()
            )
            printer.line(f"{sign} {said}", style)


def _document(
    name: str,
    knowledge_base: KnowledgeBase,
    made: Revision | None,
    warnings: Iterable[PddlWarning],
) -> dict[str, object]:
    """Give what was loaded in the form that becomes JSON."""
    asserted, retracted = {}, {}
    if made is not None:
        (entry,) = knowledge_base.at(made.number).log(limit=1)
        asserted, retracted = _counts(entry, "+"), _counts(entry, "-")
    return {
        "knowledge_base": name,
        "revision": None if made is None else made.number,
        "head": knowledge_base.revision if made is None else made.number,
        "asserted": asserted,
        "retracted": retracted,
        "warnings": [warning._asdict() for warning in warnings],
    }


def _counts(entry: LogEntry, sign: str) -> dict[str, int]:
    kinds = (change.kind for change in entry.changes if change.sign == sign)
    return dict(sorted(Counter(_LABELS.get(kind, kind) for kind in kinds).items()))


def _part(told: Progress | None, begin: int, end: int, whole: int) -> Progress | None:
    """Make of the progress of one document that of the load, whose last part is the commit."""
    if told is None:
        return None
    return lambda done, of: told(
        int((begin + (end - begin) * done / max(1, of)) * (1 - _COMMIT)), max(1, whole)
    )
