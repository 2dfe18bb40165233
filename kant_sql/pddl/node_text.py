"""The text of a node, or why no text could carry it.

`str()` of a node is the same text. This is for documents that someone has made by hand: it refuses
what could not be read back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from ..dto.formula import (
    ARITHMETIC,
    ASSIGNMENTS,
    COMPARISONS,
    MODALS,
    TIMES,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Equal,
    Exists,
    Fluent,
    Forall,
    Imply,
    IsViolated,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TypedName,
    Variable,
    When,
    variables_text,
)
from ..dto.name import RESERVED, check_name, fold
from ..dto.node import children
from ..dto.number import decimal_text
from ..errors import InvalidKnowledgeError

PREFERENCE, DEFINE = "preference", "define"
# A parenthesis behind these is read as a formula or a fluent of theirs, and not as a term.
_OPERATORS = {DEFINE, PREFERENCE, *MODALS, *ASSIGNMENTS}
_TIME_WORDS = {tuple(time.split()) for time in TIMES}


def node_text(node: Node, explicit: bool = False) -> str:
    """Write a node.

    Args:
        node: a formula, an effect, an expression or a term.
        explicit: whether a variable's `- object` is written at the end of a list, too.

    Returns:
        The PDDL text, in one line.

    Raises:
        InvalidKnowledgeError: the text could not be read back.
    """
    texts: list[str] = []
    stack: list[Node | None] = [node]
    while stack:
        part = stack.pop()
        if part is None:
            texts.append(")")
        elif (leaf := _LEAVES.get(type(part))) is not None:
            texts.append(f" {leaf(part)}")
        else:
            texts.append(f" ({_head(part, explicit)}")
            stack.append(None)
            stack.extend(reversed(children(part)))
    return "".join(texts)[1:]


def _number(node: Number) -> str:
    return decimal_text(node.value)


def check_types(names: Iterable[TypedName]) -> None:
    """Refuse a typed list that could not be read back.

    Args:
        names: the list.

    Raises:
        InvalidKnowledgeError: a name has no type, or a type is called `either`.
    """
    for name in names:
        if not name.types:
            raise InvalidKnowledgeError(f"{name.name!r} has no type; give it 'object'")
        if not RESERVED["type"].isdisjoint(map(fold, name.types)):
            raise InvalidKnowledgeError(
                f"{name.name!r} is of a type called 'either', a reserved word; choose another name"
            )


def check_predicate(name: str) -> None:
    """Refuse a predicate's name that begins something else.

    Args:
        name: the name.

    Raises:
        InvalidNameError: the word is reserved.
    """
    if fold(name) in RESERVED["predicate"]:
        check_name("predicate", name)


def check_word(what: str, word: str, allowed: Iterable[str]) -> None:
    """Refuse an operator that is none.

    Args:
        what: what it should be.
        word: the operator.
        allowed: those that there are.

    Raises:
        InvalidKnowledgeError: it is not among them.
    """
    if word not in (choices := tuple(allowed)):
        raise InvalidKnowledgeError(f"{word!r} is no {what}; use one of {', '.join(choices)}")


def _atom(node: Atom) -> str:
    word = fold(node.predicate)
    check_predicate(node.predicate)
    match node.terms:
        case (Constant(name), Fluent()) if (word, fold(name)) in _TIME_WORDS:
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of the object '{name}' and a function's value is read as a"
                " time; rename the object"
            )
        case (Fluent(), *_) | (_, Fluent(), *_) if word == PREFERENCE or (
            word in _OPERATORS and isinstance(node.terms[0], Fluent)
        ):
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of a function's value is read as the operator; rename the"
                " predicate"
            )
    return node.predicate


def _fluent(node: Fluent) -> str:
    if node.terms and isinstance(node.terms[0], Fluent) and fold(node.function) == DEFINE:
        raise InvalidKnowledgeError(
            f"'{node.function}' of a function's value is read as a definition; rename the function"
        )
    return node.function


def _arithmetic(node: Arithmetic) -> str:
    check_word("arithmetic operator", node.operator, ARITHMETIC)
    if len(node.operands) < (1 if node.operator == "-" else 2):
        raise InvalidKnowledgeError(
            f"{node.operator!r} of {len(node.operands)} operands is no number; give it two"
        )
    return node.operator


def _comparison(node: Comparison) -> str:
    check_word("comparison", node.operator, COMPARISONS)
    return node.operator


def _assign(node: Assign) -> str:
    check_word("effect on a fluent", node.operator, ASSIGNMENTS)
    return node.operator


def _timed(node: Timed) -> str:
    check_word("time of a condition or an effect", node.time, TIMES)
    return node.time


def _quantifier(node: Forall | Exists, explicit: bool) -> str:
    word = "forall" if isinstance(node, Forall) else "exists"
    check_types(node.variables)
    return f"{word} ({variables_text(node.variables, explicit)})"


def _modal(node: Modal) -> str:
    check_word("modal operator", node.operator, MODALS)
    given = (len(node.numbers), len(node.formulas))
    if given != MODALS[node.operator]:
        numbers, formulas = MODALS[node.operator]
        raise InvalidKnowledgeError(
            f"{node.operator!r} takes {numbers} numbers and {formulas} formulas,"
            f" not {given[0]} and {given[1]}; give it these"
        )
    return node.operator


def _preference(node: Preference) -> str:
    return "preference" if node.name is None else f"preference {node.name}"


def _head(node: Node, explicit: bool) -> str:
    if isinstance(node, Forall | Exists):
        return _quantifier(node, explicit)
    head = _HEADS.get(type(node))
    if head is None:
        raise InvalidKnowledgeError(
            f"a {type(node).__name__} is no part of a formula; put it where the document has it"
        )
    return head(node)


_LEAVES: dict[type, Callable[[Any], str]] = {
    Variable: str,
    Constant: str,
    ContinuousTime: str,
    IsViolated: str,
    Number: _number,
}
_HEADS: dict[type, Callable[[Any], str]] = {
    Fluent: _fluent,
    Arithmetic: _arithmetic,
    Atom: _atom,
    Equal: lambda _: "=",
    Comparison: _comparison,
    Not: lambda _: "not",
    And: lambda _: "and",
    Or: lambda _: "or",
    Imply: lambda _: "imply",
    Timed: _timed,
    Preference: _preference,
    Modal: _modal,
    When: lambda _: "when",
    Assign: _assign,
}
