"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from typing_extensions import override

from .arguments import expect
from .dao import interfaces as daos
from .dao.interfaces import forwarding
from .documents.interfaces import Exchange
from .errors import InvalidArgumentError
from .factory import Connection, DaoFactory, create_dao_factory
from .history.interfaces import History
from .plans.interfaces import PlanDao


@forwarding(factory=Connection, _exchange=Exchange, _history=History)
class KnowledgeBase(Exchange, History, Connection):
    """A robot's knowledge: its present state, its history, and its documents.

    Threads may share it. Use it as a context manager, or call `close`.

    Attributes:
        factory: the factory of the DAOs.
        types: the DAO of types.
        objects: the DAO of objects.
        predicates: the DAO of predicates.
        functions: the DAO of functions.
        function_values: the DAO of function values (fluents).
        propositions: the DAO of facts and goals.
        actions: the DAO of actions.
        processes: the DAO of processes.
        events: the DAO of events.
        derived_predicates: the DAO of the rules of derived predicates.
        timed_initial_literals: the DAO of timed initial literals and values.
        initial_literals: the DAO of negative literals and equalities of the initial state.
        goals: the DAO of goals of any form.
        constraints: the DAO of the problem's constraints.
        domain_constraints: the DAO of the domain's constraints.
        metric: the DAO of the metric.
        plans: the DAO of recorded plans.
    """

    types: daos.PddlTypeDao
    objects: daos.PddlObjectDao
    predicates: daos.PddlPredicateDao
    functions: daos.PddlFunctionDao
    function_values: daos.PddlFunctionValueDao
    propositions: daos.PddlPropositionDao
    actions: daos.PddlActionDao
    processes: daos.PddlProcessDao
    events: daos.PddlEventDao
    derived_predicates: daos.DerivedPredicateDao
    timed_initial_literals: daos.TimedInitialLiteralDao
    initial_literals: daos.InitialLiteralDao
    goals: daos.GoalDao
    constraints: daos.ConstraintDao
    domain_constraints: daos.ConstraintDao
    metric: daos.MetricDao
    plans: PlanDao

    def __init__(self, factory: DaoFactory) -> None:
        """Create the DAOs.

        Args:
            factory: the factory; the knowledge base owns it.
        """
        self.factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self._exchange = factory.create_exchange()
        self._history = factory.create_history()
        self.types = factory.create_pddl_type_dao()
        self.objects = factory.create_pddl_object_dao()
        self.predicates = factory.create_pddl_predicate_dao()
        self.functions = factory.create_pddl_function_dao()
        self.function_values = factory.create_pddl_function_value_dao()
        self.propositions = factory.create_pddl_proposition_dao()
        self.actions = factory.create_pddl_action_dao()
        self.processes = factory.create_pddl_process_dao()
        self.events = factory.create_pddl_event_dao()
        self.derived_predicates = factory.create_derived_predicate_dao()
        self.timed_initial_literals = factory.create_timed_initial_literal_dao()
        self.initial_literals = factory.create_initial_literal_dao()
        self.goals = factory.create_goal_dao()
        self.constraints = factory.create_constraint_dao()
        self.domain_constraints = factory.create_domain_constraint_dao()
        self.metric = factory.create_metric_dao()
        self.plans = factory.create_plan_dao()

    @override
    def at(self, when: int | datetime) -> Self:
        return type(self)(self.factory.at(when))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def connect(
    url: str, *, knowledge_base: str = "default", actor: str | None = None
) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        url: the database URL: `sqlite:///robot.db` for a file, `sqlite://` for a store in memory,
            `postgresql://user@host/database` for a server.
        knowledge_base: the knowledge base's name; the first write creates it.
        actor: who writes, by default.

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
    return KnowledgeBase(create_dao_factory(url, knowledge_base=knowledge_base, actor=actor))
