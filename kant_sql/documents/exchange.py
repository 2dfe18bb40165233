"""Domains and problems: load them from text or documents, write them, and give them to planners.

Each load is one transaction, unless the task or thread has one open.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeVar

from .. import planning
from ..arguments import Progress, one_of, optional_call
from ..dto.lexical import is_name
from ..errors import InvalidKnowledgeError, PddlError, printable
from ..knowledge.definitions import DOMAIN
from ..pddl import read_domain, read_problem, used_requirements
from ..pddl.document import Domain, PddlWarning, Problem
from ..pddl.lexer import Source
from ..pddl.reader import without_collector
from ..pddl.writer import write, write_domain
from ..store.snapshot import View, read_revision
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .build import build_domain, build_problem, domain_title, problem_text
from .load import store_domain, store_problem

if TYPE_CHECKING:
    from unified_planning.model import Problem as UpProblem

T = TypeVar("T")

logger = logging.getLogger("kant_sql.documents")

Mode = Literal["replace", "merge"]


class Loaded(NamedTuple):
    """The result of loading a document.

    Attributes:
        revision: the new revision; None if nothing changed, or within an open transaction.
        warnings: deviations from the standard with only one sensible meaning.
    """

    revision: int | None
    warnings: tuple[PddlWarning, ...]


class PlanningTask(NamedTuple):
    """Domain and problem of one revision; within a transaction, of the one that it began from."""

    revision: int
    domain: Domain
    problem: Problem


def load_domain(
    state: State,
    *sources: Source,
    mode: Mode = "replace",
    strict: bool = False,
    progress: Progress | None = None,
) -> Loaded:
    """Load a domain, in at most one revision.

    Args:
        *sources: paths, or texts that begin with `(`; several files form one domain if they
            do not contradict each other.
        mode: `replace` retracts elements that the domain lacks: types, constants, predicates,
            functions, constraints, derived predicates, actions, and the facts, values and formulas
            that no longer fit. `merge` keeps all of them, and refuses a domain that contradicts
            them.
        strict: refuse deviations from the standard, instead of warning.
        progress: called with the number of written elements, not yet committed, and their total.

    Returns:
        The revision, and the warnings with their positions.

    Raises:
        PddlError: the text is not valid; the error has the position, what was found and what
            was expected.
        SourceMissingError: a file does not exist; this is a `FileNotFoundError`, too.
        SourceError: a file cannot be read.
        ConflictError: with mode `merge`, the domain contradicts the store.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.load_domain('''(define (domain doors)
        ...   (:requirements :strips)
        ...   (:predicates (open)))''')
        Loaded(revision=2, warnings=())
        >>> print(*kb.predicates.get_all())
        (open)
    """
    optional_call(progress, "progress")
    read = read_domain(*sources, strict=strict)
    replace = _is_replacing(mode)
    revision = _write(
        state.store, lambda transaction: store_domain(transaction, read, replace, progress)
    )
    return _loaded(state.store, "domain", read.name, revision, read.warnings)


@without_collector()
def load_problem(
    state: State,
    source: Source,
    *,
    mode: Mode = "replace",
    strict: bool = False,
    progress: Progress | None = None,
) -> Loaded:
    """Load a problem of the stored domain, in at most one revision.

    Args:
        source: a path, or a text that begins with `(`.
        mode: `replace` retracts elements that the problem lacks: objects, initial state, goal,
            constraints and metric. `merge` keeps them, and refuses a problem that contradicts them.
        strict: as `load_domain`.
        progress: as `load_domain`.

    Returns:
        The revision, and the warnings with their positions.

    Raises:
        PddlError: the text is not valid, or does not fit the domain.
        SourceMissingError: the file does not exist; this is a `FileNotFoundError`, too.
        SourceError: the file cannot be read.
        ConflictError: with mode `merge`, the problem contradicts the store.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> loaded = kb.load_problem('''(define (problem patrol) (:domain tiago)
        ...   (:objects rb1 - robot wp1 wp2 - wp)
        ...   (:init (robot_at rb1 wp2)) (:goal (robot_at rb1 wp1)))''')
        >>> print(*kb.propositions.get_all())
        (robot_at rb1 wp2)
    """
    store = state.store
    optional_call(progress, "progress")
    replace = _is_replacing(mode)
    of_domain = domain(state)
    read = _read_problem(store, source, of_domain, strict)

    def work(transaction: Transaction) -> None:
        nonlocal read
        now = build_domain(transaction.definitions, _default_name(store.name))
        if now != of_domain:
            # Another writer changed the domain after the check of the problem.
            read = _read_problem(store, source, now, strict)
        store_problem(transaction, read, replace, progress)

    revision = _write(store, work)
    return _loaded(store, "problem", read.name, revision, read.warnings)


@without_collector()
def load_documents(store: Store, of_domain: Domain, given: Problem, mode: Mode) -> Loaded:
    """Load documents of a domain and its problem, in at most one revision."""
    replace = _is_replacing(mode)
    # They pass the reader's checks before they are stored.
    checked = read_domain(write(of_domain))
    own = read_problem(write(given), domain=checked)

    def work(transaction: Transaction) -> None:
        store_domain(transaction, checked, replace)
        store_problem(transaction, own, replace)

    warnings = of_domain.warnings + given.warnings
    return _loaded(store, "domain and problem", given.name, _write(store, work), warnings)


def domain(state: State) -> Domain:
    """Build the domain.

    Returns:
        The domain; named like the knowledge base if none was loaded.

    Examples:
        >>> kb.pddl.domain().name
        'tiago'
    """
    name = _default_name(state.store.name)
    return state.store.read_definitions(lambda known: build_domain(known, name), state.at)


@without_collector()
def problem(state: State) -> Problem:
    """Build the problem: the initial state is the present state.

    Returns:
        The problem; named like the knowledge base if none was loaded.

    Examples:
        >>> kb.pddl.problem().facts
        (Atom(predicate='robot_at', terms=(Constant(name='rb1'), Constant(name='wp1'))),)
    """
    return _read(state, build_problem)


@without_collector()
def read_task(state: State) -> PlanningTask:
    """Build the domain and the problem of one state."""

    def build(view: View, own: str, of_domain: str) -> PlanningTask:
        made = build_problem(view, own, of_domain)
        return PlanningTask(read_revision(view), build_domain(view.definitions, own), made)

    return _read(state, build)


def domain_pddl(state: State) -> str:
    """Write the domain as PDDL.

    Returns:
        The text.

    Examples:
        >>> print(kb.domain_pddl(), end="")
        (define (domain tiago)
          (:requirements :strips :typing)
          (:types
            robot wp - object
          )
          (:predicates
            (robot_at ?r0 - robot ?w1 - wp)
          )
        )
    """
    return write_domain(domain(state))


@without_collector()
def problem_pddl(state: State) -> str:
    """Write the problem as PDDL, from one consistent state.

    Returns:
        The text.

    Examples:
        >>> print(kb.problem_pddl(), end="")
        (define (problem tiago)
          (:domain tiago)
          (:objects
            rb1 - robot
            wp1 - wp
          )
          (:init
            (robot_at rb1 wp1)
          )
          (:goal (and))
        )
    """
    return _read(state, problem_text)


def requirements(state: State) -> tuple[str, ...]:
    """Compute the requirements that domain and problem use.

    Returns:
        The requirements, in the order of the standard.

    Examples:
        >>> kb.pddl.requirements()
        (':strips', ':typing')
    """
    task = read_task(state)
    return used_requirements(task.domain, problem=task.problem)


def to_unified_planning(state: State) -> UpProblem:
    """Convert the present state to a problem of unified-planning.

    Returns:
        The problem.

    Raises:
        UnsupportedConstructError: unified-planning cannot express a part of it.
        PlannerMissingError: unified-planning is not installed.

    Examples:
        >>> kb.pddl.to_unified_planning().name
        'tiago'
    """
    task = read_task(state)
    return planning.to_unified_planning(task.domain, problem=task.problem)


def load_unified_planning(state: State, problem: UpProblem, *, mode: Mode = "replace") -> Loaded:
    """Load a problem of unified-planning with its domain, in at most one revision.

    Mode `replace` retracts elements that the problem lacks, `merge` keeps them.

    Returns:
        The revision; there are no warnings.

    Raises:
        UnsupportedConstructError: PDDL cannot express a part of it.
        ConflictError: with mode `merge`, the problem contradicts the store.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.pddl.load_unified_planning(kb.pddl.to_unified_planning()).revision
        2
    """
    own_domain, own = planning.from_unified_planning(problem)
    return load_documents(state.store, own_domain, own, mode)


def _loaded(
    store: Store, kind: str, name: str, revision: int | None, warnings: tuple[PddlWarning, ...]
) -> Loaded:
    logger.info(
        "knowledge base %r: loaded %s %r, revision %s, %d warnings",
        store.name,
        kind,
        name,
        revision,
        len(warnings),
    )
    for warning in warnings:
        logger.info("%s", printable(str(warning)))
    return Loaded(revision, warnings)


def _read(state: State, build: Callable[[View, str, str], T]) -> T:
    """Build documents from one consistent state."""
    name = _default_name(state.store.name)
    return state.store.read_in_snapshot(
        lambda view: build(view, name, domain_title(view.definitions, name)), state.at
    )


def _write(store: Store, work: Callable[[Transaction], None]) -> int | None:
    def run(transaction: Transaction) -> Transaction:
        work(transaction)
        return transaction

    return store.write(run).made


def _read_problem(store: Store, source: Source, of_domain: Domain, strict: bool) -> Problem:
    if store.read_definitions(lambda known: known.documents.named(DOMAIN)) is not None:
        return read_problem(source, domain=of_domain, strict=strict)
    # A domain made through DAOs fits any name.
    named = read_problem(source, strict=strict).domain
    try:
        own = dataclasses.replace(of_domain, name=named)
        return read_problem(source, domain=own, strict=strict)
    except PddlError as error:
        place = (error.source, error.line, error.column, error.found)
        remedy = f"no domain is loaded here: load the domain {named} first, with load_domain()"
        raise PddlError(*place, f"{error.expected}; {remedy}", error.nesting) from error


def _default_name(name: str) -> str:
    """Name a document that was never loaded: like the knowledge base, if PDDL allows it."""
    return name if is_name(name, "domain") else "default"


def given_texts(view: View, knowledge_base: str) -> tuple[str, str]:
    """Write the domain and the problem of a state for a planner."""
    name = _default_name(knowledge_base)
    domain = write_domain(build_domain(view.definitions, name))
    return domain, problem_text(view, name, domain_title(view.definitions, name))


def _is_replacing(mode: str) -> bool:
    return one_of(mode, ("replace", "merge"), "the mode", InvalidKnowledgeError) == "replace"
