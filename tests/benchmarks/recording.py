"""Records the calls that the components of the coffee shop's robot make on their DAOs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from kant_sql import KnowledgeBase
from kant_sql.factory import SqliteDaoFactory

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

from kant_sql_plugins.demo.coffee_shop_tasks import TASKS, connect_robot, load

KNOWLEDGE_BASE = "coffee_shop"


class Call(NamedTuple):
    """A call of a DAO's method."""

    dao: str
    method: str
    arguments: tuple[Any, ...]


class Step(NamedTuple):
    """A call by itself, or a transaction with what was called in it."""

    actor: str
    calls: tuple[Call, ...]
    in_transaction: bool = False
    reason: str | None = None

    @property
    def kind(self) -> str:
        call = self.calls[0]
        return "transaction" if self.in_transaction else f"{call.dao}.{call.method}"


class RecordedDao:
    """Passes calls on to a DAO, and notes them."""

    def __init__(self, dao: object, name: str, note: Callable[[Call], None]) -> None:
        self._dao = dao
        self._name = name
        self._note = note

    def __getattr__(self, method: str) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            self._note(Call(self._name, method, arguments))
            return getattr(self._dao, method)(*arguments)

        return call


def _recorded(kind: str, name: str) -> Any:
    """A factory method whose DAO is recorded under a name."""
    method = "create_goal_dao" if kind == "goal" else f"create_pddl_{kind}_dao"

    def create(factory: RecordingFactory) -> RecordedDao:
        dao = getattr(super(RecordingFactory, factory), method)()
        return RecordedDao(dao, name, factory._note)

    # Front doors ask by name.
    create.__name__ = method
    return create


class RecordingFactory(SqliteDaoFactory):
    """Creates DAOs that note what they are called for."""

    def __init__(self, url: str, actor: str, steps: list[Step]) -> None:
        super().__init__(url, knowledge_base=KNOWLEDGE_BASE, actor=actor)
        self._actor = actor
        self._steps = steps
        self._calls: list[Call] | None = None

    def _note(self, call: Call) -> None:
        if self._calls is None:
            self._steps.append(Step(self._actor, (call,)))
        else:
            self._calls.append(call)

    create_pddl_type_dao = _recorded("type", "types")
    create_pddl_object_dao = _recorded("object", "objects")
    create_pddl_predicate_dao = _recorded("predicate", "predicates")
    create_pddl_proposition_dao = _recorded("proposition", "propositions")
    create_pddl_action_dao = _recorded("action", "actions")
    create_goal_dao = _recorded("goal", "goals")

    @contextmanager
    def transaction(self, *, reason: str | None = None, **options: Any) -> Iterator[None]:
        assert not options, "not replayed"
        self._calls = []
        with super().transaction(reason=reason):
            yield
        self._steps.append(Step(self._actor, tuple(self._calls), True, reason))
        self._calls = None


def record(folder: Path) -> tuple[list[Step], list[Step]]:
    """Let the robot work once: the steps that fill a new store, and those of an iteration on it."""
    steps: list[Step] = []
    url = f"sqlite:///{folder / 'recorded.db'}"

    def connect(actor: str) -> KnowledgeBase:
        return KnowledgeBase(RecordingFactory(url, actor, steps))

    with closing(connect_robot(connect)) as robot:
        load(robot)
        filling = [*steps]
        steps.clear()
        for task in TASKS.values():
            task(robot)
    return filling, steps
