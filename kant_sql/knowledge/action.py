"""What an action is, at one revision, and how its literals become expression trees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from .predicate import ParameterDefinition

CONDITION, EFFECT, DURATION = "condition", "effect", "duration"
AND, NOT, EQUAL = "and", "not", "="
PREDICATE, VARIABLE, NUMBER = "predicate", "variable", "number"
TIMES = ("at start", "over all", "at end")
DURATION_VARIABLE = "?duration"


class Term(NamedTuple):
    """A term of a literal: just one of the two.

    Attributes:
        parameter: the position of the action's parameter.
        object_id: the constant.
    """

    parameter: int | None
    object_id: int | None


class LiteralDefinition(NamedTuple):
    """A literal of a condition or an effect.

    Attributes:
        predicate_id: its predicate.
        terms: its terms, in order.
        time: when it holds; None in an action that is not durative.
        is_negative: whether it is negated.
    """

    predicate_id: int
    terms: tuple[Term, ...]
    time: str | None
    is_negative: bool


class ActionDefinition(NamedTuple):
    """An action.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        parameters: the parameters, in order.
        conditions: the literals that must hold, in order.
        effects: the literals that it brings about, in order.
        duration: the number's text; None for an action that is not durative.
        text: the canonical PDDL text.
    """

    id: int
    name: str
    parameters: tuple[ParameterDefinition, ...]
    conditions: tuple[LiteralDefinition, ...]
    effects: tuple[LiteralDefinition, ...]
    duration: str | None
    text: str


class Node(NamedTuple):
    """A row of an expression tree, without its owner.

    Attributes:
        position: its place in preorder, from 0.
        parent: the position of the node above; None for the root.
        operator: what it does to its children, or what kind of leaf it is.
        predicate_id: the predicate of a predicate node.
        value: the text of a variable or a number.
        terms: the terms of a predicate node, in order.
    """

    position: int
    parent: int | None
    operator: str
    predicate_id: int | None = None
    value: str | None = None
    terms: tuple[Term, ...] = ()


def literals_tree(literals: Iterable[LiteralDefinition]) -> list[Node]:
    """Write literals as the tree whose root is their conjunction.

    Args:
        literals: the literals, in order.

    Returns:
        The nodes in preorder.
    """
    nodes = [Node(0, None, AND)]
    for literal in literals:
        parent = 0
        for operator in (literal.time, NOT if literal.is_negative else None):
            if operator is not None:
                nodes.append(Node(len(nodes), parent, operator))
                parent = len(nodes) - 1
        nodes.append(Node(len(nodes), parent, PREDICATE, literal.predicate_id, terms=literal.terms))
    return nodes


def tree_literals(nodes: Sequence[Node]) -> tuple[LiteralDefinition, ...]:
    """Read literals back from the tree of their conjunction.

    Args:
        nodes: the nodes in preorder.

    Returns:
        The literals, in order.
    """
    literals = []
    for node in nodes:
        if node.operator == PREDICATE and node.predicate_id is not None:
            above = []
            parent = node.parent
            while parent:
                above.append(nodes[parent].operator)
                parent = nodes[parent].parent
            time = next((operator for operator in above if operator in TIMES), None)
            literals.append(LiteralDefinition(node.predicate_id, node.terms, time, NOT in above))
    return tuple(literals)


def duration_tree(duration: str) -> list[Node]:
    """Write a fixed duration as a tree (PDDL 2.1, section 5.1: `(= ?duration 10)`).

    Args:
        duration: the number's text.

    Returns:
        The nodes in preorder.
    """
    return [
        Node(0, None, EQUAL),
        Node(1, 0, VARIABLE, value=DURATION_VARIABLE),
        Node(2, 0, NUMBER, value=duration),
    ]


def tree_duration(nodes: Sequence[Node]) -> str | None:
    """Read a fixed duration back.

    Args:
        nodes: the nodes in preorder; none for an action that is not durative.

    Returns:
        The number's text, or None.
    """
    return next((node.value for node in nodes if node.operator == NUMBER), None)
