"""The page of a merge: the changes of a branch, and the conflicts."""

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

# Changes, and conflicts, on a page.
MOST = 200

BranchName = Annotated[str, Query(description="The branch, a knowledge base of this store.")]


class MergePage(NamedTuple):
    """The changes that a merge of a branch would make; nothing is merged here.

    Attributes:
        merge: the first 200 changes and conflicts; null without a branch.
        changes: the number of changes.
        conflicts: the number of conflicts.
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
