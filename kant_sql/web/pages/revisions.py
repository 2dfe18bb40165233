"""The page of a revision: who wrote, when, why, and what changed."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query
from typing_extensions import TypedDict

from ...json_documents import LogEntryDocument, entry_document
from ...knowledge_base import KnowledgeBase
from ..registry import Pages

PAGES = Pages("history")

RevisionNumber = Annotated[int, Query(ge=1, description="The revision's number.")]


class RevisionPage(TypedDict):
    """A revision with its changes."""

    revision: LogEntryDocument
    head: int


@PAGES.page("/revision", "revision.html")
def revision(kb: KnowledgeBase, number: RevisionNumber) -> RevisionPage:
    """Show a revision: who wrote, when, why, and what changed."""
    (entry,) = kb.log(since=number, until=number)
    return {"revision": entry_document(entry), "head": kb.revision}
