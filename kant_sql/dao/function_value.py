"""The values of functions: the DAO of numeric and object fluents, and their references.

Each row of an answer has the fluent's id, its function's, the ids of its objects separated by
spaces, and the number as text or the id of the object that it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from decimal import Context, Decimal, Inexact, localcontext
from typing import Any

from sqlalchemy import BigInteger, ColumnElement, Text, bindparam, cast, null, select
from typing_extensions import override

from ..arguments import expect, expect_list, shown
from ..dto import PddlFunctionDto, PddlFunctionValueDto, PddlObjectDto
from ..dto.elements import atom_text, trusted_value
from ..dto.formulas import Fluent, Node
from ..dto.lexical import MAX_DIGITS, decimal_text, is_word, number_text
from ..errors import InvalidKnowledgeError, TypeMismatchError, each_readable
from ..html import Listing
from ..knowledge.atoms import FluentKey, FluentValue
from ..knowledge.definitions import Definitions, FunctionDefinition
from ..pddl.given import read_value
from ..sql.dialects.base import Row
from ..sql.intervals import ANY_FUNCTION, held_then
from ..sql.query import constant
from ..sql.rows import KB, looked_up, table_of
from ..sql.tables import FunctionValueRow, FunctionValueVersionRow
from ..store.snapshot import View
from ..store.transaction import Transaction
from .base import NO_ID, DtoBuilder, Reading, SqlGroundDao
from .dependants import function_values_on
from .interfaces import FunctionReference, Number, ObjectReference, PddlFunctionValueDao, ValueLike
from .proposition import Arguments
from .signatures import FUNCTIONS
from .text import expect_text, read_stored, read_text, refuse_unknown
from .type import OBJECTS

# Digits of a result that has no exact decimal, such as a third, or one beyond `MAX_DIGITS` digits.
ROUNDED_DIGITS = 28

Operation = Callable[[Context, Decimal, Decimal], Decimal]


def _divide(context: Context, number: Decimal, by: Decimal) -> Decimal:
    if not by:
        raise InvalidKnowledgeError("no number can be divided by 0")
    return context.divide(number, by)


INCREASE: Operation = Context.add
DECREASE: Operation = Context.subtract
SCALE_UP: Operation = Context.multiply
SCALE_DOWN: Operation = _divide


def calculate(operation: Operation, number: Decimal, by: Decimal) -> Decimal:
    """Calculate exactly, if the result terminates within `MAX_DIGITS` digits."""
    with localcontext(prec=MAX_DIGITS) as context:
        context.clear_flags()
        result = operation(context, number, by)
        if not context.flags[Inexact] and -int(result.as_tuple().exponent) <= MAX_DIGITS:
            return result
        context.prec = ROUNDED_DIGITS
        return operation(context, number, by)


_FLUENTS = table_of(FunctionValueRow).c
_ARGUMENTS = looked_up(_FLUENTS.arguments, _FLUENTS.id, FunctionValueVersionRow.function_value_id)
_ROWS = select(
    FunctionValueVersionRow.function_value_id,
    FunctionValueVersionRow.function_id,
    _ARGUMENTS,
    FunctionValueVersionRow.value,
    FunctionValueVersionRow.object_id,
).where(FunctionValueVersionRow.kb_id == KB)


def _reading(*conditions: ColumnElement[bool]) -> Reading:
    now = _ROWS.where(FunctionValueVersionRow.until.is_(None), *conditions)
    then = _ROWS.where(held_then(FunctionValueVersionRow), *(conditions or (ANY_FUNCTION,)))
    return Reading(now, then, constant(""), cast(null(), Text), cast(null(), BigInteger))


_FLUENT = (
    select(FunctionValueRow.id)
    .where(FunctionValueRow.kb_id == KB)
    .where(FunctionValueRow.function_id == bindparam("function"))
    .where(FunctionValueRow.arguments == bindparam("arguments"))
    .correlate(None)
    .scalar_subquery()
)
ALL = _reading()
OF_FUNCTION = _reading(FunctionValueVersionRow.function_id == bindparam("function"))
OF_FLUENT = _reading(FunctionValueVersionRow.function_value_id == _FLUENT)


VALUE = "(= (battery rb1) 80)"


class FluentReferences(Arguments):
    """The references of the fluents of one batch."""

    role = "a function value"

    def entry(self, given: ValueLike) -> tuple[FluentKey, str, FluentValue]:
        """Check a value; save missing elements that a DTO refers to."""
        if isinstance(given, str | Node):
            fluent, value = read_text(self._transaction, read_value, given)
            if value is None:
                raise InvalidKnowledgeError(f"{fluent} has no value; give one, such as '{VALUE}'")
            function, key, text = self.resolve(fluent.function, names_of(fluent))
            return key, text, self.value(function, value, text)
        function, key, text = self.resolve(given.function, given.objects)
        return key, text, self.value(function, given.value, text)

    def resolve(
        self, function: FunctionReference, objects: Sequence[ObjectReference]
    ) -> tuple[FunctionDefinition, FluentKey, str]:
        """Check a fluent; save missing elements that a DTO refers to."""
        declared = FUNCTIONS.ensure(self._transaction, function, self.role)
        names = [each if isinstance(each, str) else each.name for each in objects]
        shown = f"({' '.join([declared.name, *map(str, names)])})"
        found = self.check(shown, declared, objects)
        ids = " ".join([str(object_.id) for object_ in found])
        text = atom_text(declared.name, [object_.name for object_ in found])
        return declared, FluentKey(declared.id, ids), text

    def value(self, function: FunctionDefinition, given: object, text: str) -> FluentValue:
        """Check a value."""
        if not function.type_ids:
            return FluentValue(number_text(self.number(function, given, text)))
        if not isinstance(given, str | PddlObjectDto):
            raise TypeMismatchError(
                f"{text}: the value is {shown(given)}, expected an object, as in {function.text}"
            )
        object_ = OBJECTS.ensure(self._transaction, given, self.role)
        if not self._transaction.definitions.any_fits(object_.type_ids, function.type_ids):
            raise self.mismatch(f"{text}: the value", object_, function.type_ids, function.text)
        return FluentValue(object_.name, object_.id)

    def number(self, function: FunctionDefinition, given: object, text: str) -> Decimal:
        """Check a number, exactly as it is written: a float by its shortest digits."""
        if function.type_ids or isinstance(given, bool) or not isinstance(given, Number):
            expected = "an object" if function.type_ids else "a number"
            raise TypeMismatchError(
                f"{text}: the value is {shown(given)}, expected {expected}, as in {function.text}"
            )
        try:
            return Decimal(number_text(given))
        except InvalidKnowledgeError as error:
            raise InvalidKnowledgeError(f"{text}: {error}") from None


def existing_key(
    definitions: Definitions, function: FunctionReference, objects: Sequence[ObjectReference]
) -> FluentKey | None:
    """Find the key of a fluent from names alone."""
    declared = definitions.functions.named(_name(function))
    ids = definitions.arguments(map(_name, objects))
    return None if declared is None or ids is None else FluentKey(declared.id, ids)


def names_of(fluent: Fluent) -> list[str]:
    """Return the names of a ground fluent's objects."""
    return [str(term) for term in fluent.terms]


def fluent_of(
    function: FunctionReference, objects: Sequence[ObjectReference]
) -> tuple[FunctionReference, Sequence[ObjectReference]]:
    """Return a fluent's function and objects, which may be given as one text."""
    if isinstance(function, str) and function.lstrip().startswith("("):
        words = function.strip()[1:-1].split()
        if not words or function.strip()[-1] != ")" or not all(map(is_word, words)):
            raise InvalidKnowledgeError(f"{shown(function)} is not a fluent; write '(battery rb1)'")
        if objects:
            raise InvalidKnowledgeError(
                f"{shown(function)} has its objects already; leave out objects={shown(objects)}"
            )
        function, *objects = words
    if not isinstance(function, str | PddlFunctionDto):
        raise InvalidKnowledgeError(
            f"the function of a function value is a name or a PddlFunctionDto, not "
            f"{type(function).__name__}: {shown(function)}"
        )
    kinds: tuple[type[Any], ...] = (PddlObjectDto, str)
    expect_list(objects, kinds, "the list of objects of a function value")
    return function, objects


def _name(reference: FunctionReference | ObjectReference) -> str:
    return reference if isinstance(reference, str) else reference.name


def _value(transaction: Transaction, key: FluentKey | None) -> FluentValue | None:
    fluent = transaction.values.find_one(key)
    return None if fluent is None else transaction.values.value(fluent)


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


class SqlFunctionValueDao(SqlGroundDao[ValueLike], PddlFunctionValueDao):
    """The values of functions in an SQL store."""

    @override
    def get(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> Decimal | PddlObjectDto | None:
        function, objects = fluent_of(function, objects)
        transaction = self._store.current()
        if transaction is not None and self._at is None:
            # From memory: a query would first have to write the pending changes.
            value = _value(transaction, existing_key(transaction.definitions, function, objects))
            if value is None:
                self._refuse_unknown(function, objects)
                return None
            if value.object_id is None:
                return Decimal(value.text)
            return DtoBuilder(transaction.definitions).object(value.object_id)

        def read(view: View) -> Decimal | PddlObjectDto | None:
            key = existing_key(view.definitions, function, objects)
            # Query even without a fluent: the head may show that there is one now.
            asked = (NO_ID, "") if key is None else key
            rows = OF_FLUENT.rows(view, function=asked[0], arguments=asked[1])
            for *_, number, object_id in rows:
                if object_id is None:
                    return Decimal(number)
                return DtoBuilder(view.definitions).object(object_id)
            if key is None:
                self._refuse_unknown(function, objects)
            return None

        return self._store.read(read, self._at)

    def _refuse_unknown(
        self, function: FunctionReference, objects: Sequence[ObjectReference]
    ) -> None:
        """Refuse names that never existed; the element of a DTO may be saved later."""
        if isinstance(function, str):
            refuse_unknown(self._store, function, "function")
        for each in objects:
            if isinstance(each, str):
                refuse_unknown(self._store, each, "object")

    @override
    def get_all(self) -> list[PddlFunctionValueDto]:
        found = self._store.read(lambda view: _dtos(view, ALL.rows(view)), self._at)
        return Listing(found, "element")

    @override
    def get_by_function(self, name: str) -> list[PddlFunctionValueDto]:
        return self._of_named(
            *("function", name, "value"),
            lambda view, id_: _dtos(view, OF_FUNCTION.rows(view, function=id_)),
        )

    @override
    def set(
        self,
        function: FunctionReference,
        *,
        objects: Sequence[ObjectReference] = (),
        value: Number | ObjectReference,
    ) -> bool:
        self._check_writable()
        function, objects = fluent_of(function, objects)

        def set_value(transaction: Transaction) -> bool:
            references = FluentReferences(transaction)
            declared, key, text = references.resolve(function, objects)
            entry = key, text, references.value(declared, value, text)
            return transaction.values.set_many([entry]) == 1

        return self._store.write(set_value)

    @override
    def unset(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = ()
    ) -> bool:
        self._check_writable()
        function, objects = fluent_of(function, objects)

        def unset(transaction: Transaction) -> bool:
            key = existing_key(transaction.definitions, function, objects)
            if transaction.values.find_one(key) is None:
                self._refuse_unknown(function, objects)
            return self._unset(transaction, key)

        return self._store.write(unset)

    @override
    def increase(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        return self._change("increased", INCREASE, function, objects, by)

    @override
    def decrease(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        return self._change("decreased", DECREASE, function, objects, by)

    @override
    def scale_up(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        return self._change("scaled up", SCALE_UP, function, objects, by)

    @override
    def scale_down(
        self, function: FunctionReference, *, objects: Sequence[ObjectReference] = (), by: Number
    ) -> Decimal:
        return self._change("scaled down", SCALE_DOWN, function, objects, by)

    def _remove(self, transaction: Transaction, dto: ValueLike) -> bool:
        return self._unset(transaction, self._key_of(transaction, dto))

    @staticmethod
    def _unset(transaction: Transaction, key: FluentKey | None) -> bool:
        fluent = transaction.values.find_or_say(key, transaction.definitions)
        return fluent is not None and transaction.values.set(fluent, None)

    def _check(self, dto: object) -> None:
        self._check_writable()
        expect_text(dto, "the function value DAO", "a value", VALUE, PddlFunctionValueDto)
        if isinstance(dto, PddlFunctionValueDto):
            expect(dto.function, PddlFunctionDto, "the function of a function value")
            expect_list(dto.objects, PddlObjectDto, "the list of objects of a function value")

    def _holds(self, transaction: Transaction, dto: ValueLike) -> bool:
        return _value(transaction, self._key_of(transaction, dto)) is not None

    def _key_of(self, transaction: Transaction, given: ValueLike) -> FluentKey | None:
        if not isinstance(given, str | Node):
            return existing_key(transaction.definitions, given.function, given.objects)
        found = read_stored(transaction, read_value, given)
        if found is None:
            return None
        fluent = found.fluent
        return existing_key(transaction.definitions, fluent.function, names_of(fluent))

    def _save_batch(self, transaction: Transaction, dtos: Iterable[ValueLike]) -> int:
        entry = FluentReferences(transaction).entry
        return transaction.values.set_many([entry(dto) for dto in dtos])

    def _remove_all(self, transaction: Transaction) -> int:
        self._refuse_all_of_past(transaction)
        held = function_values_on(transaction, None)
        transaction.values.unset(held)
        return len(held)

    def _change(
        self,
        changed: str,
        operation: Operation,
        function: FunctionReference,
        objects: Sequence[ObjectReference],
        by: Number,
    ) -> Decimal:
        self._check_writable()
        function, objects = fluent_of(function, objects)

        def change(transaction: Transaction) -> Decimal:
            remedy = "set the value that it had then"
            transaction.refuse_period(f"a value that is {changed}", remedy)
            references, values = FluentReferences(transaction), transaction.values
            declared, key, text = references.resolve(function, objects)
            number = references.number(declared, by, text)
            fluent = values.find_one(key)
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

        return self._store.write(change)
