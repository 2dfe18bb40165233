"""The hierarchy of types: which are below which."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

Types = tuple[str, ...]


class Fit(Enum):
    """Whether an argument of some types fits a parameter of some types."""

    YES = "yes"
    # The argument's type is above the parameter's: some of its objects fit.
    PERHAPS = "perhaps"
    NO = "no"


def is_below(parents: Mapping[str, Types], lower: Types, upper: Types) -> bool:
    """Tell whether one of some types is one of others, or below it.

    Args:
        parents: the types directly above each type.
        lower: the types to go up from.
        upper: the types to come to.

    Returns:
        Whether it is.
    """
    stack, seen = list(lower), set(lower)
    while stack:
        type_ = stack.pop()
        if type_ in upper:
            return True
        above = [parent for parent in parents.get(type_, ()) if parent not in seen]
        seen.update(above)
        stack += above
    return False


def find_cycle(parents: Mapping[str, Types]) -> str | None:
    """Find a type that is above itself.

    Args:
        parents: the types directly above each type.

    Returns:
        Such a type; None when there is none.
    """
    children: dict[str, list[str]] = {}
    waiting = {type_: sum(1 for one in above if one in parents) for type_, above in parents.items()}
    for type_, above in parents.items():
        for parent in above:
            children.setdefault(parent, []).append(type_)
    ready = [type_ for type_, count in waiting.items() if not count]
    while ready:
        type_ = ready.pop()
        del waiting[type_]
        for child in children.get(type_, ()):
            waiting[child] -= 1
            if not waiting[child]:
                ready.append(child)
    seen: set[str] = set()
    type_ = next(iter(waiting), "")
    while type_ not in seen and waiting:
        seen.add(type_)
        type_ = next(one for one in parents[type_] if one in waiting)
    return type_ or None
