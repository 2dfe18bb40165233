"""The interface of whole documents: load, write, plan."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NamedTuple

from ..dao.interfaces import Interface, Progress, required
from ..pddl.document import Domain, PddlWarning, Problem
from ..pddl.lexer import Source
from ..pddl.writer import write
from ..planning import Plan, from_unified_planning, problem_hash, solve, to_unified_planning

if TYPE_CHECKING:
    from unified_planning.model import Problem as UpProblem


Mode = Literal["replace", "merge"]


class Loaded(NamedTuple):
    """The result of loading a document.

    Attributes:
        revision: the new revision; None when nothing changed, or within an open transaction.
        warnings: deviations from the standard that can be read in one way only.
    """

    revision: int | None
    warnings: tuple[PddlWarning, ...]


class State(NamedTuple):
    """Domain and problem of one revision; within a transaction, of the one it began from."""

    revision: int
    domain: Domain
    problem: Problem


class Exchange(Interface):
    """Loads domains and problems, from text or documents, and writes them.

    Each load is one transaction, unless the task or thread has one open. Mode `replace` retracts
    what the document does not declare: for a domain types, constants, predicates, functions,
    constraints, derived predicates, actions, and the facts, values and formulas that no longer fit;
    for a problem objects, initial state, goal, constraints and metric. Mode `merge` keeps it, and
    refuses a document that contradicts it.
    """

    @required
    def load_domain(
        self,
        *sources: Source,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a domain, in at most one revision.

        Args:
            *sources: paths, or texts that begin with `(`; several files form one domain if they
                do not contradict each other.
            mode: `replace` retracts what the domain does not declare, `merge` keeps it.
            strict: refuse deviations from the standard, instead of warning.
            progress: called with the number of elements written, and the number in total; they
                are not committed yet.

        Returns:
            The revision, and the warnings with their positions.

        Raises:
            PddlError: the text is not valid; the error has the position, what was found and what
                was expected.
            SourceMissingError: a file does not exist; this is a `FileNotFoundError`, too.
            SourceError: a file cannot be read.
            ConflictError: with mode `merge`, the domain contradicts what is stored.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> kb.load_domain('''(define (domain doors)
            ...   (:requirements :strips)
            ...   (:predicates (open)))''')
            Loaded(revision=2, warnings=())
            >>> print(*kb.predicates.get_all())
            (open)
        """

    @required
    def load_problem(
        self,
        source: Source,
        *,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a problem of the stored domain, in at most one revision.

        Args:
            source: a path, or a text that begins with `(`.
            mode: `replace` retracts what the problem does not declare, `merge` keeps it.
            strict: as `load_domain`.
            progress: as `load_domain`.

        Returns:
            The revision, and the warnings with their positions.

        Raises:
            PddlError: the text is not valid, or does not fit the domain.
            SourceMissingError: the file does not exist; this is a `FileNotFoundError`, too.
            SourceError: the file cannot be read.
            ConflictError: with mode `merge`, the problem contradicts what is stored.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> loaded = kb.load_problem('''(define (problem patrol) (:domain tiago)
            ...   (:objects rb1 - robot wp1 wp2 - wp)
            ...   (:init (robot_at rb1 wp2)) (:goal (robot_at rb1 wp1)))''')
            >>> print(*kb.propositions.get_no_goals())
            (robot_at rb1 wp2)
        """

    @required
    def domain(self) -> Domain:
        """Build the domain.

        Returns:
            The domain; named like the knowledge base if none was loaded.

        Examples:
            >>> kb.domain().name
            'tiago'
        """

    @required
    def problem(self) -> Problem:
        """Build the problem: the present state as initial state, and the goals.

        Returns:
            The problem; named like the knowledge base if none was loaded.

        Examples:
            >>> kb.problem().facts
            (Atom(predicate='robot_at', terms=(Constant(name='rb1'), Constant(name='wp1'))),)
        """

    @required
    def domain_pddl(self) -> str:
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

    @required
    def problem_pddl(self) -> str:
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

    @required
    def requirements(self) -> tuple[str, ...]:
        """Compute the requirements that domain and problem use.

        Returns:
            The requirements, in the order of the standard.

        Examples:
            >>> kb.requirements()
            (':strips', ':typing')
        """

    def to_unified_planning(self) -> UpProblem:
        """Convert the present state to a problem of unified-planning.

        Returns:
            The problem.

        Raises:
            UnsupportedConstructError: unified-planning cannot express something of it.
            PlannerMissingError: unified-planning is not installed.

        Examples:
            >>> kb.to_unified_planning().name
            'tiago'
        """
        state = self._state()
        return to_unified_planning(state.domain, problem=state.problem)

    def load_unified_planning(self, problem: UpProblem, *, mode: Mode = "replace") -> Loaded:
        """Load a problem of unified-planning with its domain, in at most one revision.

        Mode `replace` retracts what the problem does not declare, `merge` keeps it.

        Returns:
            The revision; there are no warnings.

        Raises:
            UnsupportedConstructError: PDDL cannot express something of it.
            ConflictError: with mode `merge`, the problem contradicts what is stored.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> kb.load_unified_planning(kb.to_unified_planning()).revision
            2
        """
        domain, own = from_unified_planning(problem)
        return self._load(domain, problem=own, mode=mode)

    def plan(
        self, engine: str | None = None, *, timeout: float | None = None, strict: bool = False
    ) -> Plan:
        """Find a plan from the present state to the goals.

        Preferences and metrics reach a planner as costs of actions (Keyder and Geffner, Soft goals
        can be compiled away, 2009). What of them it cannot be given is named in the plan's
        `ignored` and logged as a warning; all other parts of the problem are always given.

        Args:
            engine: an engine's name in unified-planning, for example `fast-downward`; None to
                choose an installed one that supports the problem.
            timeout: seconds to wait; None to wait without limit. Plans of problems with soft
                goals are improved for 10 seconds, or half of the timeout if that is less.
            strict: refuse to ignore a part of the metric or a preference.

        Returns:
            The plan, with the revision of the state. If soft goals were compiled away or ignored,
            it has the planner's input as `domain_pddl` and `problem_pddl`.

        Raises:
            NoPlanError: there is no plan, or none was found in time.
            UnsupportedConstructError: planners cannot express something of the problem, or with
                `strict` something of its metric or preferences.
            PlannerMissingError: unified-planning or the engine is not installed.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:predicates (open))
            ...   (:action unlock :parameters () :effect (open)))''').revision
            2
            >>> kb.load_problem('''(define (problem enter) (:domain doors)
            ...   (:init) (:goal (open)))''').revision
            3
            >>> print(kb.plan("pyperplan"), end="")
            (unlock)
        """
        state = self._state()
        plan = solve(
            state.domain, problem=state.problem, engine=engine, timeout=timeout, strict=strict
        )
        domain = write(state.domain) if plan.domain_pddl is None else plan.domain_pddl
        problem = write(state.problem) if plan.problem_pddl is None else plan.problem_pddl
        digest = problem_hash(domain, problem=problem)
        return replace(plan, revision=state.revision, problem_hash=digest)

    @required
    def _state(self) -> State:
        """Build the domain and the problem from one state."""

    @required
    def _load(self, domain: Domain, *, problem: Problem, mode: Mode) -> Loaded:
        """Load a domain and its problem, in at most one revision."""
