"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, Self, TypeVar, cast

from . import html
from .arguments import expect
from .dao.base import refuse_past
from .documents.exchange import (
    domain,
    domain_pddl,
    load_domain,
    load_problem,
    problem,
    problem_pddl,
    requirements,
)
from .documents.planners import load_unified_planning, plan, to_unified_planning
from .errors import InvalidArgumentError
from .factory import DaoFactory, Daos, SqlDaoFactory, create_dao_factory, daos_only
from .history.anchors import anchor
from .history.archive.archive import archive
from .history.audit import to_arrow
from .history.diff import diff, diff_lines, state_lines
from .history.follow import changes, watch
from .history.log import log, revisions
from .history.overview import read_overview
from .history.replication.calls import push
from .history.replication.promote import promote
from .history.restore import restore
from .history.timeline import timeline
from .history.verify.verify import verify
from .history.versions import blame, history
from .moment_text import When
from .reasoning.act import applicable_actions, is_applicable, why_not
from .reasoning.ask import holds, query
from .reasoning.complete import complete
from .reasoning.durative import abort, apply, broken_invariants, end, start
from .reasoning.explain import is_goal_reached, metric_value, unsatisfied, unsatisfied_goals
from .reasoning.rules import check_rules
from .reasoning.validate import validate
from .reasoning.when import when
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


def reads(
    function: Callable[Concatenate[State, P], R],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a function of a state: a method with its docstring, arguments and defaults."""

    @wraps(function)
    def ask(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return function(state_of(self), *args, **kwargs)

    return _method(ask)


def writes(
    function: Callable[Concatenate[State, P], R],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a function that writes, as `reads`; views of the past refuse it."""

    @wraps(function)
    def write(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
        state = state_of(self)
        if state.at is not None:
            refuse_past(state.store, state.at)
        return function(state, *args, **kwargs)

    return _method(write)


def delegates(
    method: Callable[Concatenate[DaoFactory, P], R],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
    """Bind a method of the factory, as `reads`."""

    @wraps(method)
    def call(self: KnowledgeBase, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return cast(Callable[P, R], getattr(self.factory, method.__name__))(*args, **kwargs)

    return call


def _method(
    bound: Callable[Concatenate[KnowledgeBase, P], R],
) -> Callable[Concatenate[KnowledgeBase, P], R]:
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

    load_domain = writes(load_domain)
    load_problem = writes(load_problem)
    load_unified_planning = writes(load_unified_planning)
    domain = reads(domain)
    problem = reads(problem)
    domain_pddl = reads(domain_pddl)
    problem_pddl = reads(problem_pddl)
    requirements = reads(requirements)
    to_unified_planning = reads(to_unified_planning)
    plan = reads(plan)

    holds = reads(holds)
    query = reads(query)
    complete = reads(complete)
    unsatisfied = reads(unsatisfied)
    unsatisfied_goals = reads(unsatisfied_goals)
    is_goal_reached = reads(is_goal_reached)
    metric_value = reads(metric_value)
    why_not = reads(why_not)
    applicable_actions = reads(applicable_actions)
    is_applicable = reads(is_applicable)
    apply = writes(apply)
    start = writes(start)
    end = writes(end)
    abort = writes(abort)
    broken_invariants = reads(broken_invariants)
    validate = reads(validate)
    when = reads(when)
    check_rules = reads(check_rules)

    revisions = reads(revisions)
    log = reads(log)
    changes = reads(changes)
    watch = reads(watch)
    diff = reads(diff)
    history = reads(history)
    blame = reads(blame)
    timeline = reads(timeline)
    to_arrow = reads(to_arrow)
    restore = writes(restore)
    verify = reads(verify)
    anchor = reads(anchor)
    archive = writes(archive)
    push = writes(push)
    promote = writes(promote)

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
        return diff_lines(state_lines(state_of(self)), state_lines(state_of(other)))

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
        counts = {"revision": head, **read_overview(state_of(self))._asdict()}
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
