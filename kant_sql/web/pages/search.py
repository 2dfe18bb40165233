"""The page of a search: what a few characters may mean."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query
from typing_extensions import TypedDict

from ...dto.lexical import fold
from ...errors import InvalidArgumentError
from ...history.element_pages import SearchMatch, read_matches
from ...knowledge_base import KnowledgeBase
from ...moment_text import parse_moment
from ..registry import Pages

PAGES = Pages("search")

Sought = Annotated[
    str,
    Query(
        description="Part of a name or of a fact, a revision's number, or a time.",
        max_length=10_000,
    ),
]


class MatchDocument(TypedDict):
    """Something whose name or text contains what is looked for."""

    kind: str
    text: str


class SearchDocument(TypedDict):
    """What was found; `revision` and `moment` if the text is a revision's number or a time."""

    q: str
    revision: int | None
    moment: str | None
    matches: list[MatchDocument]


@PAGES.page("/search", "search.html")
def search(kb: KnowledgeBase, q: Sought = "") -> SearchDocument:
    """Find objects, definitions, facts and values by a part of their names, or a revision."""
    text = q.strip()
    moment = None
    if text:
        try:
            moment = parse_moment(text)
        except InvalidArgumentError:
            moment = None
    is_revision = isinstance(moment, int) and 0 < moment <= kb.revision
    matches = read_matches(kb._reader(), text) if text else []
    return {
        "q": q,
        "revision": moment if is_revision and isinstance(moment, int) else None,
        "moment": text if moment is not None and not isinstance(moment, int) else None,
        "matches": [
            {"kind": one.kind, "text": one.text}
            for one in sorted(matches, key=lambda one: _rank(one, fold(text)))
        ],
    }


def _rank(match: SearchMatch, text: str) -> tuple[bool, bool, int]:
    """Return what sorts the most probable match first."""
    folded = fold(match.text)
    return folded != text, not folded.startswith(text), len(folded)
