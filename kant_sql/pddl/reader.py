"""Reading PDDL: text becomes documents, and what is wrong is said with its place."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from ..arguments import expect
from ..dto.name import fold
from ..errors import InvalidArgumentError
from .collector import without_collector
from .cursor import Cursor, Reading
from .document import Domain, Problem
from .domain import DomainReader
from .forms import DOMAIN, PROBLEM, Form, Scanner
from .problem import ProblemReader
from .tokens import Source, load

Document = TypeVar("Document", Domain, Problem)


@without_collector()
def read_domain(*sources: Source, strict: bool = False) -> Domain:
    """Read a domain, which may be spread over several sources.

    What several sources say alike is one; where they contradict each other they are refused.

    Args:
        sources: each a path, or a string with PDDL text, which begins with `(`.
        strict: whether to refuse what violates the standard but can be read in one way only.

    Returns:
        The domain, with warnings about what violates the standard.

    Raises:
        PddlError: a source cannot be read as PDDL, or contradicts itself or another.
        SourceMissingError: there is no such file; it is a `FileNotFoundError`, too.
        SourceError: a file cannot be read.
    """
    reading = Reading(strict)
    forms: list[Form] = []
    for source in sources:
        forms += _of_kind(reading, Scanner(reading, load(source)).scan(), DOMAIN)
    if not forms:
        raise TypeError("read_domain() needs at least one source")
    return _with_warnings(DomainReader(reading).read(forms), reading)


@without_collector()
def read_problem(source: Source, *, domain: Domain | None = None, strict: bool = False) -> Problem:
    """Read a problem.

    Args:
        source: a path, or a string with PDDL text, which begins with `(`.
        domain: its domain. Without it, what the problem uses is not checked against a domain.
        strict: whether to refuse what violates the standard but can be read in one way only.

    Returns:
        The problem, with warnings about what violates the standard.

    Raises:
        PddlError: the source cannot be read as PDDL, or does not suit the domain.
        SourceMissingError: there is no such file; it is a `FileNotFoundError`, too.
        SourceError: the file cannot be read.
    """
    if domain is not None:
        expect(domain, Domain, "the domain", InvalidArgumentError)
    reading = Reading(strict)
    forms = _of_kind(reading, Scanner(reading, load(source)).scan(), PROBLEM)
    if len(forms) > 1:
        Cursor(reading, forms[1].head, "").fail("one problem", at=3)
    return _with_warnings(ProblemReader(reading, forms[0], domain).read(), reading)


@without_collector()
def read(source: Source, *, strict: bool = False) -> list[Domain | Problem]:
    """Read all that a source defines.

    A problem is checked against its domain when that is in the source, too.

    Args:
        source: a path, or a string with PDDL text, which begins with `(`.
        strict: whether to refuse what violates the standard but can be read in one way only.

    Returns:
        The domains and problems, in order; the warnings of each are its own.

    Raises:
        PddlError: the source cannot be read as PDDL.
        SourceMissingError: there is no such file; it is a `FileNotFoundError`, too.
        SourceError: the file cannot be read.
    """
    scanning = Reading(strict)
    forms = Scanner(scanning, load(source)).scan()
    domains: dict[str, Domain] = {}
    documents: dict[int, Domain | Problem] = {}
    for number, form in enumerate(forms):
        if form.kind == DOMAIN:
            reading = Reading(strict)
            if fold(form.name) in domains:
                Cursor(reading, form.head, "").fail("each domain once", at=4)
            domain = DomainReader(reading).read([form])
            domains[fold(form.name)] = domain
            documents[number] = _with_warnings(domain, reading)
    for number, form in enumerate(forms):
        if form.kind == PROBLEM:
            reading = Reading(strict)
            reader = ProblemReader(reading, form, domains.get(fold(form.domain)))
            documents[number] = _with_warnings(reader.read(), reading)
    found = [documents[number] for number in range(len(forms))]
    found[0] = replace(found[0], warnings=scanning.warnings() + found[0].warnings)
    return found


def _with_warnings(document: Document, reading: Reading) -> Document:
    warnings = reading.warnings()
    return replace(document, warnings=warnings) if warnings else document


def _of_kind(reading: Reading, forms: list[Form], kind: str) -> list[Form]:
    """Choose the forms of a kind, and note that there are others."""
    chosen = [form for form in forms if form.kind == kind]
    if not chosen:
        Cursor(reading, forms[0].head, "").fail(kind, at=3)
    for form in forms:
        if form.kind != kind:
            cursor = Cursor(reading, form.head, "")
            cursor.deviate(f"a {kind} alone", "left out", f"the {form.nesting} beside it", 0)
    return chosen
