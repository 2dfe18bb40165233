"""The abstract DAOs, one for each kind of PDDL element, which every family implements.

Each call is one transaction, unless the task or thread has one open, and makes one revision if it
changes something. Besides the errors listed, every method can raise `StoreError` (the database
refused or failed; nothing was written), and every write `ReadOnlyError` (on a view of the past).

Each call returns new DTOs. Within one result, DTOs share the types, predicates and objects that
they refer to.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Generic, TypeVar

from ..arguments import Progress
from ..dto import (
    Dto,
    PddlActionDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.formulas import Derived, Equal, Formula, Metric, Node, Not, TimedLiteral

__all__ = [
    "AnyDao",
    "ConstraintDao",
    "Dao",
    "DerivedPredicateDao",
    "FormulaDao",
    "GoalDao",
    "InitialLiteralDao",
    "MetricDao",
    "NamedDao",
    "PddlActionDao",
    "PddlEventDao",
    "PddlFunctionDao",
    "PddlFunctionValueDao",
    "PddlObjectDao",
    "PddlPredicateDao",
    "PddlProcessDao",
    "PddlPropositionDao",
    "PddlTypeDao",
    "Progress",
    "RedefinableDao",
    "TimedInitialLiteralDao",
]

# PDDL text and nodes, unlike DTOs, name known elements only.
FactLike = PddlPropositionDto | str | Node
ValueLike = PddlFunctionValueDto | str | Node
GoalLike = Formula | PddlPropositionDto | str

E = TypeVar("E", bound=Dto | Node)
D = TypeVar("D", bound=Dto)
# The argument of save and delete.
Given = TypeVar("Given")


class AnyDao(ABC, Generic[E, Given]):
    """Reads, saves and deletes one kind of PDDL element, or the formulas of one section."""

    @abstractmethod
    def get_all(self) -> list[E]:
        """Read all elements of the kind.

        Returns:
            The elements, in the order of their first assertion.

        Examples:
            >>> print(*kb.objects.get_all())
            rb1 - robot wp1 - wp
        """

    @abstractmethod
    def save(self, dto: Given | Sequence[Given]) -> bool:
        """Insert or update an element, and insert the elements it refers to if they are missing.

        Args:
            dto: the element, or a list of elements, which are saved in one revision.

        Returns:
            True; an element that cannot be saved raises.

        Raises:
            InvalidKnowledgeError: it is not well-formed; the message names the element, what was
                found and what was expected.
            PddlError: a text cannot be read, or has an unknown name; with the position, and a
                similar name.
            ConflictError: it refers to an element that is stored with another definition.
            DependantsError: it redefines an element that live facts or actions depend on.

        Examples:
            >>> kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
            True
            >>> print(*kb.objects.get_all())
            rb1 - robot wp1 - wp wp2 - wp
        """

    @abstractmethod
    def insert(self, dto: Given) -> bool:
        """Save an element if it is not stored.

        Returns:
            False if it is stored, with any definition; then nothing changes.

        Raises:
            PddlError, InvalidKnowledgeError, ConflictError: as `save`.
        """

    @abstractmethod
    def save_all(self, dtos: Iterable[Given]) -> int:
        """Save many elements in one revision, faster than one by one.

        Args:
            dtos: the elements. An iterator is consumed in batches, in constant memory for
                propositions, so each element must be a DTO of its own.

        Returns:
            The number of elements that changed the store.

        Raises:
            PddlError, InvalidKnowledgeError, ConflictError, DependantsError: as `save`; nothing is
                saved.

        Examples:
            >>> places = [PddlObjectDto(wp, f"wp{number}") for number in range(1, 1001)]
            >>> kb.objects.save_all(places)
            999
            >>> kb.revision
            2
        """

    @abstractmethod
    def delete(self, dto: Given) -> bool:
        """Delete an element and everything that depends on it, in one revision.

        Args:
            dto: the element; only its identity counts. For a named element, the name is enough, in
                any case.

        Returns:
            False if it is not stored.

        Raises:
            PddlError: a text cannot be read, or refers to an element that never existed.

        Examples:
            >>> kb.objects.delete(rb1)
            True
            >>> kb.propositions.get_all()
            []
        """

    @abstractmethod
    def delete_all(self, dtos: Iterable[Given] | None = None) -> int:
        """Delete elements of the kind and everything that depends on them, in one revision.

        Args:
            dtos: the elements, given as for `delete`; None for all of the kind.

        Returns:
            The number of deleted elements of the kind.

        Examples:
            >>> kb.objects.delete_all([wp1, wp2])
            1
        """


class Dao(AnyDao[D, Given]):
    """Reads, saves and deletes one kind of PDDL element."""

    @abstractmethod
    def update(self, dto: Given) -> bool:
        """Save an element that is stored.

        Returns:
            False when it is not stored; then nothing changes.

        Raises:
            PddlError, InvalidKnowledgeError, ConflictError, DependantsError: as `save`.
        """


class NamedDao(Dao[D, D | str]):
    """Reads, saves and deletes one kind of named element.

    Give an element as a DTO or as its PDDL text, which `str` of the DTO writes; `delete` and
    `delete_all` also take its name.
    """

    @abstractmethod
    def get(self, name: str) -> D | None:
        """Read one element.

        Args:
            name: its name, in any case.

        Returns:
            The element, or None.

        Examples:
            >>> print(kb.objects.get("RB1"))
            rb1 - robot
            >>> kb.objects.get("rb2") is None
            True
        """


class RedefinableDao(NamedDao[D]):
    """Reads, saves and deletes one kind of named element that others can depend on."""

    @abstractmethod
    def save(self, dto: D | str | Sequence[D | str], *, cascade: bool = False) -> bool:
        """Insert or redefine an element, and insert the elements it refers to if they are missing.

        Args:
            dto: the element, a DTO or text; or a list of elements, which are saved in one revision.
            cascade: instead of refusing, retract the live facts and actions that depend on the
                present definition, in the same revision.

        Returns:
            True; an element that cannot be saved raises.

        Raises:
            InvalidKnowledgeError: it is not well-formed.
            PddlError: a text cannot be read; with the position.
            ConflictError: it refers to an element that is stored with another definition.
            DependantsError: live facts or actions depend on the present definition, and `cascade`
                is False.

        Examples:
            >>> wider = "(robot_at ?r - robot ?from - wp ?to - wp)"
            >>> kb.predicates.save(wider)
            Traceback (most recent call last):
            kant_sql.errors.DependantsError: ...
            >>> kb.predicates.save(wider, cascade=True)
            True
            >>> kb.propositions.get_all()
            []
        """

    @abstractmethod
    def update(self, dto: D | str, *, cascade: bool = False) -> bool:
        """Redefine an element that is stored.

        Args:
            dto: the element.
            cascade: as `save`.

        Returns:
            False when it is not stored; then nothing changes.

        Raises:
            PddlError, InvalidKnowledgeError, ConflictError, DependantsError: as `save`.
        """


class PddlTypeDao(RedefinableDao[PddlTypeDto]):
    """Reads, saves and deletes types; `room - place` is the text of one.

    Deleting a type deletes its subtypes, their objects, the predicates and actions with parameters
    of these types, and the facts and goals of these predicates.

    `save` takes the DTO as the whole definition: without a parent, the type is a child of `object`.
    In a reference from another element, a type is found by name, and its parent is compared only if
    it is given.

    Examples:
        >>> kb.types.save(["room - place", "tiago - robot"])
        True
        >>> print(*kb.types.get_all(), sep=", ")
        robot, wp, place, room - place, tiago - robot
    """


class PddlObjectDao(RedefinableDao[PddlObjectDto]):
    """Reads, saves and deletes objects; `rb1 - robot` is the text of one.

    Deleting an object deletes the facts, goals and actions that refer to it.

    Examples:
        >>> kb.objects.save("rb2 - robot")
        True
    """

    @abstractmethod
    def get_by_type(self, name: str) -> list[PddlObjectDto]:
        """Read the objects of a type and its subtypes.

        Args:
            name: the type's name, in any case; `object` for all objects.

        Returns:
            The objects, in the order of their first assertion; none for a type that was deleted.

        Raises:
            UnknownNameError: there never was such a type.

        Examples:
            >>> print(*kb.objects.get_by_type("wp"))
            wp1 - wp
        """


class PddlPredicateDao(RedefinableDao[PddlPredicateDto]):
    """Reads, saves and deletes predicates; `(robot_at ?r - robot ?w - wp)` is the text of one.

    Deleting a predicate deletes its facts and goals, and the actions that refer to it.
    """


class PddlActionDao(NamedDao[PddlActionDto]):
    """Reads, saves and deletes actions; nothing depends on them.

    A condition or an effect is a literal, or a node of `kant_sql.pddl`. Saving a literal inserts
    the elements it refers to if they are missing; the names in a node or a text must be known.

    Examples:
        >>> kb.actions.save("(:action leave :parameters (?r - robot ?w - wp) "
        ...     ":precondition (robot_at ?r ?w) :effect (not (robot_at ?r ?w)))")
        True
    """


class PddlProcessDao(NamedDao[PddlProcessDto]):
    """Reads, saves and deletes processes (PDDL+), named apart from actions and events."""


class PddlEventDao(NamedDao[PddlEventDto]):
    """Reads, saves and deletes events (PDDL+), named apart from actions and processes."""


class PddlPropositionDao(Dao[PddlPropositionDto, FactLike]):
    """Reads, saves and deletes facts; goals have a DAO of their own, `kb.goals`.

    Give a fact as PDDL text such as `(robot_at rb1 wp1)`, as a ground `Atom`, or as a DTO. Text and
    atoms name known elements; a DTO also has their types, and missing ones are saved with it. There
    is nothing to update: `update` returns whether the fact holds.

    Examples:
        >>> kb.objects.save(wp2)
        True
        >>> kb.propositions.save("(robot_at rb1 wp2)")
        True
        >>> kb.propositions.save("(robot_at rb1 wp3)")
        Traceback (most recent call last):
        kant_sql.errors.PddlError: ...
        >>> kb.propositions.delete_all(["(robot_at rb1 wp1)", "(robot_at rb1 wp2)"])
        2
    """

    @abstractmethod
    def save(self, dto: FactLike | Sequence[FactLike]) -> bool:
        """Save a fact.

        Args:
            dto: PDDL text or an atom of a fact, or a DTO; or a list of these, which are saved in
                one revision.

        Returns:
            True; a fact that cannot be saved raises.

        Raises:
            PddlError: the text is not a fact, or names an unknown element; with the position, and a
                similar name.
            InvalidKnowledgeError: it is a goal, which belongs to `kb.goals`; or as `Dao.save`.
            ConflictError: as `Dao.save`.
        """

    @abstractmethod
    def confirm(
        self, facts: FactLike | Iterable[FactLike], *, not_within: float | None = None
    ) -> int:
        """Confirm facts that hold, because they were observed again. The state does not change.

        A fact that an act asserted is expected until another actor confirms it. A transaction does
        not confirm facts that it asserts itself.

        Args:
            facts: PDDL text or an atom of a fact, or a DTO; or several of these, which are
                confirmed in one revision.
            not_within: seconds; skips facts that this actor confirmed more recently, and that
                nobody has retracted since. If no fact is left, the call writes nothing.

        Returns:
            The number of confirmed facts.

        Raises:
            InvalidKnowledgeError: one of them does not hold, or is a goal; no fact is confirmed.
            PddlError: as `save`.
            InvalidArgumentError: `not_within` is not a number of seconds, from 0.

        Examples:
            >>> kb.propositions.confirm("(robot_at rb1 wp1)", not_within=5)
            1
            >>> kb.propositions.confirm("(robot_at rb1 wp1)", not_within=5)
            0
        """

    @abstractmethod
    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        """Read the facts of one predicate.

        Args:
            name: the predicate's name, in any case.

        Returns:
            The facts; none for a predicate that was deleted.

        Raises:
            UnknownNameError: there never was such a predicate.

        Examples:
            >>> print(*kb.propositions.get_by_predicate("robot_at"))
            (robot_at rb1 wp1)
        """

    @abstractmethod
    def get_by_object(self, name: str) -> list[PddlPropositionDto]:
        """Read the facts that mention an object.

        Args:
            name: the object's name, in any case.

        Returns:
            The facts; none for an object that was deleted.

        Raises:
            UnknownNameError: there never was such an object.

        Examples:
            >>> print(*kb.propositions.get_by_object("wp1"))
            (robot_at rb1 wp1)
        """


FunctionReference = str | PddlFunctionDto
ObjectReference = str | PddlObjectDto
Number = int | float | Decimal


class PddlFunctionDao(RedefinableDao[PddlFunctionDto]):
    """Reads, saves and deletes functions; `(battery ?r - robot) - number` is the text of one.

    Deleting a function deletes its values, and the actions and formulas that refer to it. A new
    name for a parameter is a change but not a redefinition: nothing depends on it.
    """


class PddlFunctionValueDao(Dao[PddlFunctionValueDto, ValueLike]):
    """Reads, sets and unsets the values of functions: numeric fluents and object fluents.

    A fluent is a function applied to objects. Give functions and objects as DTOs, of which writes
    insert missing ones, or by name, in any case, if they are known.

    Numbers are exact decimals. A `float` stands for its shortest decimal text. Setting a fluent to
    an equal number, such as 10 to 10.0, changes nothing.

    `save`, `insert`, `update` and `save_all` take DTOs, PDDL text such as `(= (battery rb1) 80)`,
    and nodes. `insert` sets a fluent that has no value, `update` one that has a value; `delete`
    unsets a fluent with any value; a text may omit the value: `(battery rb1)`.

    Examples:
        >>> kb.functions.save("(battery ?r - robot) - number")
        True
        >>> kb.function_values.save("(= (battery rb1) 80)")
        True
        >>> kb.function_values.get("battery", objects=["rb1"])
        Decimal('80')
        >>> kb.function_values.delete("(battery rb1)")
        True
    """

    @abstractmethod
    def get(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> Decimal | PddlObjectDto | None:
        """Read the value of a fluent: a function applied to objects, in order.

        Args:
            function: a DTO, a name, or the whole fluent as PDDL text, such as `(battery rb1)`.
            objects: its arguments, in order: DTOs or names.

        Returns:
            A number, or an object for an object fluent; None if it has no value.

        Raises:
            UnknownNameError: a function or an object is given by a name that never was.

        Examples:
            >>> battery = PddlFunctionDto("battery", [robot])
            >>> kb.function_values.set(battery, objects=[rb1], value=87.5)
            True
            >>> kb.function_values.get("battery", objects=["rb1"])
            Decimal('87.5')
            >>> kb.function_values.get("(battery rb1)")
            Decimal('87.5')
        """

    @abstractmethod
    def get_by_function(self, name: str) -> list[PddlFunctionValueDto]:
        """Read the values of one function.

        Args:
            name: the function's name, in any case.

        Returns:
            The values; none for a function that was deleted.

        Raises:
            UnknownNameError: there never was such a function.
        """

    @abstractmethod
    def set(
        self,
        function: FunctionReference,
        *,
        objects: Sequence[ObjectReference] = (),
        value: Number | ObjectReference,
    ) -> bool:
        """Set a fluent, given as for `get`, to a number or an object.

        Args:
            function: a DTO, a name, or the whole fluent as PDDL text.
            objects: its arguments, in order: DTOs or names.
            value: a finite number of at most 400 digits; for an object fluent, an object or its
                name.

        Returns:
            Whether the value changed.

        Raises:
            ArityError: the function has another number of parameters.
            TypeMismatchError: an object does not fit its parameter, or the value the function.
            ConflictError: a DTO is stored with another definition.
            InvalidKnowledgeError: a name is unknown, or an argument is not well-formed.

        Examples:
            >>> kb.function_values.set(PddlFunctionDto("battery", [robot]), objects=[rb1], value=90)
            True
            >>> kb.function_values.set("battery", objects=["rb1"], value=90)
            False
        """

    @abstractmethod
    def unset(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> bool:
        """Remove the value of a fluent, given as for `get`.

        Returns:
            False if it has no value.

        Raises:
            UnknownNameError: a function or an object is given by a name that never was.
        """

    @abstractmethod
    def increase(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        """Add `by` to the number of a fluent, given as for `get`, atomically.

        Returns:
            The new value: exact if 400 digits can express it, else rounded to 28 significant
            digits.

        Raises:
            InvalidKnowledgeError: the fluent has no value; or as `set`.

        Examples:
            >>> distance = PddlFunctionDto("distance", [robot])
            >>> _ = kb.function_values.set(distance, objects=[rb1], value=1.1)
            >>> kb.function_values.increase(distance, objects=[rb1], by=2.2)
            Decimal('3.3')
        """

    @abstractmethod
    def decrease(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        """Subtract `by` from a number, atomically; otherwise as `increase`."""

    @abstractmethod
    def scale_up(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        """Multiply a number by `by`, atomically; otherwise as `increase`."""

    @abstractmethod
    def scale_down(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        """Divide a number by `by`, which is not 0, atomically; otherwise as `increase`."""


N = TypeVar("N", bound=Node)


class FormulaDao(AnyDao[N, Given]):
    """Reads, saves and deletes formulas of one section: nodes of `kant_sql.pddl`, or PDDL text.

    The predicates, functions, types and objects that a formula names must be known. Deleting one of
    them deletes the formula.
    """

    @abstractmethod
    def save(self, formula: Given | Sequence[Given]) -> bool:
        """Save a formula; a conjunction of goals or constraints is saved as its conjuncts.

        Args:
            formula: a node, or PDDL text; or a list of these, which are saved in one revision.

        Returns:
            True; a formula that cannot be saved raises.

        Raises:
            PddlError: a text cannot be read; with the position, and a similar name.
            InvalidKnowledgeError: it is not well-formed, or a name is not known.

        Examples:
            >>> kb.goals.save("(or (robot_at rb1 wp1) (robot_at rb1 wp1))")
            True
            >>> print(*kb.goals.get_all())
            (or (robot_at rb1 wp1) (robot_at rb1 wp1))
        """


class DerivedPredicateDao(FormulaDao[Derived, Derived | str]):
    """Reads, saves and deletes the rules of derived predicates (PDDL 2.2, section 3.1)."""


class TimedInitialLiteralDao(FormulaDao[TimedLiteral, TimedLiteral | str]):
    """Reads, saves and deletes timed initial literals and values (PDDL 2.2, section 3.2)."""


class InitialLiteralDao(FormulaDao[Not | Equal, Not | Equal | str]):
    """Reads, saves and deletes negative literals and equalities of the initial state."""


class GoalDao(FormulaDao[Formula, GoalLike]):
    """Reads, saves and deletes goals of any form, ground atoms among them.

    A conjunction is stored as its conjuncts. A `PddlPropositionDto` means a goal here, whatever its
    `is_goal`; missing elements that it refers to are saved with it.

    Examples:
        >>> kb.goals.save(["(not (robot_at rb1 wp1))", PddlPropositionDto(robot_at, [rb1, wp2])])
        True
    """

    @abstractmethod
    def get_propositions(self) -> list[PddlPropositionDto]:
        """Read the goals that are ground atoms, as DTOs with `is_goal`.

        Returns:
            The propositions, in the order of their first assertion.

        Examples:
            >>> _ = kb.goals.save(["(not (robot_at rb1 wp1))", "(robot_at rb1 wp1)"])
            >>> print(*kb.goals.get_propositions())
            (robot_at rb1 wp1)
        """


class ConstraintDao(FormulaDao[Formula, Formula | str]):
    """Reads, saves and deletes trajectory constraints (PDDL 3.0, section 2).

    A conjunction is stored as its conjuncts.
    """


class MetricDao(ABC):
    """Reads and sets the metric, which planners minimize or maximize (PDDL 2.1, section 4.1)."""

    @abstractmethod
    def get(self) -> Metric | None:
        """Read the metric.

        Returns:
            The metric, or None.
        """

    @abstractmethod
    def set(self, metric: Metric | str | None) -> bool:
        """Set the metric, or remove it.

        Args:
            metric: a node, or PDDL text such as `(:metric minimize (total-time))`; None removes it.

        Returns:
            Whether the metric changed.

        Raises:
            PddlError: a text cannot be read; with the position.
            InvalidKnowledgeError: it is not well-formed, or a name is not known.
        """
