"""The trees of PlanSys2's messages say what the formulas say, in both directions."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
from hypothesis import given

from kant_sql.dto.formulas import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TypedName,
    Variable,
    When,
    walk,
)
from kant_sql.dto.lexical import fold
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import Domain
from kant_sql.ros.trees import Messages, read_tree, write_tree
from tests.ros import messages
from tests.support.generators.documents import domains

MADE = Messages(messages.Node, messages.Param, {"robot_at": ["robot", "wp"]}, {"wp": ["dock"]})
R, P = Variable("r"), Variable("p")
AT = Atom("robot_at", (R, P))
LOW = Comparison("<", Fluent("battery", (R,)), Number(20))


def normal(part: Node, names: dict[str, str], count: int) -> Node:
    """Say a formula by what a tree can hold, with its variables as a tree names them."""
    if isinstance(part, Imply):
        return normal(Or((Not(part.condition), part.formula)), names, count)
    if isinstance(part, Forall):
        return normal(Not(Exists(part.variables, Not(part.formula))), names, count)
    if isinstance(part, Variable):
        return Variable(names.get(fold(part.name), part.name))
    if isinstance(part, Arithmetic):
        operands = [normal(each, names, count) for each in part.operands]
        nested = (
            operands[0] if len(operands) > 1 else Arithmetic(part.operator, (Number(0), *operands))
        )
        for each in operands[1:]:
            nested = Arithmetic(part.operator, (nested, each))
        return nested
    if isinstance(part, Number):
        return Number(float(part.value))
    if isinstance(part, Exists):
        numbers = {fold(each.name): str(count + at) for at, each in enumerate(part.variables)}
        variables = tuple(
            TypedName(
                numbers[fold(each.name)],
                ("object",) if fold(each.types[0]) == "object" else each.types,
            )
            for each in part.variables
        )
        names = {**names, **numbers}
        return Exists(variables, normal(part.formula, names, len(names)))
    changed = {}
    for each in fields(part):
        value = getattr(part, each.name)
        if isinstance(value, Node):
            changed[each.name] = normal(value, names, count)
        elif isinstance(value, tuple):
            changed[each.name] = tuple(
                normal(one, names, count) if isinstance(one, Node) else one for one in value
            )
    return replace(part, **changed)


def formulas_of(domain: Domain) -> list[Formula]:
    """The conditions and effects of a domain, without the times of durative actions."""
    found: list[Formula] = [each.formula for each in domain.derived]
    for action in domain.actions:
        parts = (*action.condition, *action.effect)
        timed = [each.formula for each in walk(*parts) if isinstance(each, Timed)]
        found += timed or parts
    return found


def is_held(part: Node) -> bool:
    """Whether PlanSys2's messages have a form for a formula, as their interface file says."""
    if isinstance(part, Preference | Modal | When | Timed):
        return False
    if isinstance(part, Forall | Exists) and any(len(each.types) > 1 for each in part.variables):
        return False
    if isinstance(part, Atom | Fluent) and any(isinstance(each, Fluent) for each in part.terms):
        return False
    allowed = (And, Or, Not, Exists, Forall, Imply, Atom, Fluent, Number, Variable, Constant)
    return isinstance(part, (*allowed, Comparison, Equal, Arithmetic, Assign))


@given(domains())
def test_what_a_tree_can_hold_is_read_as_it_was_written(domain: Domain) -> None:
    for formula in formulas_of(domain):
        if all(is_held(part) for part in walk(formula)):
            nodes = write_tree(formula, MADE)
            assert read_tree(nodes) == normal(formula, {}, 0)
            assert [node.node_id for node in nodes] == list(range(len(nodes)))
        else:
            with pytest.raises(InvalidKnowledgeError, match="no form in PlanSys2"):
                write_tree(formula, MADE)
