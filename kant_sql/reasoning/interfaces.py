"""The interface of reasoning: ask, explain, act, validate, and hold rules against the past."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from ..dao.interfaces import Interface, required
from ..dto.formulas import Node
from .ask import Answers, Binding


class Reasoning(Interface):
    """Asks whether conditions hold, explains, acts, validates plans, and asks the past."""

    # Ask.

    @required
    def holds(self, condition: str | Node, /, **bindings: Binding) -> bool:
        """Return whether a condition holds.

        A condition is evaluated in the database, in one statement unless it needs recursion. A
        fluent without a value makes the comparison or the atom around it false, as the validator
        VAL has it; so does a division by zero. Numbers are compared as doubles. Facts count, goals
        do not; a derived predicate holds by its rules (PDDL 2.2), or as a stored fact.

        Args:
            condition: PDDL text or a node; all conditions of PDDL except preferences and
                constraints. With free variables, it holds if it holds for some objects.
            **bindings: objects, or their names, for free variables; `_` stands for `-`.

        Returns:
            Whether it holds.

        Raises:
            PddlError: the text is no condition, or it names what is not known; with the position,
                and a similar name.
            TypeMismatchError: a given object does not fit its variable.
            UnsupportedConstructError: the condition is nested too deeply for a database.
            ArchivedError: a part of the state was moved to an archive.

        Examples:
            >>> kb.holds("(robot_at rb1 wp1)")
            True
            >>> kb.holds("(exists (?w - wp) (not (robot_at ?r ?w)))", r="rb1")
            False
        """

    @required
    def query(
        self,
        condition: str | Node,
        /,
        *,
        parameters: str | None = None,
        limit: int | None = None,
        **bindings: Binding,
    ) -> Answers:
        """Find the objects for which a condition holds.

        Args:
            condition: as for `holds`; its free variables are the columns. A variable that no
                positive atom binds ranges over the objects of its types.
            parameters: the free variables with their types, `"(?r - robot ?w - wp)"`, which also
                gives their order; by default a variable has the types that all atoms with it
                allow.
            limit: the greatest number of answers.
            **bindings: objects, or their names, for free variables.

        Returns:
            The answers, without duplicates, in the order in which the objects were declared. They
            are read when they are first needed.

        Raises:
            PddlError, TypeMismatchError, UnsupportedConstructError, ArchivedError: as `holds`.
            InvalidArgumentError: a binding is for no free variable, or `limit` is no number.

        Examples:
            >>> for robot, wp in kb.query("(robot_at ?r ?w)"):
            ...     print(robot, wp)
            rb1 wp1
            >>> kb.query("(robot_at ?r ?w)", w="wp1").to_dicts()
            [{'r': 'rb1'}]
        """

    # Explain.

    # Act.

    # Plans.

    # The past.

    # What if.
