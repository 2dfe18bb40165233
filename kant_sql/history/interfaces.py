"""What can be asked of the past."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from datetime import datetime

from ..dto.dto import Dto
from ..dto.formula import Node
from ..knowledge.changes import Change
from .anchors import Anchor
from .archiving import Archived
from .revisions import LogEntry, Revision
from .verifying import Progress, Verification
from .versions import Version

# A revision's number, or an aware time.
When = int | datetime
# A DTO, a formula, PDDL text such as `(robot_at rb1 wp1)`, or a name.
Element = Dto | Node | str


class History(ABC):
    """What was: revisions, what they changed, and whether they are what was written."""

    @abstractmethod
    def revisions(self, after: int = 0, *, limit: int | None = None) -> list[Revision]:
        """Read revisions, oldest first.

        Args:
            after: only those with a larger number.
            limit: at most so many; None for all.

        Returns:
            The revisions.
        """

    @abstractmethod
    def log(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        actor: str | None = None,
        element: Element | None = None,
        limit: int | None = None,
    ) -> Iterator[LogEntry]:
        """Read revisions with what they changed, newest first, in constant memory.

        Args:
            since: only this revision and later ones, or those committed at this time or later.
            until: only this revision and earlier ones, or those committed up to this time.
            actor: only those of this actor.
            element: only those that changed this element, with what they changed of it: a DTO, a
                formula, PDDL text such as `(robot_at rb1 wp1)`, or a name.
            limit: at most so many; None for all.

        Returns:
            The entries up to the revision that is the last now, read in pages as they are asked
            for.

        Raises:
            UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
            ArchivedError: once it comes to a revision of which a part was moved to an archive.
            InvalidKnowledgeError: `element` is none of these.
        """

    @abstractmethod
    def changes(self, after: int = 0, *, limit: int | None = None) -> Iterator[LogEntry]:
        """Follow what changes, oldest first: a feed that can be resumed.

        Revisions come in order and without gaps. Who keeps the number of the last one that was
        dealt with, and begins there again, gets each at least once.

        Args:
            after: only revisions with a larger number.
            limit: at most so many; None for all that there are.

        Returns:
            The entries, read in pages as they are asked for; it ends at the head.

        Raises:
            UnknownRevisionError: the knowledge base has not come to `after` yet.
            ArchivedError: changes behind `after` were moved to an archive.
            StoreIntegrityError: a revision is missing.
        """

    @abstractmethod
    def watch(self, after: int | None = None, *, timeout: float | None = None) -> int | None:
        """Wait until there is a revision that the caller does not know.

        It works across processes, and goes on when a server was started anew.

        Args:
            after: the last revision that the caller knows; None for the head as it is now.
            timeout: how many seconds to wait; None for as long as it takes.

        Returns:
            The number of the last revision, which is larger than `after`; None when time ran out.

        Raises:
            UnknownRevisionError: the knowledge base has not come to `after` yet.
            ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
            InvalidTimeoutError: `timeout` is negative, or no number.
            StoreError: time ran out while the store could not be reached, or the knowledge base
                was closed meanwhile.
        """

    @abstractmethod
    def diff(self, a: When, b: When) -> list[Change]:
        """Tell what knowledge is different between two states; plans and archives are records.

        Args:
            a: a revision's number, or an aware time.
            b: another; it may be the earlier one.

        Returns:
            `+` what holds at `b` and not at `a`, `-` what holds at `a` and not at `b`, sorted by
            sign, kind and text.

        Raises:
            UnknownRevisionError: there is no such revision yet, or a time lies in the future or
                has no zone.
            ArchivedError: one of the states was moved to an archive.
        """

    @abstractmethod
    def history(self, element: Element) -> list[Version]:
        """Tell when an element held, and who asserted and retracted it.

        Args:
            element: a DTO (a function value whatever its value), a formula, PDDL text, or a name,
                which stands for all definitions of that name. Of texts, `(robot_at rb1 wp1)` is
                the fact and the goal, `(battery rb1)` what the function gives there, and others
                are formulas, or definitions as the log shows them.

        Returns:
            Its versions as far as they are in this store and not in an archive, oldest first;
            empty when it never was.

        Raises:
            InvalidKnowledgeError: it is none of these.
        """

    @abstractmethod
    def blame(self, element: Element) -> Version | None:
        """Tell who asserted what holds now, why, and since when.

        Args:
            element: as for `history`.

        Returns:
            The version that holds, `since` telling the revision; None when it does not hold. Of
            a text that is a fact and a goal, the fact.

        Raises:
            InvalidKnowledgeError: it is none of these, or several things of that name hold.
        """

    @abstractmethod
    def restore(
        self, when: When, *, reason: str | None = None, actor: str | None = None
    ) -> int | None:
        """Make the state equal to a past one, as a new revision.

        Nothing is lost: what is retracted stays in the history, and the restoration can be undone
        in the same way. Plans and archives are records, no state: they stay.

        Args:
            when: a revision's number, or an aware time.
            reason: why; `restored revision 12` when not given.
            actor: who does it; the knowledge base's actor when not given.

        Returns:
            The revision; None when nothing was different, or when it is part of a transaction
            that is still open.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: that state was moved to an archive.
            ReadOnlyError: this is a view of the past.
        """

    @abstractmethod
    def verify(
        self,
        anchor: Anchor | None = None,
        *,
        progress: Progress | None = None,
        structure: bool = True,
    ) -> Verification:
        """Recompute every hash from the tables, and compare what is said twice.

        Args:
            anchor: what `anchor()` gave at an earlier time, kept elsewhere.
            progress: called with how much is checked, and how much there is to check.
            structure: whether indexes, constraints and views are checked as well. All knowledge
                bases of a store have them in common: of several, one is enough.

        Returns:
            What was checked, and what is wrong: the first revision, and what differs.

        Raises:
            ReadOnlyError: the task or thread has a transaction open.
        """

    @abstractmethod
    def anchor(self) -> Anchor:
        """Give the heads of all knowledge bases of the store, to keep elsewhere.

        Returns:
            The heads.
        """

    @abstractmethod
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
        """Move versions that ended before a time into another store.

        The other store has the knowledge base as it was at the last revision before that time,
        history and all, and answers what this one answered. This one keeps what held then, the
        revisions, and their hashes. It may be interrupted at any point and begun again.

        Args:
            before: an aware time, or the number of a revision: what ended earlier is moved.
            to: the other store's URL, on either dialect; a new SQLite file is created. It holds
                nothing of this knowledge base but what was archived before.
            dry_run: only count.
            reason: why.
            actor: who does it; the knowledge base's actor when not given.
            progress: called with the number of revisions that the other store has, and is to have.

        Returns:
            What was moved, or would be.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ConflictError: the other store has another knowledge base of this name.
            ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
        """
