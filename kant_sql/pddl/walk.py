"""Going through the nodes of a formula, without recursion: nesting is no limit here."""

from __future__ import annotations

from collections.abc import Iterator

from ..dto.formula import Node


def children(node: Node) -> tuple[Node, ...]:
    """Give the nodes directly within a node.

    Args:
        node: any node.

    Returns:
        Its formulas, effects, expressions, numbers and terms, in the order of the text.
    """
    found: list[Node] = []
    names: tuple[str, ...] = type(node).__slots__
    for name in names:
        value = getattr(node, name)
        if isinstance(value, Node):
            found.append(value)
        elif isinstance(value, tuple):
            found.extend(part for part in value if isinstance(part, Node))
    return tuple(found)


def walk(*nodes: Node) -> Iterator[Node]:
    """Go through nodes and all that is within them, in preorder.

    Args:
        nodes: where to begin, in order.

    Yields:
        Each node before what is within it, in the order of the text.
    """
    stack = list(reversed(nodes))
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(children(node)))


def depth(node: Node) -> int:
    """Tell how deeply nodes are nested.

    Args:
        node: any node.

    Returns:
        1 for a node with nothing within it.
    """
    deepest, level = 0, [node]
    while level:
        deepest += 1
        level = [child for parent in level for child in children(parent)]
    return deepest
