"""The page of a merge: what a branch would bring, and what both sides say differently."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, NamedTuple

from fastapi import Query

from ...errors import ConflictError, InvalidArgumentError
from ...factory import SqlDaoFactory
from ...history.merged import Merge
from ...knowledge_base import KnowledgeBase, state_of
from ..registry import Pages

PAGES = Pages("branches")

# How many changes and how many conflicts a page has.
MOST = 200

BranchName = Annotated[str, Query(description="The branch, a knowledge base of this store.")]


class MergePage(NamedTuple):
    """The changes that a merge of a branch would make; nothing is merged here.

    Attributes:
        merge: the first 200 changes and conflicts; null without a branch.
        changes: how many changes there are.
        conflicts: how many conflicts there are.
    """

    merge: Merge | None
    changes: int = 0
    conflicts: int = 0


@PAGES.page("/merge", "merge.html", is_form=True, rows=["merge.conflicts", "merge.changes"])
def merge(kb: KnowledgeBase, branch: BranchName = "") -> MergePage:
    """Show the changes that a merge of a branch would make, and the conflicts, with who and why."""
    if not branch:
        return MergePage(None)
    other = SqlDaoFactory.one_of_many(state_of(kb).store.backend, branch, None)
    try:
        found = kb.merge_preview(KnowledgeBase(other))
    except ConflictError as error:
        raise InvalidArgumentError(str(error)) from error
    shown = replace(found, changes=found.changes[:MOST], conflicts=found.conflicts[:MOST])
    return MergePage(shown, len(found.changes), len(found.conflicts))
