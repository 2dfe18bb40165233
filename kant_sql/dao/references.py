"""What propositions refer to: checked, and saved when it is missing."""

from __future__ import annotations

from typing import Any

from ..atoms import AtomKey
from ..dto import PddlObjectDto, PddlPredicateDto, PddlPropositionDto
from ..dto.atom_dto import atom_text
from ..errors import ArityError, TypeMismatchError
from ..knowledge.object import ObjectDefinition
from ..knowledge.predicate import PredicateDefinition
from ..transaction import Transaction
from .object import ensure_object
from .predicate import ensure_predicate

_ROLE = "a proposition"


class References:
    """What the propositions of one batch refer to: the same reference is checked once.

    A batch only ever adds definitions, so that what was found to agree goes on to agree.
    """

    def __init__(self, transaction: Transaction) -> None:
        """Make it for one batch.

        Args:
            transaction: the transaction.
        """
        self._transaction = transaction
        # By the address of a DTO, which is kept so that no other comes to be there.
        self._predicates: dict[int, tuple[PredicateDefinition, Any]] = {}
        self._objects: dict[tuple[str, int], tuple[ObjectDefinition, Any]] = {}

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
        if len(dto.objects) != len(predicate.parameters):
            raise ArityError(
                f"{dto} has {len(dto.objects)} arguments, expected {len(predicate.parameters)} as "
                f"in {predicate.text}"
            )
        objects: list[ObjectDefinition] = []
        definitions = self._transaction.definitions
        for parameter, object_dto in zip(predicate.parameters, dto.objects, strict=True):
            object_ = self._object(object_dto)
            type_id, allowed = object_.type_id, parameter.type_ids
            if type_id not in allowed and not definitions.fits(type_id, allowed):
                raise self._mismatch(dto, len(objects), object_, predicate)
            objects.append(object_)
        ids = " ".join([str(object_.id) for object_ in objects])
        text = atom_text(predicate.name, [object_.name for object_ in objects])
        return AtomKey(bool(dto.is_goal), predicate.id, ids), text

    def _predicate(self, dto: PddlPredicateDto) -> PredicateDefinition:
        found = self._predicates.get(id(dto))
        if found is None:
            found = ensure_predicate(self._transaction, dto, _ROLE), dto
            self._predicates[id(dto)] = found
        return found[0]

    def _object(self, dto: PddlObjectDto) -> ObjectDefinition:
        if type(dto) is not PddlObjectDto or type(dto.name) is not str:
            return ensure_object(self._transaction, dto, _ROLE)
        type_ = dto.type
        key = (dto.name, id(type_))
        found = self._objects.get(key)
        if found is None:
            found = self._objects[key] = ensure_object(self._transaction, dto, _ROLE), type_
        return found[0]

    def _mismatch(
        self,
        dto: PddlPropositionDto,
        position: int,
        object_: ObjectDefinition,
        predicate: PredicateDefinition,
    ) -> TypeMismatchError:
        types = self._transaction.definitions.types
        wanted = predicate.parameters[position].type_ids[0]
        return TypeMismatchError(
            f"{dto}: argument {position + 1}, {object_.name!r}, is of type "
            f"{types.live(object_.type_id).name!r}, expected {types.live(wanted).name!r} or a "
            f"subtype, as in {predicate.text}"
        )
