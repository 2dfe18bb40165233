"""Expression trees: nodes in preorder, which refer to elements by id."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

PREDICATE, FUNCTION, VARIABLE, NUMBER = "predicate", "function", "variable", "number"
TIME = "#t"
DERIVED, AT, IS_VIOLATED, PREFERENCE, WHEN = "derived", "at", "is-violated", "preference", "when"
AND, OR, NOT, IMPLY, FORALL, EXISTS = "and", "or", "not", "imply", "forall", "exists"
EQUAL = "="
OPTIMIZATIONS = ("minimize", "maximize")


class ParameterDefinition(NamedTuple):
    """A parameter: its name without question mark, and its types (several for `either`)."""

    name: str
    type_ids: tuple[int, ...]


class TreeTerm(NamedTuple):
    """A term of a node: a parameter, a constant, a variable or a function's value.

    Attributes:
        parameter: the position of the owner's parameter.
        quantifier: the position of the node that binds the variable.
        variable: the position of the variable there.
        child: the position of the function node.
    """

    parameter: int | None = None
    object_id: int | None = None
    quantifier: int | None = None
    variable: int | None = None
    child: int | None = None


class TreeNode(NamedTuple):
    """A row of an expression tree, without its owner.

    Attributes:
        position: its place in preorder, from 0.
        parent: the position of the node above; None for the root.
        operator: the operation on its children, or the kind of leaf.
        value: the text of a number, or the name of a variable or a preference.
    """

    position: int
    parent: int | None
    operator: str
    predicate_id: int | None = None
    function_id: int | None = None
    value: str | None = None
    terms: tuple[TreeTerm, ...] = ()
    variables: tuple[ParameterDefinition, ...] = ()


Tree = tuple[TreeNode, ...]


def children(tree: Tree) -> dict[int | None, list[TreeNode]]:
    """Return the child nodes of each node."""
    below: dict[int | None, list[TreeNode]] = {}
    for node in tree:
        below.setdefault(node.parent, []).append(node)
    return below


class Mentioned(NamedTuple):
    """The ids of definitions that an element may mention."""

    types: Collection[int] = ()
    objects: Collection[int] = ()
    predicates: Collection[int] = ()
    functions: Collection[int] = ()


def mentioned(trees: Iterable[Tree]) -> Mentioned:
    """Find the ids that trees mention."""
    nodes = [node for tree in trees for node in tree]
    return Mentioned(
        {id_ for node in nodes for variable in node.variables for id_ in variable.type_ids},
        {term.object_id for node in nodes for term in node.terms if term.object_id is not None},
        {node.predicate_id for node in nodes if node.predicate_id is not None},
        {node.function_id for node in nodes if node.function_id is not None},
    )


def mentions(trees: Iterable[Tree], scope: Mentioned) -> bool:
    """Return whether trees mention an element of a scope."""
    return any(
        id_ in wanted for own, wanted in zip(mentioned(trees), scope, strict=True) for id_ in own
    )
