"""The node's own services and messages: revisions by number, queries, and actions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from ..history.revisions import LogEntry
from ..knowledge_base import KnowledgeBase
from .service import Service

# The most revisions and answers of one response.
MOST = 1000


def write_revision(entry: LogEntry, made: Any) -> Any:
    """Write a revision and its changes; `made` is the module `kant_sql_msgs.msg`."""
    revision = entry.revision
    message = made.Revision(number=revision.number, hash=revision.hash)
    message.committed_at.sec = int(revision.committed_at.timestamp())
    message.committed_at.nanosec = revision.committed_at.microsecond * 1000
    message.actor, message.reason = revision.actor or "", revision.reason or ""
    message.source = "" if revision.source is None else json.dumps(revision.source)
    message.changes = [
        made.Change(sign=one.sign, kind=one.kind, text=one.text) for one in entry.changes
    ]
    return message


def services(kb: KnowledgeBase, made: Any, kinds: Any) -> Iterator[Service]:
    """Yield `~/get_revisions`, `~/query` and `~/apply`; `kinds` is `kant_sql_msgs.srv`."""

    def get_revisions(request: Any, response: Any) -> None:
        response.head = kb.revision
        entries = kb.changes(request.after, limit=min(request.limit, MOST))
        response.revisions = [write_revision(one, made) for one in entries]

    def query(request: Any, response: Any) -> None:
        asked = kb.at(request.at) if request.at else kb
        answers = asked.query(request.condition, limit=min(request.limit, MOST))
        response.columns = list(answers.columns)
        response.answers = [made.Answer(objects=list(answer)) for answer in answers]
        response.holds = bool(response.answers)

    def apply(request: Any, response: Any) -> None:
        revision = kb.apply(request.action, reason=request.reason or None)
        response.revision = revision or kb.revision

    yield Service("~/get_revisions", kinds.GetRevisions, get_revisions)
    yield Service("~/query", kinds.Query, query)
    yield Service("~/apply", kinds.Apply, apply)
