"""Types, objects, predicates, functions, propositions and function values as plain data."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, ClassVar, TypeVar

from ..arguments import expect, flag, items, refusal
from ..errors import InvalidKnowledgeError, InvalidNameError, KantSqlError
from .lexical import (
    check_number,
    checked_parameter_names,
    declaration_text,
    either_text,
    fold,
    number_text,
)


def _malformed(dto: Dto) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(
        f"a field of this {type(dto).__name__} was overwritten with an invalid value; make it "
        "again with its constructor, which names the fault"
    )


D = TypeVar("D", bound="Dto")


class Dto:
    """A PDDL element as plain data; `str()` of it is its PDDL text.

    Two DTOs are equal if they denote the same element, whatever their other fields. Assignments to
    fields are unchecked: a DTO with a field of a wrong type equals only itself, and its text and
    its hash raise `InvalidKnowledgeError`.
    """

    # Messages name the class; a field's role is made once, because DTOs are made in bulk.
    _roles: ClassVar[dict[str, str]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls._roles = {name: f"the {name} of a {cls.__name__}" for name in ("predicate", "objects")}

    def _identity(self) -> tuple[object, ...]:
        """Return a hashable key that identifies this element."""
        raise NotImplementedError

    def _text(self) -> str:
        """Return the PDDL text."""
        return repr(self)

    def __str__(self) -> str:
        try:
            return expect(self._text(), str, "the text")
        except KantSqlError:
            raise
        except Exception as error:
            raise _malformed(self) from error

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Dto):
            return NotImplemented
        try:
            return bool(self._identity() == other._identity())
        except Exception:
            # Fields are public and unchecked: a DTO without identity equals only itself.
            return self is other

    def __hash__(self) -> int:
        try:
            return hash(self._identity())
        except KantSqlError:
            raise
        except Exception as error:
            raise _malformed(self) from error


def trusted(made: type[D], **fields: object) -> D:
    """Make a DTO from a checked definition, without checks."""
    dto = object.__new__(made)
    dto.__dict__ = fields
    return dto


class NamedDto(Dto):
    """An element identified by its kind and its name, ignoring case."""

    name: str
    _kind: ClassVar[str]

    def get_name(self) -> str:
        """Return the name."""
        return self.name

    def set_name(self, name: str) -> None:
        """Set the name."""
        self.name = self._checked_name(name)

    @classmethod
    def _checked_name(cls, name: str) -> str:
        # Saving the element checks the rules for names.
        if type(name) is not str:
            expect(name, str, f"the name of a {cls.__name__}", InvalidNameError)
        return name

    def _identity(self) -> tuple[object, ...]:
        return (self._kind, fold(self.name))


@dataclass(init=False, eq=False, repr=False)
class PddlTypeDto(NamedDto):
    """A type, and its parent in the hierarchy.

    Equal by name. Its text is `robot`, or `robot - vehicle` with a parent.

    Attributes:
        name: the type's name.
        parent: the supertype. `None` means the root type `object` when this DTO is saved itself,
            and "not stated" in a reference from another element.
    """

    name: str
    parent: PddlTypeDto | None

    _kind: ClassVar[str] = "type"

    def __init__(self, name: str, *, parent: PddlTypeDto | None = None) -> None:
        self.name = self._checked_name(name)
        self.set_parent(parent)

    def get_parent(self) -> PddlTypeDto | None:
        """Return the parent."""
        return self.parent

    def set_parent(self, parent: PddlTypeDto | None) -> None:
        """Set the parent."""
        if parent is not None:
            expect(parent, PddlTypeDto, "the parent of a PddlTypeDto")
        self.parent = parent

    def __repr__(self) -> str:
        texts: list[str] = []
        current: PddlTypeDto | None = self
        seen: set[int] = set()
        while type(current) is PddlTypeDto:
            if id(current) in seen:
                # Assigned parents may form a cycle.
                return "".join(texts) + "..." + ")" * len(texts)
            seen.add(id(current))
            texts.append(f"PddlTypeDto(name={current.name!r}, parent=")
            current = current.parent
        return f"{''.join(texts)}{current!r}{')' * len(texts)}"

    def __deepcopy__(self, memo: dict[int, Any]) -> PddlTypeDto:
        chain: list[PddlTypeDto] = []
        current: PddlTypeDto | None = self
        while current is not None and id(current) not in memo:
            chain.append(current)
            made = memo[id(current)] = copy.copy(current)
            made.__dict__.pop("parent")
            current = current.parent
        # Parents first and without recursion: hierarchies may be of any depth.
        for one in reversed(chain):
            made = memo[id(one)]
            for name, value in vars(one).items():
                setattr(made, name, copy.deepcopy(value, memo))
        found: PddlTypeDto = memo[id(self)]
        return found

    def _text(self) -> str:
        return self.name if self.parent is None else f"{self.name} - {self.parent.name}"


@dataclass(init=False, eq=False)
class PddlEitherTypeDto(PddlTypeDto):
    """The type `either` of a parameter or an object: one of several types (PDDL 1.2).

    It can stand for a type in a reference, but cannot be saved. Its name and its text are
    `(either robot human)`.

    Attributes:
        types: the types, in order.
    """

    types: list[PddlTypeDto]

    def __init__(self, types: Iterable[PddlTypeDto]) -> None:
        self.types = self._checked_types(types)
        super().__init__(either_text(type_.name for type_ in self.types))

    def get_types(self) -> list[PddlTypeDto]:
        """Return the types."""
        return self.types

    def set_types(self, types: Iterable[PddlTypeDto]) -> None:
        """Set the types."""
        self.types = self._checked_types(types)
        self.name = either_text(type_.name for type_ in self.types)

    @staticmethod
    def _checked_types(types: Iterable[PddlTypeDto]) -> list[PddlTypeDto]:
        if types is None:
            raise refusal("the types of a PddlEitherTypeDto", "a list", types)
        return items(types, PddlTypeDto, "the types of a PddlEitherTypeDto")


@dataclass(init=False, eq=False)
class PddlObjectDto(NamedDto):
    """An object of the world, or a parameter of an action.

    Equal by name. Its text is `rb1 - robot`.

    Attributes:
        type: the object's type.
        name: the object's name; a parameter's is written without its question mark.
        is_constant: whether the domain, not the problem, declares it; ignored in references.
    """

    type: PddlTypeDto
    name: str
    is_constant: bool

    _kind: ClassVar[str] = "object"

    def __init__(self, type: PddlTypeDto, name: str, *, is_constant: bool = False) -> None:
        self.set_type(type)
        self.name = self._checked_name(name)
        self.set_is_constant(is_constant)

    def get_type(self) -> PddlTypeDto:
        """Return the type."""
        return self.type

    def set_type(self, type: PddlTypeDto) -> None:
        """Set the type."""
        self.type = expect(type, PddlTypeDto, "the type of a PddlObjectDto")

    def get_is_constant(self) -> bool:
        """Return whether the domain, not the problem, declares it."""
        return self.is_constant

    def set_is_constant(self, is_constant: bool) -> None:
        """Set whether the domain, not the problem, declares it."""
        self.is_constant = flag(is_constant, "is_constant of a PddlObjectDto")

    def _text(self) -> str:
        return f"{self.name} - {self.type.name}"


def trusted_object(type: PddlTypeDto, name: str, is_constant: bool) -> PddlObjectDto:
    """Make an object from a checked definition, without checks."""
    dto = object.__new__(PddlObjectDto)
    dto.type = type
    dto.name = name
    dto.is_constant = is_constant
    return dto


class DeclarationDto(NamedDto):
    """A declaration with parameters."""

    types: list[PddlTypeDto]
    parameter_names: list[str] | None

    def get_types(self) -> list[PddlTypeDto]:
        """Return the types of the parameters."""
        return self.types

    def set_types(self, types: Iterable[PddlTypeDto] | None) -> None:
        """Set the types of the parameters."""
        self.types = items(types, PddlTypeDto, f"the types of a {type(self).__name__}")

    def get_parameter_names(self) -> list[str] | None:
        """Return the names of the parameters."""
        return self.parameter_names

    def set_parameter_names(self, parameter_names: Iterable[str] | None) -> None:
        """Set the names of the parameters."""
        owner = f"a {type(self).__name__}"
        self.parameter_names = checked_parameter_names(parameter_names, owner)


@dataclass(init=False, eq=False)
class PddlPredicateDto(DeclarationDto):
    """A predicate and its parameters.

    Equal by name. Its text is `(robot_at ?r0 - robot ?w1 - wp)`: the default name of a parameter is
    the first letter of its type with the position.

    Attributes:
        name: the predicate's name.
        types: the type of each parameter, in order; empty for a predicate without parameters.
        parameter_names: the name of each parameter, in order, without question marks; they may
            repeat. `None` means "not stated": stored names are kept.
    """

    name: str
    types: list[PddlTypeDto]
    parameter_names: list[str] | None

    _kind: ClassVar[str] = "predicate"

    def __init__(
        self,
        name: str,
        types: Iterable[PddlTypeDto] | None = None,
        *,
        parameter_names: Iterable[str] | None = None,
    ) -> None:
        self.name = self._checked_name(name)
        self.set_types(types)
        self.set_parameter_names(parameter_names)

    def _text(self) -> str:
        return declaration_text(self.name, [part.name for part in self.types], self.parameter_names)


class AppliedDto(Dto):
    """A predicate or a function applied to terms."""

    objects: list[PddlObjectDto]

    def get_objects(self) -> list[PddlObjectDto]:
        """Return the terms."""
        return self.objects

    def set_objects(self, objects: Iterable[PddlObjectDto] | None) -> None:
        """Set the terms."""
        self.objects = items(objects, PddlObjectDto, self._roles["objects"])

    def _folded_objects(self) -> tuple[str, ...]:
        return tuple(fold(object_.name) for object_ in self.objects)


@dataclass(init=False, eq=False)
class AtomDto(AppliedDto):
    """A predicate applied to terms.

    Attributes:
        predicate: the predicate.
        objects: the terms, in order.
    """

    predicate: PddlPredicateDto
    objects: list[PddlObjectDto]

    def __init__(
        self, predicate: PddlPredicateDto, objects: Iterable[PddlObjectDto] | None = None
    ) -> None:
        self.set_predicate(predicate)
        self.set_objects(objects)

    def get_predicate(self) -> PddlPredicateDto:
        """Return the predicate."""
        return self.predicate

    def set_predicate(self, predicate: PddlPredicateDto) -> None:
        """Set the predicate."""
        self.predicate = expect(predicate, PddlPredicateDto, self._roles["predicate"])


def atom_text(predicate: str, terms: Iterable[str]) -> str:
    """Write a predicate applied to terms."""
    return f"({' '.join([predicate, *terms])})"


@dataclass(init=False, eq=False)
class PddlPropositionDto(AtomDto):
    """A predicate applied to objects: a fact of the present state, or a goal.

    Equal by predicate, objects and `is_goal`: a fact and a goal of the same atom are two elements.
    Its text is `(robot_at rb1 wp1)`.

    Attributes:
        predicate: the predicate.
        objects: the arguments, in order.
        is_goal: whether it is a goal rather than a fact.
    """

    is_goal: bool

    def __init__(
        self,
        predicate: PddlPredicateDto,
        objects: Iterable[PddlObjectDto] | None = None,
        is_goal: bool = False,
    ) -> None:
        super().__init__(predicate, objects)
        self.set_is_goal(is_goal)

    def get_is_goal(self) -> bool:
        """Return whether it is a goal."""
        return self.is_goal

    def set_is_goal(self, is_goal: bool) -> None:
        """Set whether it is a goal."""
        self.is_goal = flag(is_goal, "is_goal of a PddlPropositionDto")

    def _identity(self) -> tuple[object, ...]:
        name = fold(self.predicate.name)
        return ("proposition", name, self._folded_objects(), bool(self.is_goal))

    def _text(self) -> str:
        return atom_text(self.predicate.name, [object_.name for object_ in self.objects])


def trusted_proposition(
    predicate: PddlPredicateDto, objects: list[PddlObjectDto], is_goal: bool
) -> PddlPropositionDto:
    """Make a proposition without checks: a store returns hundreds of thousands."""
    dto = object.__new__(PddlPropositionDto)
    dto.predicate = predicate
    dto.objects = objects
    dto.is_goal = is_goal
    return dto


@dataclass(init=False, eq=False)
class PddlFunctionDto(DeclarationDto):
    """A function, its parameters and the type of its values.

    Its values are numbers (numeric fluents, PDDL 2.1, section 3) or objects (object fluents, PDDL
    3.1). Equal by name. Its text is `(distance ?w0 - wp ?w1 - wp)`, or `(loc ?t0 - truck) - place`
    with objects as values.

    Attributes:
        name: the function's name.
        types: the type of each parameter, in order; empty for a function without parameters.
        value_types: the types of its values: empty for numbers, several for an `either`.
        parameter_names: the name of each parameter, in order, without question marks; they may
            repeat. `None` means "not stated": stored names are kept.
    """

    name: str
    types: list[PddlTypeDto]
    value_types: list[PddlTypeDto]
    parameter_names: list[str] | None

    _kind: ClassVar[str] = "function"

    def __init__(
        self,
        name: str,
        types: Iterable[PddlTypeDto] | None = None,
        *,
        value_types: Iterable[PddlTypeDto] | None = None,
        parameter_names: Iterable[str] | None = None,
    ) -> None:
        self.name = self._checked_name(name)
        self.set_types(types)
        self.set_value_types(value_types)
        self.set_parameter_names(parameter_names)

    def get_value_types(self) -> list[PddlTypeDto]:
        """Return the types of the values."""
        return self.value_types

    def set_value_types(self, value_types: Iterable[PddlTypeDto] | None) -> None:
        """Set the types of the values."""
        self.value_types = items(value_types, PddlTypeDto, "the value types of a PddlFunctionDto")

    def _text(self) -> str:
        return function_text(
            self.name,
            [part.name for part in self.types],
            [part.name for part in self.value_types],
            self.parameter_names,
        )


def function_text(
    name: str,
    type_names: Iterable[str],
    value_type_names: Sequence[str],
    parameter_names: Sequence[str] | None = None,
) -> str:
    """Write a function's declaration."""
    text = declaration_text(name, type_names, parameter_names)
    if not value_type_names:
        return text
    return f"{text} - {either_text(value_type_names)}"


Value = int | float | Decimal | PddlObjectDto


@dataclass(init=False, eq=False)
class PddlFunctionValueDto(AppliedDto):
    """A function applied to objects, with its value.

    Equal by function and objects, whatever the value. Its text is `(= (distance wp1 wp2) 10)`.

    Attributes:
        function: the function.
        objects: the arguments, in order.
        value: a number, or an object for a function whose values are objects.
    """

    function: PddlFunctionDto
    objects: list[PddlObjectDto]
    value: Value

    def __init__(
        self,
        function: PddlFunctionDto,
        objects: Iterable[PddlObjectDto] | None = None,
        value: Value = 0,
    ) -> None:
        self.set_function(function)
        self.set_objects(objects)
        self.set_value(value)

    def get_function(self) -> PddlFunctionDto:
        """Return the function."""
        return self.function

    def set_function(self, function: PddlFunctionDto) -> None:
        """Set the function."""
        self.function = expect(function, PddlFunctionDto, "the function of a PddlFunctionValueDto")

    def get_value(self) -> Value:
        """Return the value."""
        return self.value

    def set_value(self, value: Value) -> None:
        """Set the value."""
        if not isinstance(value, PddlObjectDto):
            check_number(value, "the value of a PddlFunctionValueDto")
        self.value = value

    def _identity(self) -> tuple[object, ...]:
        return ("function value", fold(self.function.name), self._folded_objects())

    def _text(self) -> str:
        fluent = atom_text(self.function.name, [object_.name for object_ in self.objects])
        value = self.value
        return value_text(
            fluent, value.name if isinstance(value, PddlObjectDto) else number_text(value)
        )


def value_text(fluent: str, value: str) -> str:
    """Write the value of a fluent."""
    return f"(= {fluent} {value})"


def trusted_value(
    function: PddlFunctionDto, objects: list[PddlObjectDto], value: Value
) -> PddlFunctionValueDto:
    """Make a value without checks: a store returns hundreds of thousands."""
    dto = object.__new__(PddlFunctionValueDto)
    dto.function = function
    dto.objects = objects
    dto.value = value
    return dto
