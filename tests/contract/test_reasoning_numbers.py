"""Comparisons of numbers are exact, in each state and over the past, on every backend.

The judge calculates with fractions. KANT_SQL_TEST_EXAMPLES=500 hunts for longer.
"""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import (
    KnowledgeBase,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlTypeDto,
    Plan,
)
from kant_sql.dto.formulas import Arithmetic, Comparison, Fluent, Number
from tests.support.evaluator import Evaluator, State, Theory
from tests.support.profile import hunting

DOMAIN = """(define (domain numbers) (:requirements :numeric-fluents)
  (:functions (f0) (f1) (f2) (f3) (f4))
  {action})"""
OPERATORS = ("<", "<=", "=", ">=", ">")
# Neighbours that one double stands for, numbers beyond doubles, and such as no double has.
NUMBERS = (
    *("0", "0.1", "0.2", "0.3", "0.30", "-0.1", "1", "2", "3", "7", "-2.5", "100.05", "49"),
    *("9007199254740992", "9007199254740993", "9007199254740993.0", "0.1000000000000000000001"),
    *("-9007199254740993", "-9007199254740993.5", "0.99999999999999999999", "1e-330", "-1e-330"),
    *("1e200", "1e-200", "1e320", "1.1e320"),
)
Expression = Number | Fluent | Arithmetic


def expression(random: Random, depth: int) -> Expression:
    if not depth or random.random() < 0.3:
        if random.random() < 0.6:
            return Fluent(f"f{random.randrange(5)}")
        return Number(Decimal(random.choice(NUMBERS)))
    operator = random.choice("+-*/")
    count = random.choice((2, 2, 3)) if operator in "+*" else random.choice((1, 2))
    count = 2 if operator == "/" else count
    return Arithmetic(operator, tuple(expression(random, depth - 1) for _ in range(count)))


def comparison(random: Random) -> Comparison:
    left = expression(random, random.choice((0, 1, 2, 3)))
    right = expression(random, random.choice((0, 1, 2)))
    if random.random() < 0.3:
        # The same by another way, so that the sides are equal or nearly so.
        right = Arithmetic("/", (Arithmetic("*", (left, Number(3))), Number(3)))
    return Comparison(random.choice(OPERATORS), left, right)


@pytest.mark.more
def test_comparisons_are_exact(fresh_kb: KnowledgeBase) -> None:
    @hunting(25)
    @given(st.integers(0, 2**32 - 1))
    def same(seed: int) -> None:
        judge_comparisons(fresh_kb, seed)

    same()


def test_a_number_may_be_the_id_of_an_object(fresh_kb: KnowledgeBase) -> None:
    function = PddlFunctionDto("level", [PddlTypeDto("robot")])
    level = PddlFunctionValueDto(function, [PddlObjectDto(PddlTypeDto("robot"), "rb1")], 5)
    fresh_kb.function_values.save(level)
    found = [fresh_kb.holds(f"(>= (level rb1) {number})") for number in range(10)]
    assert found == [number <= 5 for number in range(10)]


def judge_comparisons(fresh_kb: KnowledgeBase, seed: int) -> None:
    random = Random(seed)
    asked = [comparison(random) for _ in range(12)]
    values = {f"f{n}": random.choice(NUMBERS) for n in range(5) if random.random() < 0.95}
    action = f"(:action act :parameters () :precondition {asked[0]} :effect ())"
    fresh_kb.load_domain(DOMAIN.format(action=action), mode="replace")
    init = " ".join(f"(= ({name}) {Decimal(value):f})" for name, value in values.items())
    fresh_kb.load_problem(
        f"(define (problem p) (:domain numbers) (:init {init}) (:goal (and)))", mode="replace"
    )
    state = State({}, frozenset(), {(name,): Fraction(value) for name, value in values.items()})
    judge = Evaluator(Theory({}), state)
    then = fresh_kb.at(fresh_kb.revision)
    for condition in asked:
        text = str(condition)
        wanted = judge.holds(condition, {})
        assert fresh_kb.holds(text) is wanted, f"{text} in the database, {values}"
        assert then.holds(text) is wanted, f"{text} in the past, {values}"
        assert bool(len(fresh_kb.when(text, since=fresh_kb.revision))) is wanted, text
        assert bool(fresh_kb.unsatisfied(text)) is not wanted, text
    assert (not fresh_kb.why_not("(act)")) is judge.holds(asked[0], {})
    assert fresh_kb.validate(Plan.read("(act)")).valid is judge.holds(asked[0], {})
