"""What all nodes of formulas have in common, however deeply they are nested.

Formulas that programs write are nested thousands of levels deep: a sum of all preferences, for
example. So no method of a node uses the interpreter's stack for its levels; memory is the limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self

from .. import arguments
from ..arguments import expect_tuple


class Node:
    """A node of a formula, an effect or an expression.

    Whoever makes one is held to the types of its attributes, else gets an `InvalidKnowledgeError`.
    A list is kept as a tuple. Nodes are immutable, so a copy of one is the node itself.
    """

    __slots__ = ()

    def _keep(self, field: str, wanted: type | tuple[type, ...], role: str) -> None:
        """Check a field that is a tuple, and make one of a list."""
        value = getattr(self, field)
        checked: tuple[object, ...] = expect_tuple(value, wanted, role)
        if checked is not value:
            object.__setattr__(self, field, checked)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class FormulaNode(Node):
    """A node that is a formula or an effect by itself, and can stand in another one."""

    __slots__ = ()


class Branch(Node):
    """A node that may contain nodes of its own class, at any depth.

    A subclass is a dataclass whose comparison and texts come from here. All other nodes contain
    nodes, but never one of their own class, so that the methods of a dataclass do for them.
    """

    __slots__ = ()

    def _head(self) -> str:
        """Give the text between the parenthesis and the first node within."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other) or not isinstance(other, Branch):
            return NotImplemented
        return self is other or _records(self) == _records(other)

    def __hash__(self) -> int:
        return hash(_records(self))

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (_records(self),)

    def __str__(self) -> str:
        texts: list[str] = []
        stack: list[Node | None] = [self]
        while stack:
            part = stack.pop()
            if part is None:
                texts.append(")")
            elif isinstance(part, Branch):
                texts.append(f" ({part._head()}")
                stack.append(None)
                stack.extend(reversed(children(part)))
            else:
                texts.append(f" {part}")
        return "".join(texts)[1:]

    def __repr__(self) -> str:
        texts: list[str] = []
        stack: list[Branch | str] = [self]
        while stack:
            part = stack.pop()
            if isinstance(part, Branch):
                stack.extend(reversed([*_repr_parts(part)]))
            else:
                texts.append(part)
        return "".join(texts)


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
    """Count the levels of nested nodes.

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


def shown(node: object) -> str:
    """Give the text of a node for a message, not too long.

    Args:
        node: the node, or what was given in place of one.

    Returns:
        Its text, or the beginning of it.
    """
    return f"{node!s:.80}" if isinstance(node, Node) else arguments.shown(node)


def _records(node: Branch) -> tuple[object, ...]:
    """Give all that a node says as one flat tuple, in preorder.

    A branch is a tuple: its class, and each of its fields; in place of a node within it an
    ellipsis, and in place of a tuple of nodes their number. Other nodes are there as they are.
    """
    found: list[object] = []
    stack: list[Any] = [node]
    while stack:
        part = stack.pop()
        if not isinstance(part, Branch):
            found.append(part)
            continue
        record: list[object] = [type(part)]
        within: list[Any] = []
        names: tuple[str, ...] = type(part).__slots__
        for name in names:
            value = getattr(part, name)
            if isinstance(value, Node):
                record.append(...)
                within.append(value)
            elif _is_of_nodes(value):
                record.append(len(value))
                within += value
            else:
                record.append(value)
        found.append(tuple(record))
        within.reverse()
        stack += within
    return tuple(found)


def _is_of_nodes(value: object) -> bool:
    return type(value) is tuple and bool(value) and isinstance(value[0], Node)


def _rebuilt(records: tuple[Any, ...]) -> Node:
    """Make a node of its records: what is within a node comes behind it."""
    stack: list[Any] = []
    for record in reversed(records):
        if not isinstance(record, tuple):
            stack.append(record)
            continue
        kind, *fields = record
        values: list[object] = []
        for field in fields:
            if field is ...:
                values.append(stack.pop())
            elif isinstance(field, int):
                values.append(tuple([stack.pop() for _ in range(field)]))
            else:
                values.append(field)
        stack.append(kind(*values))
    node: Node = stack.pop()
    return node


def _repr_parts(node: Branch) -> Iterator[Branch | str]:
    """Give the pieces of the text that a dataclass has."""
    names: tuple[str, ...] = type(node).__slots__
    opening = f"{type(node).__qualname__}("
    for name in names:
        value = getattr(node, name)
        yield f"{opening}{name}="
        opening = ", "
        if _is_of_nodes(value):
            for number, one in enumerate(value):
                yield ", " if number else "("
                yield one if isinstance(one, Branch) else repr(one)
            yield ",)" if len(value) == 1 else ")"
        else:
            yield value if isinstance(value, Branch) else repr(value)
    yield ")"
