"""Typed parameters as PDDL text, as predicates and functions declare them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..arguments import items

_EITHER = "(either "


def either_text(type_names: Iterable[str]) -> str:
    """Write a type, or several of which one is meant.

    Args:
        type_names: the names of the types.

    Returns:
        The PDDL text, for example `robot`, or `(either robot human)`.
    """
    names = list(type_names)
    return names[0] if len(names) == 1 else f"{_EITHER}{' '.join(names)})"


def variable_name(type_name: str, position: int) -> str:
    """Name a parameter that was given no name.

    Args:
        type_name: the name of its type, or `(either a b)`.
        position: its position, from 0.

    Returns:
        The first letter of the type and the position, without a question mark.
    """
    return f"{type_name.removeprefix(_EITHER)[:1]}{position}"


def checked_parameter_names(names: Iterable[str] | None, owner: str) -> list[str] | None:
    """Check the names that a DTO gives to parameters.

    Args:
        names: the names, in order; None for "not said".
        owner: what has the parameters, for the message.

    Returns:
        The names, or None.

    Raises:
        InvalidKnowledgeError: they are no list of strings.
    """
    return None if names is None else items(names, str, f"the parameter names of {owner}")


def declaration_text(
    name: str, type_names: Iterable[str], parameter_names: Sequence[str] | None = None
) -> str:
    """Write the declaration of a predicate, or of a function without its type.

    Args:
        name: its name.
        type_names: the type of each parameter as text, in order.
        parameter_names: the name of each parameter, in order; what has none gets the first letter
            of its type and the position.

    Returns:
        The PDDL text, for example `(robot_at ?r0 - robot ?w1 - wp)`.
    """
    given = parameter_names or ()
    parts = [name]
    for position, type_name in enumerate(type_names):
        own = given[position] if position < len(given) else variable_name(type_name, position)
        parts.append(f"?{own} - {type_name}")
    return f"({' '.join(parts)})"
