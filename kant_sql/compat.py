"""The drop-in for the original KANT library's Python API.

A program written for it changes its imports and its URI, nothing else::

    from kant_sql.compat import DaoFactoryMethod, DaoFamilies, PddlTypeDto

    dao_factory = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri="sqlite:///robot.db")

As there, writes return False for ill-typed knowledge, and log the reason to `kant_sql.compat`;
errors of the store are raised. Constructors and setters of DTOs raise `InvalidKnowledgeError` for
an argument of the wrong class, for example a predicate that is None.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from enum import IntEnum
from typing import Generic, TypeVar

from .arguments import shown
from .dao.interfaces import Dao, NamedDao, PddlPropositionDao
from .dto import (
    Dto,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from .errors import (
    ConflictError,
    DependantsError,
    InvalidArgumentError,
    InvalidKnowledgeError,
    UnknownNameError,
)
from .factory import DaoFactory as _SqlDaoFactory
from .factory import create_dao_factory

__all__ = [
    "CompatDao",
    "CompatNamedDao",
    "CompatPropositionDao",
    "DaoFactory",
    "DaoFactoryMethod",
    "DaoFamilies",
    "Dto",
    "PddlActionDto",
    "PddlConditionEffectDto",
    "PddlObjectDto",
    "PddlPredicateDto",
    "PddlPropositionDto",
    "PddlTypeDto",
]

logger = logging.getLogger(__name__)

D = TypeVar("D", bound=Dto)


class DaoFamilies(IntEnum):
    """The original's families and this library's. The URI alone picks the database."""

    ROS2 = 0
    MONGO = 1
    SQL = 2


class CompatDao(Generic[D]):
    """A DAO that returns False for ill-typed knowledge."""

    def __init__(self, dao: Dao[D]) -> None:
        self._dao = dao

    def get_all(self) -> list[D]:
        """Read all elements of the kind."""
        return self._dao.get_all()

    def _save(self, dto: D) -> bool:
        """Save an element; return False when it is stored already, or is ill-typed."""
        return _judged(self._dao.insert, dto)

    def _update(self, dto: D) -> bool:
        """Save an element that is stored; return False when it is not, or is ill-typed."""
        return _judged(self._dao.update, dto)

    def save(self, dto: D) -> bool:
        """Insert or update an element; return False when it is ill-typed."""
        return _judged(self._dao.save, dto)

    def delete(self, dto: D) -> bool:
        """Delete an element and everything that depends on it; return False when it is absent."""
        return _judged(self._dao.delete, dto)

    def delete_all(self) -> bool:
        """Delete all elements of the kind and everything that depends on them; return True."""
        self._dao.delete_all()
        return True


class CompatNamedDao(CompatDao[D]):
    """A DAO of named elements that returns False for ill-typed knowledge."""

    def __init__(self, dao: NamedDao[D]) -> None:
        super().__init__(dao)
        self._named = dao

    def get(self, name: str) -> D | None:
        """Read one element, by its name in any case; None if it is not stored."""
        return self._named.get(name)


class CompatPropositionDao(CompatDao[PddlPropositionDto]):
    """The DAO of propositions; it returns False for ill-typed knowledge."""

    def __init__(self, dao: PddlPropositionDao) -> None:
        super().__init__(dao)
        self._propositions = dao

    def get_by_predicate(self, predicate_name: str) -> list[PddlPropositionDto]:
        """Read the facts and the goals of one predicate."""
        try:
            return self._propositions.get_by_predicate(predicate_name)
        except UnknownNameError:
            return []

    def get_goals(self) -> list[PddlPropositionDto]:
        """Read the goals."""
        return self._propositions.get_goals()

    def get_no_goals(self) -> list[PddlPropositionDto]:
        """Read the facts."""
        return self._propositions.get_no_goals()


class DaoFactory:
    """Creates the DAOs, as the original's factory does."""

    def __init__(self, factory: _SqlDaoFactory) -> None:
        self._factory = factory

    def create_pddl_type_dao(self) -> CompatNamedDao[PddlTypeDto]:
        """Create the DAO of types."""
        return CompatNamedDao(self._factory.create_pddl_type_dao())

    def create_pddl_object_dao(self) -> CompatNamedDao[PddlObjectDto]:
        """Create the DAO of objects."""
        return CompatNamedDao(self._factory.create_pddl_object_dao())

    def create_pddl_predicate_dao(self) -> CompatNamedDao[PddlPredicateDto]:
        """Create the DAO of predicates."""
        return CompatNamedDao(self._factory.create_pddl_predicate_dao())

    def create_pddl_proposition_dao(self) -> CompatPropositionDao:
        """Create the DAO of propositions."""
        return CompatPropositionDao(self._factory.create_pddl_proposition_dao())

    def create_pddl_action_dao(self) -> CompatNamedDao[PddlActionDto]:
        """Create the DAO of actions."""
        return CompatNamedDao(self._factory.create_pddl_action_dao())


class DaoFactoryMethod:
    """Creates the factory, as the original's factory method does."""

    def __init__(self) -> None:
        self.dao_families = DaoFamilies

    def create_dao_factory(
        self, family: int, *, uri: str, node: object | None = None
    ) -> DaoFactory:
        """Create the factory.

        Args:
            family: a member of `DaoFamilies`; any of them works with any URI.
            uri: the database URL.
            node: the original's ROS 2 node; ignored.

        Returns:
            The factory.

        Raises:
            InvalidArgumentError: there is no such family; it is a `ValueError`.
            InvalidUrlError: no DAO family supports the URI.
            SchemaError: the database's tables are missing, outdated or too new.
            StoreError: the database cannot be opened.
        """
        if not isinstance(family, int) or family not in list(DaoFamilies):
            raise InvalidArgumentError(f"{shown(family)} is not a valid DaoFamilies")
        return DaoFactory(create_dao_factory(uri))


def _judged(call: Callable[[D], bool], dto: D) -> bool:
    """Make a call; return False and log the reason for refused knowledge."""
    try:
        return call(dto)
    except (InvalidKnowledgeError, ConflictError, DependantsError) as error:
        logger.warning("refused: %s", error)
        return False
