"""The abstract DAOs of functions and their values; `interfaces.py` says what all DAOs do."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from decimal import Decimal

from ..dto import PddlFunctionDto, PddlFunctionValueDto, PddlObjectDto
from .interfaces import Dao, RedefinableDao

FunctionReference = str | PddlFunctionDto
ObjectReference = str | PddlObjectDto
Number = int | float | Decimal


class PddlFunctionDao(RedefinableDao[PddlFunctionDto]):
    """Reads, saves and deletes functions.

    Deleting a function deletes its values, and the actions and formulas that mention it. Another
    name for a parameter is a change, but no redefinition: nothing depends on it.
    """


class PddlFunctionValueDao(Dao[PddlFunctionValueDto]):
    """Reads, sets and unsets the values of functions: numeric fluents and object fluents.

    A fluent is a function applied to objects. Each can be given by name, in any spelling, if it is
    known; what is given as a DTO is saved when it is missing, as far as a method writes.

    Numbers are exact decimals: an `int` or a `Decimal` is what it says, a `float` what its shortest
    text says. To set a number to an equal one, as 10 to 10.0, changes nothing.

    `insert` gives a value to a fluent that has none, `update` to one that has one; `delete` unsets
    a fluent, whatever the DTO's value.
    """

    @abstractmethod
    def get(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> Decimal | PddlObjectDto | None:
        """Read what a fluent is.

        Args:
            function: the function.
            objects: its arguments, in order.

        Returns:
            A number, or an object for a function whose values are objects; None when it has no
            value, or something in it is not known.
        """

    @abstractmethod
    def get_by_function(self, name: str) -> list[PddlFunctionValueDto]:
        """Read the values of one function.

        Args:
            name: the function's name, in any spelling.

        Returns:
            The values; none when there is no such function.
        """

    @abstractmethod
    def set(
        self,
        function: FunctionReference,
        *,
        objects: Sequence[ObjectReference],
        value: Number | ObjectReference,
    ) -> bool:
        """Let a fluent be a number, or an object.

        Args:
            function: the function.
            objects: its arguments, in order.
            value: a finite number of at most 400 digits; for a function whose values are objects,
                one, or its name.

        Returns:
            Whether that is a change.

        Raises:
            ArityError: the function has another number of parameters.
            TypeMismatchError: an object does not fit its parameter, or the value the function.
            ConflictError: it refers to something that is stored with another definition.
            InvalidKnowledgeError: a name is not known, or something else is not well formed.
        """

    @abstractmethod
    def unset(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> bool:
        """Let a fluent have no value any more.

        Args:
            function: the function.
            objects: its arguments, in order.

        Returns:
            False when it has none, or something in it is not known.
        """

    @abstractmethod
    def increase(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Add to a number, exactly. No other writer comes between the reading and the writing.

        Args:
            function: the function.
            objects: its arguments, in order.
            by: how much.

        Returns:
            The new value. Here and in the three that follow, it is exact where it can be written
            with 400 digits, and else rounded to 28 significant ones.

        Raises:
            InvalidKnowledgeError: the fluent has no value; or as `set`.
        """

    @abstractmethod
    def decrease(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Subtract from a number.

        Args:
            function: the function.
            objects: its arguments, in order.
            by: how much.

        Returns:
            The new value.

        Raises:
            InvalidKnowledgeError: as `increase`.
        """

    @abstractmethod
    def scale_up(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Multiply a number.

        Args:
            function: the function.
            objects: its arguments, in order.
            by: the factor.

        Returns:
            The new value.

        Raises:
            InvalidKnowledgeError: as `increase`.
        """

    @abstractmethod
    def scale_down(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Divide a number.

        Args:
            function: the function.
            objects: its arguments, in order.
            by: the divisor.

        Returns:
            The new value.

        Raises:
            InvalidKnowledgeError: as `increase`, or the divisor is 0.
        """
