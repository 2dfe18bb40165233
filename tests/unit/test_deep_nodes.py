"""What Python does with any object works for nodes as deep as formulas may be."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest

from kant_sql.dto.formulas import (
    MAX_NESTING,
    And,
    Arithmetic,
    Atom,
    Branch,
    Comparison,
    Constant,
    Exists,
    Fluent,
    Forall,
    Imply,
    Metric,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TypedName,
    When,
)

P, Q, ONE = Atom("p"), Atom("q", (Constant("a"),)), Number(1)
VARIABLES = (TypedName("x", ("a", "b")),)
WRAP: dict[type, Callable[[Any], Any]] = {
    Not: Not,
    And: lambda node: And((P, node, Q)),
    Or: lambda node: Or((node,)),
    Imply: lambda node: Imply(node, Q),
    Forall: lambda node: Forall(VARIABLES, node),
    Exists: lambda node: Exists(VARIABLES, node),
    Timed: lambda node: Timed("at end", node),
    Preference: lambda node: Preference(None, node),
    Modal: lambda node: Modal("within", (ONE,), (node,)),
    When: lambda node: When(Q, node),
    Arithmetic: lambda node: Arithmetic("+", (node, ONE)),
    Fluent: lambda node: Fluent("f", (node, Constant("a"))),
}


# What may stand at the bottom, and another such node.
LEAVES: dict[type, tuple[Node, Node]] = {
    Arithmetic: (ONE, Number(2)),
    Fluent: (Constant("a"), Constant("b")),
}


def nested(kind: type, levels: int, leaf: int = 0) -> Any:
    node: Any = LEAVES.get(kind, (P, Q))[leaf]
    for _ in range(levels):
        node = WRAP[kind](node)
    return node


def test_all_nodes_that_may_contain_their_like_are_here() -> None:
    names = {each.__name__ for each in Branch.__subclasses__()}
    assert names == {each.__name__ for each in WRAP}


@pytest.mark.parametrize("kind", WRAP, ids=lambda kind: kind.__name__)
def test_deep_nodes(kind: type) -> None:
    node, same, other = (
        nested(kind, MAX_NESTING),
        nested(kind, MAX_NESTING),
        nested(kind, MAX_NESTING, 1),
    )
    assert node == same
    assert hash(node) == hash(same)
    assert node != other
    assert node != nested(kind, MAX_NESTING - 1)
    assert len({node, same, other}) == 2
    assert str(node) == str(same) != str(other)
    assert str(node).count("(") >= MAX_NESTING
    assert repr(node) == repr(same) != repr(other)
    assert pickle.loads(pickle.dumps(node)) == node
    assert copy.copy(node) is copy.deepcopy(node) is node


@pytest.mark.parametrize("kind", WRAP, ids=lambda kind: kind.__name__)
def test_small_nodes_say_what_dataclasses_do(kind: type) -> None:
    node = nested(kind, 2)
    assert eval(repr(node), {**globals(), "Decimal": __import__("decimal").Decimal}) == node
    assert pickle.loads(pickle.dumps(node)) == node
    assert node != P
    assert node.__eq__(P) is NotImplemented
    assert node == nested(kind, 2)
    names = type(node).__slots__
    assert repr(node) == f"{kind.__name__}({', '.join(f'{n}={getattr(node, n)!r}' for n in names)})"


def test_what_holds_deep_nodes() -> None:
    total = nested(Arithmetic, MAX_NESTING)
    for whole in (Metric("minimize", total), Comparison("<", total, ONE)):
        again = type(whole)(*(getattr(whole, name) for name in type(whole).__slots__))
        assert whole == again
        assert hash(whole) == hash(again)
        assert repr(whole) == repr(again)
        assert str(whole) == str(again)
        assert pickle.loads(pickle.dumps(whole)) == whole
        assert copy.deepcopy(whole) == whole
