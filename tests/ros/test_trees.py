"""The trees of PlanSys2's messages say what the formulas say, in both directions."""

from __future__ import annotations

import re
from functools import reduce
from typing import Any

import pytest
from hypothesis import given

from kant_sql.dto.formulas import (
    ARITHMETIC,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    Variable,
    When,
    walk,
)
from kant_sql.dto.lexical import fold
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import Domain
from kant_sql.ros.trees import Messages, read_tree, write_tree
from tests.ros import messages
from tests.support.generators.documents import domains
from tests.support.profile import PROFILE, hunting

MADE = Messages(messages.Node, messages.Param, {"robot_at": ["robot", "wp"]}, {"wp": ["dock"]})


def parsed(text: str) -> Any:
    """Split PDDL text into nested lists of words."""
    stack: list[list[Any]] = [[]]
    for token in re.findall(r"[()]|[^\s()]+", text):
        if token == "(":
            stack.append([])
        elif token == ")":
            last = stack.pop()
            stack[-1].append(last)
        else:
            stack[-1].append(token)
    return stack[0][0]


def normal(part: Any, names: dict[str, str]) -> Any:
    """Say a formula by what a tree can hold, with its variables as a tree names them."""
    if isinstance(part, str):
        is_number = re.fullmatch(r"-?[0-9.]+", part)
        return str(Number(float(part))) if is_number else names.get(fold(part), part)
    if not part:
        return part
    head, rest = part[0], part[1:]
    if head == "imply":
        return normal(["or", ["not", rest[0]], rest[1]], names)
    if head == "forall":
        return normal(["not", ["exists", rest[0], ["not", rest[1]]]], names)
    if head == "exists":
        words = [word for word in rest[0] if word[0] == "?"]
        names = {**names, **{fold(word): f"?{len(names) + at}" for at, word in enumerate(words)}}
        return [head, [names.get(fold(word), word) for word in rest[0]], normal(rest[1], names)]
    if head in ARITHMETIC and len(rest) != 2:
        first, *others = [normal(each, names) for each in (rest if rest[1:] else ["0", *rest])]
        return reduce(lambda left, right: [head, left, right], others, first)
    return [normal(each, names) if at else each for at, each in enumerate(part)]


def formulas_of(domain: Domain) -> list[Formula]:
    """The conditions and effects of a domain, without the times of durative actions."""
    found: list[Formula] = [each.formula for each in domain.derived]
    for action in domain.actions:
        parts = (*action.condition, *action.effect)
        timed = [each.formula for each in walk(*parts) if isinstance(each, Timed)]
        found += timed or parts
    return found


def is_held(part: Node) -> bool:
    """Whether PlanSys2's messages have a form for a formula, as their interface file says."""
    if isinstance(part, Preference | Modal | When | Timed):
        return False
    if isinstance(part, Forall | Exists) and any(len(each.types) > 1 for each in part.variables):
        return False
    if isinstance(part, Atom | Fluent) and any(isinstance(each, Fluent) for each in part.terms):
        return False
    allowed = (And, Or, Not, Exists, Forall, Imply, Atom, Fluent, Number, Variable, Constant)
    return isinstance(part, (*allowed, Comparison, Equal, Arithmetic, Assign))


@hunting(PROFILE.texts)
@given(domains())
def test_what_a_tree_can_hold_is_read_as_it_was_written(domain: Domain) -> None:
    for formula in formulas_of(domain):
        if all(is_held(part) for part in walk(formula)):
            nodes = write_tree(formula, MADE)
            assert parsed(str(read_tree(nodes))) == normal(parsed(str(formula)), {})
            assert [node.node_id for node in nodes] == list(range(len(nodes)))
        else:
            with pytest.raises(InvalidKnowledgeError, match="no form in PlanSys2"):
                write_tree(formula, MADE)
