"""The interface of the past: what happened to a knowledge base, and going back."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from ..dao.interfaces import Interface, Progress, required
from ..dto.elements import Dto
from ..dto.formulas import Node
from ..moment_text import When
from ..sql.changes import Change
from .anchors import Anchor
from .archive.archive import Archived
from .excerpts import StateReader
from .overview import Overview, Tally
from .replication.push import Pushed
from .revisions import LogEntry, Revision
from .timeline import Timeline
from .verify.verify import Verification
from .versions import Version

if TYPE_CHECKING:
    import pyarrow

# A DTO, a formula, PDDL text such as `(robot_at rb1 wp1)`, or a name.
Element = Dto | Node | str


class History(Interface):
    """Reads the revisions of a knowledge base, restores, verifies and archives them."""

    @required
    def revisions(self, after: int = 0, *, limit: int | None = None) -> list[Revision]:
        """Read revisions, oldest first.

        Args:
            after: return revisions with a larger number.
            limit: the maximum number of revisions; None for all.

        Returns:
            The revisions, without what they changed.

        Examples:
            >>> [(revision.number, revision.actor) for revision in kb.revisions()]
            [(1, 'perception')]
        """

    @required
    def log(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        actor: str | None = None,
        element: Element | None = None,
        limit: int | None = None,
    ) -> Iterator[LogEntry]:
        """Read revisions and their changes, newest first, in constant memory.

        Args:
            since: the first revision, or the earliest time of commit; both inclusive.
            until: the last revision, or the latest time of commit; both inclusive.
            actor: return revisions of this actor.
            element: return revisions that changed this element, and their changes of it: a DTO, a
                formula, PDDL text such as `(robot_at rb1 wp1)`, or a name. Of an object, the
                changes of all that involves it, as for `history`.
            limit: the maximum number of revisions; None for all.

        Returns:
            The entries up to the present head, read in pages on demand.

        Raises:
            UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
            ArchivedError: on reaching a revision that is partly in an archive.
            UnknownNameError: instead of no entry, if there never was such an actor, or `element` is
                a text with a name that never was.
            InvalidKnowledgeError: `element` is not one of the above.

        Examples:
            >>> for entry in kb.log(element="(robot_at rb1 wp1)"):
            ...     print(entry.revision.number, entry.revision.actor, entry.changes[0].sign)
            1 perception +
        """

    @required
    def changes(self, after: int = 0, *, limit: int | None = None) -> Iterator[LogEntry]:
        """Read revisions and their changes, oldest first: a feed that can be resumed.

        Revisions come in order and without gaps. A consumer that stores the number of the last
        revision it processed, and resumes from there, receives each revision at least once.

        Args:
            after: return revisions with a larger number.
            limit: the maximum number of revisions; None for all.

        Returns:
            The entries, read in pages on demand; the iterator ends at the head.

        Raises:
            UnknownRevisionError: the knowledge base has no revision `after` yet.
            ArchivedError: changes after `after` were moved to an archive.
            StoreIntegrityError: a revision is missing.

        Examples:
            >>> processed = 0
            >>> for entry in kb.changes(after=processed):
            ...     processed = entry.revision.number
            >>> processed
            1
        """

    @required
    def watch(self, after: int | None = None, *, timeout: float | None = None) -> int | None:
        """Wait for a new revision.

        Revisions of other processes count. The wait survives a restart of the server.

        Args:
            after: the last revision that the caller knows; None for the present head.
            timeout: seconds to wait; None to wait without limit.

        Returns:
            The number of the head, which is larger than `after`; None after a timeout.

        Raises:
            UnknownRevisionError: the knowledge base has no revision `after` yet.
            ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
            InvalidTimeoutError: `timeout` is negative, or not a number.
            StoreError: the timeout passed while the store was unreachable, or the knowledge base
                was closed.

        Examples:
            >>> kb.watch(after=0)
            1
            >>> kb.watch(after=1, timeout=0) is None
            True
        """

    @required
    def diff(self, a: When, b: When) -> list[Change]:
        """Compare two states. Recorded plans and archives belong to no state.

        Args:
            a: a revision, given as for `kb.at`.
            b: another, before or after `a`.

        Returns:
            `+` for what holds at `b` only, `-` for what holds at `a` only, sorted by sign, kind and
            text.

        Raises:
            UnknownRevisionError: there is no such revision yet, or a time lies in the future or
                has no zone.
            ArchivedError: one of the states was moved to an archive.

        Examples:
            >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
            >>> for change in kb.diff(1, 2):
            ...     print(change.sign, change.kind, change.text)
            + fact (robot_at rb1 wp2)
            + object wp2 - wp
        """

    @required
    def diff_with(self, other: History) -> list[Change]:
        """Compare this state with that of another knowledge base, in any store.

        Args:
            other: the other one, in the present or the past.

        Returns:
            What would turn this state into the other's: `+` for what holds only there, `-` for what
            holds only here, sorted by sign, kind and text. Pending changes of open transactions
            count.

        Raises:
            InvalidArgumentError: `other` is not a knowledge base.

        Examples:
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
            ...     for change in kb.diff_with(trial):
            ...         print(change.sign, change.kind, change.text)
            + fact (robot_at rb1 wp2)
            + object wp2 - wp
        """

    @required
    def _watch(
        self, after: int | None, timeout: float | None, is_ended: Callable[[], bool]
    ) -> int | None:
        """Wait as `watch` does, or until somebody ends the wait; this is seen after a while."""

    @required
    def _state_lines(self) -> list[tuple[str, str]]:
        """Return kind and text of all that belongs to the state."""

    @required
    def _overview(self) -> Overview:
        """Count what the state holds."""

    @required
    def _reader(self) -> StateReader:
        """Return where pages read that show a part of a large store."""

    @required
    def _tally(self, since: When | None, until: When | None, most: int) -> Tally:
        """Count the revisions of a range by actor, and their changes by kind."""

    @required
    def history(self, element: Element) -> list[Version]:
        """Read when an element held, and who asserted and retracted it.

        Args:
            element: a DTO (the value of a function value is ignored), a formula, PDDL text, or a
                name, which matches all definitions of that name. The text `(robot_at rb1 wp1)`
                matches the fact and the goal, `(battery rb1)` the values of the fluent; other texts
                are formulas, or definitions as the log shows them. The name or DTO of an object
                matches all that involves it: facts, goals, values, formulas, actions and steps of
                plans, too; `rb1 - robot` only its declaration.

        Returns:
            Its versions in this store, oldest first; empty for an unknown element. Archived
            versions are not included.

        Raises:
            InvalidKnowledgeError: `element` is not one of the above.

        Examples:
            >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
            >>> for version in kb.history("(robot_at rb1 wp1)"):
            ...     print(version.since.number, version.until.number)
            1 2
        """

    @required
    def blame(self, element: Element) -> Version | None:
        """Show who asserted an element that holds now, when and why.

        Args:
            element: as for `history`; of an object, its declaration.

        Returns:
            The version that holds, with the revision that asserted it in `since`; None when the
            element does not hold. A text that matches a fact and a goal gives the fact.

        Raises:
            InvalidKnowledgeError: `element` is not valid, or matches several things that hold.

        Examples:
            >>> kb.blame("(robot_at rb1 wp1)").since.actor
            'perception'
        """

    @required
    def timeline(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        predicate: str | None = None,
        object: str | None = None,
        text: str | None = None,
        kinds: Iterable[str] = ("fact", "goal", "value", "plan"),
        lanes: int = 50,
        after: str | None = None,
        slices: int = 600,
    ) -> Timeline:
        """Read what held when in a window of time: a picture of it, however much happened.

        A lane is a fact, a goal or a fluent that held at some time of the window. If it changed
        seldom, it has a bar for each version. If it changed often, versions that last for a slice
        of the window, as wide as a pixel, are bars, and the others are counted by slice.

        Args:
            since: the beginning, given as for `kb.at`; None for the first revision.
            until: the end; None for the last revision. A time in the future counts as now.
            predicate: show lanes of this predicate or function.
            object: show lanes with this object among the arguments, and steps of plans likewise.
            text: show lanes whose text has this part, in any case, and steps of plans likewise.
            kinds: what to show: some of `fact`, `goal`, `value` and `plan`.
            lanes: the maximum number of lanes.
            after: `next` of the timeline before, to go on with the lanes that follow. Plans come
                with the first lanes.
            slices: the number of slices of the window. There are fewer where many lanes have so
                many versions that these are counted.

        Returns:
            The timeline. A part that was moved to an archive is missing, as `archived_until` says.

        Raises:
            UnknownRevisionError: there is no such revision yet, or a time has no zone.
            UnknownNameError: instead of no lane, if there never was such a predicate or object.
            InvalidArgumentError: the window ends before it begins, or an argument is out of range.

        Examples:
            >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
            >>> for lane in kb.timeline(object="rb1").lanes:
            ...     for bar in lane.bars:
            ...         print(lane.kind, lane.text, bar.since, bar.until, bar.actor)
            fact (robot_at rb1 wp1) 1 2 perception
        """

    @required
    def to_arrow(self, view: str) -> pyarrow.Table:
        """Read a view for auditors as a table with types, for pandas, polars and DuckDB.

        Times are timestamps in UTC, numbers of revisions, ids and counts 64-bit integers, seconds
        and numbers doubles, truths booleans; the rest, JSON of the source too, is text.

        Args:
            view: the view's name, as `fact` or `audit_fact`; `docs/audit.md` describes them.

        Returns:
            Its rows that are of this knowledge base, as they are committed, oldest first. To read
            more than fits into memory, use `kant_sql.export.open_reader`.

        Raises:
            InvalidArgumentError: there is no such view.
            ExtraMissingError: pyarrow is not installed; the extra `data` has it.
            ReadOnlyError: this is a view of the past, as these views have all of the history; or
                the task or thread has a transaction open.

        Examples:
            >>> facts = kb.to_arrow("fact")
            >>> facts.select(["text", "since", "asserted_by"]).to_pylist()
            [{'text': '(robot_at rb1 wp1)', 'since': 1, 'asserted_by': 'perception'}]
        """

    @required
    def restore(
        self, when: When, *, reason: str | None = None, actor: str | None = None
    ) -> int | None:
        """Restore a past state as a new revision.

        The history is kept, so a restoration can itself be undone. Recorded plans and archives
        belong to no state, and stay.

        Args:
            when: a revision, given as for `kb.at`.
            reason: why; by default `restored revision NUMBER`.
            actor: who restores; by default the knowledge base's actor.

        Returns:
            The new revision; None when the states are equal, or within an open transaction.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: that state was moved to an archive.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> kb.propositions.delete_all()
            1
            >>> kb.restore(1)
            3
            >>> print(*kb.propositions.get_all())
            (robot_at rb1 wp1)
        """

    @required
    def verify(
        self,
        anchor: Anchor | None = None,
        *,
        progress: Progress | None = None,
        structure: bool = True,
        resume: bool = False,
        keep: bool = False,
    ) -> Verification:
        """Recompute every hash from the tables, and compare all redundant data.

        With `keep`, where an intact verification ended is kept in the store; with `resume`, the
        next one continues there. It checks what later revisions wrote, and does not find
        what was altered since in rows of earlier ones: verify all of it from time to time. Who may
        write the table `verification` can also make it say more than was verified.

        Args:
            anchor: an earlier result of `anchor()`, kept elsewhere.
            progress: called with the number of items checked, and the number in total.
            structure: also check indexes, constraints and views. All knowledge bases of a store
                share them, so one check per store is enough. Indexes are left out when an earlier
                verification is continued.
            resume: continue where the last verification that was kept ended, if it is still there.
            keep: keep where this one ends, if nothing is wrong; else forget what was kept, so that
                the next one begins at revision 1. Who may only read keeps nothing.

        Returns:
            What was checked and what is wrong: the first revision, and the differences.

        Raises:
            ReadOnlyError: the task or thread has a transaction open.

        Examples:
            >>> verification = kb.verify(keep=True)
            >>> verification.is_intact
            True
            >>> kb.verify(resume=True).continued_from == kb.revision
            True
        """

    @required
    def anchor(self) -> Anchor:
        """Read the heads of all knowledge bases of the store, to keep elsewhere.

        Returns:
            The heads; `verify` compares a later state with them.

        Examples:
            >>> anchor = kb.anchor()
            >>> kb.verify(anchor).is_intact
            True
        """

    @required
    def archive(
        self,
        before: When,
        *,
        to: str,
        dry_run: bool = False,
        reason: str | None = None,
        actor: str | None = None,
        progress: Progress | None = None,
    ) -> Archived:
        """Move versions that ended before a revision or time into another store.

        The target holds the knowledge base up to the last revision before `before`, with its
        history, and answers every question about it. This store keeps that state, all revisions
        and their hashes. An interrupted archive can be resumed by calling this again.

        Args:
            before: a revision, given as for `kb.at`: versions that ended earlier are moved.
            to: the target's URL, on any dialect; a new SQLite file is created. The target may
                contain this knowledge base only from earlier archiving.
            dry_run: only count.
            reason: why.
            actor: who archives; by default the knowledge base's actor.
            progress: called with the number of revisions copied, and the number in total.

        Returns:
            What was moved, or would be.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ConflictError: the target has another knowledge base of this name.
            ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.

        Examples:
            >>> _ = kb.propositions.delete_all()
            >>> kb.archive(2, to="sqlite:///2025.db", dry_run=True).upto
            1
        """

    @required
    def push(
        self,
        url: str,
        *,
        archive: str | None = None,
        adopt: bool = False,
        progress: Progress | None = None,
    ) -> Pushed:
        """Send the revisions that another store lacks, with their numbers, times and hashes.

        The target becomes a replica, which refuses local writes until it is promoted. Each batch is
        checked against its hashes there before it is committed. An interrupted push can be resumed
        by calling this again. The connection to the target stays open for the next call; then, if
        there is nothing new, a push takes one statement on each side.

        Args:
            url: the target's URL, on any dialect; a new SQLite file is created.
            archive: the URL of the archive that has what this store has no more; by default the
                one that this store names.
            adopt: whether a target that is no replica becomes one, if it has a part of this history
                and nothing else.
            progress: called with the last revision that the target has, and this one's last.

        Returns:
            What was sent.

        Raises:
            DivergedError: the target's history differs; the error has the first such revision.
            ReplicaError: the target is no replica.
            ArchivedError: only an archive has a part of what is to be sent.
            StoreIntegrityError: a revision does not fit its hash; nothing of its batch was written.
            ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.

        Examples:
            >>> kb.push("sqlite:///server.db").revisions == kb.revision
            True
            >>> kb.push("sqlite:///server.db").revisions
            0
        """

    @required
    def promote(self, *, reason: str | None = None, actor: str | None = None) -> int | None:
        """Make a knowledge base of its own of a replica: from now on it is written to here.

        That is a revision; the origin's later revisions are refused.

        Args:
            reason: why.
            actor: who promotes; by default the knowledge base's actor.

        Returns:
            The revision; None when this is no replica.

        Raises:
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> kb.promote() is None
            True
        """
