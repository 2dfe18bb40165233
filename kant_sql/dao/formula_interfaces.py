"""The abstract DAOs of formulas that stand on their own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Generic, TypeVar

from ..dto.formula import Derived, Equal, Formula, Metric, Node, Not, TimedLiteral

N = TypeVar("N", bound=Node)


class FormulaDao(ABC, Generic[N]):
    """Reads, saves and deletes formulas of one sort: nodes of `kant_sql.pddl`.

    A formula names predicates, functions, types and objects, which must be known already. It is
    deleted with what it mentions.
    """

    @abstractmethod
    def get_all(self) -> list[N]:
        """Read all formulas of the sort.

        Returns:
            The formulas, in the order in which each was first known.
        """

    @abstractmethod
    def save(self, formula: N) -> bool:
        """Let a formula stand. A conjunction of goals or constraints is each of its conjuncts.

        Args:
            formula: the formula.

        Returns:
            True; what cannot be saved raises.

        Raises:
            InvalidKnowledgeError: it is not well formed, or names what is not known.
        """

    @abstractmethod
    def insert(self, formula: N) -> bool:
        """Let a formula stand that does not stand yet.

        Args:
            formula: the formula.

        Returns:
            False when it stands already; nothing is changed then.

        Raises:
            InvalidKnowledgeError: as `save`.
        """

    @abstractmethod
    def save_all(self, formulas: Iterable[N]) -> int:
        """Let many formulas stand, in one revision.

        Args:
            formulas: the formulas.

        Returns:
            How many of them changed something.

        Raises:
            InvalidKnowledgeError: as `save`; nothing of all is saved.
        """

    @abstractmethod
    def delete(self, formula: N) -> bool:
        """Let a formula stand no more.

        Args:
            formula: the formula, as `get_all` gives it.

        Returns:
            False when it does not stand.
        """

    @abstractmethod
    def delete_all(self) -> int:
        """Let no formula of the sort stand.

        Returns:
            How many there were.
        """


class DerivedPredicateDao(FormulaDao[Derived]):
    """Reads, saves and deletes the rules of derived predicates (PDDL 2.2, section 3.1)."""


class TimedInitialLiteralDao(FormulaDao[TimedLiteral]):
    """Reads, saves and deletes timed initial literals and values (PDDL 2.2, section 3.2)."""


class InitialLiteralDao(FormulaDao[Not | Equal]):
    """Reads, saves and deletes what else is said of the initial state: `not` and `=`."""


class GoalDao(FormulaDao[Formula]):
    """Reads, saves and deletes goals of any form, ground atoms among them.

    A conjunction is stored as its conjuncts, and a ground atom as a proposition with `is_goal`, so
    that `PddlPropositionDao.get_goals` gives it too.
    """


class ConstraintDao(FormulaDao[Formula]):
    """Reads, saves and deletes constraints on the trajectory (PDDL 3.0, section 2).

    A conjunction is stored as its conjuncts.
    """


class MetricDao(ABC):
    """Reads and sets what a plan is measured by (PDDL 2.1, section 4.1): one metric, or none."""

    @abstractmethod
    def get(self) -> Metric | None:
        """Read the metric.

        Returns:
            The metric; None when plans are not measured.
        """

    @abstractmethod
    def set(self, metric: Metric | None) -> bool:
        """Let plans be measured by a metric, instead of the one there was.

        Args:
            metric: the metric; None for none.

        Returns:
            Whether that is a change.

        Raises:
            InvalidKnowledgeError: it is not well formed, or names what is not known.
        """
