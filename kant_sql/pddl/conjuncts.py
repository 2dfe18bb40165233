"""Conjunctions at the top of a goal, a condition or an effect are lists of their conjuncts."""

from __future__ import annotations

from ..dto.formula import And, Formula


def flatten(formula: Formula) -> tuple[Formula, ...]:
    """Give the conjuncts of a formula, also those of conjunctions directly within.

    Args:
        formula: the formula.

    Returns:
        The conjuncts, in order.
    """
    if not isinstance(formula, And):
        return (formula,)
    if And not in map(type, formula.formulas):
        return formula.formulas
    found: list[Formula] = []
    stack: list[Formula] = [formula]
    while stack:
        part = stack.pop()
        if isinstance(part, And):
            stack.extend(reversed(part.formulas))
        else:
            found.append(part)
    return tuple(found)
