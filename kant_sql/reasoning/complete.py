"""Completion of names, for editors and prompts."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from ..arguments import count_limit, expect
from ..dto.lexical import fold
from ..errors import InvalidArgumentError
from ..html import Listing
from ..knowledge.definitions import Definition, Definitions
from ..store.state import State

# The order of elements with similar names.
_KINDS = ("predicate", "function", "object", "action", "type")
DEFAULT_LIMIT = 20


class Completion(NamedTuple):
    """A matching name.

    Attributes:
        kind: `predicate`, `function`, `object`, `action` or `type`.
        name: the name.
        text: its definition as PDDL text.
    """

    kind: str
    name: str
    text: str


class _Named(NamedTuple):
    """A definition with its folded name as sort key."""

    folded: str
    order: int
    kind: str
    definition: Definition


def complete(state: State, beginning: str, *, limit: int = DEFAULT_LIMIT) -> list[Completion]:
    """Find the names that begin with some characters, for editors and prompts.

    Args:
        beginning: the first characters of a name, in any case; empty for all names.
        limit: the maximum number of names.

    Returns:
        The predicates, functions, objects, actions and types whose names begin like this, in this
        order and by name; then those whose names contain the characters.

    Raises:
        ArchivedError: a part of this state was moved to an archive.
        InvalidArgumentError: `beginning` is not text, or `limit` is not a number.

    Examples:
        >>> for one in kb.pddl.complete("rob"):
        ...     print(one.kind, one.text)
        predicate (robot_at ?r0 - robot ?w1 - wp)
        type robot
    """
    wanted = fold(expect(beginning, str, "the beginning of a name", InvalidArgumentError))
    most = count_limit(limit, "limit")

    def work(definitions: Definitions) -> list[Completion]:
        found = islice(_matches(definitions.derive(_names), wanted), most)
        return [Completion(one.kind, one.definition.name, one.definition.text) for one in found]

    return Listing(state.store.read_definitions(work, state.at), "name")


def _matches(names: list[_Named], wanted: str) -> Iterator[_Named]:
    first = last = bisect_left(names, wanted, key=lambda one: one.folded)
    while last < len(names) and names[last].folded.startswith(wanted):
        last += 1
    yield from sorted(names[first:last], key=lambda one: (one.order, one.folded))
    for one in (*names[:first], *names[last:]):
        if wanted in one.folded:
            yield one


def _names(definitions: Definitions) -> list[_Named]:
    """Return all names of a state, sorted."""
    names = (
        _Named(fold(one.name), order, kind, one)
        for order, kind in enumerate(_KINDS)
        for one in definitions.elements(kind)
    )
    return sorted(names, key=lambda one: one[:2])
