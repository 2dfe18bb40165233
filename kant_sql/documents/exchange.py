"""Loading PDDL files into an SQL store, and writing them from it."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import TypeVar

from typing_extensions import override

from ..arguments import one_of, optional_call
from ..dao.base import SqlDao
from ..dao.interfaces import Progress
from ..dto.lexical import is_name
from ..errors import InvalidKnowledgeError, PddlError, printable
from ..knowledge.definitions import DOMAIN, Definitions
from ..pddl import read_domain, read_problem, used_requirements
from ..pddl.document import Domain, PddlWarning, Problem
from ..pddl.lexer import Source
from ..pddl.reader import without_collector
from ..pddl.writer import write, write_domain
from ..store.snapshot import View, read_revision
from ..store.transaction import Transaction
from .build import build_domain, build_problem, domain_title, problem_text
from .interfaces import Exchange, Loaded, Mode, State
from .load import load_domain, load_problem

T = TypeVar("T")

logger = logging.getLogger("kant_sql.documents")


class SqlExchange(SqlDao, Exchange):
    """Loads domains and problems into an SQL store, and builds them from it."""

    @override
    def load_domain(
        self,
        *sources: Source,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        optional_call(progress, "progress")
        domain = read_domain(*sources, strict=strict)
        replace = self._is_replacing(mode)
        revision = self._write(
            lambda transaction: load_domain(transaction, domain, replace, progress)
        )
        return self._loaded("domain", domain.name, revision, domain.warnings)

    @override
    @without_collector()
    def load_problem(
        self,
        source: Source,
        *,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        optional_call(progress, "progress")
        replace = self._is_replacing(mode)
        domain = self.domain()
        problem = self._read_problem(source, domain, strict)

        def work(transaction: Transaction) -> None:
            nonlocal problem
            now = self._build_domain(transaction.definitions)
            if now != domain:
                # Another writer changed the domain after the problem was checked against it.
                problem = self._read_problem(source, now, strict)
            load_problem(transaction, problem, replace, progress)

        revision = self._write(work)
        return self._loaded("problem", problem.name, revision, problem.warnings)

    @override
    @without_collector()
    def _load(self, domain: Domain, *, problem: Problem, mode: Mode) -> Loaded:
        replace = self._is_replacing(mode)
        # Documents from any maker pass the reader's checks before they are stored.
        checked = read_domain(write(domain))
        own = read_problem(write(problem), domain=checked)

        def work(transaction: Transaction) -> None:
            load_domain(transaction, checked, replace)
            load_problem(transaction, own, replace)

        warnings = domain.warnings + problem.warnings
        return self._loaded("domain and problem", problem.name, self._write(work), warnings)

    @override
    def domain(self) -> Domain:
        return self._store.read_definitions(self._build_domain, self._at)

    @override
    @without_collector()
    def problem(self) -> Problem:
        return self._read(lambda view: build_problem(view, *self._names(view.definitions)))

    @override
    @without_collector()
    def _state(self) -> State:
        def work(view: View) -> State:
            definitions = view.definitions
            problem = build_problem(view, *self._names(definitions))
            return State(read_revision(view), self._build_domain(definitions), problem)

        return self._read(work)

    @override
    def domain_pddl(self) -> str:
        return write_domain(self.domain())

    @override
    @without_collector()
    def problem_pddl(self) -> str:
        return self._read(lambda view: problem_text(view, *self._names(view.definitions)))

    @override
    def requirements(self) -> tuple[str, ...]:
        state = self._state()
        return used_requirements(state.domain, problem=state.problem)

    def _loaded(
        self, kind: str, name: str, revision: int | None, warnings: tuple[PddlWarning, ...]
    ) -> Loaded:
        logger.info(
            "knowledge base %r: loaded %s %r, revision %s, %d warnings",
            self._store.name,
            kind,
            name,
            revision,
            len(warnings),
        )
        for warning in warnings:
            logger.info("%s", printable(str(warning)))
        return Loaded(revision, warnings)

    def _read(self, work: Callable[[View], T]) -> T:
        return self._store.read_in_snapshot(work, self._at)

    def _write(self, work: Callable[[Transaction], None]) -> int | None:
        self._check_writable()
        made: list[Transaction] = []

        def remember(transaction: Transaction) -> None:
            made[:] = [transaction]
            work(transaction)

        self._store.write(remember)
        committed = made[0].committed
        return None if committed is None else committed.number

    def _read_problem(self, source: Source, domain: Domain, strict: bool) -> Problem:
        if self._store.read_definitions(lambda known: known.documents.named(DOMAIN)) is not None:
            return read_problem(source, domain=domain, strict=strict)
        # A domain that was made through DAOs fits any name.
        named = read_problem(source, strict=strict).domain
        try:
            own = dataclasses.replace(domain, name=named)
            return read_problem(source, domain=own, strict=strict)
        except PddlError as error:
            place = (error.source, error.line, error.column, error.found)
            remedy = f"no domain is loaded here: load the domain {named} first, with load_domain()"
            raise PddlError(*place, f"{error.expected}; {remedy}", error.nesting) from error

    def _build_domain(self, definitions: Definitions) -> Domain:
        return build_domain(definitions, self._default_name)

    def _names(self, definitions: Definitions) -> tuple[str, str]:
        return self._default_name, domain_title(definitions, self._default_name)

    @property
    def _default_name(self) -> str:
        """The name of a document that was never loaded: the knowledge base's, if PDDL allows it."""
        return self._store.name if is_name(self._store.name, "domain") else "default"

    @staticmethod
    def _is_replacing(mode: str) -> bool:
        return one_of(mode, ("replace", "merge"), "the mode", InvalidKnowledgeError) == "replace"
