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
from .document import Domain, PddlWarning, Problem
from .domain import DomainReader
from .forms import DOMAIN, PROBLEM, Form, Scanner
from .lexer import Source, decode, load, read_file
from .problem import ProblemReader


@contextmanager
def without_collector() -> Iterator[None]:
    """Pause the cyclic garbage collector: documents have no cycles, and it goes through them.

    Reading 200,000 facts takes 2.5 times as long with it, and loading them into a store a fifth
    longer. Threads that do so at the same time leave it as the first of them found it, or end the
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
    diagnostics = Diagnostics(strict)
    forms: list[Form] = []
    for source in sources:
        forms += _of_kind(diagnostics, Scanner(diagnostics, load(source)).scan(), DOMAIN)
    if not forms:
        raise TypeError("read_domain() needs at least one source")
    return _with_warnings(DomainReader(diagnostics).read(forms), diagnostics)


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
    diagnostics = Diagnostics(strict)
    forms = _of_kind(diagnostics, Scanner(diagnostics, load(source)).scan(), PROBLEM)
    if len(forms) > 1:
        Cursor(diagnostics, forms[1].head).fail("one problem", at=3)
    return _with_warnings(ProblemReader(diagnostics, forms[0], domain).read(), diagnostics)


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
    """Choose the forms of a kind, and note that there are others."""
    chosen = [form for form in forms if form.kind == kind]
    if not chosen:
        Cursor(diagnostics, forms[0].head).fail(kind, at=3)
    for form in forms:
        if form.kind != kind:
            cursor = Cursor(diagnostics, form.head)
            cursor.deviate(f"a {kind} alone", "left out", f"the {form.nesting} beside it", 0)
    return chosen


class Finding(NamedTuple):
    """Something that is wrong with a file.

    Attributes:
        source: the file's path.
        line: the line, from 1; None when the file cannot be read at all.
        column: the column, from 1; None likewise.
        is_error: whether the file is refused; else it violates the standard, but can be read.
        message: what was found, and what was expected.
    """

    source: str
    line: int | None
    column: int | None
    is_error: bool
    message: str


class Checked(NamedTuple):
    """A domain or a problem that was checked.

    Attributes:
        kind: `domain` or `problem`.
        name: its name.
        sources: the files that it is in.
        is_read: whether it can be read.
        domain: the name of the domain that a problem was checked against; None without one.
    """

    kind: str
    name: str
    sources: tuple[str, ...]
    is_read: bool
    domain: str | None


class Report(NamedTuple):
    """What came of checking.

    Attributes:
        documents: the domains and problems, in the order of the files.
        findings: what is wrong, in the order of the files and of the places in them.
    """

    documents: tuple[Checked, ...]
    findings: tuple[Finding, ...]


def check(files: Iterable[Path | tuple[str, bytes]]) -> Report:
    """Check files.

    Domains of one name that follow each other in one folder are one domain. A problem is checked
    against the domain of its name that is the last before it, or else the first behind it. If there
    are domains, but none of its name, that is an error; if there are none at all, or its domain
    cannot be read, the problem is checked as far as that is possible without.
    """
    checker = _Checker()
    for file in files:
        checker.add(*((str(file), None) if isinstance(file, Path) else file))
    return checker.report()


@dataclass(eq=False)
class _Definition:
    """A domain, which may be spread over several forms, or a problem."""

    forms: list[Form]
    is_read: bool = False
    domain: Domain | None = None

    @property
    def kind(self) -> str:
        return self.forms[0].kind

    @property
    def name(self) -> str:
        return self.forms[0].name

    @property
    def sources(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(form.head.text.name for form in self.forms))

    @property
    def place(self) -> tuple[Path, str]:
        return Path(self.sources[0]).parent, fold(self.name)

    def checked(self) -> Checked:
        """What is reported of it."""
        domain = None if self.domain is None or self.kind == DOMAIN else self.domain.name
        return Checked(self.kind, self.name, self.sources, self.is_read, domain)


class _Checker:
    """What has been found so far."""

    def __init__(self) -> None:
        self._definitions: list[_Definition] = []
        self._findings: list[Finding] = []
        self._order: dict[str, int] = {}

    def add(self, name: str, data: bytes | None) -> None:
        """Find the definitions of a file; without data, it is read."""
        self._order.setdefault(name, len(self._order))
        diagnostics = Diagnostics(strict=False)
        forms: list[Form] = []
        try:
            data = read_file(name) if data is None else data
            forms = Scanner(diagnostics, decode(name, data)).scan()
        except PddlError as error:
            self._refuse(error)
        except SourceError as error:
            self._findings.append(Finding(name, None, None, True, error.strerror or ""))
        self._warn(diagnostics.warnings())
        for form in forms:
            self._add(_Definition([form]))

    def _add(self, definition: _Definition) -> None:
        last = self._definitions[-1] if self._definitions else None
        if last and last.kind == definition.kind == DOMAIN and last.place == definition.place:
            last.forms += definition.forms
        else:
            self._definitions.append(definition)

    def report(self) -> Report:
        """Read the definitions, and tell what is wrong with them."""
        domains = [one for one in enumerate(self._definitions) if one[1].kind == DOMAIN]
        named: dict[str, list[tuple[int, _Definition]]] = {}
        for position, definition in domains:
            self._check_domain(definition)
            named.setdefault(fold(definition.name), []).append((position, definition))
        for position, definition in enumerate(self._definitions):
            if definition.kind != DOMAIN:
                candidates = named.get(fold(definition.forms[0].domain), domains)
                self._check_problem(definition, _nearest(candidates, position))
        found = sorted(
            self._findings,
            key=lambda one: (self._order[one.source], one.line or 0, one.column or 0),
        )
        return Report(tuple(one.checked() for one in self._definitions), tuple(found))

    def _check_domain(self, definition: _Definition) -> None:
        diagnostics = Diagnostics(strict=False)
        try:
            definition.domain = DomainReader(diagnostics).read(definition.forms)
            definition.is_read = True
        except PddlError as error:
            self._refuse(error)
        self._warn(diagnostics.warnings())

    def _check_problem(self, definition: _Definition, domain: Domain | None) -> None:
        diagnostics = Diagnostics(strict=False)
        try:
            ProblemReader(diagnostics, definition.forms[0], domain).read()
            definition.is_read, definition.domain = True, domain
        except PddlError as error:
            self._refuse(error)
        self._warn(diagnostics.warnings())

    def _refuse(self, error: PddlError) -> None:
        place = f"{error.source}:{error.line}:{error.column}: "
        message = str(error).removeprefix(place)
        self._findings.append(Finding(error.source, error.line, error.column, True, message))

    def _warn(self, warnings: Iterable[PddlWarning]) -> None:
        for source, line, column, message in warnings:
            self._findings.append(Finding(source, line, column, False, message))


def _nearest(domains: Sequence[tuple[int, _Definition]], position: int) -> Domain | None:
    """Choose the last domain before a place, or else the first behind it."""
    if not domains:
        return None
    before = bisect(domains, position, key=lambda one: one[0])
    return domains[max(before - 1, 0)][1].domain
