"""The page of a search: what a few characters may mean."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import Query

from ...errors import InvalidArgumentError
from ...history.search import SearchMatch, read_matches
from ...knowledge_base import KnowledgeBase, state_of
from ...moment_text import parse_moment
from ..registry import Pages

PAGES = Pages("search")

# How many matches a page has.
MATCHES = 100

Sought = Annotated[
    str,
    Query(
        description="Part of a name or of a fact, a revision's number, or a time.",
        max_length=10_000,
    ),
]


class SearchPage(NamedTuple):
    """What was found; `revision` and `moment` if the text is a revision's number or a time.

    `matches` begins with what has this very name, then come names that begin so, then facts of the
    object of this name, then what contains the text. `is_cut`: more than these match.
    """

    q: str
    revision: int | None
    moment: str | None
    matches: list[SearchMatch]
    is_cut: bool


@PAGES.page("/search", "search.html", rows=["matches"])
def search(kb: KnowledgeBase, q: Sought = "") -> SearchPage:
    """Find objects, definitions, facts, values, actors or a revision by a part of a name."""
    text = q.strip()
    moment = None
    if text:
        try:
            moment = parse_moment(text)
        except InvalidArgumentError:
            moment = None
    is_revision = isinstance(moment, int) and 0 < moment <= kb.revision
    matches = read_matches(state_of(kb), text, MATCHES + 1) if text else []
    return SearchPage(
        q,
        moment if is_revision and isinstance(moment, int) else None,
        text if moment is not None and not isinstance(moment, int) else None,
        matches[:MATCHES],
        len(matches) > MATCHES,
    )
