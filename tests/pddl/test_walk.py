"""Going through nodes: all of them, in the order of the text."""

from __future__ import annotations

from decimal import Decimal

from kant_sql.dto import formulas as f

X, A = f.Variable("x"), f.Constant("a")
P = f.Atom("p", (X, f.Fluent("f", (A,))))
FIVE = f.Number(Decimal(5))


def test_children_are_all_the_nodes_within_in_order() -> None:
    assert f.children(P) == P.terms
    assert f.children(f.And((P, f.Not(P)))) == (P, f.Not(P))
    assert f.children(f.Modal("within", (FIVE,), (P,))) == (FIVE, P)
    assert f.children(f.Forall((f.TypedName("x"),), P)) == (P,)
    assert f.children(f.Derived("p", (f.TypedName("x"),), P)) == (P,)
    assert f.children(f.TimedLiteral(FIVE, f.Not(P))) == (FIVE, f.Not(P))
    assign = f.Assign("assign", f.Fluent("f"), FIVE)
    assert f.children(assign) == (f.Fluent("f"), FIVE)
    for leaf in (X, A, FIVE, f.ContinuousTime(), f.Fluent("f"), f.And()):
        assert f.children(leaf) == ()


def test_walking_is_in_preorder() -> None:
    nodes: list[f.Node] = [f.And((f.Not(P), P)), f.Not(P), P, X, f.Fluent("f", (A,)), A]
    nodes += [P, X, f.Fluent("f", (A,)), A]
    assert list(f.walk(nodes[0])) == nodes
    assert list(f.walk(P, A)) == [*f.walk(P), A]
    assert list(f.walk()) == []
