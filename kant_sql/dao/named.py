"""What the DAOs of named elements share: all that does not depend on the kind."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, ClassVar, Generic, TypeVar

from ..arguments import expect, flag
from ..dto.dto import NamedDto
from ..errors import InvalidArgumentError
from ..knowledge.definitions import Definitions
from ..transaction import Transaction
from .base import SqlDao, batches
from .builder import DtoBuilder

D = TypeVar("D", bound=NamedDto)


class SqlNamedDao(SqlDao, Generic[D]):
    """Reads, saves and deletes one kind of named element."""

    kind: ClassVar[str]
    dto_class: type[D]

    def get(self, name: str) -> D | None:
        """Read one element."""

        def work(definitions: Definitions) -> D | None:
            definition = self._named(definitions, name)
            return None if definition is None else self._build(DtoBuilder(definitions), definition)

        return self._store.read_definitions(work, self._at)

    def get_all(self) -> list[D]:
        """Read all elements of the kind."""

        def work(definitions: Definitions) -> list[D]:
            builder = DtoBuilder(definitions)
            return [self._build(builder, definition) for definition in self._all(definitions)]

        return self._store.read_definitions(work, self._at)

    def save(self, dto: D, *, cascade: bool = False) -> bool:
        """Insert an element, or redefine it."""
        self._check(dto)
        flag(cascade, "cascade", InvalidArgumentError)
        self._store.write(lambda transaction: self._put(transaction, dto, cascade))
        return True

    def insert(self, dto: D) -> bool:
        """Save an element that is not there yet."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            if self._named(transaction.definitions, dto.name) is not None:
                return False
            self._put(transaction, dto, False)
            return True

        return self._store.write(work)

    def update(self, dto: D, *, cascade: bool = False) -> bool:
        """Redefine an element that is there already."""
        self._check(dto)
        flag(cascade, "cascade", InvalidArgumentError)

        def work(transaction: Transaction) -> bool:
            if self._named(transaction.definitions, dto.name) is None:
                return False
            self._put(transaction, dto, cascade)
            return True

        return self._store.write(work)

    def save_all(self, dtos: Iterable[D]) -> int:
        """Save many elements in one revision."""
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(dtos):
                for dto in batch:
                    self._check(dto)
                transaction.look_up(self.kind, (dto.name for dto in batch))
                with transaction.batch():
                    changed += sum(self._put(transaction, dto, False) for dto in batch)
        return changed

    def delete(self, dto: D) -> bool:
        """Delete an element, and all that depends on it."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            definition = self._named(transaction.definitions, dto.name)
            if definition is None:
                return False
            self._remove(transaction, [definition.id])
            return True

        return self._store.write(work)

    def delete_all(self) -> int:
        """Delete all elements of the kind, and all that depends on them."""
        self._check_writable()

        def work(transaction: Transaction) -> int:
            ids = [definition.id for definition in self._all(transaction.definitions)]
            if ids:
                self._remove(transaction, ids)
            return len(ids)

        return self._store.write(work)

    def _check(self, dto: D) -> None:
        self._check_writable()
        expect(dto, self.dto_class, f"what the {self.kind} DAO takes")

    def _named(self, definitions: Definitions, name: str) -> Any:
        definition = definitions.elements(self.kind).named(name)
        return definition if definition is not None and self._is_mine(definition) else None

    def _all(self, definitions: Definitions) -> list[Any]:
        return [each for each in definitions.elements(self.kind) if self._is_mine(each)]

    def _is_mine(self, definition: Any) -> bool:
        """Tell whether a definition of the kind is one that this DAO is for."""
        return True

    @abstractmethod
    def _build(self, builder: DtoBuilder, definition: Any) -> D:
        """Make the DTO of a definition."""

    @abstractmethod
    def _put(self, transaction: Transaction, dto: D, cascade: bool) -> bool:
        """Define the element as the DTO says; tell whether that is a change."""

    @abstractmethod
    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        """Delete elements, and all that depends on them."""
