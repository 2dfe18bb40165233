"""What an element is that someone asks about: a DTO, a formula, PDDL text, or a name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from ..arguments import expect, expect_list, shown
from ..dto import (
    PddlActionDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.dto import Dto, NamedDto
from ..dto.formula import Node
from ..dto.name import RESERVED, fold, is_word
from ..errors import InvalidKnowledgeError
from ..knowledge.sources import FACT, GOAL, VALUE
from ..pddl.tokens import tokenize

NAMED_KINDS = ("type", "object", "predicate", "function", "action", "document")
_CLASSES: dict[type[Dto], str] = {
    PddlTypeDto: "type",
    PddlObjectDto: "object",
    PddlPredicateDto: "predicate",
    PddlFunctionDto: "function",
    PddlActionDto: "action",
}
_DECIMAL = re.compile(r"-?\d+\.\d+")
# How the text of a definition begins whose name comes next, and what it defines.
_DEFINITIONS = {
    ":constants": "object",
    ":action": "action",
    ":durative-action": "action",
    ":process": "action",
    ":event": "action",
}
ACCEPTED = (
    "give a DTO of a type, object, predicate, function, action, proposition or function value, a "
    "formula, PDDL text such as (robot_at rb1 wp1), or a name"
)


class Named(NamedTuple):
    """The definitions of a name.

    Attributes:
        kinds: of which kinds.
        name: the name, folded.
    """

    kinds: tuple[str, ...]
    name: str


class Applied(NamedTuple):
    """A predicate or a function, applied to objects.

    Attributes:
        roles: `fact`, `goal`, `value`: as which of them.
        name: the name of predicate or function, folded.
        arguments: the names of the objects, folded.
    """

    roles: frozenset[str]
    name: str
    arguments: tuple[str, ...]


class Written(NamedTuple):
    """A formula that stands on its own, in whatever section.

    Attributes:
        words: its text as `comparable` gives it.
    """

    words: str


Sought = Named | Applied | Written


def comparable(text: str) -> str:
    """Give the form of a formula's text under which it is compared.

    Args:
        text: the text.

    Returns:
        Its words, folded, and separated by single blanks.
    """
    return " ".join(map(_comparable_word, tokenize(fold(text))))


def _comparable_word(word: str) -> str:
    """Write a number in one way: 7.50 is 7.5."""
    return word.rstrip("0").rstrip(".") if _DECIMAL.fullmatch(word) else word


def sought(element: object) -> list[Sought]:
    """Tell what someone asks about.

    Args:
        element: a DTO, a formula, PDDL text, or a name.

    Returns:
        What may be meant by it.

    Raises:
        InvalidKnowledgeError: it is none of these.
    """
    if isinstance(element, Dto):
        return [_of_dto(element)]
    if isinstance(element, Node):
        return list(_of_text(str(element)))
    if isinstance(element, str):
        return list(_of_text(element))
    raise _refusal(element)


def _refusal(element: object) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(f"{shown(element)} is no element of a knowledge base; {ACCEPTED}")


def _of_dto(dto: Dto) -> Sought:
    if isinstance(dto, PddlPropositionDto):
        expect(dto.predicate, PddlPredicateDto, "the predicate of a proposition")
        role = GOAL if dto.is_goal else FACT
        return _applied((role,), dto.predicate.name, _names(dto.objects, "a proposition"))
    if isinstance(dto, PddlFunctionValueDto):
        expect(dto.function, PddlFunctionDto, "the function of a function value")
        return _applied((VALUE,), dto.function.name, _names(dto.objects, "a function value"))
    kinds = [kind for class_, kind in _CLASSES.items() if isinstance(dto, class_)]
    if kinds and isinstance(dto, NamedDto):
        return Named((kinds[0],), fold(dto.name))
    raise _refusal(dto)


def _names(objects: Any, of: str) -> list[str]:
    role = f"the list of objects of {of}"
    return [object_.name for object_ in expect_list(objects, PddlObjectDto, role)]


def _applied(roles: Iterable[str], name: str, arguments: Iterable[str]) -> Applied:
    return Applied(frozenset(roles), fold(name), tuple(map(fold, arguments)))


def _of_text(text: str) -> Iterator[Sought]:
    words = tokenize(fold(text))
    if words[:1] != ["("]:
        yield _of_declaration(words, text)
        return
    end = _end(words)
    head, tail = words[1:2], words[end:]
    if head in ([], ["("], [")"]) or tail[:1] not in ([], ["-"]):
        raise _refusal(text)
    if tail:
        # A function's text may end with the type of its values.
        yield Named(("function",), head[0])
    else:
        yield from _of_list(head[0], words)


def _of_list(head: str, words: list[str]) -> Iterator[Sought]:
    if head == "and":
        for conjunct in _parts(words[2:-1]):
            yield from _of_text(conjunct)
    elif head in _DEFINITIONS or head == "define":
        kind = _DEFINITIONS.get(head, "document")
        yield Named((kind,), next((word for word in words[2:] if word not in "()"), ""))
    elif len(words) > 3 and words[2][0] == "?" and is_word(head):
        yield Named(("predicate", "function"), head)
    else:
        yield from _of_formula(words)


def _of_declaration(words: list[str], text: str) -> Named:
    """Read a name, or the text of a type or an object: `wp1 - wp`."""
    if len(words) > 2 and words[1] == "-":
        return Named(("type", "object"), words[0])
    if len(words) != 1 or not is_word(words[0]):
        raise _refusal(text)
    return Named(NAMED_KINDS, words[0])


def _of_formula(words: list[str]) -> Iterator[Sought]:
    inner = words[1:-1]
    is_flat = "(" not in inner and all(map(is_word, inner))
    if is_flat and inner[0] not in RESERVED["predicate"]:
        yield _applied((FACT, GOAL, VALUE), inner[0], inner[1:])
    if not is_flat or inner[0] in RESERVED["predicate"]:
        yield Written(comparable(" ".join(words)))
    # `(= (fuel t1) 7)`: what the fluent is, and perhaps a goal.
    if inner[:2] == ["=", "("] and inner.index(")") == len(inner) - 2:
        fluent = inner[2:-2]
        if fluent and "(" not in fluent and all(map(is_word, fluent)):
            yield _applied((VALUE,), fluent[0], fluent[1:])


def _end(words: list[str]) -> int:
    """Give the position behind the list that words begin with; 0 when it does not end."""
    depth = 0
    for position, word in enumerate(words, start=1):
        depth += (word == "(") - (word == ")")
        if depth == 0:
            return position
    return 0


def _parts(words: list[str]) -> Iterator[str]:
    """Split words into lists."""
    while words:
        end = _end(words) or len(words)
        yield " ".join(words[:end])
        words = words[end:]
