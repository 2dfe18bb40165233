"""Terms and numbers: the leaves of formulas, and what has a type."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal

from ..arguments import expect, expect_tuple, items
from .name import ROOT_TYPE
from .node import Branch, Node
from .number import check_number
from .parameters import either_text


@dataclass(frozen=True, slots=True)
class TypedName:
    """A name with its type, as lists of parameters, objects and types have it.

    Attributes:
        name: the name; a variable's without its question mark.
        types: the names of its types: one, or several for `either`.
    """

    name: str
    types: tuple[str, ...] = (ROOT_TYPE,)

    def __post_init__(self) -> None:
        expect(self.name, str, "the name of a TypedName")
        types = expect_tuple(self.types, str, "the types of a TypedName")
        if types is not self.types:
            object.__setattr__(self, "types", types)

    @property
    def type_text(self) -> str:
        """The type as PDDL text: `robot`, or `(either robot human)`."""
        return either_text(self.types)


@dataclass(frozen=True, slots=True)
class Variable(Node):
    """A variable: a parameter, or what a quantifier binds. `?duration` is one as well.

    Attributes:
        name: its name, without the question mark.
    """

    name: str

    def __post_init__(self) -> None:
        expect(self.name, str, "the name of a Variable")

    def __str__(self) -> str:
        return f"?{self.name}"


@dataclass(frozen=True, slots=True)
class Constant(Node):
    """An object, by its name.

    Attributes:
        name: its name.
    """

    name: str

    def __post_init__(self) -> None:
        expect(self.name, str, "the name of a Constant")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fluent(Branch):
    """A function applied to terms: a number, or an object (PDDL 3.1), that changes over time.

    Attributes:
        function: the function's name.
        terms: the terms, in order.
    """

    function: str
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        expect(self.function, str, "the function of a Fluent")
        self._keep("terms", TERMS, "the terms of a Fluent")

    def _head(self) -> str:
        return self.function


@dataclass(frozen=True, slots=True, init=False)
class Number(Node):
    """A number, exactly.

    Attributes:
        value: the number, finite and of at most `MAX_DIGITS` digits; an `int`, or a `float` by
            the shortest digits that denote it, is taken too.
    """

    value: Decimal

    def __init__(self, value: Decimal | int | float) -> None:
        object.__setattr__(self, "value", check_number(value, "the value of a Number"))

    def __str__(self) -> str:
        return format(self.value, "f")


@dataclass(frozen=True, slots=True)
class ContinuousTime(Node):
    """The time that has passed, `#t`, in a continuous effect (PDDL 2.1, section 5.3)."""

    def __str__(self) -> str:
        return "#t"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Arithmetic(Branch):
    """An operation on numbers.

    Attributes:
        operator: `+`, `-`, `*` or `/`; `-` of one operand negates it.
        operands: the operands, in order.
    """

    operator: str
    operands: tuple[Expression, ...]

    def __post_init__(self) -> None:
        expect(self.operator, str, "the operator of an Arithmetic")
        self._keep("operands", EXPRESSIONS, "the operands of an Arithmetic")

    def _head(self) -> str:
        return self.operator


@dataclass(frozen=True, slots=True)
class IsViolated(Node):
    """How often a preference is violated (PDDL 3.0, section 3), in a metric.

    Attributes:
        preference: the preference's name.
    """

    preference: str

    def __post_init__(self) -> None:
        expect(self.preference, str, "the preference of an IsViolated")

    def __str__(self) -> str:
        return list_text("is-violated", self.preference)


Term = Variable | Constant | Fluent
Expression = Number | Fluent | Variable | Arithmetic | ContinuousTime | IsViolated
# `isinstance` is faster on tuples than on unions.
TERMS = (Variable, Constant, Fluent)
EXPRESSIONS = (Number, Fluent, Variable, Arithmetic, ContinuousTime, IsViolated)


def variables_text(variables: Iterable[TypedName], explicit: bool = False) -> str:
    """Write typed variables.

    Args:
        variables: the variables, in order.
        explicit: whether `- object` is written at the end, too.

    Returns:
        The PDDL text, for example `?r - robot ?w - (either wp door)`.
    """
    given = items(variables, TypedName, "the variables")
    return typed_text([TypedName(f"?{part.name}", part.types) for part in given], explicit)


def typed_text(names: Iterable[TypedName], explicit: bool = False) -> str:
    """Write a typed list: an untyped tail stays untyped, for it is of `object` anyway.

    Args:
        names: the names, in order.
        explicit: whether `- object` is written at the end, too.

    Returns:
        The PDDL text, for example `rb1 rb2 - robot wp1 - wp`.
    """
    given = items(names, TypedName, "the names")
    tail = len(given)
    while not explicit and tail and given[tail - 1].types == (ROOT_TYPE,):
        tail -= 1
    parts = []
    for position, item in enumerate(given):
        parts.append(item.name)
        last = position + 1 == tail or (
            position + 1 < tail and given[position + 1].types != item.types
        )
        if position < tail and last:
            parts.append(f"- {item.type_text}")
    return " ".join(parts)


def list_text(head: str, *parts: object) -> str:
    """Write a list.

    Args:
        head: its first word.
        *parts: what follows, each as its text.

    Returns:
        The PDDL text.
    """
    return f"({' '.join([head, *map(str, parts)])})"
