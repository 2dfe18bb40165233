"""Checking many files at once: all that is wrong with each of them, and not only the first."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..dto.name import fold
from ..errors import PddlError, SourceError
from .cursor import Reading
from .document import Domain, PddlWarning
from .domain import DomainReader
from .forms import DOMAIN, Form, Scanner
from .problem import ProblemReader
from .tokens import decode, read_file


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

    Args:
        files: each a path, or a name and the bytes that are there.

    Returns:
        What was checked, and what is wrong with it.
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
        reading = Reading(strict=False)
        forms: list[Form] = []
        try:
            data = read_file(name) if data is None else data
            forms = Scanner(reading, decode(name, data)).scan()
        except PddlError as error:
            self._refuse(error)
        except SourceError as error:
            self._findings.append(Finding(name, None, None, True, error.strerror or ""))
        self._warn(reading.warnings())
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
        reading = Reading(strict=False)
        try:
            definition.domain = DomainReader(reading).read(definition.forms)
            definition.is_read = True
        except PddlError as error:
            self._refuse(error)
        self._warn(reading.warnings())

    def _check_problem(self, definition: _Definition, domain: Domain | None) -> None:
        reading = Reading(strict=False)
        try:
            ProblemReader(reading, definition.forms[0], domain).read()
            definition.is_read, definition.domain = True, domain
        except PddlError as error:
            self._refuse(error)
        self._warn(reading.warnings())

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
