"""Replaces variables of formulas by objects or other nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from ..dto import formulas as f
from ..dto.lexical import fold

N = TypeVar("N", bound=f.Node)

# The names of objects, by folded name of a variable.
Binding = Mapping[str, str]


def bound(variables: Sequence[f.TypedName], names: Sequence[str]) -> dict[str, str]:
    """Bind variables to objects."""
    return {fold(one.name): name for one, name in zip(variables, names, strict=True)}


def substitute(node: N, binding: Binding) -> N:
    """Replace free variables by objects; other variables, such as `?duration`, stay."""
    return replaced(node, {key: f.Constant(name) for key, name in binding.items()})


def replaced(node: N, values: Mapping[str, f.Node]) -> N:
    """Replace free variables by nodes, by their folded names."""
    if isinstance(node, f.Variable):
        return values.get(fold(node.name), node)  # type: ignore[return-value]
    if not values or isinstance(node, f.Constant | f.Number):
        return node
    # Variables of a quantifier hide those of the same name outside.
    if isinstance(node, f.Forall | f.Exists | f.Count | f.Derived):
        hidden = {fold(one.name) for one in node.variables}
        values = {key: one for key, one in values.items() if key not in hidden}
    return rebuilt(node, lambda child: replaced(child, values))


def rebuilt(node: N, change: Callable[[f.Node], f.Node]) -> N:
    """Rebuild a node with each child changed."""
    fields: list[object] = []
    names: tuple[str, ...] = type(node).__slots__
    for name in names:
        value = getattr(node, name)
        if isinstance(value, f.Node):
            fields.append(change(value))
        elif isinstance(value, tuple) and value and isinstance(value[0], f.Node):
            fields.append(tuple(map(change, value)))
        else:
            fields.append(value)
    return type(node)(*fields)
