"""The interface of reasoning: ask, explain, act, validate, and hold rules against the past."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from ..dao.interfaces import Interface, required
from ..dto import PddlObjectDto
from ..dto.formulas import Formula, Node
from ..history.interfaces import When
from ..planning import Plan
from ..plans.interfaces import RecordedPlan
from .ask import Answers, Binding
from .held import HeldPeriods
from .validate import Validation


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

    @required
    def validate(self, plan: Plan | RecordedPlan, *, at: When | None = None) -> Validation:
        """Execute a plan in memory from a state of the store; nothing is written.

        Sequential and temporal plans are executed as PDDL 2.1 defines (Fox and Long, 2003), with
        timed initial literals, derived predicates, preferences, trajectory constraints and
        continuous change that is linear in time. Durations may deviate from their constraints by
        0.01, and what is at most 0.001 apart is at one time, as in VAL. Steps without a start time
        are executed one after another.

        Args:
            plan: a plan, or a recorded one, which is executed from the state chosen here, not from
                the one that it was made from.
            at: a revision's number, or an aware time; None for the present, or the past state that
                this is a view of.

        Returns:
            Whether the plan is valid; if not, the first step that cannot be executed with its
            unsatisfied conditions, or the goals and constraints that it does not satisfy; its
            makespan, in the plan's units, the value of the metric, and its violated preferences.

        Raises:
            UnsupportedConstructError: the domain has processes or events, change that is not
                linear in time, or constraints that PDDL 3.0 gives no meaning.
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: that state was moved to an archive.
            InvalidKnowledgeError: `plan` is no plan, or derived predicates are not stratified.

        Examples:
            >>> from kant_sql import Plan, PlanStep
            >>> kb.load_domain('''(define (domain doors) (:predicates (open) (locked))
            ...   (:action unlock :parameters () :precondition (locked) :effect (not (locked)))
            ...   (:action push :parameters () :precondition (not (locked)) :effect (open)))'''
            ... ).revision
            2
            >>> kb.load_problem('''(define (problem enter) (:domain doors)
            ...   (:init (locked)) (:goal (open)))''').revision
            3
            >>> steps = (PlanStep(None, "unlock"), PlanStep(None, "push"))
            >>> print(kb.validate(Plan(steps, "by hand", "unknown")))
            the plan is valid
            makespan 2
            >>> print(kb.validate(Plan(steps[1:], "by hand", "unknown")))
            the plan is not valid
            step 0, (push), fails at 1:
              (not (locked)): holds
        """

    # The past.

    @required
    def when(
        self,
        condition: Formula | str,
        /,
        *,
        since: When | None = None,
        until: When | None = None,
        parameters: str | None = None,
        **bindings: str | PddlObjectDto,
    ) -> HeldPeriods:
        """Find the periods during which a condition held, for each binding of its free variables.

        What was committed counts. Where a name in the condition is not defined, or has another
        meaning, the condition does not hold. Of a conjunction of atoms, the database joins the
        intervals of the facts; any other condition is evaluated at each revision that changed
        something that it mentions.

        Args:
            condition: PDDL text, or a formula.
            since: the first revision, or the earliest time of commit; both inclusive.
            until: the last revision, or the latest time of commit; both inclusive.
            parameters: the free variables with their types, as `(?r - robot ?w - wp)`; by default
                those of the condition, which range over what its atoms allow.
            bindings: objects for some of the free variables, as names or DTOs.

        Returns:
            The periods, in the order of their beginnings; none of them adjoin.

        Raises:
            PddlError: the condition is not well-formed, or a name in it was never defined.
            InvalidArgumentError: a binding names no free variable.
            UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
            ArchivedError: a part of the range was moved to an archive.

        Examples:
            >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
            >>> for held in kb.when("(robot_at ?r wp1)"):
            ...     print(held.binding["r"], held.since.number, held.until.number)
            rb1 1 2
        """
