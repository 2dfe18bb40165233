"""What fluents refer to: by names that must be known, or by DTOs that are saved when missing."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import Any

from ..arguments import expect_list, shown
from ..dto import PddlFunctionDto, PddlFunctionValueDto, PddlObjectDto
from ..dto.atom_dto import atom_text
from ..dto.number import number_text
from ..errors import InvalidKnowledgeError, TypeMismatchError
from ..fluents import FluentKey, FluentValue
from ..knowledge.definitions import Definitions
from ..knowledge.function import FunctionDefinition
from ..transaction import Transaction
from .fluent_interfaces import FunctionReference, Number, ObjectReference
from .function import ensure_function
from .references import Arguments

_ROLE = "a function value"


class FluentReferences(Arguments):
    """What the fluents of one batch refer to."""

    def __init__(self, transaction: Transaction) -> None:
        """Make it for one batch.

        Args:
            transaction: the transaction.
        """
        super().__init__(transaction, _ROLE)
        self._functions: dict[int, tuple[FunctionDefinition, Any]] = {}

    def entry(self, dto: PddlFunctionValueDto) -> tuple[FluentKey, str, FluentValue]:
        """Check a value, and save what it refers to when it is missing.

        Args:
            dto: the value.

        Returns:
            What makes its fluent the one that it is, the fluent's canonical PDDL text, and its
            value.

        Raises:
            ArityError: the function has another number of parameters.
            TypeMismatchError: an object does not fit its parameter, or the value the function.
            ConflictError: it refers to something that is stored with another definition.
            InvalidKnowledgeError: something that is missing is not well formed.
        """
        function, key, text = self.resolve(dto.function, dto.objects)
        return key, text, self.value(function, dto.value, text)

    def resolve(
        self, function: FunctionReference, objects: Sequence[ObjectReference]
    ) -> tuple[FunctionDefinition, FluentKey, str]:
        """Check a fluent, and save what it refers to by a DTO when it is missing.

        Args:
            function: the function.
            objects: its arguments, in order.

        Returns:
            The function, what makes the fluent the one that it is, and its canonical PDDL text.

        Raises:
            ArityError: the function has another number of parameters.
            TypeMismatchError: an object does not fit its parameter.
            ConflictError: it refers to something that is stored with another definition.
            InvalidKnowledgeError: a name is not known, or what is missing is not well formed.
        """
        declared = self._function(function)
        names = [each if isinstance(each, str) else each.name for each in objects]
        shown = f"({' '.join([declared.name, *map(str, names)])})"
        found = self.check(shown, declared, objects)
        ids = " ".join([str(object_.id) for object_ in found])
        text = atom_text(declared.name, [object_.name for object_ in found])
        return declared, FluentKey(declared.id, ids), text

    def value(self, function: FunctionDefinition, given: object, text: str) -> FluentValue:
        """Check a value.

        Args:
            function: the function.
            given: a number; for a function whose values are objects, one, or its name.
            text: the fluent's text, for the message.

        Returns:
            The value.

        Raises:
            TypeMismatchError: the value is not of the function's kind or type.
            InvalidKnowledgeError: the number is not finite or too long, or no object is known by
                the name.
        """
        if not function.type_ids:
            return FluentValue(number_text(self.number(function, given, text)))
        if not isinstance(given, str | PddlObjectDto):
            raise TypeMismatchError(
                f"{text}: the value is {shown(given)}, expected an object, as in {function.text}"
            )
        object_ = self.object(given)
        if not self._transaction.definitions.any_fits(object_.type_ids, function.type_ids):
            raise self.mismatch(f"{text}: the value", object_, function.type_ids, function.text)
        return FluentValue(object_.name, object_.id)

    def number(self, function: FunctionDefinition, given: object, text: str) -> Decimal:
        """Check a number, exactly as it is written: a float by its shortest digits.

        Args:
            function: the function that it is for.
            given: the number.
            text: the fluent's text, for the message.

        Returns:
            The number.

        Raises:
            TypeMismatchError: it is none, or the function's values are objects.
            InvalidKnowledgeError: it is not finite, or too long.
        """
        if function.type_ids or isinstance(given, bool) or not isinstance(given, Number):
            expected = "an object" if function.type_ids else "a number"
            raise TypeMismatchError(
                f"{text}: the value is {shown(given)}, expected {expected}, as in {function.text}"
            )
        try:
            return Decimal(number_text(given))
        except InvalidKnowledgeError as error:
            raise InvalidKnowledgeError(f"{text}: {error}") from None

    def _function(self, dto: FunctionReference) -> FunctionDefinition:
        if isinstance(dto, str):
            named = self._transaction.definitions.functions.named(dto)
            if named is None:
                raise InvalidKnowledgeError(
                    f"{_ROLE} refers to function {shown(dto)}, which is not known; save it first, "
                    "or give a PddlFunctionDto"
                )
            return named
        found = self._functions.get(id(dto))
        if found is None:
            found = ensure_function(self._transaction, dto, _ROLE), dto
            self._functions[id(dto)] = found
        return found[0]


def existing_key(
    definitions: Definitions, function: FunctionReference, objects: Sequence[ObjectReference]
) -> FluentKey | None:
    """Find what makes a fluent the one that it is, from names alone.

    Args:
        definitions: the definitions.
        function: the function.
        objects: its arguments, in order.

    Returns:
        The key; None when a name in it is not known, so that it has no value.
    """
    declared = definitions.functions.named(_name(function))
    ids = definitions.arguments(map(_name, objects))
    return None if declared is None or ids is None else FluentKey(declared.id, ids)


def check_fluent(function: FunctionReference, objects: Sequence[ObjectReference]) -> None:
    """Refuse what is neither a name nor a DTO.

    Args:
        function: the function.
        objects: its arguments.

    Raises:
        InvalidKnowledgeError: something is neither.
    """
    if not isinstance(function, str | PddlFunctionDto):
        raise InvalidKnowledgeError(
            f"the function of {_ROLE} is a name or a PddlFunctionDto, not "
            f"{type(function).__name__}: {shown(function)}"
        )
    kinds: tuple[type[Any], ...] = (PddlObjectDto, str)
    expect_list(objects, kinds, f"the list of objects of {_ROLE}")


def _name(reference: FunctionReference | ObjectReference) -> str:
    return reference if isinstance(reference, str) else reference.name
