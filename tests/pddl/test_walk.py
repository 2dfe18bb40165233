"""Going through nodes: all of them, in the order of the text."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql.dto.formulas import (
    MAX_NESTING,
    And,
    Assign,
    Atom,
    Constant,
    ContinuousTime,
    Derived,
    Fluent,
    Forall,
    Formula,
    Modal,
    Node,
    Not,
    Number,
    TimedLiteral,
    TypedName,
    Variable,
    check_nesting,
    children,
    walk,
)
from kant_sql.errors import InvalidKnowledgeError

X, A = Variable("x"), Constant("a")
P = Atom("p", (X, Fluent("f", (A,))))
FIVE = Number(Decimal(5))


def test_children_are_all_the_nodes_within_in_order() -> None:
    assert children(P) == P.terms
    assert children(And((P, Not(P)))) == (P, Not(P))
    assert children(Modal("within", (FIVE,), (P,))) == (FIVE, P)
    assert children(Forall((TypedName("x"),), P)) == (P,)
    assert children(Derived("p", (TypedName("x"),), P)) == (P,)
    assert children(TimedLiteral(FIVE, Not(P))) == (FIVE, Not(P))
    assign = Assign("assign", Fluent("f"), FIVE)
    assert children(assign) == (Fluent("f"), FIVE)
    for leaf in (X, A, FIVE, ContinuousTime(), Fluent("f"), And()):
        assert children(leaf) == ()


def test_walking_is_in_preorder() -> None:
    nodes: list[Node] = [And((Not(P), P)), Not(P), P, X, Fluent("f", (A,)), A]
    nodes += [P, X, Fluent("f", (A,)), A]
    assert list(walk(nodes[0])) == nodes
    assert list(walk(P, A)) == [*walk(P), A]
    assert list(walk()) == []


def test_nesting_counts_formulas_and_functions_but_no_names() -> None:
    nested: Formula = P
    for _ in range(MAX_NESTING - 2):
        nested = Not(nested)
    check_nesting(nested, P)
    check_nesting(Derived("p", (TypedName("x"),), nested))
    with pytest.raises(InvalidKnowledgeError, match="nested 51 levels deep, expected at most 50"):
        check_nesting(P, And((P, nested)))
