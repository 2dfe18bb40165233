"""The boolean structure of formulas: conjunctions, disjunctions, and what is negated in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..dto import formulas as f
from ..dto.lexical import fold

# A formula, and whether it is negated.
Literal = tuple[f.Formula, bool]


def junction(part: f.Node, negated: bool) -> tuple[list[Literal], bool] | None:
    """Return the parts of a conjunction (True) or a disjunction, each with whether it is negated.

    A part that is no junction has none.
    """
    if isinstance(part, f.Not):
        return [(part.formula, not negated)], True
    if isinstance(part, f.And):
        return [(one, negated) for one in part.formulas], not negated
    if isinstance(part, f.Or):
        return [(one, negated) for one in part.formulas], negated
    if isinstance(part, f.Imply):
        return [(part.condition, not negated), (part.formula, negated)], negated
    return None


def positive(formulas: Iterable[f.Formula]) -> list[Literal]:
    """Return formulas as the parts of a search, not negated."""
    return [(formula, False) for formula in formulas]


def flatten(parts: Iterable[Literal], is_and: bool = True) -> list[Literal]:
    """Return the parts of nested conjunctions, or of disjunctions, in order."""
    found: list[Literal] = []
    stack = list(parts)[::-1]
    while stack:
        part, negated = stack.pop()
        inner = junction(part, negated)
        if inner is not None and (inner[1] == is_and or len(inner[0]) == 1):
            stack.extend(reversed(inner[0]))
        else:
            found.append((part, negated))
    return found


def alternatives(parts: Sequence[Literal]) -> list[list[Literal]]:
    """Return the conjunctions of a disjunction; one for anything else."""
    whole = flatten(parts)
    if len(whole) != 1 or junction(*whole[0]) is None:
        return [whole]
    return [flatten([one]) for one in flatten(whole, is_and=False)]


def merged(
    variables: Sequence[f.TypedName], parts: Sequence[Literal]
) -> tuple[list[f.TypedName], Sequence[Literal]]:
    """Merge quantifiers that directly contain one of the same kind."""
    found = list(variables)
    while True:
        whole = flatten(parts)
        if len(whole) != 1:
            return found, whole
        part, negated = whole[0]
        kind = f.Forall if negated else f.Exists
        if not isinstance(part, kind):
            return found, whole
        names = {fold(one.name) for one in found}
        if any(fold(one.name) in names for one in part.variables):
            return found, whole
        found += part.variables
        parts = [(part.formula, negated)]
