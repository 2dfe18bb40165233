"""Where the versions of an element are, said so that one statement finds them by names alone."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Text, bindparam, cast, literal_column, select

from ..dto.name import is_word
from ..knowledge.loading import KB
from ..knowledge.sources import FACT, GOAL, PROPOSITION, SOURCES, VALUE
from ..tables import FunctionRow, ObjectRow, PredicateRow
from .elements import Applied, Named, Sought

# Each number of arguments is a statement of its own.
MOST_ARGUMENTS = 8


class Place(NamedTuple):
    """Where versions of an element may be.

    Attributes:
        source: one of `SOURCES`.
        arguments: how many objects a predicate or a function is applied to; None for a name.
        roles: of a proposition, whether it is a goal: True, False, or both.
    """

    source: str
    arguments: int | None = None
    roles: tuple[bool, ...] = ()


def places(wanted: list[Sought]) -> tuple[Place, ...] | None:
    """Tell where the versions of an element may be.

    Args:
        wanted: what is asked about.

    Returns:
        The places; none where nobody can have used these names; None where names alone do not tell.
    """
    match wanted:
        case [Named(kinds, name)]:
            return tuple(map(Place, kinds)) if is_word(name) else ()
        case [Applied(roles, name, arguments)] if len(arguments) <= MOST_ARGUMENTS:
            return _of_roles(roles, len(arguments)) if all(map(is_word, (name, *arguments))) else ()
    return None


@cache
def _of_roles(roles: frozenset[str], arguments: int) -> tuple[Place, ...]:
    goals = tuple(role == GOAL for role in (FACT, GOAL) if role in roles)
    of_propositions = [Place(PROPOSITION, arguments, goals)] if goals else []
    return (*of_propositions, *([Place(VALUE, arguments)] if VALUE in roles else []))


def each_alone(place: Place) -> list[Place]:
    """Split a place into those of which each has one identity at most.

    Args:
        place: the place.

    Returns:
        The places.
    """
    return [place._replace(roles=(role,)) for role in place.roles] or [place]


def parameters(wanted: list[Sought]) -> dict[str, str]:
    """Give the parameters that `identity_at` needs.

    Args:
        wanted: what is asked about: one that `places` tells of.

    Returns:
        The parameters.
    """
    match wanted:
        case [Named(_, name)]:
            return {"name": name}
        case [Applied(_, name, arguments)]:
            given = {f"argument{number}": argument for number, argument in enumerate(arguments)}
            return {"name": name, **given}
    return {}


def identity_at(place: Place) -> Select[Any]:
    """Give the ids of the identities whose versions are at a place.

    Args:
        place: the place.

    Returns:
        The query, which goes by a unique index.
    """
    identity = SOURCES[place.source].identity
    ids: Select[Any] = select(identity.id).where(identity.kb_id == KB)
    if place.arguments is None:
        return ids.where(identity.key == bindparam("name"))
    interned = identity.arguments == _interned(place.arguments)
    if place.source == VALUE:
        return ids.where(identity.function_id == _named(FunctionRow, "name"), interned)
    roles: list[Any] = [literal_column("TRUE" if is_goal else "FALSE") for is_goal in place.roles]
    of_role = identity.is_goal == roles[0] if len(roles) == 1 else identity.is_goal.in_(roles)
    return ids.where(of_role, identity.predicate_id == _named(PredicateRow, "name"), interned)


def _named(mapped: Any, parameter: str) -> ColumnElement[int]:
    return (
        select(mapped.id)
        .where(mapped.kb_id == KB, mapped.key == bindparam(parameter))
        .correlate(None)
        .scalar_subquery()
    )


def _interned(arguments: int) -> ColumnElement[str]:
    """Give what the ids of objects are interned by; NULL when one is not known."""
    text: Any = literal_column("''")
    for number in range(arguments):
        id_ = cast(_named(ObjectRow, f"argument{number}"), Text)
        text = text.concat(literal_column("' '")).concat(id_) if number else id_
    return text  # type: ignore[no-any-return]
