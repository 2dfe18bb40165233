"""Reading PDDL text into documents, and checking many files at once."""

from __future__ import annotations

import gc
from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

from ..arguments import expect
from ..dto.lexical import fold
from ..errors import InvalidArgumentError, PddlError, SourceError
from .cursor import Cursor, Diagnostics
from .document import Domain, Problem
from .domain import DomainReader
from .forms import DOMAIN, PROBLEM, Form, Scanner
from .lexer import Source, decode, load, read_file
from .problem import ProblemReader


@contextmanager
def without_collector() -> Iterator[None]:
    """Pause the cyclic garbage collector: it would traverse documents, which have no cycles.

    Without the pause, reading 200,000 facts takes 2.5 times as long, and loading them into a store
    a fifth longer. Threads that overlap here restore the state that the first one found, or end the
    pause early.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


Document = TypeVar("Document", Domain, Problem)


@without_collector()
def read_domain(*sources: Source, strict: bool = False) -> Domain:
    """Read a domain from one or several sources.

    Repetitions in several sources are merged; contradictions are refused.

    Args:
        sources: paths, or strings with PDDL text, which begin with `(`.
        strict: whether to refuse violations of the standard that have only one sensible reading.

    Returns:
        The domain, with warnings about violations of the standard.

    Raises:
        PddlError: a source is not PDDL, or contradicts itself or another source.
        SourceMissingError: a file does not exist; also a `FileNotFoundError`.
        SourceError: a file cannot be read.
    """
    diagnostics = Diagnostics(strict)
    forms: list[Form] = []
    for source in sources:
        forms += _of_kind(diagnostics, Scanner(diagnostics, load(source)).scan(), DOMAIN)
    if not forms:
        raise TypeError("a domain is read from at least one source: a path, or PDDL text")
    return _with_warnings(DomainReader(diagnostics).read(forms), diagnostics)


@without_collector()
def read_problem(source: Source, *, domain: Domain | None = None, strict: bool = False) -> Problem:
    """Read a problem.

    Args:
        source: a path, or a string with PDDL text, which begins with `(`.
        domain: its domain. Without it, references to the domain are not checked.
        strict: whether to refuse violations of the standard that have only one sensible reading.

    Returns:
        The problem, with warnings about violations of the standard.

    Raises:
        PddlError: the source is not PDDL, or contradicts itself or the domain.
        SourceMissingError: the file does not exist; also a `FileNotFoundError`.
        SourceError: the file cannot be read.
    """
    if domain is not None:
        expect(domain, Domain, "the domain", InvalidArgumentError)
    diagnostics = Diagnostics(strict)
    forms = _of_kind(diagnostics, Scanner(diagnostics, load(source)).scan(), PROBLEM)
    if len(forms) > 1:
        Cursor(diagnostics, forms[1].head).fail("one problem", at=3)
    return _with_warnings(ProblemReader(diagnostics, forms[0], domain).read(), diagnostics)


@without_collector()
def read(source: Source, *, strict: bool = False) -> list[Domain | Problem]:
    """Read all domains and problems of a source.

    A problem is checked against its domain if the source contains it.

    Args:
        source: a path, or a string with PDDL text, which begins with `(`.
        strict: whether to refuse violations of the standard that have only one sensible reading.

    Returns:
        The domains and problems, in order, each with its own warnings.

    Raises:
        PddlError: the source is not PDDL.
        SourceMissingError: the file does not exist; also a `FileNotFoundError`.
        SourceError: the file cannot be read.
    """
    scanning = Diagnostics(strict)
    forms = Scanner(scanning, load(source)).scan()
    domains: dict[str, Domain] = {}
    documents: dict[int, Domain | Problem] = {}
    for number, form in enumerate(forms):
        if form.kind == DOMAIN:
            diagnostics = Diagnostics(strict)
            if fold(form.name) in domains:
                Cursor(diagnostics, form.head).fail("each domain once", at=4)
            domain = DomainReader(diagnostics).read([form])
            domains[fold(form.name)] = domain
            documents[number] = _with_warnings(domain, diagnostics)
    for number, form in enumerate(forms):
        if form.kind == PROBLEM:
            diagnostics = Diagnostics(strict)
            reader = ProblemReader(diagnostics, form, domains.get(fold(form.domain)))
            documents[number] = _with_warnings(reader.read(), diagnostics)
    found = [documents[number] for number in range(len(forms))]
    found[0] = replace(found[0], warnings=scanning.warnings() + found[0].warnings)
    return found


def _with_warnings(document: Document, diagnostics: Diagnostics) -> Document:
    warnings = diagnostics.warnings()
    return replace(document, warnings=warnings) if warnings else document


def _of_kind(diagnostics: Diagnostics, forms: list[Form], kind: str) -> list[Form]:
    """Return the forms of a kind; warn about others."""
    chosen = [form for form in forms if form.kind == kind]
    if not chosen:
        Cursor(diagnostics, forms[0].head).fail(kind, at=3)
    for form in forms:
        if form.kind != kind:
            cursor = Cursor(diagnostics, form.head)
            cursor.deviate(f"a {kind} alone", "left out", f"the {form.nesting} beside it", 0)
    return chosen


class Diagnostic(NamedTuple):
    """An error or a warning about a file; without a position if the file cannot be read."""

    source: str
    line: int | None
    column: int | None
    is_error: bool
    message: str


class CheckedDocument(NamedTuple):
    """A checked domain or problem."""

    kind: str  # `domain` or `problem`
    name: str
    sources: tuple[str, ...]  # the files that contain it
    is_read: bool  # whether it can be read
    domain: str | None  # the name of the domain that a problem was checked against, if any


class CheckReport(NamedTuple):
    """The result of a check, in the order of the files and of the positions in them."""

    documents: tuple[CheckedDocument, ...]
    findings: tuple[Diagnostic, ...]


def check(files: Iterable[Path | tuple[str, bytes]]) -> CheckReport:
    """Check files.

    Consecutive domains of one name and one folder are one domain. A problem is checked against the
    last domain of its name before it, or else the first one after it. If there are domains but none
    of its name, that is an error. Without any domain, or if its domain cannot be read, a problem is
    checked without one.
    """
    checker = _Checker()
    for file in files:
        checker.add(*((str(file), None) if isinstance(file, Path) else file))
    return checker.report()


@dataclass(eq=False)
class _Definition:
    """A domain of one or several forms, or a problem."""

    forms: list[Form]
    is_read: bool = False
    domain: Domain | None = None

    def __post_init__(self) -> None:
        self.kind, self.name = self.forms[0].kind, self.forms[0].name
        self.place = Path(self.forms[0].head.text.name).parent, fold(self.name)

    def checked(self) -> CheckedDocument:
        """Return the entry for the report."""
        sources = dict.fromkeys(form.head.text.name for form in self.forms)
        domain = None if self.domain is None or self.kind == DOMAIN else self.domain.name
        return CheckedDocument(self.kind, self.name, tuple(sources), self.is_read, domain)


class _Checker:
    """A check in progress."""

    def __init__(self) -> None:
        self._definitions: list[_Definition] = []
        self._findings: list[Diagnostic] = []
        self._order: dict[str, int] = {}

    @contextmanager
    def _reading(self) -> Iterator[Diagnostics]:
        """Turn the warnings and the errors of a reading into findings."""
        diagnostics = Diagnostics(strict=False)
        try:
            yield diagnostics
        except PddlError as error:
            place = error.source, error.line, error.column
            message = str(error).removeprefix("{}:{}:{}: ".format(*place))
            self._findings.append(Diagnostic(*place, True, message))
        except SourceError as error:
            self._findings.append(
                Diagnostic(error.filename, None, None, True, error.strerror or "")
            )
        for source, line, column, message in diagnostics.warnings():
            self._findings.append(Diagnostic(source, line, column, False, message))

    def add(self, name: str, data: bytes | None) -> None:
        """Scan the definitions of a file, which is read unless its data is given."""
        self._order.setdefault(name, len(self._order))
        with self._reading() as diagnostics:
            data = read_file(name) if data is None else data
            for form in Scanner(diagnostics, decode(name, data)).scan():
                self._add(_Definition([form]))

    def _add(self, definition: _Definition) -> None:
        last = self._definitions[-1] if self._definitions else None
        if last and last.kind == definition.kind == DOMAIN and last.place == definition.place:
            last.forms += definition.forms
        else:
            self._definitions.append(definition)

    def report(self) -> CheckReport:
        """Read the definitions, and report the findings."""
        domains = [one for one in enumerate(self._definitions) if one[1].kind == DOMAIN]
        named: dict[str, list[tuple[int, _Definition]]] = {}
        for position, definition in domains:
            with self._reading() as diagnostics:
                definition.domain = DomainReader(diagnostics).read(definition.forms)
                definition.is_read = True
            named.setdefault(fold(definition.name), []).append((position, definition))
        for position, definition in enumerate(self._definitions):
            if definition.kind == DOMAIN:
                continue
            [form] = definition.forms
            domain = _nearest(named.get(fold(form.domain), domains), position)
            with self._reading() as diagnostics:
                ProblemReader(diagnostics, form, domain).read()
                definition.is_read, definition.domain = True, domain
        found = sorted(
            self._findings,
            key=lambda one: (self._order[one.source], one.line or 0, one.column or 0),
        )
        return CheckReport(tuple(one.checked() for one in self._definitions), tuple(found))


def _nearest(domains: Sequence[tuple[int, _Definition]], position: int) -> Domain | None:
    """Return the last domain before a position, or else the first one after it."""
    if not domains:
        return None
    before = bisect(domains, position, key=lambda one: one[0])
    return domains[max(before - 1, 0)][1].domain
