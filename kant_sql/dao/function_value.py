"""The values of functions: the DAO of numeric and object fluents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Any

from ..arguments import expect, expect_list
from ..backends import Row
from ..dto import PddlFunctionDto, PddlFunctionValueDto, PddlObjectDto
from ..dto.number import decimal_text
from ..dto.pddl_function_value_dto import trusted_value
from ..errors import InvalidKnowledgeError, each_readable
from ..fluents import Fluent, FluentValue
from ..transaction import Transaction
from ..view import View
from .arithmetic import DECREASE, INCREASE, SCALE_DOWN, SCALE_UP, Operation, calculate
from .base import SqlDao, batches
from .builder import DtoBuilder
from .fluent_interfaces import (
    FunctionReference,
    Number,
    ObjectReference,
    PddlFunctionValueDao,
)
from .fluent_reading import ALL, OF_FLUENT, OF_FUNCTION
from .fluent_references import FluentReferences, check_fluent, existing_key
from .fluents_on import function_values_on
from .reading import NO_ID


def _dtos(view: View, rows: Iterable[Any]) -> list[PddlFunctionValueDto]:
    builder = DtoBuilder(view.definitions)

    def make(row: Row) -> PddlFunctionValueDto:
        _, function_id, arguments, number, object_id = row
        return trusted_value(
            builder.function(function_id),
            [builder.object(int(id_)) for id_ in arguments.split()],
            Decimal(number) if object_id is None else builder.object(object_id),
        )

    return each_readable("function_value", [*rows], make)


class SqlFunctionValueDao(SqlDao, PddlFunctionValueDao):
    """The values of functions in an SQL store."""

    def get(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> Decimal | PddlObjectDto | None:
        """Read what a fluent is."""
        check_fluent(function, objects)
        transaction = self._store.current()
        if transaction is not None and self._at is None:
            # From memory: a query would have to write first what is pending.
            value = self._value(transaction, function, objects)
            if value is None or value.object_id is None:
                return None if value is None else Decimal(value.text)
            return DtoBuilder(transaction.definitions).object(value.object_id)

        def work(view: View) -> Decimal | PddlObjectDto | None:
            key = existing_key(view.definitions, function, objects)
            # Asked even of no fluent: the head may say that there is one by now.
            asked = (NO_ID, "") if key is None else key
            rows = OF_FLUENT.rows(view, function=asked[0], arguments=asked[1])
            for *_, number, object_id in rows:
                if object_id is None:
                    return Decimal(number)
                return DtoBuilder(view.definitions).object(object_id)
            return None

        return self._store.read(work, self._at)

    def get_all(self) -> list[PddlFunctionValueDto]:
        """Read the values of all functions."""
        return self._store.read(lambda view: _dtos(view, ALL.rows(view)), self._at)

    def get_by_function(self, name: str) -> list[PddlFunctionValueDto]:
        """Read the values of one function."""

        def work(view: View) -> list[PddlFunctionValueDto]:
            function = view.definitions.functions.named(name)
            id_ = NO_ID if function is None else function.id
            return _dtos(view, OF_FUNCTION.rows(view, function=id_))

        return self._store.read(work, self._at)

    def set(
        self,
        function: FunctionReference,
        *,
        objects: Sequence[ObjectReference],
        value: Number | ObjectReference,
    ) -> bool:
        """Let a fluent be a number, or an object."""
        self._check_writable()
        check_fluent(function, objects)

        def work(transaction: Transaction) -> bool:
            references = FluentReferences(transaction)
            declared, key, text = references.resolve(function, objects)
            entry = key, text, references.value(declared, value, text)
            return transaction.values.set_many([entry]) == 1

        return self._store.write(work)

    def unset(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> bool:
        """Let a fluent have no value any more."""
        self._check_writable()
        check_fluent(function, objects)

        def work(transaction: Transaction) -> bool:
            fluent = self._find(transaction, function, objects)
            return fluent is not None and transaction.values.set(fluent, None)

        return self._store.write(work)

    def increase(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Add to a number."""
        return self._change("increased", INCREASE, function, objects, by)

    def decrease(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Subtract from a number."""
        return self._change("decreased", DECREASE, function, objects, by)

    def scale_up(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Multiply a number."""
        return self._change("scaled up", SCALE_UP, function, objects, by)

    def scale_down(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference], by: Number
    ) -> Decimal:
        """Divide a number."""
        return self._change("scaled down", SCALE_DOWN, function, objects, by)

    def save(self, dto: PddlFunctionValueDto) -> bool:
        """Let a fluent be what a DTO says."""
        self._check(dto)
        self._store.write(lambda transaction: self._save_batch(transaction, [dto]))
        return True

    def insert(self, dto: PddlFunctionValueDto) -> bool:
        """Give a value to a fluent that has none."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            if self._value(transaction, dto.function, dto.objects) is not None:
                return False
            return self._save_batch(transaction, [dto]) == 1

        return self._store.write(work)

    def update(self, dto: PddlFunctionValueDto) -> bool:
        """Give another value to a fluent that has one."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            if self._value(transaction, dto.function, dto.objects) is None:
                return False
            self._save_batch(transaction, [dto])
            return True

        return self._store.write(work)

    def save_all(self, dtos: Iterable[PddlFunctionValueDto]) -> int:
        """Give many fluents their values, in one revision."""
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(dtos):
                for dto in batch:
                    self._check(dto)
                names = (object_.name for dto in batch for object_ in dto.objects)
                # What has no name is refused in its turn.
                transaction.look_up("object", {name for name in names if isinstance(name, str)})
                changed += self._save_batch(transaction, batch)
        return changed

    def delete(self, dto: PddlFunctionValueDto) -> bool:
        """Let a fluent have no value any more."""
        self._check(dto)
        return self.unset(dto.function, objects=dto.objects)

    def delete_all(self) -> int:
        """Let no fluent have a value."""
        self._check_writable()

        def work(transaction: Transaction) -> int:
            held = function_values_on(transaction, None)
            transaction.values.unset(held)
            return len(held)

        return self._store.write(work)

    def _check(self, dto: PddlFunctionValueDto) -> None:
        self._check_writable()
        expect(dto, PddlFunctionValueDto, "what the function value DAO takes")
        expect(dto.function, PddlFunctionDto, "the function of a function value")
        expect_list(dto.objects, PddlObjectDto, "the list of objects of a function value")

    @staticmethod
    def _save_batch(transaction: Transaction, dtos: Iterable[PddlFunctionValueDto]) -> int:
        entry = FluentReferences(transaction).entry
        return transaction.values.set_many([entry(dto) for dto in dtos])

    def _change(
        self,
        changed: str,
        operation: Operation,
        function: FunctionReference,
        objects: Sequence[ObjectReference],
        by: Number,
    ) -> Decimal:
        self._check_writable()
        check_fluent(function, objects)

        def work(transaction: Transaction) -> Decimal:
            references, values = FluentReferences(transaction), transaction.values
            declared, key, text = references.resolve(function, objects)
            number = references.number(declared, by, text)
            fluent = values.find([key]).get(key)
            now = None if fluent is None else values.value(fluent)
            if fluent is None or now is None:
                raise InvalidKnowledgeError(
                    f"{text} has no value that could be {changed}; set it first"
                )
            try:
                result = decimal_text(calculate(operation, Decimal(now.text), number))
            except InvalidKnowledgeError as error:
                raise InvalidKnowledgeError(
                    f"{text} is {now.text:.40} and cannot be {changed} by {number!s:.40}: {error}"
                ) from None
            values.set(fluent, FluentValue(result))
            return Decimal(result)

        return self._store.write(work)

    @classmethod
    def _value(
        cls,
        transaction: Transaction,
        function: FunctionReference,
        objects: Sequence[ObjectReference],
    ) -> FluentValue | None:
        fluent = cls._find(transaction, function, objects)
        return None if fluent is None else transaction.values.value(fluent)

    @staticmethod
    def _find(
        transaction: Transaction,
        function: FunctionReference,
        objects: Sequence[ObjectReference],
    ) -> Fluent | None:
        key = existing_key(transaction.definitions, function, objects)
        return None if key is None else transaction.values.find([key]).get(key)
