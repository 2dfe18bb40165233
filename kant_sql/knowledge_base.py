"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Self

from . import documents, history, html, reasoning
from .binding import Front, creates, delegates, reads, state_of, writes
from .factory import DaoFactory, create_dao_factory
from .moment_text import When
from .sql.changes import Change

if TYPE_CHECKING:
    from .operations import Operations
    from .pddl_parts import PddlParts

# Revisions that a notebook shows of a knowledge base.
_LATEST = 5


class KnowledgeBase(Front):
    """A robot's knowledge: its present state, its history, and its documents.

    Threads may share it. Use it as a context manager, or call `close`.
    """

    types = creates(DaoFactory.create_pddl_type_dao)
    objects = creates(DaoFactory.create_pddl_object_dao)
    predicates = creates(DaoFactory.create_pddl_predicate_dao)
    functions = creates(DaoFactory.create_pddl_function_dao)
    function_values = creates(DaoFactory.create_pddl_function_value_dao)
    propositions = creates(DaoFactory.create_pddl_proposition_dao)
    goals = creates(DaoFactory.create_goal_dao)
    actions = creates(DaoFactory.create_pddl_action_dao)
    plans = creates(DaoFactory.create_plan_dao)

    transaction = delegates(DaoFactory.transaction)

    load_domain = writes(lambda: documents.exchange.load_domain)
    load_problem = writes(lambda: documents.exchange.load_problem)
    domain_pddl = reads(lambda: documents.exchange.domain_pddl)
    problem_pddl = reads(lambda: documents.exchange.problem_pddl)

    holds = reads(lambda: reasoning.ask.holds)
    query = reads(lambda: reasoning.ask.query)
    when = reads(lambda: reasoning.when.when)
    unsatisfied = reads(lambda: reasoning.explain.unsatisfied)
    why_not = reads(lambda: reasoning.act.why_not)
    applicable_actions = reads(lambda: reasoning.act.applicable_actions)
    apply = writes(lambda: reasoning.durative.apply)
    start = writes(lambda: reasoning.durative.start)
    end = writes(lambda: reasoning.durative.end)
    abort = writes(lambda: reasoning.durative.abort)
    plan = reads(lambda: documents.planners.plan)
    validate = reads(lambda: reasoning.validate.validate)

    log = reads(lambda: history.log.log)
    changes = reads(lambda: history.follow.changes)
    watch = reads(lambda: history.follow.watch)
    history = reads(lambda: history.versions.history)
    blame = reads(lambda: history.versions.blame)
    timeline = reads(lambda: history.timeline.timeline)
    restore = writes(lambda: history.restore.restore)

    @cached_property
    def pddl(self) -> PddlParts:
        """Rarer parts of PDDL, and whole documents as trees."""
        from .pddl_parts import PddlParts

        return PddlParts(self._factory, state=self._state)

    @cached_property
    def store(self) -> Operations:
        """Operations on the store: verification, anchors, archives, replication."""
        from .operations import Operations

        return Operations(self._factory, state=self._state)

    def diff(self, a: When | KnowledgeBase, b: When | KnowledgeBase) -> list[Change]:
        """Compare two states. Recorded plans and archives belong to no state.

        Args:
            a: a revision, given as for `at`; or the state of another knowledge base, in any store,
                as a branch has it.
            b: another, before or after `a`.

        Returns:
            What would turn `a` into `b`: `+` for what holds at `b` only, `-` for what holds at `a`
            only, sorted by sign, kind and text. Of a knowledge base, pending changes of open
            transactions count.

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
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.delete("(robot_at rb1 wp2)")
            ...     print(*kb.diff(kb, trial))
            Change(sign='-', kind='fact', text='(robot_at rb1 wp2)')
        """
        if not (isinstance(a, KnowledgeBase) or isinstance(b, KnowledgeBase)):
            return history.diff.diff(state_of(self), a, b)
        here, there = (one if isinstance(one, KnowledgeBase) else self.at(one) for one in (a, b))
        lines = history.diff.state_lines
        return history.diff.diff_lines(lines(state_of(here)), lines(state_of(there)))

    def at(self, when: When) -> Self:
        """Open a past state for reading; writes raise `ReadOnlyError`.

        Args:
            when: a revision's number (0 is before the first), an aware time up to now, or a text of
                either: `2026-01-31T09:30:00Z` (UTC unless it has a zone), `2 hours ago`,
                `yesterday 14:03`, `now`.

        Returns:
            The same DAOs on that state.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            InvalidArgumentError: a text is neither a revision's number nor a time.
            ArchivedError: a part of that state was moved to an archive.

        Examples:
            >>> kb.at(0).propositions.get_all()
            []
            >>> kb.at("yesterday").revision
            0
        """
        return type(self)(self._factory.at(when))

    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> Self:
        """Begin a knowledge base with a state of this one, to try something out.

        All that belongs to the state goes over: definitions, facts, goals and values, in the same
        order, so that both write the same documents. (A domain or problem that was never loaded is
        called as its knowledge base, and so is a branch without `name`.) Recorded plans and the
        history stay behind. The first revision of the branch names this knowledge base, its
        revision and that revision's hash in `source`, as `parent`, `revision` and `hash`; a branch
        of an empty state has no revision yet.

        Args:
            name: the name of the branch; None for that of this knowledge base.
            at: a revision, given as for `at`; None for the present, or for this past state.
            url: the store of the branch, on any dialect; a new SQLite file is created. None for
                this store with a `name`, and without one for a store in memory, which ends when
                the branch is closed. A store in memory holds one knowledge base, so that a branch
                of it is in another store in memory.

        Returns:
            The branch, which writes as the same actor; close it as any other.

        Raises:
            ConflictError: the store has a knowledge base of that name.
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: a part of that state was moved to an archive.
            ReadOnlyError: the task or thread has a transaction open: what is pending has no
                revision that the branch could name.
            InvalidUrlError: the URL is not valid, or of a family that takes no branches.

        Examples:
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.delete_all()
            ...     print(kb.diff(kb, trial)[0])
            Change(sign='-', kind='fact', text='(robot_at rb1 wp1)')
        """
        return type(self)(self._factory.branch(name, at=at, url=url))

    @property
    def revision(self) -> int:
        """The number of the last revision, 0 before the first.

        Within a transaction, the revision that it began from; of a past state, its revision.
        """
        return self._factory.revision

    def close(self) -> None:
        """Close the database connections. This deletes a store in memory.

        Later calls raise `ClosedError`, on past states, too. An open transaction is rolled back: at
        once if it is this thread's, else at the end of its block. Closing a past state does
        nothing.
        """
        self._factory.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._factory.label}>"

    def _repr_html_(self) -> str:
        return html.guarded(self._shown)

    def _shown(self) -> str:
        """Write what the state holds, and who changed it last."""
        head = self.revision
        found = history.log.revisions(state_of(self), max(0, head - _LATEST))
        last = [each._html_row_() for each in found][::-1]
        latest = html.heading("The latest revisions") + html.table(last) if last else ""
        counts = {"revision": head, **history.overview.read_overview(state_of(self))._asdict()}
        return html.heading(self._factory.label) + html.fields(counts) + latest

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def connect(
    url: str,
    *,
    knowledge_base: str = "default",
    actor: str | None = None,
    read_only: bool = False,
) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        url: the database URL: `sqlite:///robot.db` for a file, `sqlite://` for a store in memory,
            `postgresql://user@host/database` for a server.
        knowledge_base: the knowledge base's name; the first write creates it.
        actor: who writes, by default.
        read_only: whether the database is to refuse all writes of these connections; each raises
            `ReadOnlyError`. Nothing is created then, so that the store has to exist.

    Returns:
        The knowledge base. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL is not valid, or no DAO family supports it.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.

    Examples:
        The examples of this reference continue from here.

        >>> import kant_sql
        >>> from kant_sql import PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
        >>> robot, wp = PddlTypeDto("robot"), PddlTypeDto("wp")
        >>> robot_at = PddlPredicateDto("robot_at", [robot, wp])
        >>> rb1 = PddlObjectDto(robot, "rb1")
        >>> wp1, wp2 = PddlObjectDto(wp, "wp1"), PddlObjectDto(wp, "wp2")
        >>> kb = kant_sql.connect("sqlite://", knowledge_base="tiago", actor="perception")
        >>> kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp1]))
        True
        >>> kb.revision
        1
    """
    return KnowledgeBase(
        create_dao_factory(url, knowledge_base=knowledge_base, actor=actor, read_only=read_only)
    )
