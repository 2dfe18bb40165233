"""The home page: the knowledge bases of the store."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query
from typing_extensions import TypedDict

from ...errors import KantSqlError, QuestionCancelledError
from ...json_documents import InventoryDocument, inventory_document
from ...limits import limited
from ...sql.inventory import Inventory
from ..registry import Pages
from ..stores import OpenStore
from ..verifying import VerifyDocument

PAGES = Pages("knowledge bases")

# Whether all goals are reached is asked of so many knowledge bases, where counting does not tell.
MOST_ASKED = 8
# Seconds that the database may take for each statement of that.
GOAL_SECONDS = 1.0

After = Annotated[str | None, Query(description="The last name of the page before.")]
Part = Annotated[str | None, Query(description="What the names contain.")]


class OverviewDocument(InventoryDocument):
    """A knowledge base of the home page.

    `is_goal_reached` is about all goals; null: not asked. `verification` is what this server has
    verified.
    """

    is_goal_reached: bool | None
    verification: VerifyDocument


class HomeDocument(TypedDict):
    """Knowledge bases of a store; `next` is the parameter `after` of the next page."""

    knowledge_bases: list[OverviewDocument]
    part: str | None
    next: str | None


@PAGES.page("/", "home.html", rows=["knowledge_bases"])
def knowledge_bases(store: OpenStore, after: After = None, part: Part = None) -> HomeDocument:
    """List the knowledge bases with their heads, oldest first, 50 at a time."""
    found, has_more = store.read_catalog(lambda catalog: catalog.overview(after=after, part=part))
    asked = [one.name for one in found if one.reached is None and one.error is None][:MOST_ASKED]
    return {
        "knowledge_bases": [_document(store, one, one.name in asked) for one in found],
        "part": part,
        "next": found[-1].name if has_more else None,
    }


def _is_goal_reached(store: OpenStore, name: str) -> bool | None:
    """Ask a knowledge base; None when it takes too long, or cannot tell."""
    try:
        with limited(seconds=GOAL_SECONDS), store.knowledge_base(name) as kb:
            return kb.is_goal_reached()
    except QuestionCancelledError:
        raise
    except KantSqlError:
        # The page of the goals says what is wrong; the other knowledge bases are listed all the
        # same.
        return None


def _document(store: OpenStore, one: Inventory, is_asked: bool) -> OverviewDocument:
    is_reached = None if one.reached is None else one.reached == one.goals
    if is_asked:
        is_reached = _is_goal_reached(store, one.name)
    return {
        **inventory_document(one),
        "is_goal_reached": is_reached,
        "verification": store.verifier.state(one.name),
    }
