"""The home page: the knowledge bases of the store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple, TypeVar

from fastapi import Query

from ...errors import KantSqlError, QuestionCancelledError
from ...knowledge_base import state_of
from ...limits import limited
from ...reasoning.explain import is_goal_reached
from ...sql.inventory import Inventory
from ..registry import Pages
from ..stores import OpenStore
from ..verifying import VerificationState

T = TypeVar("T")

PAGES = Pages("knowledge bases")

# Knowledge bases whose goals are evaluated, if counting is not enough.
MOST_ASKED = 8
# The maximum seconds for each statement of that.
GOAL_SECONDS = 1.0

After = Annotated[str | None, Query(description="The last name of the page before.")]
Part = Annotated[str | None, Query(description="What the names contain.")]


@dataclass(frozen=True)
class ListedKnowledgeBase:
    """A knowledge base of the home page.

    `is_goal_reached` covers all goals; null: not evaluated. `verification` is this server's last
    result.
    """

    _json_ = "*inventory", "is_goal_reached", "verification"

    inventory: Inventory
    is_goal_reached: bool | None
    verification: VerificationState


class HomePage(NamedTuple):
    """Knowledge bases of a store; `next` is the parameter `after` of the next page."""

    knowledge_bases: list[ListedKnowledgeBase]
    part: str | None
    next: str | None


@PAGES.page("/", "home.html", rows=["knowledge_bases"])
def knowledge_bases(store: OpenStore, after: After = None, part: Part = None) -> HomePage:
    """List the knowledge bases with their heads, oldest first, 50 at a time."""
    found, has_more = store.read_catalog(lambda catalog: catalog.overview(after=after, part=part))
    asked = [one.name for one in found if one.reached is None and one.error is None][:MOST_ASKED]
    listed = [_listed(store, one, one.name in asked) for one in found]
    return HomePage(listed, part, found[-1].name if has_more else None)


def briefly(question: Callable[[], T]) -> T | None:
    """Run a question; None if it takes too long, or fails."""
    # Its own page shows the error; show the rest here.
    try:
        with limited(seconds=GOAL_SECONDS):
            return question()
    except QuestionCancelledError:
        raise
    except KantSqlError:
        return None


def _is_goal_reached(store: OpenStore, name: str) -> bool:
    with store.knowledge_base(name) as kb:
        return is_goal_reached(state_of(kb))


def _listed(store: OpenStore, one: Inventory, is_asked: bool) -> ListedKnowledgeBase:
    is_reached = None if one.reached is None else one.reached == one.goals
    if is_asked:
        is_reached = briefly(partial(_is_goal_reached, store, one.name))
    return ListedKnowledgeBase(one, is_reached, store.verifier.state(one.name))
