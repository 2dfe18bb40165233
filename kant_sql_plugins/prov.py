"""Acts and their causes as W3C PROV (Moreau and Missier, PROV-DM, 2013), in PROV-JSON.

Executions and revisions without one are activities; versions of facts and values are entities;
actors are agents. An activity used the versions on which its conditions depend, and generated and
invalidated those that its revisions began and ended.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import kant_sql
from kant_sql.acts import Execution
from kant_sql.dao.interfaces import Progress
from kant_sql.errors import InvalidArgumentError, needing
from kant_sql.export.files import Exported, encoded, folder_name, new_export, refuse_valid_clock
from kant_sql.history.revisions import LogEntry
from kant_sql.knowledge.sayings import COMMITTED
from kant_sql.knowledge_base import KnowledgeBase, state_of
from kant_sql.moment_text import When
from kant_sql.reasoning.because import literals_used
from kant_sql.sql.executions import EXECUTION, PLAN_STEP, read_outcome
from kant_sql.sql.rows import FACT, VALUE

if TYPE_CHECKING:
    from prov.model import ProvDocument

FORMAT = "prov"
# The number of executions whose conditions are evaluated together.
PAGE = 200
_FLUENT = re.compile(r"\(= (\(.*?\)) .*\)")


def export_provenance(
    url: str,
    *,
    to: str | PathLike[str],
    knowledge_base: str | None = None,
    names: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    since: When | None = None,
    until: When | None = None,
    replace: bool = False,
    progress: Progress | None = None,
    clock: str = COMMITTED,
) -> Exported:
    """Write a document of PROV-JSON, built in memory, for each knowledge base.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        knowledge_base: the knowledge base; None for all of the store.
        names: must be None: provenance is whole.
        elements: must be None.
        since: only revisions from this one, or from this aware time on.
        until: only revisions up to this one, or to this time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the number of finished revisions, and their total.
        clock: must be `committed`: an act used what was known when it was done, not what was
            stated about that time later.

    Returns:
        The written files; the rows of a file are its revisions.

    Raises:
        InvalidArgumentError: the folder has other files, names or elements are given, the clock is
            `valid`, or the range ends before it begins.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        ExtraMissingError: prov is not installed; it comes with the extra `prov`.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    if names is not None or elements is not None:
        raise InvalidArgumentError("provenance is whole; leave names and elements out")
    # In PROV, an activity generates while it lasts: a late report did not make a fact true.
    refuse_valid_clock(clock, "acts used what was known when they were done, so provenance is")
    with needing("this needs prov, which is not installed; run: pip install 'kant-sql[prov]'"):
        from prov.model import ProvDocument
    with new_export(url, FORMAT, to, knowledge_base, since, until, replace, progress) as export:
        for state, (low, high) in export.each():
            path = f"{folder_name(state.name)}/provenance.json"
            with (
                kant_sql.connect(url, knowledge_base=state.name, read_only=True) as kb,
                export.folder.new_file(path, state, "provenance") as made,
            ):
                document: Any = ProvDocument()
                if low <= high:
                    made.rows = _Provenance(document, kb.at(high), state.name).add(low, high)
                made.file.write(document.serialize(format="json").encode())
    return export.exported


class _Provenance:
    """Adds the revisions of a knowledge base to a document."""

    def __init__(self, document: ProvDocument, kb: KnowledgeBase, name: str) -> None:
        self._document, self._kb = document, kb
        document.add_namespace("kb", f"urn:kant-sql:{encoded(name)}:")
        self._entities: set[str] = set()
        # The present version of a fact or a fluent, by its text without a value.
        self._held: dict[str, str] = {}
        self._made: defaultdict[str, list[str]] = defaultdict(list)

    def add(self, low: int, high: int) -> int:
        """Add the revisions of a range; return how many there are."""
        count = 0
        for entry in self._kb.changes(low - 1, limit=high - low + 1):
            self._revision(entry)
            count += 1
        acts = [*self._kb.executions.get_all(since=low, until=high)]
        for start in range(0, len(acts), PAGE):
            page = acts[start : start + PAGE]
            for act, used in zip(page, literals_used(state_of(self._kb), page), strict=True):
                self._act(act, used)
        return count

    def _revision(self, entry: LogEntry) -> None:
        """Add the changes of a revision, with its executions or its observation."""
        revision, document = entry.revision, self._document
        told = [
            read_outcome(one.text).id
            for one in entry.changes
            if one.sign == "+" and one.kind in (EXECUTION, PLAN_STEP)
        ]
        activities = [f"kb:execution/{one}" for one in told] or [f"kb:revision/{revision.number}"]
        at = revision.committed_at
        if not told:
            label = revision.reason or f"revision {revision.number}"
            document.activity(activities[0], at, at, {"prov:label": label})
        for activity in activities if revision.actor is not None else ():
            document.wasAssociatedWith(activity, self._agent(revision.actor or ""))
        # Ends first: a value ends where the next one begins.
        for change in sorted(entry.changes, key=lambda one: one.sign, reverse=True):
            if change.kind not in (FACT, VALUE):
                continue
            found = _FLUENT.fullmatch(change.text) if change.kind == VALUE else None
            key = found[1] if found else change.text
            if change.sign == "+":
                self._held[key] = self._entity(key, revision.number, change.text)
                for activity in activities:
                    document.wasGeneratedBy(self._held[key], activity, at)
                    self._made[activity].append(self._held[key])
                continue
            ended = self._held.pop(key, None) or self._before(key, revision.number)
            for activity in activities:
                document.wasInvalidatedBy(ended, activity, at)

    def _before(self, key: str, revision: int) -> str:
        """Return a version that began before the range."""
        version = self._kb.at(revision - 1).blame(key)
        return self._entity(key, 0 if version is None else version.since.number, key)

    def _act(self, act: Execution, used: list[tuple[str, int]]) -> None:
        """Add an execution with the versions that it used; derive the versions that it made."""
        activity, document = f"kb:execution/{act.id}", self._document
        said = {"prov:label": str(act), "kb:outcome": act.outcome, "kb:reason": act.reason}
        given = {key: value for key, value in said.items() if value is not None}
        document.activity(activity, act.started_at, act.ended_at, given)
        versions = [
            self._entity(key, since, key)
            for key, since in dict.fromkeys(used)
            if since and not key.startswith("(not ")
        ]
        for version in versions:
            document.used(activity, version, act.started_at)
        for made in self._made.get(activity, ()):
            for version in versions:
                document.wasDerivedFrom(made, version, activity)

    def _entity(self, key: str, since: int, text: str) -> str:
        """Return the name of a version; add it on first use."""
        name = f"kb:version/{encoded(key)}/{since}"
        if name not in self._entities:
            self._entities.add(name)
            self._document.entity(name, {"prov:label": text, "kb:since": since})
        return name

    def _agent(self, actor: str) -> str:
        name = f"kb:agent/{encoded(actor)}"
        if name not in self._entities:
            self._entities.add(name)
            self._document.agent(name, {"prov:label": actor})
        return name
