"""The front door: a knowledge base with its DAOs and questions, and a store of many."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, cast

from . import acts, documents, history, html, reasoning
from .arguments import expect, flag, whole_number
from .dao.base import refuse_past
from .errors import InvalidArgumentError, InvalidUrlError
from .factory import DaoFactory, SqlDaoFactory, create_dao_factory, daos_only, family_of
from .history.merged import Decision, Merge
from .history.moments import is_valid_clock, refuse_valid
from .knowledge.sayings import COMMITTED
from .moment_text import When
from .sql.changes import Change
from .sql.dialects import create_backend, dialect_name
from .sql.inventory import Catalog, Inventory
from .sql.schema import ensure_schema
from .store.state import State
from .store.store import close_backend

# Public names that `kant_sql` does not export.
__all__ = ["Executions", "KeptRules", "Operations", "PddlParts"]

# Revisions of a knowledge base that a notebook shows.
_LATEST = 5
# Writers take all but one of them.
CONNECTIONS, FEWEST_CONNECTIONS = 8, 2

P = ParamSpec("P")
R = TypeVar("R")


class Front:
    """A knowledge base, or one of its parts."""

    def __init__(self, factory: DaoFactory, *, state: State | None = None) -> None:
        self._factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self._state = state
        if state is None and isinstance(factory, SqlDaoFactory):
            self._state = factory.state


def factory_of(front: Front) -> DaoFactory:
    """Return the factory of the DAOs."""
    return front._factory


def state_of(front: Front) -> State:
    """Return the state that functions of a state read.

    Raises:
        InvalidUrlError: the DAO family has no SQL store, and so only DAOs.
        ClosedError: the store was closed.
    """
    state = front._state
    if state is None:
        raise daos_only(front._factory, "history, documents and reasoning")
    if state.store.is_closed:
        state.store.refuse_closed()
    return state


def creates(create: Callable[[DaoFactory], R]) -> cached_property[R]:
    """Bind a factory method: an attribute with the DAO, created on first use."""

    @wraps(create)
    def make(front: Front) -> R:
        return cast(R, getattr(front._factory, create.__name__)())

    make.__doc__ = (create.__doc__ or "").replace("Create the", "The")
    return cached_property(cast(Callable[[Any], R], make))


class _Question:
    """Makes the method on first use, and replaces this descriptor by it."""

    def __init__(self, make: Callable[[], Callable[..., Any]]) -> None:
        self._make = make

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = owner, name

    def __get__(self, front: object, owner: type | None = None) -> Any:
        method = self._make()
        setattr(*self._place, method)
        return method.__get__(front, owner)


def _bound(
    find: Callable[[], Callable[Concatenate[State, P], R]],
    state: Callable[[Front], State],
    *,
    is_of_range: bool = False,
) -> Callable[Concatenate[Front, P], R]:
    def make() -> Callable[..., R]:
        function = find()

        @wraps(function)
        def ask(self: Front, /, *args: P.args, **kwargs: P.kwargs) -> R:
            if is_of_range:
                refuse_valid(self._state, function.__name__)
            return function(state(self), *args, **kwargs)

        return _method(ask)

    return cast("Callable[Concatenate[Front, P], R]", _Question(make))


def reads(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a function of a state as a method, with its docstring, arguments and defaults.

    `find` returns it. Its module is imported on first use of the method.
    """
    return _bound(find, state_of)


def reviews(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a function about a range of revisions, like `reads`; states of valid time refuse it."""
    return _bound(find, state_of, is_of_range=True)


def writes(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a function that writes, like `reads`; views of the past refuse it."""
    return _bound(find, _present_of)


def _present_of(front: Front) -> State:
    """Return the state for functions that write; refuse a view of the past."""
    state = state_of(front)
    if state.at is not None:
        refuse_past(state.store, state.at)
    return state


def delegates(
    method: Callable[Concatenate[DaoFactory, P], R],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a method of the factory, like `reads`."""

    @wraps(method)
    def call(self: Front, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return cast(Callable[P, R], getattr(self._factory, method.__name__))(*args, **kwargs)

    return call


def _method(bound: Callable[..., R]) -> Callable[..., R]:
    """Replace the state by `self` in the signature and the annotations."""
    shown = inspect.signature(bound)
    state, *others = shown.parameters.values()
    own = state.replace(name="self", annotation=inspect.Parameter.empty)
    bound.__signature__ = shown.replace(parameters=[own, *others])  # type: ignore[attr-defined]
    hints = bound.__annotations__.items()
    bound.__annotations__ = {name: hint for name, hint in hints if name != state.name}
    return bound


class PddlParts(Front):
    """`kb.pddl`: the rarer parts of PDDL, and whole documents as trees."""

    processes = creates(DaoFactory.create_pddl_process_dao)
    events = creates(DaoFactory.create_pddl_event_dao)
    derived_predicates = creates(DaoFactory.create_derived_predicate_dao)
    timed_initial_literals = creates(DaoFactory.create_timed_initial_literal_dao)
    initial_literals = creates(DaoFactory.create_initial_literal_dao)
    constraints = creates(DaoFactory.create_constraint_dao)
    domain_constraints = creates(DaoFactory.create_domain_constraint_dao)
    metric = creates(DaoFactory.create_metric_dao)

    metric_value = reads(lambda: reasoning.explain.metric_value)
    check_rules = reviews(lambda: reasoning.rules.check_rules)
    causal_links = reviews(lambda: reasoning.links.causal_links)
    broken_invariants = reads(lambda: reasoning.durative.broken_invariants)

    domain = reads(lambda: documents.exchange.domain)
    problem = reads(lambda: documents.exchange.problem)
    requirements = reads(lambda: documents.exchange.requirements)
    complete = reads(lambda: reasoning.complete.complete)
    to_unified_planning = reads(lambda: documents.exchange.to_unified_planning)
    load_unified_planning = writes(lambda: documents.exchange.load_unified_planning)


class KeptRules(Front):
    """`kb.rules`: rules kept in the store, which report violations or refuse them."""

    get = reads(lambda: reasoning.kept_rules.get)
    get_all = reads(lambda: reasoning.kept_rules.get_all)
    save = writes(lambda: reasoning.kept_rules.save)
    delete = writes(lambda: reasoning.kept_rules.delete)
    standing = reviews(lambda: reasoning.rule_watch.standing)


class Executions(Front):
    """`kb.executions`: executions, and reports of components that act without PDDL."""

    get = reads(lambda: acts.executions.get)
    get_all = reviews(lambda: acts.executions.get_all)
    report = writes(lambda: acts.executions.report)


class Operations(Front):
    """`kb.store`: verification, anchors, archives and replication of a knowledge base.

    The functions of `kant_sql.operations` take the URL of a whole store.
    """

    revisions = reads(lambda: history.log.revisions)
    verify = reviews(lambda: history.verify.verify.verify)
    anchor = reviews(lambda: history.anchors.anchor)
    archive = writes(lambda: history.archive.archive.archive)
    retain = writes(lambda: history.erasure.retention.retain)
    push = writes(lambda: history.replication.calls.push)
    promote = writes(lambda: history.replication.calls.promote)
    to_arrow = reviews(lambda: history.anchors.to_arrow)

    @property
    def factory(self) -> DaoFactory:
        """The factory of the DAOs: the family of the store, its address and its name."""
        return self._factory


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
    when = reviews(lambda: reasoning.when.when)
    consequences = reviews(lambda: reasoning.because.consequences)
    origins = reviews(lambda: reasoning.because.origins)
    unsatisfied = reads(lambda: reasoning.explain.unsatisfied)
    why_not = reads(lambda: reasoning.act.why_not)
    applicable_actions = reads(lambda: reasoning.act.applicable_actions)
    apply = writes(lambda: reasoning.durative.apply)
    start = writes(lambda: reasoning.durative.start)
    end = writes(lambda: reasoning.durative.end)
    abort = writes(lambda: reasoning.durative.abort)
    fail = writes(lambda: acts.executions.fail)
    statistics = reviews(lambda: acts.statistics.statistics)
    execute = writes(lambda: reasoning.execute.execute)
    plan = reads(lambda: reasoning.search.plan)
    replan = writes(lambda: reasoning.replan.replan)
    validate = reads(lambda: reasoning.validate.validate)
    state = reads(lambda: reasoning.memory.state)
    commit = writes(lambda: reasoning.memory.commit)

    log = reviews(lambda: history.log.log)
    changes = reviews(lambda: history.follow.changes)
    watch = reviews(lambda: history.follow.watch)
    watch_rules = reviews(lambda: reasoning.rule_watch.watch_rules)
    history = reviews(lambda: history.versions.history)
    blame = reviews(lambda: history.versions.blame)
    unconfirmed = reviews(lambda: history.confirmations.unconfirmed)
    contradicted = reviews(lambda: history.confirmations.contradicted)
    corrections = reviews(lambda: history.corrections.corrections)
    stale = reviews(lambda: reasoning.stale.stale)
    timeline = reviews(lambda: history.timeline.timeline)
    restore = writes(lambda: history.restore.restore)
    erasure_preview = writes(lambda: history.erasure.preview.erasure_preview)
    erase = writes(lambda: history.erasure.erase.erase)

    @cached_property
    def pddl(self) -> PddlParts:
        """Rarer parts of PDDL, and whole documents as trees."""
        return PddlParts(self._factory, state=self._state)

    @cached_property
    def executions(self) -> Executions:
        """Executions: read them, and report acts without PDDL."""
        return Executions(self._factory, state=self._state)

    @cached_property
    def rules(self) -> KeptRules:
        """Rules kept in the store."""
        return KeptRules(self._factory, state=self._state)

    @cached_property
    def store(self) -> Operations:
        """Operations on the store: verification, anchors, archives, replication."""
        return Operations(self._factory, state=self._state)

    def diff(
        self, a: When | KnowledgeBase, b: When | KnowledgeBase, *, clock: str = COMMITTED
    ) -> list[Change]:
        """Compare two states. Recorded plans and archives are not part of a state.

        Args:
            a: a revision, given as for `at`; or another knowledge base, in any store, such as a
                branch.
            b: likewise; before or after `a`.
            clock: `committed`, or `valid` to compare the states that were true at two times, as
                known in this state; then a revision means its time.

        Returns:
            The changes from `a` to `b`: `+` for elements of `b` only, `-` for elements of `a` only,
            sorted by sign, kind and text. For knowledge bases, they include pending changes.

        Raises:
            UnknownRevisionError: there is no such revision yet, or a time lies in the future or
                has no zone.
            ArchivedError: one of the states was moved to an archive.
            InvalidArgumentError: there is no such clock, or `a` or `b` is a knowledge base.

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
        is_valid = is_valid_clock(clock)
        if not (isinstance(a, KnowledgeBase) or isinstance(b, KnowledgeBase)):
            refuse_valid(self._state, "diff")
            compare = history.diff.valid_diff if is_valid else history.diff.diff
            return compare(state_of(self), a, b)
        if is_valid:
            raise InvalidArgumentError(
                "clock='valid' compares two times of this knowledge base; of another one, give "
                "kb.at(valid=...)"
            )
        here, there = (
            state_of(one if isinstance(one, KnowledgeBase) else self.at(one)) for one in (a, b)
        )
        return history.diff.diff_states(here, there)

    def at(
        self, when: When | None = None, *, known: When | None = None, valid: When | None = None
    ) -> Self:
        """Open a past state for reading; writes raise `ReadOnlyError`.

        Args:
            when: a revision's number (0 is before the first), an aware time up to now, or a text of
                either: `2026-01-31T09:30:00Z` (UTC unless it has a zone), `2 hours ago`,
                `yesterday 14:03`, `now`. It selects the state as known then.
            known: the same as `when`, by name.
            valid: a time, for the state that was true then, as known now or at `known`. Facts and
                values are those of that time, goals those of the known time; definitions are the
                last ones of all elements known since. This state refuses questions about a range of
                revisions.

        Returns:
            The same DAOs on that state.

        Raises:
            UnknownRevisionError: there is no such revision yet, the time lies in the future or has
                no zone, or none of the three is given.
            InvalidArgumentError: a text is neither a revision's number nor a time, `valid` is not a
                time, or you gave both `when` and `known`.
            ArchivedError: a part of that state is in an archive.

        Examples:
            >>> kb.at(0).propositions.get_all()
            []
            >>> kb.at("yesterday").revision
            0
        """
        return type(self)(self._factory.at(when, known=known, valid=valid))

    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> Self:
        """Create a knowledge base from a state of this one, to try something out.

        The branch gets the whole state (definitions, facts, goals and values) in the same order, so
        both write the same documents. (A domain or problem that was never loaded has the name of
        its knowledge base, as does a branch without `name`.) Recorded plans and the history are not
        copied. The first revision of the branch names this knowledge base, its revision and that
        revision's hash in `source`, as `parent`, `revision` and `hash`; a branch of an empty state
        has no revision yet.

        Args:
            name: the name of the branch; None for the name of this knowledge base.
            at: a revision, given as for `at`; None for the present, or for this past state.
            url: the store of the branch, on any dialect; a new SQLite file is created. None for
                this store with a `name`, and without one for a store in memory, which closing the
                branch deletes. A store in memory that `connect` opened holds one knowledge base, so
                its branches are in other stores in memory.

        Returns:
            The branch, which writes as the same actor; close it like any knowledge base.

        Raises:
            ConflictError: the store has a knowledge base of that name.
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: a part of that state is in an archive.
            ReadOnlyError: the task or thread has a transaction open: pending changes have no
                revision that the branch could name.
            InvalidUrlError: the URL is not valid, or its family has no branches.

        Examples:
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.delete_all()
            ...     print(kb.diff(kb, trial)[0])
            Change(sign='-', kind='fact', text='(robot_at rb1 wp1)')
        """
        return type(self)(self._factory.branch(name, at=at, url=url))

    def merge_preview(
        self, branch: KnowledgeBase, *, decide: Mapping[str, Decision] | None = None
    ) -> Merge:
        """Compare a branch with this knowledge base as a merge would, but write nothing.

        Args:
            branch: as for `merge`.
            decide: as for `merge`; decisions may be missing.

        Returns:
            The changes; the conflicts with who wrote, when and why on both sides; and why the
            result would be refused, if so. For the latter, and for rules that the result would
            break, it writes and rolls back; a read-only knowledge base, in a copy in memory.

        Raises:
            ConflictError: this is not a branch of this knowledge base.
            ArchivedError: a part of the changes of either side is in an archive.

        Examples:
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.delete("(robot_at rb1 wp1)")
            ...     print(*kb.merge_preview(trial).changes)
            Change(sign='-', kind='fact', text='(robot_at rb1 wp1)')
        """
        here = _present_of(self)
        other = state_of(expect(branch, KnowledgeBase, "the branch", InvalidArgumentError))
        return history.merge.merge_preview(here, other, decide)

    def merge(
        self,
        branch: KnowledgeBase,
        *,
        decide: Mapping[str, Decision] | None = None,
        reason: str | None = None,
        actor: str | None = None,
        expected_revision: int | None = None,
    ) -> Merge:
        """Merge the changes of a branch since it began, as one revision here.

        The base is the state in which the branch began, or was merged last. The merge applies
        changes that only the branch has made since. A conflict is an element that both have changed
        differently, an element that one has deleted and the other now uses, or a refusing rule that
        the result would break. It merges definitions, facts, goals, values, rules, documents and
        sayings about periods; plans, executions and confirmations stay in the branch. The revision
        names in `source` the `branch`, its `revision` and its `hash`, and the `base` here.

        Args:
            branch: a branch of this knowledge base, in any store, or a past state of one.
            decide: for each conflict its `element`, and `ours` to keep this side, or `theirs`. A
                decision for a deletion also deletes the elements that mention the deleted one.
                `ours` also leaves out a saying without a conflict.
            reason: why; by default `merged NAME at revision NUMBER`.
            actor: who merges; by default the knowledge base's actor.
            expected_revision: the last revision, as in a preview's `head`; None for any.

        Returns:
            The changes, and the revision, which is None if nothing was new.

        Raises:
            MergeConflictError: conflicts are not decided; nothing was written.
            RuleViolatedError: with these decisions, the result would violate a refusing rule.
            ConflictError: this is not a branch of this knowledge base, definitions of one side do
                not fit elements of the other, or a revision cannot have all sayings of the branch.
            StaleRevisionError: another writer came first.
            InvalidArgumentError: a decision matches no conflict.
            ArchivedError: a part of the changes of either side is in an archive.
            ReadOnlyError: this is a view of the past, or one of the two has a transaction open.

        Examples:
            >>> with kb.branch() as trial:
            ...     _ = trial.propositions.delete("(robot_at rb1 wp1)")
            ...     print(kb.merge(trial).revision)
            2
        """
        here = _present_of(self)
        other = state_of(expect(branch, KnowledgeBase, "the branch", InvalidArgumentError))
        return history.merge.merge(here, other, decide, reason, actor, expected_revision)

    @property
    def revision(self) -> int:
        """The number of the last revision, 0 before the first.

        Within a transaction, the revision from which it began; for a past state, its revision.
        """
        return self._factory.revision

    def close(self) -> None:
        """Close the database connections. This deletes a store in memory.

        Later calls raise `ClosedError`, also on past states. An open transaction is rolled back:
        this thread's at once, others at the end of their blocks. Closing a past state does nothing.
        """
        self._factory.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._factory.label}>"

    def _repr_html_(self) -> str:
        return html.guarded(self._shown)

    def _shown(self) -> str:
        """Write the counts of the state, and its last changes."""
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
    clock: str = COMMITTED,
) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        url: the database URL: `sqlite:///robot.db` for a file, `sqlite://` for a store in memory,
            `postgresql://user@host/database` for a server.
        knowledge_base: the knowledge base's name; the first write creates it.
        actor: who writes, by default.
        read_only: whether the database refuses all writes of these connections; each raises
            `ReadOnlyError`. The store must exist: nothing is created.
        clock: `observed` to use `observed_at` of a transaction as its `valid_from`; if it is not
            before the store's clock, the transaction is valid from now on.

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
    own: Any = {"knowledge_base": knowledge_base, "actor": actor, "read_only": read_only}
    return KnowledgeBase(create_dao_factory(url, **own, clock=clock))


class KnowledgeStore:
    """A store whose knowledge bases share a few connections.

    Threads may share it. Use it as a context manager, or call `close`.

    Attributes:
        connections: the maximum number of connections to a server.
        catalog: pages of its knowledge bases, and searches by name.
    """

    def __init__(
        self, url: str, *, connections: int = CONNECTIONS, read_only: bool = False
    ) -> None:
        """Open the store, as `open_store` describes."""
        family = family_of(url)
        if not issubclass(family, SqlDaoFactory):
            raise InvalidUrlError(
                f"{dialect_name(url)}: this DAO family shares no connections; use kant_sql.connect"
            )
        self._family = family
        self.connections = connections
        self._backend = create_backend(url, read_only=read_only, connections=connections)
        self.catalog = Catalog(self._backend)
        try:
            ensure_schema(self._backend)
        except BaseException:
            self._backend.close()
            raise

    @property
    def address(self) -> str:
        """The URL of the store for messages, without a password."""
        return self._backend.label

    @property
    def has_one_connection(self) -> bool:
        """Whether all threads take turns on one connection, as in memory."""
        return self._backend.has_one_connection

    @property
    def writers(self) -> int:
        """The maximum number of open transactions."""
        # One queue for all knowledge bases: there is one writer.
        is_one = self._backend.queue("a") == self._backend.queue("b")
        return 1 if is_one else self.connections - 1

    def knowledge_base(
        self, name: str = "default", *, actor: str | None = None, clock: str = COMMITTED
    ) -> KnowledgeBase:
        """Open a knowledge base on the shared connections, without a statement.

        Keep it while you use it: it caches definitions and up to 2,000 facts, which saves
        statements. Closing it closes no connection.

        Args:
            name: the knowledge base's name; the first write creates it.
            actor: who writes, by default.
            clock: as for `kant_sql.connect`.

        Returns:
            The knowledge base.

        Raises:
            InvalidMetadataError: `name` cannot name a knowledge base.
            ClosedError: the store was closed.

        Examples:
            >>> import kant_sql
            >>> from kant_sql import PddlTypeDto
            >>> with kant_sql.open_store("sqlite://") as store:
            ...     for name in ("tiago", "pepper"):
            ...         _ = store.knowledge_base(name).types.save(PddlTypeDto("robot"))
            ...     print([(one.name, one.revision) for one in store.knowledge_bases()])
            [('tiago', 1), ('pepper', 1)]
        """
        self._backend.refuse_closed()
        return KnowledgeBase(self._family.one_of_many(self._backend, name, actor, clock))

    def knowledge_bases(self) -> list[Inventory]:
        """List the knowledge bases that have a revision, oldest first.

        Returns:
            The knowledge bases, oldest first.
        """
        return self.catalog.every()

    def close(self) -> None:
        """Close all knowledge bases and all connections. This deletes a store in memory.

        Open transactions are rolled back: this thread's at once, others at the end of their blocks.
        """
        close_backend(self._backend)

    def __repr__(self) -> str:
        closed = ", closed" if self._backend.is_closed else ""
        return f"<{type(self).__name__} {self.address}{closed}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def open_store(url: str, *, connections: int = 8, read_only: bool = False) -> KnowledgeStore:
    """Open a store, to work with many knowledge bases over a few connections.

    A transaction holds a connection until its block ends. One connection is reserved for reading,
    so one fewer than `connections` can write at once; other writers and readers wait without a
    connection, for up to 20 s. All watchers share one more connection.

    Args:
        url: the database URL, as for `kant_sql.connect`.
        connections: the maximum number of connections to a server, besides that of the watchers; at
            least 2. A file, or a store in memory, needs no limit.
        read_only: whether the database refuses all writes of these connections.

    Returns:
        The store. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL is not valid, or its DAO family shares no connections.
        InvalidArgumentError: `connections` is less than 2.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    flag(read_only, "read_only", InvalidArgumentError)
    whole_number(
        connections, "connections", least=FEWEST_CONNECTIONS, expected="a whole number from 2 on"
    )
    return KnowledgeStore(url, connections=connections, read_only=read_only)
