"""From definitions to DTOs, sharing what is referred to within one result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.formula import Atom, Comparison, Constant, Fluent, Node, Not, Number, Timed, Variable
from ..dto.name import fold
from ..dto.number import decimal_text, number_text
from ..dto.parameters import variable_name
from ..dto.pddl_action_dto import Duration
from ..dto.pddl_proposition_dto import trusted_proposition
from ..errors import reading_rows
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree_reader import TreeReader
from ..pddl.document import ACTION, EVENT, PROCESS


class DtoBuilder:
    """Builds the DTOs of one result from the definitions that it was read with."""

    def __init__(self, definitions: Definitions) -> None:
        self._definitions = definitions
        self._types: dict[int, PddlTypeDto] = {}
        self._objects: dict[int, PddlObjectDto] = {}
        self._predicates: dict[int, PddlPredicateDto] = {}
        self._functions: dict[int, PddlFunctionDto] = {}

    def type(self, id_: int) -> PddlTypeDto:
        """Build a type, with the types above it.

        Args:
            id_: the type's id.

        Returns:
            The DTO.
        """
        pending = [id_] if id_ not in self._types else []
        opened: set[int] = set()
        # Those above come first, on a stack that is not the interpreter's.
        while pending:
            definition = self._definitions.types.live(pending[-1])
            above = definition.parent_ids
            missing = [each for each in above if each not in self._types]
            with reading_rows("type_version", f"type {definition.id!r}"):
                if missing and definition.id in opened:
                    raise ValueError("the type is above itself")
                opened.add(definition.id)
                if missing:
                    pending += missing
                    continue
                dto = PddlTypeDto(definition.name, parent=self.types(above) if above else None)
            self._types.setdefault(pending.pop(), dto)
        return self._types[id_]

    def types(self, ids: Sequence[int]) -> PddlTypeDto:
        """Build the type that stands for one type, or for several.

        Args:
            ids: the types' ids.

        Returns:
            The DTO, a `PddlEitherTypeDto` for several.
        """
        if len(ids) == 1:
            return self.type(ids[0])
        return PddlEitherTypeDto([self.type(id_) for id_ in ids])

    def object(self, id_: int) -> PddlObjectDto:
        """Build an object.

        Args:
            id_: the object's id.

        Returns:
            The DTO.
        """
        dto = self._objects.get(id_)
        if dto is None:
            definition = self._definitions.objects.live(id_)
            with reading_rows("object_version", f"object {id_!r}"):
                dto = PddlObjectDto(
                    self.types(definition.type_ids),
                    definition.name,
                    is_constant=definition.is_constant,
                )
            self._objects[id_] = dto
        return dto

    def predicate(self, id_: int) -> PddlPredicateDto:
        """Build a predicate.

        Args:
            id_: the predicate's id.

        Returns:
            The DTO.
        """
        dto = self._predicates.get(id_)
        if dto is None:
            definition = self._definitions.predicates.live(id_)
            with reading_rows("predicate_version", f"predicate {id_!r}"):
                types = [self._parameter_type(parameter) for parameter in definition.parameters]
                names = _given_names(types, definition.parameters)
                dto = PddlPredicateDto(definition.name, types, parameter_names=names)
            self._predicates[id_] = dto
        return dto

    def function(self, id_: int) -> PddlFunctionDto:
        """Build a function.

        Args:
            id_: the function's id.

        Returns:
            The DTO.
        """
        dto = self._functions.get(id_)
        if dto is None:
            definition = self._definitions.functions.live(id_)
            types = [self._parameter_type(parameter) for parameter in definition.parameters]
            dto = PddlFunctionDto(
                definition.name,
                types,
                value_types=[self.type(type_id) for type_id in definition.type_ids],
                parameter_names=_given_names(types, definition.parameters),
            )
            self._functions[id_] = dto
        return dto

    def proposition(self, predicate_id: int, arguments: str, is_goal: bool) -> PddlPropositionDto:
        """Build a proposition.

        Args:
            predicate_id: its predicate.
            arguments: the ids of its objects in order, separated by spaces.
            is_goal: whether it is a goal.

        Returns:
            The DTO.
        """
        objects = [self.object(int(id_)) for id_ in arguments.split()]
        return trusted_proposition(self.predicate(predicate_id), objects, bool(is_goal))

    def action(self, definition: ActionDefinition) -> PddlActionDto:
        """Build an action.

        Args:
            definition: the action.

        Returns:
            The DTO.
        """
        with reading_rows("action_version", f"action {definition.id!r}"):
            return self._action(definition)

    def _action(self, definition: ActionDefinition) -> PddlActionDto:
        parameters = [
            PddlObjectDto(self._parameter_type(parameter), parameter.name)
            for parameter in definition.parameters
        ]
        duration, conditions, effects = (
            TreeReader(self._definitions, tree, definition.parameters).conjuncts()
            for tree in definition.trees
        )
        own = (definition.name, parameters)
        parts = self._parts(conditions, parameters), self._parts(effects, parameters)
        if definition.kind == PROCESS:
            return PddlProcessDto(*own, *parts)
        if definition.kind == EVENT:
            return PddlEventDto(*own, *parts)
        if definition.kind == ACTION:
            return PddlActionDto(*own, *parts, durative=False)
        return PddlActionDto(*own, *parts, duration=_duration(duration))

    def _parts(
        self, formulas: Iterable[Node], parameters: list[PddlObjectDto]
    ) -> list[PddlConditionEffectDto | Node]:
        by_name = {fold(parameter.name): parameter for parameter in parameters}
        return [self._literal(formula, by_name) or formula for formula in formulas]

    def _literal(
        self, formula: Node, by_name: dict[str, PddlObjectDto]
    ) -> PddlConditionEffectDto | None:
        """Build the literal that a formula is, if it is one that a DTO of the paper can say."""
        time = formula.time if isinstance(formula, Timed) else None
        inner = formula.formula if isinstance(formula, Timed) else formula
        atom = inner.formula if isinstance(inner, Not) else inner
        if not isinstance(atom, Atom) or any(isinstance(term, Fluent) for term in atom.terms):
            return None
        objects = self._definitions.objects
        terms = []
        for term in atom.terms:
            if isinstance(term, Variable):
                terms.append(by_name[fold(term.name)])
            elif isinstance(term, Constant) and (found := objects.named(term.name)):
                if fold(term.name) in by_name:
                    return None
                terms.append(self.object(found.id))
        predicate = self._definitions.predicates.named(atom.predicate)
        assert predicate is not None
        return PddlConditionEffectDto(
            self.predicate(predicate.id), terms, time, isinstance(inner, Not)
        )

    def _parameter_type(self, parameter: ParameterDefinition) -> PddlTypeDto:
        return self.types(parameter.type_ids)


def _given_names(
    types: Iterable[PddlTypeDto], parameters: Iterable[ParameterDefinition]
) -> list[str] | None:
    """Give the names of parameters, unless they are those that parameters without names get."""
    names = [parameter.name for parameter in parameters]
    derived = [variable_name(type_.name, position) for position, type_ in enumerate(types)]
    return None if names == derived else names


def _duration(constraints: Sequence[Node]) -> Duration:
    """Give a duration that is fixed by a number as that number, as the paper's DTO has it."""
    match constraints:
        case [Comparison("=", Variable("duration"), Number(value))]:
            text = decimal_text(value)
            exact: int | float = float(text) if "." in text else int(text)
            return exact if number_text(exact) == text else value
    return list(constraints)
