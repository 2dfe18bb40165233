"""The drop-in for the original KANT library's Python API.

A program written for it changes its imports and its URI, nothing else::

    from kant_sql.compat import DaoFactoryMethod, DaoFamilies, PddlTypeDto

    dao_factory = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri="sqlite:///robot.db")

As there, ill-typed knowledge is answered with False, and the reason goes to the log
`kant_sql.compat`; an error of the store itself is raised. Constructors and setters of DTOs refuse
what is no such thing at all, as a predicate that is None, with `InvalidKnowledgeError`.
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
)
from .factory import DaoFactory as _SqlDaoFactory
from .factory import create_dao_factory

__all__ = [
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
    """The original's families, and this library's. Any of them is served by the URI's database."""

    ROS2 = 0
    MONGO = 1
    SQL = 2


class CompatDao(Generic[D]):
    """A DAO that answers ill-typed knowledge with False."""

    def __init__(self, dao: Dao[D]) -> None:
        self._dao = dao

    def get_all(self) -> list[D]:
        """Read all elements of the kind.

        Returns:
            The elements.
        """
        return self._dao.get_all()

    def _save(self, dto: D) -> bool:
        """Save an element that is not there yet.

        Args:
            dto: the element.

        Returns:
            False when it is there already, or cannot be saved.
        """
        return _judged(self._dao.insert, dto)

    def _update(self, dto: D) -> bool:
        """Save an element that is there already.

        Args:
            dto: the element.

        Returns:
            False when it is not there, or cannot be saved.
        """
        return _judged(self._dao.update, dto)

    def save(self, dto: D) -> bool:
        """Save an element, or update it.

        Args:
            dto: the element.

        Returns:
            False when it cannot be saved.
        """
        return _judged(self._dao.save, dto)

    def delete(self, dto: D) -> bool:
        """Delete an element, and all that depends on it.

        Args:
            dto: the element.

        Returns:
            False when it is not there.
        """
        return _judged(self._dao.delete, dto)

    def delete_all(self) -> bool:
        """Delete all elements of the kind, and all that depends on them.

        Returns:
            True.
        """
        self._dao.delete_all()
        return True


class CompatNamedDao(CompatDao[D]):
    """A DAO of elements with a name, that answers ill-typed knowledge with False."""

    def __init__(self, dao: NamedDao[D]) -> None:
        super().__init__(dao)
        self._named = dao

    def get(self, name: str) -> D | None:
        """Read one element.

        Args:
            name: its name, in any spelling.

        Returns:
            The element, or None.
        """
        return self._named.get(name)


class CompatPropositionDao(CompatDao[PddlPropositionDto]):
    """The DAO of propositions, that answers ill-typed knowledge with False."""

    def __init__(self, dao: PddlPropositionDao) -> None:
        super().__init__(dao)
        self._propositions = dao

    def get_by_predicate(self, predicate_name: str) -> list[PddlPropositionDto]:
        """Read the facts and the goals of one predicate.

        Args:
            predicate_name: the predicate's name, in any spelling.

        Returns:
            The propositions.
        """
        return self._propositions.get_by_predicate(predicate_name)

    def get_goals(self) -> list[PddlPropositionDto]:
        """Read the goals.

        Returns:
            The propositions with `is_goal`.
        """
        return self._propositions.get_goals()

    def get_no_goals(self) -> list[PddlPropositionDto]:
        """Read the facts.

        Returns:
            The propositions without `is_goal`.
        """
        return self._propositions.get_no_goals()


class DaoFactory:
    """Creates the DAOs, as the original's factory does."""

    def __init__(self, factory: _SqlDaoFactory) -> None:
        self._factory = factory

    def create_pddl_type_dao(self) -> CompatNamedDao[PddlTypeDto]:
        """Create the DAO of types.

        Returns:
            The DAO.
        """
        return CompatNamedDao(self._factory.create_pddl_type_dao())

    def create_pddl_object_dao(self) -> CompatNamedDao[PddlObjectDto]:
        """Create the DAO of objects.

        Returns:
            The DAO.
        """
        return CompatNamedDao(self._factory.create_pddl_object_dao())

    def create_pddl_predicate_dao(self) -> CompatNamedDao[PddlPredicateDto]:
        """Create the DAO of predicates.

        Returns:
            The DAO.
        """
        return CompatNamedDao(self._factory.create_pddl_predicate_dao())

    def create_pddl_proposition_dao(self) -> CompatPropositionDao:
        """Create the DAO of propositions.

        Returns:
            The DAO.
        """
        return CompatPropositionDao(self._factory.create_pddl_proposition_dao())

    def create_pddl_action_dao(self) -> CompatNamedDao[PddlActionDto]:
        """Create the DAO of actions.

        Returns:
            The DAO.
        """
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
            family: a member of `DaoFamilies`; the URI alone decides which database serves it, so
                a program need not change the family that it names.
            uri: the database URL.
            node: the original's ROS 2 node; not used.

        Returns:
            The factory.

        Raises:
            InvalidArgumentError: there is no such family; it is a `ValueError`.
            InvalidUrlError: no DAO family answers to the URI.
            SchemaError: the database's tables are missing, outdated or too new.
            StoreError: the database cannot be opened.
        """
        if not isinstance(family, int) or family not in list(DaoFamilies):
            raise InvalidArgumentError(f"{shown(family)} is not a valid DaoFamilies")
        return DaoFactory(create_dao_factory(uri))


def _judged(call: Callable[[D], bool], dto: D) -> bool:
    """Make a call, and answer knowledge that is refused with False."""
    try:
        return call(dto)
    except (InvalidKnowledgeError, ConflictError, DependantsError) as error:
        logger.warning("refused: %s", error)
        return False
