"""Replacing variables of formulas by objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from ..dto import formulas as f
from ..dto.lexical import fold

N = TypeVar("N", bound=f.Node)

# The names of objects, by folded name of a variable.
Binding = Mapping[str, str]


def bound(variables: Sequence[f.TypedName], names: Sequence[str]) -> dict[str, str]:
    """Bind variables to objects."""
    return {fold(one.name): name for one, name in zip(variables, names, strict=True)}


def substitute(node: N, binding: Binding) -> N:
    """Replace free variables by objects; those without one, such as `?duration`, stay."""
    made: N = _replaced(node, binding) if binding else node
    return made


def _replaced(part: Any, names: Binding) -> Any:
    if isinstance(part, f.Variable):
        name = names.get(fold(part.name))
        return part if name is None else f.Constant(name)
    if isinstance(part, tuple):
        return tuple([_replaced(one, names) for one in part])
    if not isinstance(part, f.Node) or not f.children(part):
        return part
    # Variables of a quantifier hide those of the same name outside.
    hidden = {fold(one.name) for one in getattr(part, "variables", ())}
    inner = {key: name for key, name in names.items() if key not in hidden} if hidden else names
    kind = type(part)
    fields: tuple[str, ...] = kind.__slots__
    return kind(*[_replaced(getattr(part, field), inner) for field in fields])
