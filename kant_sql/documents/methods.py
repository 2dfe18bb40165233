"""What the front door does with whole documents: load, write, plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..pddl.document import Domain, Problem
from ..pddl.tokens import Source
from ..pddl.writer import write
from ..planning import Plan, from_unified_planning, problem_hash, solve, to_unified_planning
from ..verification.findings import Progress
from .interfaces import Exchange, Loaded, Mode

if TYPE_CHECKING:
    from unified_planning.model import Problem as UpProblem


class DocumentMethods:
    """The part of a knowledge base that has to do with whole documents."""

    def __init__(self, exchange: Exchange) -> None:
        """Make it.

        Args:
            exchange: what loads documents, and gives them back.
        """
        self._exchange = exchange

    def load_domain(
        self,
        *sources: Source,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a domain: one revision or none; `Exchange.load_domain` says all of it.

        Args:
            *sources: paths, or texts that begin with `(`; several files are one domain.
            mode: `replace` retracts what the domain does not say, `merge` keeps it.
            strict: whether what violates the standard is refused, not warned of.
            progress: called from time to time with the number of elements that are stored, and that
                are to be stored; they are not committed yet.

        Returns:
            The revision, and the warnings with their positions.

        Raises:
            PddlError: the text cannot be read; it says where, what was found and expected.
            SourceMissingError: there is no such file; it is a `FileNotFoundError`, too.
            SourceError: a file cannot be read.
            ConflictError: with mode `merge`, it contradicts what is stored.
        """
        return self._exchange.load_domain(*sources, mode=mode, strict=strict, progress=progress)

    def load_problem(
        self,
        source: Source,
        *,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a problem: one revision or none; `Exchange.load_problem` says all of it.

        Args:
            source: a path, or a text that begins with `(`.
            mode: `replace` retracts what the problem does not say, `merge` keeps it.
            strict: whether what violates the standard is refused, not warned of.
            progress: called from time to time with the number of elements that are stored, and that
                are to be stored; they are not committed yet.

        Returns:
            The revision, and the warnings with their positions.

        Raises:
            PddlError: the text cannot be read, or does not go with the domain.
            SourceMissingError: there is no such file; it is a `FileNotFoundError`, too.
            SourceError: a file cannot be read.
            ConflictError: with mode `merge`, it contradicts what is stored.
        """
        return self._exchange.load_problem(source, mode=mode, strict=strict, progress=progress)

    def domain(self) -> Domain:
        """Build the domain.

        Returns:
            The domain as a document.
        """
        return self._exchange.domain()

    def problem(self) -> Problem:
        """Build the problem: the present state as the initial one, and the goals.

        Returns:
            The problem as a document.
        """
        return self._exchange.problem()

    def domain_pddl(self) -> str:
        """Write the domain as PDDL.

        Returns:
            The text.
        """
        return self._exchange.domain_pddl()

    def problem_pddl(self) -> str:
        """Write the problem as PDDL, from one consistent state.

        Returns:
            The text.
        """
        return self._exchange.problem_pddl()

    def requirements(self) -> tuple[str, ...]:
        """Compute which requirements domain and problem really use.

        Returns:
            The requirements, in the order of the standard.
        """
        return self._exchange.requirements()

    def to_unified_planning(self) -> UpProblem:
        """Build the state as a problem of unified-planning, straight from the store.

        Returns:
            The problem.

        Raises:
            UnsupportedConstructError: it has something that unified-planning cannot express.
            PlannerMissingError: unified-planning is not installed.
        """
        state = self._exchange.state()
        return to_unified_planning(state.domain, problem=state.problem)

    def load_unified_planning(self, problem: UpProblem, *, mode: Mode = "replace") -> Loaded:
        """Load a problem of unified-planning, domain and all: one revision or none.

        Args:
            problem: the problem.
            mode: `replace` retracts what it does not say, `merge` keeps it.

        Returns:
            The revision.

        Raises:
            UnsupportedConstructError: it has something that PDDL cannot express.
            ConflictError: with mode `merge`, it contradicts what is stored.
        """
        domain, own = from_unified_planning(problem)
        return self._exchange.put(domain, problem=own, mode=mode)

    def plan(self, engine: str | None = None, *, timeout: float | None = None) -> Plan:
        """Find a plan from the state to the goals.

        Args:
            engine: the name that unified-planning has for an engine, for example
                `fast-downward`; None to choose among the installed ones by what the problem needs.
            timeout: how many seconds to wait; without one, for as long as it takes.

        Returns:
            The plan, with the revision that it was made from.

        Raises:
            NoPlanError: there is no plan, or none was found in time.
            UnsupportedConstructError: the problem has something that planners cannot express.
            PlannerMissingError: unified-planning or the engine is not installed.
        """
        state = self._exchange.state()
        plan = solve(state.domain, problem=state.problem, engine=engine, timeout=timeout)
        digest = problem_hash(write(state.domain), problem=write(state.problem))
        return replace(plan, revision=state.revision, problem_hash=digest)
