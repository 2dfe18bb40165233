"""What text could not carry is refused, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest

from kant_sql.dto.formulas import (
    MAX_NESTING,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    Derived,
    Fluent,
    Forall,
    Formula,
    Metric,
    Modal,
    Not,
    Number,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
    walk,
)
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Action, Domain, Function, Predicate, Problem

FREE = Atom("free")
BATTERY = Fluent("battery", (Variable("r"),))
GROWS = Assign("increase", BATTERY, Number(Decimal(1)))


def number(text: str) -> Number:
    return Number(Decimal(text))


def nested(levels: int) -> Formula:
    formula: Formula = FREE
    for _ in range(levels):
        formula = Not(formula)
    return formula


KNOWN = Domain("d", (":adl",), predicates=(Predicate("free"),), functions=(Function("f"),))


def deep_sum(levels: int) -> Formula:
    value: Arithmetic = Arithmetic("-", (Fluent("f"),))
    for _ in range(levels - 1):
        value = Arithmetic("-", (value,))
    return Comparison("<", value, number("1"))


def test_what_is_nested_deeply_is_written_and_read() -> None:
    deepest = nested(MAX_NESTING - 3)
    assert sum(1 for _ in walk(deepest)) == MAX_NESTING - 2
    for goal_ in (deepest, deep_sum(MAX_NESTING - 2)):
        problem = Problem("p", "d", goal=(goal_,))
        assert read_problem(write(problem), domain=KNOWN) == problem
    for action in (
        Action("action", "a", condition=(deepest,)),
        Action("action", "a", effect=(When(deepest, FREE),)),
        Action("durative-action", "a", condition=(Timed("at end", deepest),)),
    ):
        domain = replace(KNOWN, actions=(action,))
        assert read_domain(write(domain)) == domain


def goal(formula: Formula) -> Problem:
    return Problem("p", "d", goal=(formula,))


def effect(formula: Formula) -> Domain:
    return Domain("d", actions=(Action("action", "a", effect=(formula,)),))


BAD = [
    (goal(Timed("at noon", FREE)), r"in :goal: 'at noon' is not a time .* over all, at end"),
    (goal(Comparison("!=", number("1"), number("2"))), r"'!=' is not a comparison"),
    (goal(Comparison("<", Arithmetic("^", ()), number("2"))), r"'\^' is not an arithmetic op"),
    (goal(Comparison("<", Arithmetic("+", (number("1"),)), number("2"))), r"'\+' of 1 operands"),
    (goal(Modal("never", (), (FREE,))), r"'never' is not a modal operator"),
    (goal(Modal("within", (), (FREE,))), r"'within' takes 1 numbers and 1 formulas, not 0 and 1"),
    (goal(Atom("AND")), r"'AND' cannot name a predicate: the word is reserved"),
    (goal(Atom("at", (Constant("END"), Fluent("f")))), r"is read as a time"),
    (goal(Atom("Increase", (Fluent("f"),))), r"'Increase' of a function's value is read as the"),
    (goal(Atom("<=", (Constant("a"),))), r"'<=' cannot name a predicate"),
    (goal(Forall((TypedName("x", ()),), FREE)), r"'x' has no type"),
    (goal(Derived("p", (), FREE)), r"a Derived is not part of a formula"),  # type: ignore[arg-type]
    (effect(Assign("set", BATTERY, number("1"))), r"in action a: 'set' is not an effect on"),
    (Domain("d", types=(TypedName("t", ("Either",)),)), r"'t' is of a type called 'either'"),
    (Domain("d", predicates=(Predicate("exists"),)), r"'exists' cannot name a predicate"),
    (Domain("d", derived=(Derived("or", (), FREE),)), r"in :derived or: 'or' cannot name"),
    (Domain("d", functions=(Function("f", (), ("Number",)),)), r"a type called 'number'"),
    (Domain("d", actions=(Action("method", "a"),)), r"'method' is not a kind of action"),
    (Domain("d", actions=(Action("action", "a", duration=(FREE,)),)), r"only a durative action"),
    (Domain("d", requirements=("typing",)), r"'typing' is not a requirement; write it ':typing'"),
    (Problem("p", "d", facts=(Atom("=", ()),)), r"'=' cannot name a predicate"),
    (Problem("p", "d", facts=(Atom("q", (Variable("x"),)),)), r"\(q \?x\) is not ground"),
    (Problem("p", "d", timed=(TimedLiteral(number("1"), GROWS),)), r"'increase' is not a timed"),
    (Problem("p", "d", metric=Metric("optimize", number("1"))), r"'optimize' is not an optim"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "message"), BAD)
def test_what_could_not_be_read_back_is_refused(document: Domain | Problem, message: str) -> None:
    with pytest.raises(InvalidKnowledgeError, match=message):
        write(document)


def test_only_documents_are_written() -> None:
    with pytest.raises(InvalidKnowledgeError, match="a Domain or Problem, not Atom"):
        write(FREE)  # type: ignore[arg-type]
