"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, cast

from . import documents, history, html, reasoning
from .arguments import expect
from .dao.base import refuse_past
from .errors import InvalidArgumentError
from .factory import DaoFactory, Daos, SqlDaoFactory, create_dao_factory, daos_only
from .moment_text import When
from .sql.changes import Change
from .store.state import State

P = ParamSpec("P")
R = TypeVar("R")

# Revisions that a notebook shows of a knowledge base.
_LATEST = 5


def state_of(kb: KnowledgeBase) -> State:
    """Return what functions of a state are asked of.

    Raises:
        InvalidUrlError: the DAO family is not built on an SQL store, and has DAOs only.
        ClosedError: the store was closed.
    """
    state = kb._state
    if state is None:
        raise daos_only(kb.factory, "history, documents and reasoning")
    if state.store.is_closed:
        state.store.refuse_closed()
    return state


class _Question:
    """A method of the class below that is made when it is first asked for."""

    def __init__(self, make: Callable[[], Callable[..., Any]]) -> None:
        self._make = make

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = owner, name

    def __get__(self, kb: object, owner: type | None = None) -> Any:
        """Take the place of it for good."""
        method = self._make()
        setattr(*self._place, method)
        return method.__get__(kb, owner)


def reads(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a function of a state: a method with its docstring, arguments and defaults.

    `find` names it. Its module is imported when the method is first asked for.
    """

    def make() -> Callable[..., R]:
        function = find()

        @wraps(function)
        def ask(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
            return function(state_of(self), *args, **kwargs)

        return _method(ask)

    return cast("Callable[Concatenate[KnowledgeBase, P], R]", _Question(make))


def writes(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a function that writes, as `reads`; views of the past refuse it."""

    def make() -> Callable[..., R]:
        function = find()

        @wraps(function)
        def write(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
            state = state_of(self)
            if state.at is not None:
                refuse_past(state.store, state.at)
            return function(state, *args, **kwargs)

        return _method(write)

    return cast("Callable[Concatenate[KnowledgeBase, P], R]", _Question(make))


def delegates(
    method: Callable[Concatenate[DaoFactory, P], R],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a method of the factory."""

    @wraps(method)
    def call(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return cast(Callable[P, R], getattr(self.factory, method.__name__))(*args, **kwargs)

    return call


def _method(bound: Callable[..., R]) -> Callable[..., R]:
    """Show `self` in place of the state, to `help` and to who reads annotations."""
    shown = inspect.signature(bound)
    state, *others = shown.parameters.values()
    own = state.replace(name="self", annotation=inspect.Parameter.empty)
    bound.__signature__ = shown.replace(parameters=[own, *others])  # type: ignore[attr-defined]
    hints = bound.__annotations__.items()
    bound.__annotations__ = {name: hint for name, hint in hints if name != state.name}
    return bound


class KnowledgeBase(Daos):
    """A robot's knowledge: its present state, its history, and its documents.

    Threads may share it. Use it as a context manager, or call `close`.

    Attributes:
        factory: the factory of the DAOs.
    """

    def __init__(self, factory: DaoFactory) -> None:
        """Create the DAOs.

        Args:
            factory: the factory; the knowledge base owns it.
        """
        self.factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self._state = factory.state if isinstance(factory, SqlDaoFactory) else None
        self._create(factory)

    transaction = delegates(DaoFactory.transaction)

    load_domain = writes(lambda: documents.exchange.load_domain)
    load_problem = writes(lambda: documents.exchange.load_problem)
    load_unified_planning = writes(lambda: documents.planners.load_unified_planning)
    domain = reads(lambda: documents.exchange.domain)
    problem = reads(lambda: documents.exchange.problem)
    domain_pddl = reads(lambda: documents.exchange.domain_pddl)
    problem_pddl = reads(lambda: documents.exchange.problem_pddl)
    requirements = reads(lambda: documents.exchange.requirements)
    to_unified_planning = reads(lambda: documents.planners.to_unified_planning)
    plan = reads(lambda: documents.planners.plan)

    holds = reads(lambda: reasoning.ask.holds)
    query = reads(lambda: reasoning.ask.query)
    complete = reads(lambda: reasoning.complete.complete)
    unsatisfied = reads(lambda: reasoning.explain.unsatisfied)
    unsatisfied_goals = reads(lambda: reasoning.explain.unsatisfied_goals)
    is_goal_reached = reads(lambda: reasoning.explain.is_goal_reached)
    metric_value = reads(lambda: reasoning.explain.metric_value)
    why_not = reads(lambda: reasoning.act.why_not)
    applicable_actions = reads(lambda: reasoning.act.applicable_actions)
    is_applicable = reads(lambda: reasoning.act.is_applicable)
    apply = writes(lambda: reasoning.durative.apply)
    start = writes(lambda: reasoning.durative.start)
    end = writes(lambda: reasoning.durative.end)
    abort = writes(lambda: reasoning.durative.abort)
    broken_invariants = reads(lambda: reasoning.durative.broken_invariants)
    validate = reads(lambda: reasoning.validate.validate)
    when = reads(lambda: reasoning.when.when)
    check_rules = reads(lambda: reasoning.rules.check_rules)

    revisions = reads(lambda: history.log.revisions)
    log = reads(lambda: history.log.log)
    changes = reads(lambda: history.follow.changes)
    watch = reads(lambda: history.follow.watch)
    diff = reads(lambda: history.diff.diff)
    history = reads(lambda: history.versions.history)
    blame = reads(lambda: history.versions.blame)
    timeline = reads(lambda: history.timeline.timeline)
    to_arrow = reads(lambda: history.audit.to_arrow)
    restore = writes(lambda: history.restore.restore)
    verify = reads(lambda: history.verify.verify.verify)
    anchor = reads(lambda: history.anchors.anchor)
    archive = writes(lambda: history.archive.archive.archive)
    push = writes(lambda: history.replication.calls.push)
    promote = writes(lambda: history.replication.promote.promote)

    def diff_with(self, other: KnowledgeBase) -> list[Change]:
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
        expect(other, KnowledgeBase, "what it is compared with", InvalidArgumentError)
        return history.diff.diff_lines(
            history.diff.state_lines(state_of(self)), history.diff.state_lines(state_of(other))
        )

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
        return type(self)(self.factory.at(when))

    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> Self:
        """Begin a knowledge base with a state of this one, to try out what would follow.

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
            ...     print(kb.diff_with(trial)[0])
            Change(sign='-', kind='fact', text='(robot_at rb1 wp1)')
        """
        return type(self)(self.factory.branch(name, at=at, url=url))

    @property
    def revision(self) -> int:
        """The number of the last revision, 0 before the first.

        Within a transaction, the revision that it began from; of a past state, its revision.
        """
        return self.factory.revision

    def close(self) -> None:
        """Close the database connections. This deletes a store in memory.

        Later calls raise `ClosedError`, on past states, too. An open transaction is rolled back: at
        once if it is this thread's, else at the end of its block. Closing a past state does
        nothing.
        """
        self.factory.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.factory.label}>"

    def _repr_html_(self) -> str:
        return html.guarded(self._shown)

    def _shown(self) -> str:
        """Write what the state holds, and who changed it last."""
        head = self.revision
        last = [each._html_row_() for each in self.revisions(after=max(0, head - _LATEST))][::-1]
        latest = html.heading("The latest revisions") + html.table(last) if last else ""
        counts = {"revision": head, **history.overview.read_overview(state_of(self))._asdict()}
        return html.heading(self.factory.label) + html.fields(counts) + latest

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
