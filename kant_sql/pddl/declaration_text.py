"""The text of declarations: typed lists, and what takes parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from ..dto.formula import TypedName, variables_text
from ..dto.name import ROOT_TYPE, fold
from ..errors import InvalidKnowledgeError
from .document import Function
from .node_text import check_types

WIDTH = 100
INDENT = 4
NUMBER = "number"


def typed_lines(names: Sequence[TypedName], explicit: bool) -> Iterator[str]:
    """Write a typed list of types, constants or objects: a line for each run of one type.

    Args:
        names: the list.
        explicit: whether `- object` is written at the end, too.

    Yields:
        The lines, as long as they may be.

    Raises:
        InvalidKnowledgeError: a type could not be read back.
    """
    check_types(names)
    tail = len(names)
    if not explicit:
        tail = _untyped_tail([name.types == (ROOT_TYPE,) for name in names])
    for _, group in groupby(names[:tail], lambda name: name.types):
        members = list(group)
        yield from _wrapped([name.name for name in members], f"- {members[0].type_text}")
    yield from _wrapped([name.name for name in names[tail:]])


def skeleton(name: str, parameters: Sequence[TypedName], explicit: bool) -> str:
    """Write a predicate's or a function's declaration.

    Args:
        name: its name.
        parameters: its parameters, in order.
        explicit: whether `- object` is written at the end, too.

    Returns:
        The text, for example `(at ?r - robot ?w - wp)`.

    Raises:
        InvalidKnowledgeError: a type could not be read back.
    """
    check_types(parameters)
    return f"({name} {variables_text(parameters, explicit)})" if parameters else f"({name})"


def function_lines(functions: Sequence[Function], explicit: bool) -> Iterator[str]:
    """Write the declarations of functions, one on each line.

    Args:
        functions: the functions.
        explicit: whether a parameter's `- object` is written at the end, too.

    Yields:
        The lines. `- number` is left out at the end of the list, where it is understood.

    Raises:
        InvalidKnowledgeError: a type could not be read back.
    """
    tail = _untyped_tail([not function.types for function in functions])
    for position, function in enumerate(functions):
        text = skeleton(function.name, function.parameters, explicit)
        value = TypedName(function.name, function.types or (NUMBER,))
        check_types([value])
        if NUMBER in map(fold, function.types):
            raise InvalidKnowledgeError(
                f"function {function.name!r} is of a type called 'number', which is read as a"
                " number; choose another name for the type"
            )
        yield text if position >= tail else f"{text} - {value.type_text}"


def _untyped_tail(untyped: Sequence[bool]) -> int:
    tail = len(untyped)
    while tail and untyped[tail - 1]:
        tail -= 1
    return tail


def _wrapped(words: Sequence[str], *last: str) -> Iterator[str]:
    line: list[str] = []
    width = INDENT
    for word in (*words, *last):
        if line and width + len(word) > WIDTH:
            yield " ".join(line)
            line, width = [], INDENT
        line.append(word)
        width += len(word) + 1
    if line:
        yield " ".join(line)
