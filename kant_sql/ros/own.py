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


def write_revision(entry: LogEntry, made: Any, time: Any) -> Any:
    """Write a revision and its changes.

    Args:
        entry: the revision.
        made: the module `kant_sql_msgs.msg`.
        time: `builtin_interfaces.msg.Time`.
    """
    revision = entry.revision
    seconds, micros = divmod(round(revision.committed_at.timestamp() * 1_000_000), 1_000_000)
    return made.Revision(
        number=revision.number,
        committed_at=time(sec=seconds, nanosec=micros * 1000),
        actor=revision.actor or "",
        reason=revision.reason or "",
        source="" if revision.source is None else json.dumps(revision.source),
        hash=revision.hash,
        changes=[made.Change(sign=one.sign, kind=one.kind, text=one.text) for one in entry.changes],
    )


class OwnServices:
    """Answers for `~/get_revisions`, `~/query` and `~/apply`."""

    def __init__(self, kb: KnowledgeBase, made: Any, time: Any) -> None:
        self._kb = kb
        self._made = made
        self._time = time

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `kant_sql_msgs.srv`."""
        yield Service("~/get_revisions", kinds.GetRevisions, self._revisions)
        yield Service("~/query", kinds.Query, self._query)
        yield Service("~/apply", kinds.Apply, self._apply)

    def _revisions(self, request: Any, response: Any) -> None:
        response.head = self._kb.revision
        entries = self._kb.changes(request.after, limit=min(request.limit, MOST))
        response.revisions = [write_revision(one, self._made, self._time) for one in entries]

    def _query(self, request: Any, response: Any) -> None:
        asked = self._kb.at(request.at) if request.at else self._kb
        answers = asked.query(request.condition, limit=min(request.limit, MOST))
        response.columns = list(answers.columns)
        response.answers = [self._made.Answer(objects=list(answer)) for answer in answers]
        response.holds = bool(response.answers)

    def _apply(self, request: Any, response: Any) -> None:
        made = self._kb.apply(request.action, reason=request.reason or None)
        response.revision = made or self._kb.revision
