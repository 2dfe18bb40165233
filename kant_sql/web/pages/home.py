"""The home page: the knowledge bases of the store."""

from __future__ import annotations

from typing_extensions import TypedDict

from ...knowledge.canonical import time_text
from ...sql.catalog import standings
from ..registry import Pages
from ..stores import OpenStore

PAGES = Pages("knowledge bases")


class StandingDocument(TypedDict):
    """A knowledge base, its head, and who made it."""

    name: str
    revision: int
    committed_at: str
    actor: str | None
    reason: str | None


class HomeDocument(TypedDict):
    """The knowledge bases of a store."""

    knowledge_bases: list[StandingDocument]


@PAGES.page("/", "home.html")
def knowledge_bases(store: OpenStore) -> HomeDocument:
    """List the knowledge bases with their heads."""
    found = standings(store.url)
    return {
        "knowledge_bases": [
            {
                "name": one.name,
                "revision": one.revision,
                "committed_at": time_text(one.committed_at),
                "actor": one.actor,
                "reason": one.reason,
            }
            for one in found
        ]
    }
