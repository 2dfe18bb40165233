"""The abstract DAOs: what every family of them does with each PDDL element.

One call is one transaction, unless the task or thread has one open: it happens whole or not at all,
and what changes something makes one revision. Besides the errors that a method names, each can
raise `StoreError` (the database refused or failed; nothing was written) and, if it writes,
`ReadOnlyError` (on a view of the past).

Results are built anew for each call. Within one result, DTOs share the types, predicates and
objects that they refer to.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Generic, TypeVar

from ..dto import (
    Dto,
    PddlActionDto,
    PddlEventDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
)

D = TypeVar("D", bound=Dto)


class Dao(ABC, Generic[D]):
    """Reads, saves and deletes one kind of PDDL element."""

    @abstractmethod
    def get_all(self) -> list[D]:
        """Read all elements of the kind.

        Returns:
            The elements, in the order in which each was first known.
        """

    @abstractmethod
    def save(self, dto: D) -> bool:
        """Insert an element, or update it. What it refers to is saved too when it is missing.

        Args:
            dto: the element.

        Returns:
            True; what cannot be saved raises.

        Raises:
            InvalidKnowledgeError: it is not well formed; the message names the element, what was
                found and what was expected.
            ConflictError: it refers to something that is stored with another definition.
            DependantsError: it redefines something that live facts or actions depend on.
        """

    @abstractmethod
    def insert(self, dto: D) -> bool:
        """Save an element that is not there yet.

        Args:
            dto: the element.

        Returns:
            False when it is there already, whatever its definition; nothing is changed then.

        Raises:
            InvalidKnowledgeError: as `save`.
            ConflictError: as `save`.
        """

    @abstractmethod
    def update(self, dto: D) -> bool:
        """Save an element that is there already.

        Args:
            dto: the element.

        Returns:
            False when it is not there; nothing is changed then.

        Raises:
            InvalidKnowledgeError: as `save`.
            ConflictError: as `save`.
            DependantsError: as `save`.
        """

    @abstractmethod
    def save_all(self, dtos: Iterable[D]) -> int:
        """Save many elements in one revision, faster than one by one.

        Args:
            dtos: the elements; an iterator is read as it goes, in constant memory for
                propositions. It is read ahead, so each element has to be a DTO of its own.

        Returns:
            How many of them changed something.

        Raises:
            InvalidKnowledgeError: as `save`; nothing of all is saved.
            ConflictError: as `save`; nothing of all is saved.
            DependantsError: as `save`; nothing of all is saved.
        """

    @abstractmethod
    def delete(self, dto: D) -> bool:
        """Delete an element, and in the same revision all that depends on it.

        Args:
            dto: the element; only what makes it the one that it is counts.

        Returns:
            False when it is not there.
        """

    @abstractmethod
    def delete_all(self) -> int:
        """Delete all elements of the kind, and in the same revision all that depends on them.

        Returns:
            How many elements of the kind there were.
        """


class NamedDao(Dao[D]):
    """Reads, saves and deletes one kind of element that has a name."""

    @abstractmethod
    def get(self, name: str) -> D | None:
        """Read one element.

        Args:
            name: its name, in any spelling.

        Returns:
            The element, or None when there is none of that name.
        """


class RedefinableDao(NamedDao[D]):
    """Reads, saves and deletes one kind of element that others can depend on."""

    @abstractmethod
    def save(self, dto: D, *, cascade: bool = False) -> bool:
        """Insert an element, or redefine it. What it refers to is saved too when it is missing.

        Args:
            dto: the element.
            cascade: whether a redefinition retracts, in the same revision, the live facts and
                actions that depend on the present definition, instead of being refused.

        Returns:
            True; what cannot be saved raises.

        Raises:
            InvalidKnowledgeError: it is not well formed.
            ConflictError: it refers to something that is stored with another definition.
            DependantsError: live facts or actions depend on the present definition, and `cascade`
                was not given.
        """

    @abstractmethod
    def update(self, dto: D, *, cascade: bool = False) -> bool:
        """Redefine an element that is there already.

        Args:
            dto: the element.
            cascade: as `save`.

        Returns:
            False when it is not there; nothing is changed then.

        Raises:
            InvalidKnowledgeError: as `save`.
            ConflictError: as `save`.
            DependantsError: as `save`.
        """


class PddlTypeDao(RedefinableDao[PddlTypeDto]):
    """Reads, saves and deletes types.

    Deleting a type deletes its subtypes, the objects of all these, the predicates and actions with
    parameters of them, and the facts and goals of those.

    `save` takes the DTO as the whole definition: without a parent, the type is right under the
    root. A type that another element refers to is found by name, and its parent must agree only
    when it is given.
    """


class PddlObjectDao(RedefinableDao[PddlObjectDto]):
    """Reads, saves and deletes objects.

    Deleting an object deletes the facts, goals and actions that mention it.
    """


class PddlPredicateDao(RedefinableDao[PddlPredicateDto]):
    """Reads, saves and deletes predicates.

    Deleting a predicate deletes its facts and goals, and the actions that mention it.
    """


class PddlActionDao(NamedDao[PddlActionDto]):
    """Reads, saves and deletes actions; nothing depends on them.

    A condition or an effect is a literal, or a node of `kant_sql.pddl`. A literal saves what it
    refers to when it is missing; a node names what must be known already.
    """


class PddlProcessDao(NamedDao[PddlProcessDto]):
    """Reads, saves and deletes processes (PDDL+); no action or event has the name of one."""


class PddlEventDao(NamedDao[PddlEventDto]):
    """Reads, saves and deletes events (PDDL+); no action or process has the name of one."""


class PddlPropositionDao(Dao[PddlPropositionDto]):
    """Reads, saves and deletes propositions: facts and goals."""

    @abstractmethod
    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        """Read the facts and the goals of one predicate.

        Args:
            name: the predicate's name, in any spelling.

        Returns:
            The propositions; none when there is no such predicate.
        """

    @abstractmethod
    def get_goals(self) -> list[PddlPropositionDto]:
        """Read the goals.

        Returns:
            The propositions with `is_goal`.
        """

    @abstractmethod
    def get_no_goals(self) -> list[PddlPropositionDto]:
        """Read the facts.

        Returns:
            The propositions without `is_goal`.
        """
