"""Replacing variables of formulas by objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import TypeVar, cast

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError

N = TypeVar("N", bound=f.Node)

# The names of objects, by folded name of a variable.
Binding = Mapping[str, str]

_PARENT = object()


def bound(variables: Sequence[f.TypedName], names: Sequence[str]) -> dict[str, str]:
    """Bind variables to objects."""
    return {fold(one.name): name for one, name in zip(variables, names, strict=True)}


def is_continuous(node: f.Node) -> bool:
    """Return whether an effect changes a number while time passes."""
    return isinstance(node, f.Assign) and any(
        isinstance(part, f.ContinuousTime) for part in f.walk(node.value)
    )


def check_continuous(action: str, effect: f.Assign, is_conditional: bool) -> None:
    """Refuse a continuous effect that is not an unconditional increase or decrease."""
    if is_conditional or effect.operator not in ("increase", "decrease"):
        raise UnsupportedConstructError(
            f"the action {action} has the continuous effect {effect}, which cannot be executed; "
            "only (increase ...) and (decrease ...) without a condition can"
        )


def no_multiple(effect: f.Assign) -> UnsupportedConstructError:
    """Make the error for a continuous effect without a rate."""
    return UnsupportedConstructError(
        f"the continuous effect {effect} is not a multiple of #t; write it as (* #t rate)"
    )


def combinations(
    variables: Sequence[f.TypedName], ranges: Iterable[Sequence[str]], binding: Binding
) -> Iterator[dict[str, str]]:
    """Yield the extensions of a binding by all objects in the ranges of variables."""
    keys = [fold(one.name) for one in variables]
    for names in product(*ranges):
        yield {**binding, **dict(zip(keys, names, strict=True))}


def substitute(
    node: N, binding: Binding, make: type[f.Constant] | type[f.Variable] = f.Constant
) -> N:
    """Replace free variables by objects, or by other variables.

    Variables without an object, such as `?duration`, stay. Variables of a quantifier hide those of
    the same name outside.
    """
    if not binding:
        return node
    done: list[f.Node] = []
    stack: list[tuple[object, f.Node, Binding]] = [(None, node, binding)]
    while stack:
        mark, part, names = stack.pop()
        if mark is _PARENT:
            count = len(f.children(part))
            inner = done[len(done) - count :]
            del done[len(done) - count :]
            done.append(_rebuilt(part, inner))
        elif isinstance(part, f.Variable):
            name = names.get(fold(part.name))
            done.append(part if name is None else make(name))
        elif not f.children(part):
            done.append(part)
        else:
            hidden = {fold(one.name) for one in getattr(part, "variables", ())}
            if hidden:
                names = {key: name for key, name in names.items() if key not in hidden}
            stack.append((_PARENT, part, names))
            stack.extend((None, child, names) for child in reversed(f.children(part)))
    return cast(N, done[0])


def _rebuilt(node: f.Node, inner: list[f.Node]) -> f.Node:
    """Return a node with other children."""
    left = iter(inner)
    values: list[object] = []
    names: tuple[str, ...] = type(node).__slots__
    for name in names:
        value = getattr(node, name)
        if isinstance(value, f.Node):
            value = next(left)
        elif isinstance(value, tuple):
            value = tuple([next(left) if isinstance(one, f.Node) else one for one in value])
        values.append(value)
    kind = type(node)
    return kind(*values)


def ground_text(node: f.Node, binding: Binding) -> str:
    """Write a node with objects for its free variables."""
    return str(substitute(node, binding))
