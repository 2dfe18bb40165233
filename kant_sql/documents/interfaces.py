"""What loads whole documents, and gives them back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal, NamedTuple

from ..pddl.document import Domain, PddlWarning, Problem
from ..pddl.tokens import Source
from ..verification.findings import Progress

Mode = Literal["replace", "merge"]


class Loaded(NamedTuple):
    """What came of loading a document.

    Attributes:
        revision: the revision that was made; None when nothing changed, or when it is part of a
            transaction that is still open.
        warnings: what violates the standard, and was read in the one way that makes sense.
    """

    revision: int | None
    warnings: tuple[PddlWarning, ...]


class State(NamedTuple):
    """Domain and problem of one and the same state.

    Attributes:
        revision: the revision; within a transaction, the one that it began from.
        domain: the domain.
        problem: the problem.
    """

    revision: int
    domain: Domain
    problem: Problem


class Exchange(ABC):
    """Loads domains and problems, as text or as documents, and gives them back.

    Each load is one transaction, unless the task or thread has one open: all of it is stored or
    nothing. With mode `replace`, what the document does not say is retracted: of a domain the
    types, constants, predicates, functions, constraints, derived predicates and actions, and the
    facts, values and formulas that fit no more; of a problem the objects, the initial state, the
    goal, the constraints and the metric. With mode `merge` all that stays, and a contradiction to
    it is refused.
    """

    @abstractmethod
    def load_domain(
        self,
        *sources: Source,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a domain.

        Args:
            *sources: paths, or texts that begin with `(`; several files are one domain, if they do
                not contradict each other.
            mode: `replace` or `merge`.
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
            ReadOnlyError: this is a view of the past.
        """

    @abstractmethod
    def load_problem(
        self,
        source: Source,
        *,
        mode: Mode = "replace",
        strict: bool = False,
        progress: Progress | None = None,
    ) -> Loaded:
        """Load a problem of the domain that is stored.

        Args:
            source: a path, or a text that begins with `(`.
            mode: `replace` or `merge`.
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
            ReadOnlyError: this is a view of the past.
        """

    @abstractmethod
    def put(self, domain: Domain, *, problem: Problem, mode: Mode = "replace") -> Loaded:
        """Store a domain and a problem that go together, in one revision.

        Args:
            domain: the domain.
            problem: the problem.
            mode: `replace` or `merge`.

        Returns:
            The revision, and the warnings of both.

        Raises:
            PddlError: the two do not go together.
            ConflictError: with mode `merge`, they contradict what is stored.
            ReadOnlyError: this is a view of the past.
        """

    @abstractmethod
    def domain(self) -> Domain:
        """Build the domain.

        Returns:
            The domain; named like the knowledge base when none was loaded.
        """

    @abstractmethod
    def problem(self) -> Problem:
        """Build the problem: the present state as the initial one, and the goals.

        Returns:
            The problem; named like the knowledge base when none was loaded.
        """

    @abstractmethod
    def state(self) -> State:
        """Build the domain and the problem of one and the same state.

        Returns:
            Both, and the revision.
        """

    @abstractmethod
    def domain_pddl(self) -> str:
        """Write the domain as PDDL.

        Returns:
            The text.
        """

    @abstractmethod
    def problem_pddl(self) -> str:
        """Write the problem as PDDL, from one consistent state.

        Returns:
            The text.
        """

    @abstractmethod
    def requirements(self) -> tuple[str, ...]:
        """Compute which requirements domain and problem really use.

        Returns:
            The requirements, in the order of the standard.
        """
