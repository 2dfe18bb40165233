"""What Python does with any object works for nodes as deep as formulas may be."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import pytest

from kant_sql.dto import formulas as f

P, Q, ONE = f.Atom("p"), f.Atom("q", (f.Constant("a"),)), f.Number(1)
VARIABLES = (f.TypedName("x", ("a", "b")),)
WRAP: dict[type, Callable[[Any], Any]] = {
    f.Not: f.Not,
    f.And: lambda node: f.And((P, node, Q)),
    f.Or: lambda node: f.Or((node,)),
    f.Imply: lambda node: f.Imply(node, Q),
    f.Forall: lambda node: f.Forall(VARIABLES, node),
    f.Exists: lambda node: f.Exists(VARIABLES, node),
    f.Count: lambda node: f.Count(VARIABLES, node),
    f.Timed: lambda node: f.Timed("at end", node),
    f.Preference: lambda node: f.Preference(None, node),
    f.Modal: lambda node: f.Modal("within", (ONE,), (node,)),
    f.When: lambda node: f.When(Q, node),
    f.Arithmetic: lambda node: f.Arithmetic("+", (node, ONE)),
    f.Fluent: lambda node: f.Fluent("f", (node, f.Constant("a"))),
}


# What may stand at the bottom, and another such node.
LEAVES: dict[type, tuple[f.Node, f.Node]] = {
    f.Arithmetic: (ONE, f.Number(2)),
    f.Fluent: (f.Constant("a"), f.Constant("b")),
}


def nested(kind: type, levels: int, leaf: int = 0) -> Any:
    node: Any = LEAVES.get(kind, (P, Q))[leaf]
    for _ in range(levels):
        node = WRAP[kind](node)
    return node


def test_all_nodes_that_may_contain_their_like_are_here() -> None:
    of_formulas = {
        kind.__name__
        for kind in f.FormulaNode.__subclasses__()
        if "Formula" in " ".join(map(str, kind.__annotations__.values()))
    }
    assert {each.__name__ for each in WRAP} == {"Fluent", "Arithmetic", *of_formulas}


@pytest.mark.parametrize("kind", WRAP, ids=lambda kind: kind.__name__)
def test_deep_nodes(kind: type) -> None:
    node, same, other = (
        nested(kind, f.MAX_NESTING),
        nested(kind, f.MAX_NESTING),
        nested(kind, f.MAX_NESTING, 1),
    )
    assert node == same
    assert hash(node) == hash(same)
    assert node != other
    assert node != nested(kind, f.MAX_NESTING - 1)
    assert len({node, same, other}) == 2
    assert str(node) == str(same) != str(other)
    assert str(node).count("(") >= f.MAX_NESTING
    assert repr(node) == repr(same) != repr(other)
    assert pickle.loads(pickle.dumps(node)) == node
    assert copy.copy(node) is copy.deepcopy(node) is node


@pytest.mark.parametrize("kind", WRAP, ids=lambda kind: kind.__name__)
def test_small_nodes_say_what_dataclasses_do(kind: type) -> None:
    node = nested(kind, 2)
    assert eval(repr(node), {**vars(f), "Decimal": Decimal}) == node
    assert pickle.loads(pickle.dumps(node)) == node
    assert node != P
    assert node.__eq__(P) is NotImplemented
    assert node == nested(kind, 2)
    names = type(node).__slots__
    assert repr(node) == f"{kind.__name__}({', '.join(f'{n}={getattr(node, n)!r}' for n in names)})"


def test_what_holds_deep_nodes() -> None:
    total = nested(f.Arithmetic, f.MAX_NESTING)
    for whole in (f.Metric("minimize", total), f.Comparison("<", total, ONE)):
        again = type(whole)(*(getattr(whole, name) for name in type(whole).__slots__))
        assert whole == again
        assert hash(whole) == hash(again)
        assert repr(whole) == repr(again)
        assert str(whole) == str(again)
        assert pickle.loads(pickle.dumps(whole)) == whole
        assert copy.deepcopy(whole) == whole
