"""What propositions refer to: checked, and saved when it is missing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..arguments import flag, shown
from ..atoms import AtomKey
from ..dto import PddlObjectDto, PddlPredicateDto, PddlPropositionDto
from ..dto.atom_dto import atom_text
from ..errors import ArityError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge.function import FunctionDefinition
from ..knowledge.object import ObjectDefinition
from ..knowledge.predicate import PredicateDefinition
from ..transaction import Transaction
from .object import ensure_object
from .parameters import type_text
from .predicate import ensure_predicate

_ROLE = "a proposition"


class Arguments:
    """The objects that the elements of one batch refer to: the same reference is checked once.

    A batch only ever adds definitions, so that what was found to agree goes on to agree.
    """

    def __init__(self, transaction: Transaction, role: str) -> None:
        """Make it for one batch.

        Args:
            transaction: the transaction.
            role: what refers to the objects, for the message.
        """
        self._transaction = transaction
        self._role = role
        # By the address of a DTO, which is kept so that no other comes to be there.
        self._objects: dict[tuple[str, int], tuple[ObjectDefinition, Any]] = {}

    def check(
        self,
        shown: object,
        declared: PredicateDefinition | FunctionDefinition,
        objects: Sequence[PddlObjectDto | str],
    ) -> list[ObjectDefinition]:
        """Check arguments, and save those that are missing.

        Args:
            shown: what they are arguments in, for the message.
            declared: the predicate or the function that they are arguments of.
            objects: the arguments, in order.

        Returns:
            The objects.

        Raises:
            ArityError: they are more or fewer than the parameters.
            TypeMismatchError: an object does not fit its parameter.
        """
        if len(objects) != len(declared.parameters):
            raise ArityError(
                f"{shown} has {len(objects)} arguments, expected {len(declared.parameters)} as "
                f"in {declared.text}"
            )
        found: list[ObjectDefinition] = []
        definitions = self._transaction.definitions
        for parameter, object_dto in zip(declared.parameters, objects, strict=True):
            object_ = self.object(object_dto)
            allowed = parameter.type_ids
            if object_.type_id not in allowed and not definitions.any_fits(
                object_.type_ids, allowed
            ):
                role = f"{shown}: argument {len(found) + 1}"
                raise self.mismatch(role, object_, allowed, declared.text)
            found.append(object_)
        return found

    def object(self, dto: PddlObjectDto | str) -> ObjectDefinition:
        """Find an object; save it when it is missing.

        Args:
            dto: the object as referred to, or the name of one that is known.

        Returns:
            The object.

        Raises:
            ConflictError: it is stored with another type.
            InvalidKnowledgeError: it is missing, and not well formed.
        """
        if isinstance(dto, str):
            named = self._transaction.definitions.objects.named(dto)
            if named is None:
                raise InvalidKnowledgeError(
                    f"{self._role} refers to object {shown(dto)}, which is not known; save it "
                    "first, or give a PddlObjectDto"
                )
            return named
        if type(dto) is not PddlObjectDto or type(dto.name) is not str:
            return ensure_object(self._transaction, dto, self._role)
        type_ = dto.type
        key = (dto.name, id(type_))
        found = self._objects.get(key)
        if found is None:
            found = self._objects[key] = ensure_object(self._transaction, dto, self._role), type_
        return found[0]

    def mismatch(
        self, role: str, object_: ObjectDefinition, allowed: Sequence[int], declared: str
    ) -> TypeMismatchError:
        """Make the error for an object that does not fit its place.

        Args:
            role: the place.
            object_: the object.
            allowed: the types that would fit.
            declared: the declaration that says so.

        Returns:
            The error.
        """
        definitions = self._transaction.definitions
        return TypeMismatchError(
            f"{role}, {object_.name!r}, is of type "
            f"{type_text(definitions, object_.type_ids)!r}, expected "
            f"{type_text(definitions, allowed)!r} or a subtype, as in {declared}"
        )


class References(Arguments):
    """What the propositions of one batch refer to."""

    def __init__(self, transaction: Transaction) -> None:
        """Make it for one batch.

        Args:
            transaction: the transaction.
        """
        super().__init__(transaction, _ROLE)
        self._predicates: dict[int, tuple[PredicateDefinition, Any]] = {}

    def resolve(self, dto: PddlPropositionDto) -> tuple[AtomKey, str]:
        """Check a proposition, and save what it refers to when it is missing.

        Args:
            dto: the proposition.

        Returns:
            What makes it the one that it is, and its canonical PDDL text.

        Raises:
            ArityError: the predicate has another number of parameters.
            TypeMismatchError: an object does not fit its parameter.
            ConflictError: it refers to something that is stored with another definition.
            InvalidKnowledgeError: something that is missing is not well formed.
        """
        predicate = self._predicate(dto.predicate)
        objects = self.check(dto, predicate, dto.objects)
        ids = " ".join([str(object_.id) for object_ in objects])
        text = atom_text(predicate.name, [object_.name for object_ in objects])
        return AtomKey(flag(dto.is_goal, "is_goal of a proposition"), predicate.id, ids), text

    def _predicate(self, dto: PddlPredicateDto) -> PredicateDefinition:
        found = self._predicates.get(id(dto))
        if found is None:
            found = ensure_predicate(self._transaction, dto, _ROLE), dto
            self._predicates[id(dto)] = found
        return found[0]
