"""The interface of reasoning: ask, explain, act, validate, and hold rules against the past."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

from ..dao.interfaces import Interface, required
from ..dto import PddlObjectDto
from ..dto.formulas import Formula, Node
from ..moment_text import When
from ..planning import Plan, PlanStep
from ..plans.interfaces import RecordedPlan, RecordedStep
from .ask import Answers, Binding
from .complete import DEFAULT_LIMIT, Completion
from .durative import BrokenInvariant
from .failures import FailedCondition
from .held import HeldPeriods
from .rules import Rules
from .steps import Step
from .undo import Aborted
from .validate import Validation
from .verdicts import Verdicts


class Reasoning(Interface):
    """Asks whether conditions hold, explains, acts, validates plans, and asks the past."""

    # Ask.

    @required
    def holds(self, condition: str | Node, /, **bindings: Binding) -> bool:
        """Return whether a condition holds.

        A condition is evaluated in the database, in one statement unless it needs recursion. A
        fluent without a value makes the comparison or the atom around it false, as the validator
        VAL has it; so does a division by zero. Numbers are compared exactly. Facts count, goals
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

    @required
    def complete(self, beginning: str, *, limit: int = DEFAULT_LIMIT) -> list[Completion]:
        """Find the names that may be meant by their beginning, for editors and prompts.

        Args:
            beginning: the first characters of a name, in any case; empty for all names.
            limit: the greatest number of names.

        Returns:
            The predicates, functions, objects, actions and types whose names begin so, in this
            order and by name; then those whose names contain the characters.

        Raises:
            ArchivedError: a part of this state was moved to an archive.
            InvalidArgumentError: `beginning` is no text, or `limit` is no number.

        Examples:
            >>> for one in kb.complete("rob"):
            ...     print(one.kind, one.text)
            predicate (robot_at ?r0 - robot ?w1 - wp)
            type robot
        """

    # Explain.

    @required
    def unsatisfied(self, condition: str | Node, /, **bindings: Binding) -> list[FailedCondition]:
        """Return the parts of a condition that do not hold.

        Conjunctions are taken apart, and universal quantifiers into their first 20
        counterexamples; other formulas are parts as they are.

        Args:
            condition: as for `holds`.
            **bindings: as for `holds`.

        Returns:
            The parts, in order, each with the values of both sides of a comparison, and for a fact
            that held before with the revision that retracted it. Empty if the condition holds.

        Raises:
            PddlError, TypeMismatchError, UnsupportedConstructError, ArchivedError: as `holds`.

        Examples:
            >>> for part in kb.unsatisfied("(and (robot_at rb1 wp1) (not (robot_at rb1 wp1)))"):
            ...     print(part)
            (not (robot_at rb1 wp1)): does not hold
        """

    @required
    def unsatisfied_goals(self) -> list[FailedCondition]:
        """Return the parts of the goals that do not hold; preferences are no part.

        Returns:
            The parts, as `unsatisfied`. Empty if all goals are reached.

        Examples:
            >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2], is_goal=True))
            >>> print(*kb.unsatisfied_goals())
            (robot_at rb1 wp2): does not hold
        """

    @required
    def is_goal_reached(self) -> bool:
        """Return whether all goals hold; preferences do not count.

        Returns:
            Whether they hold; True without goals.

        Examples:
            >>> kb.is_goal_reached()
            True
        """

    @required
    def metric_value(self) -> Decimal | None:
        """Evaluate the metric in this state, exactly.

        `is-violated` counts the violated instances of a preference among the goals (PDDL 3.0).

        Returns:
            Its value; None without a metric.

        Raises:
            InvalidKnowledgeError: a fluent in it has no value, or it divides by 0.
            UnsupportedConstructError: it is about `total-time`, or about a preference that is not
                a goal: a plan has these, a state has not.

        Examples:
            >>> kb.metric_value() is None
            True
        """

    @required
    def why_not(self, step: Step) -> list[FailedCondition]:
        """Return why a step cannot be executed now.

        Args:
            step: as for `apply`; its arguments may be of any type.

        Returns:
            The arguments that do not fit their parameters; else what is wrong with the duration;
            else the conditions `at start` that do not hold, as `unsatisfied`; else the effects at
            the start without a result; else the conditions `over all` that do not hold right after
            these effects. Empty for a step that `apply` can begin and `start` starts.

        Raises:
            PddlError, InvalidKnowledgeError: it names what is not known.
            UnsupportedConstructError: the action has continuous change that is not linear.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:predicates (open) (key))
            ...   (:action unlock :parameters () :precondition (key) :effect (open)))''').revision
            2
            >>> print(*kb.why_not("(unlock)"))
            (key): does not hold
        """

    # Act.

    @required
    def applicable_actions(
        self, name: str | None = None, *, limit: int | None = None, **fixed: Binding
    ) -> Iterator[PlanStep]:
        """Find the steps that can be executed in this state.

        Each action takes one statement, when its first step is needed. A durative step is one that
        `start` starts: see `is_applicable`. A step whose duration has to be chosen is left out,
        and so are actions with continuous change that is not linear. Preferences do not count.

        Args:
            name: an action's name; by default all actions in their order.
            limit: the greatest number of steps.
            **fixed: objects for parameters; actions without them are left out.

        Returns:
            The steps, ordered by action and as the objects were declared.

        Raises:
            InvalidKnowledgeError: an action or an object is not known.
            InvalidArgumentError: there is no such parameter.
            UnsupportedConstructError: the name is that of a process or an event.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:types door)
            ...   (:constants front back - door) (:predicates (open ?d - door))
            ...   (:action unlock :parameters (?d - door)
            ...     :precondition (not (open ?d)) :effect (open ?d)))''').revision
            2
            >>> print(*kb.applicable_actions())
            (unlock front) (unlock back)
        """

    @required
    def is_applicable(self, step: Step) -> bool:
        """Return whether a step can begin now.

        Its objects fit its parameters, its duration is given or fixed where it matters and allowed,
        its conditions `at start` hold, its effects `at start` have results, and its conditions
        `over all` hold right after these effects. `why_not`, `applicable_actions`, `start` and
        `apply` judge by the same condition; `apply` executes the end, too, which may fail then.

        Args:
            step: as for `apply`.

        Returns:
            Whether it can begin.

        Raises:
            PddlError, InvalidKnowledgeError: it names what is not known.
            UnsupportedConstructError: the action has continuous change that is not linear.
        """

    @required
    def apply(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> int | None:
        """Execute a step: check its conditions and write its effects, in one revision.

        Conditions and right-hand sides are evaluated in the state before, deletes come before adds,
        numbers are exact (PDDL 2.1). A durative action is executed at once: its start, its
        continuous effects for its duration, then its end, each with its conditions. The head is
        locked meanwhile, so nothing changes between the check and the effects. A step of a recorded
        plan gets the status `succeeded`.

        Args:
            step: text such as `"(move rb1 hall kitchen)"`, with `[5]` for a duration, a
                `PlanStep`, a step of a recorded plan, or an `ActionInstance` of unified-planning.
            reason: the revision's reason; by default the step.
            plan_step: the running step of a recorded plan that the revision links to.

        Returns:
            The revision; None when nothing changed, or within an open transaction.

        Raises:
            NotApplicableError: a condition does not hold, a duration is not allowed, or a
                right-hand side has no value; nothing is written.
            PlanError: the text gives a duration to an action without one.
            PddlError, InvalidKnowledgeError: the step names what is not known.
            UnsupportedConstructError: it is a process or an event, or its continuous change is not
                linear.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:predicates (open))
            ...   (:action unlock :parameters ()
            ...     :precondition (not (open)) :effect (open)))''').revision
            2
            >>> kb.apply("(unlock)", reason="the bell rang")
            3
            >>> kb.is_applicable("(unlock)")
            False
        """

    @required
    def start(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> RecordedStep:
        """Start a durative step: its conditions and effects `at start`, in one revision.

        Args:
            step: as for `apply`. Without a duration, it has the one that a constraint fixes.
            reason: as for `apply`.
            plan_step: as for `apply`.

        Returns:
            The running step, with the status `started`; a step of no plan is recorded as a plan of
            its own.

        Raises:
            NotApplicableError: the step cannot begin (see `is_applicable`), its duration violates a
                constraint by more than 0.01, or the same step is running already.
            PlanError: the action has no duration.
            UnsupportedConstructError: as `apply`.
            PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:predicates (open) (busy))
            ...   (:durative-action unlock :parameters () :duration (= ?duration 3)
            ...     :condition (over all (busy))
            ...     :effect (and (at start (busy)) (at end (open)))))''').revision
            2
            >>> step = kb.start("(unlock)")
            >>> step.status, step.duration, kb.holds("(busy)"), kb.holds("(open)")
            ('started', Decimal('3'), True, False)
            >>> kb.end(step)
            4
            >>> kb.holds("(open)")
            True
        """

    @required
    def end(
        self, step: Step, *, reason: str | None = None, plan_step: RecordedStep | None = None
    ) -> int | None:
        """End a running step: its conditions and effects `at end`, in one revision.

        Continuous effects take place first: their rates in this state, times the duration that was
        recorded at the start, not the time on the clock. Until then, readers see numbers as they
        were last written. What is `over all` must hold throughout that change, until right before
        the end; conditions and effects `at end` see the changed numbers.

        Args:
            step: as for `apply`, or what `start` returned; its duration is that of the start.
            reason: as for `apply`.
            plan_step: as for `apply`.

        Returns:
            The revision, as `apply`.

        Raises:
            NotApplicableError: a condition `over all` or `at end` does not hold.
            PlanError: the step is not running.
            PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.
        """

    @required
    def abort(self, step: Step, *, reason: str | None = None, undo: bool = False) -> Aborted:
        """Abort a running step: it gets the status `aborted`.

        What its start changed stays, and the result says what of it still stands. With `undo`, it
        is taken back in the same revision, if nothing else changed it since.

        Args:
            step: as for `end`.
            reason: the revision's reason.
            undo: whether to take back what the start changed.

        Returns:
            The revision, as `apply`; what the start left, and what was taken back.

        Raises:
            PlanError: the step is not running; or with `undo`, something else changed what its
                start changed, which is named, or the state before is not known. Nothing is written.
            PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.

        Examples:
            >>> kb.load_domain('''(define (domain doors) (:predicates (open) (busy))
            ...   (:durative-action unlock :parameters () :duration (= ?duration 3)
            ...     :effect (and (at start (busy)) (at end (open)))))''').revision
            2
            >>> print(kb.abort(kb.start("(unlock)")))
            (unlock) was aborted; it leaves +(busy)
            >>> _ = kb.propositions.delete_all()
            >>> print(kb.abort(kb.start("(unlock)"), undo=True))
            (unlock) was aborted, and +(busy) taken back
        """

    @required
    def broken_invariants(self) -> list[BrokenInvariant]:
        """Return the conditions `over all` of running steps that do not hold now.

        Returns:
            The conditions, each with its step, and the revision since which it does not hold.

        Raises:
            PlanError: this is a view of the past.
        """

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
            at: a revision, given as for `kb.at`; None for the present, or the past state that
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
              (not (locked)): does not hold
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
            PddlError: the condition is not well-formed, or no state had all its names.
            InvalidArgumentError: a binding names no free variable.
            UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
            ArchivedError: a part of the range was moved to an archive.

        Examples:
            >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
            >>> for held in kb.when("(robot_at ?r wp1)"):
            ...     print(held.binding["r"], held.since.number, held.until.number)
            rb1 1 2
        """

    @required
    def check_rules(
        self,
        rules: Rules | None = None,
        *,
        since: When | None = None,
        until: When | None = None,
        clock: str = "committed",
    ) -> Verdicts:
        """Hold trajectory constraints of PDDL 3.0 against what was recorded.

        The states of the range are the trajectory: each one at the time of its revision, in seconds
        from the first revision of the range, whose state is the initial one. The semantics is that
        of Gerevini, Haslum, Long, Saetti and Dimopoulos (Artificial Intelligence 173, 2009).
        A rule is judged where its names have a meaning; one whose names have none in the range is
        not judged, and not satisfied. A quantifier around a rule makes one rule for each object,
        which is judged in the states that have the object.

        Args:
            rules: constraints and preferences: a path, PDDL text such as
                `(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))`, formulas, or None
                for those of the domain and the problem.
            since: the first revision, or the earliest time of commit; both inclusive.
            until: the last revision, or the latest time of commit; both inclusive.
            clock: `committed`, or `observed` for the times at which knowledge was sensed, where
                they are given. A time before that of an earlier revision counts as that one.

        Returns:
            The verdicts, in the order of the rules.

        Raises:
            PddlError: a rule is not well-formed, or no state had all the names in the rules.
            UnsupportedConstructError: PDDL 3.0 gives a rule no meaning, as to nested modalities.
            SourceError: the file cannot be read.
            InvalidArgumentError: there is no such clock.
            UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
            ArchivedError: a part of the range was moved to an archive.

        Examples:
            >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
            >>> for verdict in kb.check_rules("(always (not (robot_at rb1 wp2)))"):
            ...     print(verdict.is_satisfied, verdict.revision.number, verdict.revision.actor)
            False 2 perception
        """
