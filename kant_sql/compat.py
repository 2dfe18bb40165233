"""The drop-in for the original KANT library's Python API.

A program written for it changes its imports and its URI, nothing else::

    from kant_sql.compat import DaoFactoryMethod, DaoFamilies, PddlTypeDto

    dao_factory = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri="sqlite:///robot.db")

`install` keeps even its imports. As in the original:

- Writes return False for ill-typed knowledge, and log the reason to `kant_sql.compat`; errors of
  the store are raised. Constructors and setters of DTOs raise `InvalidKnowledgeError` for an
  argument of the wrong class, for example a predicate that is None.
- `get_all` of named elements sorts them by name, types after those below them.
- Saving an element redefines the elements that it refers to, unless others use them.
- It keeps details that the original's DTOs cannot express: the parent of a type, and that an object
  is a constant. `delete_all` of objects spares constants, which belong to the domain.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable
from enum import IntEnum
from graphlib import TopologicalSorter
from types import ModuleType
from typing import Any, Generic, Protocol, Self, TypeVar

from typing_extensions import override

from .arguments import URL_VARIABLE, expect, shown
from .dao.base import redefining_references
from .dao.interfaces import AnyDao, Dao, GoalDao, NamedDao, PddlPropositionDao
from .dto import (
    Dto,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from .dto.elements import NamedDto
from .dto.formulas import Atom
from .dto.lexical import fold
from .errors import (
    ConflictError,
    DependantsError,
    InvalidArgumentError,
    InvalidKnowledgeError,
    InvalidUrlError,
    UnknownNameError,
)
from .factory import DaoFactory as _SqlDaoFactory
from .factory import create_dao_factory

__all__ = [
    "CompatDao",
    "CompatDefinitionDao",
    "CompatNamedDao",
    "CompatObjectDao",
    "CompatPropositionDao",
    "CompatTypeDao",
    "DaoFactory",
    "DaoFactoryMethod",
    "DaoFamilies",
    "Dto",
    "ParameterLoader",
    "PddlActionDto",
    "PddlConditionEffectDto",
    "PddlObjectDto",
    "PddlPredicateDto",
    "PddlPropositionDto",
    "PddlTypeDto",
    "Ros2DaoFactory",
    "install",
]

logger = logging.getLogger(__name__)

D = TypeVar("D", bound=Dto)
N = TypeVar("N", bound=NamedDto)


class DaoFamilies(IntEnum):
    """The families of the original and of this library. The URI alone selects the database."""

    ROS2 = 0
    MONGO = 1
    SQL = 2


class CompatDao(Generic[D]):
    """A DAO that returns False for ill-typed knowledge."""

    def __init__(self, dao: Dao[D, Any], factory: _SqlDaoFactory) -> None:
        self._dao = dao
        self._factory = factory

    def get_all(self) -> list[D]:
        """Read all elements of the kind."""
        return self._dao.get_all()

    def _save(self, dto: D) -> bool:
        """Save an element; return False if it is already stored, or is ill-typed."""
        return self._put(self._of(dto).insert, dto)

    def _update(self, dto: D) -> bool:
        """Save a stored element; return False if it is not stored, or is ill-typed."""
        return self._put(self._dao.update, dto)

    def save(self, dto: D) -> bool:
        """Insert or update an element; return False when it is ill-typed."""
        return self._put(self._of(dto).save, dto)

    def delete(self, dto: D) -> bool:
        """Delete an element and everything that depends on it; return False when it is absent."""
        return _answered(lambda: self._of(dto).delete(dto))

    def delete_all(self) -> bool:
        """Delete all elements of the kind and everything that depends on them; return True."""
        self._dao.delete_all()
        return True

    def _of(self, dto: D) -> AnyDao[Any, Any]:
        """Return the DAO that takes an element."""
        return self._dao

    def _put(self, call: Callable[[D], bool], dto: D) -> bool:
        def work() -> bool:
            try:
                return self._write(call, dto)
            except ConflictError:
                return self._redefine(dto)

        return _answered(work)

    def _write(self, call: Callable[[D], bool], dto: D) -> bool:
        """Write an element, with stored details that its DTO cannot express."""
        return call(dto)

    def _redefine(self, dto: D) -> bool:
        """Save an element, and redefine referenced elements that nothing else uses."""
        with self._factory.transaction():
            self._forget(dto)
            with redefining_references():
                self._write(self._of(dto).save, dto)
            # Now the whole element has to agree with the store.
            return self._write(self._of(dto).save, dto)

    def _forget(self, dto: D) -> None:
        """Retract an element without dependants, so that it uses nothing."""
        self._of(dto).delete(dto)


class CompatNamedDao(CompatDao[N]):
    """A DAO of named elements that returns False for ill-typed knowledge."""

    def __init__(self, dao: NamedDao[N], factory: _SqlDaoFactory) -> None:
        super().__init__(dao, factory)
        self._named = dao

    def get(self, name: str) -> N | None:
        """Read one element, by its name in any case; None if it is not stored."""
        return self._named.get(name)

    @override
    def get_all(self) -> list[N]:
        """Read all elements of the kind, sorted by name."""
        return sorted(super().get_all(), key=lambda dto: dto.name)


class CompatDefinitionDao(CompatNamedDao[N]):
    """A DAO of named elements that others depend on."""

    @override
    def _forget(self, dto: N) -> None:
        """Keep an element that others may depend on."""

    @override
    def _write(self, call: Callable[[N], bool], dto: N) -> bool:
        # A program without types may give anything.
        name = getattr(dto, "name", None)
        if not isinstance(name, str):
            return call(dto)
        with self._factory.transaction():
            stored = self._named.get(name)
            if stored is None or not isinstance(dto, type(stored)):
                return call(dto)
            return call(self._completed(dto, stored))

    def _completed(self, dto: N, stored: N) -> N:
        """Add stored details that the element's DTO cannot express."""
        return dto


class CompatTypeDao(CompatDefinitionDao[PddlTypeDto]):
    """The DAO of types; a type that is saved without a parent keeps its stored parent."""

    @override
    def get_all(self) -> list[PddlTypeDto]:
        """Read all types, those furthest from the root first, and otherwise by name.

        So subtypes come before the types above them, and those of no type come last: after
        `robot`, `room - place` would say in PDDL that both are places.
        """
        types = {dto.name: dto for dto in super().get_all()}
        order: TopologicalSorter[str] = TopologicalSorter()
        for name, dto in types.items():
            above = dto.parent.types if isinstance(dto.parent, PddlEitherTypeDto) else [dto.parent]
            order.add(name, *(each.name for each in above if each is not None))
        order.prepare()
        found: list[PddlTypeDto] = []
        while order.is_active():
            names = order.get_ready()
            found = [*(types[name] for name in sorted(names) if name in types), *found]
            order.done(*names)
        return found

    @override
    def _completed(self, dto: PddlTypeDto, stored: PddlTypeDto) -> PddlTypeDto:
        return stored if dto.parent is None else dto


class CompatObjectDao(CompatDefinitionDao[PddlObjectDto]):
    """The DAO of objects; constants stay constants, and `delete_all` spares them."""

    @override
    def delete_all(self) -> bool:
        """Delete all objects but constants, and everything that depends on them; return True."""
        with self._factory.transaction():
            self._named.delete_all([dto for dto in self._dao.get_all() if not dto.is_constant])
        return True

    @override
    def _completed(self, dto: PddlObjectDto, stored: PddlObjectDto) -> PddlObjectDto:
        if not stored.is_constant:
            return dto
        return PddlObjectDto(dto.type, dto.name, is_constant=True)


class CompatPropositionDao(CompatDao[PddlPropositionDto]):
    """The DAO of facts and goals; it returns False for ill-typed knowledge."""

    def __init__(self, facts: PddlPropositionDao, goals: GoalDao, factory: _SqlDaoFactory) -> None:
        super().__init__(facts, factory)
        self._facts = facts
        self._goals = goals

    @override
    def get_all(self) -> list[PddlPropositionDto]:
        """Read the facts, then the goals."""
        return [*self.get_no_goals(), *self.get_goals()]

    def get_by_predicate(self, predicate_name: str) -> list[PddlPropositionDto]:
        """Read the facts and the goals of one predicate."""
        try:
            facts = self._facts.get_by_predicate(predicate_name)
        except UnknownNameError:
            return []
        name = fold(predicate_name)
        return facts + [
            goal for goal in self._goals.get_propositions() if fold(goal.predicate.name) == name
        ]

    def get_goals(self) -> list[PddlPropositionDto]:
        """Read the goals that are propositions; others are left out, and the log says so."""
        others = [goal for goal in self._goals.get_all() if not isinstance(goal, Atom)]
        if others:
            said = ", ".join(map(str, others))
            logger.warning("formulas are no propositions, and as goals are left out: %s", said)
        return self._goals.get_propositions()

    def get_no_goals(self) -> list[PddlPropositionDto]:
        """Read the facts."""
        return self._facts.get_all()

    @override
    def _update(self, dto: PddlPropositionDto) -> bool:
        """Save a stored proposition; return False if it is not stored, or is ill-typed."""
        if self._of(dto) is self._dao:
            return super()._update(dto)
        with self._factory.transaction():
            stored = {fold(str(goal)) for goal in self._goals.get_propositions()}
            return fold(str(dto)) in stored and self.save(dto)

    @override
    def delete_all(self) -> bool:
        """Delete all facts and goals; return True."""
        with self._factory.transaction():
            self._goals.delete_all(self._goals.get_propositions())
            return super().delete_all()

    @override
    def _of(self, dto: PddlPropositionDto) -> AnyDao[Any, Any]:
        # A program without types may give anything.
        return self._goals if getattr(dto, "is_goal", False) is True else self._dao


class DaoFactory:
    """Creates the DAOs, like the original's factories: of a database, and for a ROS 2 node.

    Attributes:
        knowledge_base: the name of the knowledge base.
        actor: who writes.
    """

    def __init__(
        self,
        uri: str | None = None,
        *,
        node: object | None = None,
        knowledge_base: str = "default",
        actor: str | None = None,
    ) -> None:
        """Open a knowledge base, as `DaoFactoryMethod.create_dao_factory` describes."""
        self._uri = uri or os.environ.get(URL_VARIABLE) or ""
        if not self._uri:
            raise InvalidUrlError(
                "no database is named: give uri=, the parameter 'uri' of the node, or the "
                f"environment variable {URL_VARIABLE}, for example sqlite:///robot.db"
            )
        self._node = node
        self._given_actor = actor
        self.knowledge_base = knowledge_base
        self.connect()

    @classmethod
    def of(cls, factory: _SqlDaoFactory) -> Self:
        """Create the DAOs of an open store, which share its transactions."""
        made = cls.__new__(cls)
        made._factory = factory
        return made

    @property
    def actor(self) -> str | None:
        """Who writes: the given actor, or else the name of the node."""
        get_name = getattr(self._node, "get_name", None)
        if self._given_actor is not None or get_name is None:
            return self._given_actor
        return expect(get_name(), str, "the name of the node", InvalidArgumentError)

    def connect(self) -> None:
        """Open the database of the URI, for DAOs that are created from now on."""
        self._factory = create_dao_factory(
            self._uri, knowledge_base=self.knowledge_base, actor=self.actor
        )

    def get_uri(self) -> str:
        """Return the database URL."""
        return self._uri

    def set_uri(self, uri: str) -> None:
        """Open another database, for DAOs that are created from now on."""
        self._uri = uri
        self.connect()

    def get_node(self) -> object | None:
        """Return the ROS 2 node, if one was given."""
        return self._node

    def set_node(self, node: object | None) -> None:
        """Set the ROS 2 node, which is the actor of DAOs that are created from now on."""
        self._node = node
        self.connect()

    def create_pddl_type_dao(self) -> CompatTypeDao:
        """Create the DAO of types."""
        return CompatTypeDao(self._factory.create_pddl_type_dao(), self._factory)

    def create_pddl_object_dao(self) -> CompatObjectDao:
        """Create the DAO of objects."""
        return CompatObjectDao(self._factory.create_pddl_object_dao(), self._factory)

    def create_pddl_predicate_dao(self) -> CompatDefinitionDao[PddlPredicateDto]:
        """Create the DAO of predicates."""
        return CompatDefinitionDao(self._factory.create_pddl_predicate_dao(), self._factory)

    def create_pddl_proposition_dao(self) -> CompatPropositionDao:
        """Create the DAO of propositions."""
        facts = self._factory.create_pddl_proposition_dao()
        return CompatPropositionDao(facts, self._factory.create_goal_dao(), self._factory)

    def create_pddl_action_dao(self) -> CompatNamedDao[PddlActionDto]:
        """Create the DAO of actions."""
        return CompatNamedDao(self._factory.create_pddl_action_dao(), self._factory)


class Ros2DaoFactory(DaoFactory):
    """A factory for a ROS 2 node; the environment has the URL."""

    def __init__(self, node: object) -> None:
        """Open the knowledge base that the environment names, for a node."""
        super().__init__(node=node)


class DaoFactoryMethod:
    """Creates the factory, like the original's factory method."""

    dao_families = DaoFamilies

    def create_dao_factory(
        self,
        family: int,
        *,
        uri: str | None = None,
        node: object | None = None,
        knowledge_base: str = "default",
        actor: str | None = None,
    ) -> DaoFactory:
        """Create the factory.

        Args:
            family: a member of `DaoFamilies`; any of them works with any URI.
            uri: the database URL; by default that of the environment variable `KANT_SQL_URL`.
            node: the ROS 2 node of the program.
            knowledge_base: the knowledge base's name; the first write creates it.
            actor: who writes; by default the node's name.

        Returns:
            The factory.

        Raises:
            InvalidArgumentError: there is no such family; it is a `ValueError`.
            InvalidUrlError: no URI is given, or no DAO family supports it.
            SchemaError: the database's tables are missing, outdated or too new.
            StoreError: the database cannot be opened.
        """
        if not isinstance(family, int) or family not in list(DaoFamilies):
            raise InvalidArgumentError(f"{shown(family)} is not a valid DaoFamilies")
        return DaoFactory(uri, node=node, knowledge_base=knowledge_base, actor=actor)


class Parameter(Protocol):
    """A parameter of a ROS 2 node, as `rclpy` has it."""

    @property
    def value(self) -> object:
        """The value."""


class Node(Protocol):
    """The methods of a node of `rclpy` that `ParameterLoader` needs."""

    def get_name(self) -> str:
        """Return the node's name."""

    def has_parameter(self, name: str, /) -> bool:
        """Return whether a parameter is declared."""

    def declare_parameter(self, name: str, value: object, /) -> Parameter:
        """Declare a parameter, with its default."""

    def get_parameter(self, name: str, /) -> Parameter:
        """Return a declared parameter."""


class ParameterLoader:
    """Creates the factory from the parameters of a ROS 2 node.

    It declares `dao_family` (an integer), and as text `uri` with the database URL (or, as in the
    original, `mongo_uri`; by default the environment variable `KANT_SQL_URL`), `knowledge_base`,
    and `actor`, by default the node's name.
    """

    def __init__(self, node: Node) -> None:
        """Declare the parameters and open the knowledge base.

        Args:
            node: a node of `rclpy`.

        Raises:
            InvalidArgumentError, InvalidUrlError, SchemaError, StoreError: as
                `DaoFactoryMethod.create_dao_factory`.
        """
        if not hasattr(node, "has_parameter"):
            raise InvalidArgumentError(f"{shown(node)} is not a node of rclpy")

        def read(name: str, default: str | int) -> object:
            if not node.has_parameter(name):
                node.declare_parameter(name, default)
            return node.get_parameter(name).value

        family: Any = read("dao_family", int(DaoFamilies.SQL))
        texts = ("uri", ""), ("mongo_uri", ""), ("knowledge_base", "default"), ("actor", "")
        uri, mongo_uri, knowledge_base, actor = (str(read(*each)) for each in texts)
        self._factory = DaoFactoryMethod().create_dao_factory(
            family,
            uri=uri or mongo_uri or None,
            node=node,
            knowledge_base=knowledge_base,
            actor=actor or None,
        )

    def get_dao_factory(self) -> DaoFactory:
        """Return the factory."""
        return self._factory


def _answered(call: Callable[[], bool]) -> bool:
    """Make a call; return False and log the reason for refused knowledge."""
    try:
        return call()
    except (InvalidKnowledgeError, ConflictError, DependantsError) as error:
        logger.warning("refused: %s", error)
        return False


_DTOS: dict[str, type] = {
    "dto": Dto,
    "pddl_type_dto": PddlTypeDto,
    "pddl_object_dto": PddlObjectDto,
    "pddl_predicate_dto": PddlPredicateDto,
    "pddl_proposition_dto": PddlPropositionDto,
    "pddl_action_dto": PddlActionDto,
    "pddl_condition_effect_dto": PddlConditionEffectDto,
}
_FACTORIES: dict[str, object] = {
    "DaoFactory": DaoFactory,
    "Ros2DaoFactory": Ros2DaoFactory,
    "MongoDaoFactory": DaoFactory,
}
# The names of each module of the original that programs import.
_MODULES: dict[str, dict[str, object]] = {
    "kant_dto": {dto.__name__: dto for dto in _DTOS.values()},
    **{f"kant_dto.{module}": {dto.__name__: dto} for module, dto in _DTOS.items()},
    "kant_dao": {"ParameterLoader": ParameterLoader},
    "kant_dao.parameter_loader": {"ParameterLoader": ParameterLoader},
    "kant_dao.dao_factory": {"DaoFactoryMethod": DaoFactoryMethod, "DaoFamilies": DaoFamilies},
    "kant_dao.dao_factory.dao_factory_method": {"DaoFactoryMethod": DaoFactoryMethod},
    "kant_dao.dao_factory.dao_families": {"DaoFamilies": DaoFamilies},
    "kant_dao.dao_factory.dao_factories": _FACTORIES,
    "kant_dao.dao_factory.dao_factories.dao_factory": {"DaoFactory": DaoFactory},
    "kant_dao.dao_interface": {
        "Dao": CompatDao,
        "PddlTypeDao": CompatTypeDao,
        "PddlObjectDao": CompatObjectDao,
        "PddlPredicateDao": CompatDefinitionDao,
        "PddlPropositionDao": CompatPropositionDao,
        "PddlActionDao": CompatNamedDao,
    },
}


def install() -> None:
    """Let programs import `kant_dto` and `kant_dao` of the original, and get this library.

    Call it once, before the program imports them.

    Raises:
        InvalidArgumentError: other modules of these names are imported already.

    Examples:
        >>> from kant_sql import compat
        >>> compat.install()
        >>> from kant_dao.dao_factory import DaoFactoryMethod, DaoFamilies
        >>> from kant_dto import PddlTypeDto
        >>> factory = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri="sqlite://")
        >>> factory.create_pddl_type_dao().save(PddlTypeDto("robot"))
        True
    """
    for name in _MODULES:
        found = sys.modules.get(name)
        if found is not None and getattr(found, "__kant_sql__", None) is not _MODULES:
            raise InvalidArgumentError(
                f"{name} of {getattr(found, '__file__', None) or 'another package'} is imported "
                "already; call kant_sql.compat.install() before the program imports it"
            )
    for name, names in _MODULES.items():
        if name in sys.modules:
            continue
        module = ModuleType(name, f"The original's names, of `{__name__}`.")
        vars(module).update(names, __path__=[], __all__=[*names], __kant_sql__=_MODULES)
        sys.modules[name] = module
        package, _, last = name.rpartition(".")
        if package:
            setattr(sys.modules[package], last, module)
