"""The effects of a step: computes its changes in a state, and writes them.

All conditions and right-hand sides are evaluated in the state before, and deletes come before adds
(Fox and Long, PDDL 2.1, 2003, section 4 and definition 11). Several increases and decreases of one
fluent add up, scalings multiply, other assignments must agree. Numbers are calculated exactly.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from typing import Any

from ..dto.elements import atom_text
from ..dto.formulas import TOTAL_COST
from ..dto.lexical import decimal_text, either_text, fold
from ..errors import NotApplicableError, TypeMismatchError, few_of
from ..knowledge.atoms import AtomKey, FluentKey, FluentValue
from ..knowledge.definitions import FunctionDefinition, PredicateDefinition
from ..knowledge.resolved import AllOf, Bound, Known, NumberOf, Part, Place, Slot, closure, fits
from ..store.snapshot import View
from ..store.transaction import Transaction
from .after import ground_item
from .arithmetic import ADDITIVE, CHANGES, EXACT, SCALING, Exact, decimal_of
from .ask import given_numbers, question, statement_key
from .explain import decimals, exact, read_numbers
from .failures import BY_ZERO, NO_OBJECT, NO_VALUE, UNDEFINED, FailedCondition
from .steps import EffectItem, GroundStep

# The objects for which the earlier condition of each effect held.
Earlier = Mapping[int, set[tuple[Any, ...]]]


@dataclass
class StepChanges:
    """The changes of a step."""

    deletes: dict[AtomKey, None] = field(default_factory=dict)  # the deleted facts
    # The added facts, with their texts.
    adds: dict[AtomKey, str] = field(default_factory=dict)
    # The operators and values for each fluent, with the fluent's text.
    assignments: dict[FluentKey, tuple[str, list[tuple[str, Exact | int]]]] = field(
        default_factory=dict
    )


@dataclass(eq=False)
class EffectReader:
    """Evaluates the effects of one step in the state before, and writes them."""

    view: View
    step: GroundStep
    numbers: Mapping[str, Decimal]  # the numbers of the step: its duration
    # The objects for which the start conditions of the effects at the end held.
    held: Earlier = field(default_factory=dict)
    _changes: StepChanges = field(default_factory=StepChanges)

    def read(self, items: Sequence[EffectItem]) -> StepChanges:
        """Return the changes of the effects."""
        certain = [item for item in items if item.numbers and item.is_certain]
        known = self._numbers_of(certain) if certain else {}
        for item in items:
            if item.needs_values:
                self._check_values(item)
            for objects, values in (({}, known),) if item.is_certain else self._rows(item):
                self._apply(item, objects, values)
        return self._changes

    def write(self, transaction: Transaction, time: str) -> None:
        """Write the effects at a time."""
        write(transaction, self.step, self.read(self.step.action.items(time)))

    def _numbers_of(self, items: Sequence[EffectItem]) -> Mapping[NumberOf, Decimal]:
        """Return the numbers that unconditional effects need, by one statement."""
        numbers = list(dict.fromkeys(number for item in items for number in item.numbers))
        key = "numbers", *map(id, items)
        [texts] = self._asked(key, AllOf(()), (), numbers, self.step.values)
        return decimals(numbers, texts)

    def _check_values(self, item: EffectItem) -> None:
        """Refuse an effect whose terms or value contain an object fluent without a value."""
        if self._run(item, "lacking"):
            raise not_applicable(self.step, [FailedCondition(str(item.node), NO_OBJECT)])

    def _rows(
        self, item: EffectItem
    ) -> Iterator[tuple[Mapping[Slot, int], Mapping[NumberOf, Decimal]]]:
        """Yield the objects of each occurrence of an effect, with the numbers that it needs."""
        numbers, slots = item.numbers, [each.slot for each in item.bound]
        for row in self._run(item, "now"):
            values = decimals(numbers, row[len(slots) : len(slots) + len(numbers)])
            yield dict(zip(slots, row, strict=False)), values

    def earlier(self, items: Sequence[EffectItem]) -> Earlier:
        """Return the objects for which the start conditions of effects hold."""
        return {
            id(item): {row[: len(item.bound)] for row in self._run(item, "earlier")}
            for item in items
            if item.earlier != AllOf(())
        }

    def _run(self, item: EffectItem, which: str) -> list[Any]:
        """Return the objects for which a condition of an effect holds, with their numbers."""
        condition, bound, numbers = item.condition, item.bound, item.numbers
        if which == "earlier":
            condition, numbers = item.earlier, []
        elif which == "lacking":
            condition, bound, numbers = item.lacking, item.around, []
        given = {**self.step.values, **given_numbers(self.numbers)}
        rows = self._asked((which, id(item)), condition, bound, numbers, given)
        if not (bound or numbers):
            # Without columns, a row means that the condition holds.
            rows = [()] * len(rows)
        if which == "earlier" or item.earlier == AllOf(()):
            return rows
        held = {row[: len(bound)] for row in self.held[id(item)]}
        return [row for row in rows if row[: len(bound)] in held]

    def _asked(
        self,
        key: tuple[Hashable, ...],
        condition: Part,
        bound: Sequence[Bound],
        numbers: Sequence[NumberOf],
        given: Mapping[str, Any],
    ) -> list[Any]:
        """Run a statement; each action makes it once."""
        view, step = self.view, self.step
        statement = step.action.kept(
            (*key, *statement_key(view, self.numbers)),
            lambda: question(view, self.numbers).effects(condition, bound, numbers, step.places),
        )
        return view.reader.run(statement, given)

    def _apply(
        self, item: EffectItem, objects: Mapping[Slot, int], values: Mapping[NumberOf, Decimal]
    ) -> None:
        ids = self._objects(item.terms, objects)
        arguments = " ".join(map(str, ids))
        if item.operator == "delete":
            self._changes.deletes[AtomKey(False, item.head, arguments)] = None
            return
        if item.operator == "add":
            predicate = self.view.definitions.predicates.live(item.head)
            self._changes.adds[AtomKey(False, item.head, arguments)] = self._text(predicate, ids)
            return
        function = self.view.definitions.functions.live(item.head)
        text = self._text(function, ids)
        value = self._value(item, function, objects, values, text)
        fluent = FluentKey(function.id, arguments)
        self._changes.assignments.setdefault(fluent, (text, []))[1].append((item.operator, value))

    def _objects(self, terms: Iterable[Place], objects: Mapping[Slot, int]) -> list[int]:
        ids, places = self.step.ids, self.step.action.positions
        return [
            term.id
            if isinstance(term, Known)
            else objects[term]
            if objects and term in objects
            else ids[places[term.number]]
            for term in terms
        ]

    def _text(self, declared: PredicateDefinition | FunctionDefinition, ids: Sequence[int]) -> str:
        """Write an atom or a fluent; refuse objects that do not fit."""
        objects = [*map(self.view.definitions.objects.live, ids)]
        text = atom_text(declared.name, [each.name for each in objects])
        for each, parameter in zip(objects, declared.parameters, strict=True):
            id_, wanted = each.id, parameter.type_ids
            if each.type_ids != wanted and not self._fits(id_, wanted):
                role = f"{text}, which {self.step} changes,"
                raise self._mismatch(id_, wanted, role)
        return text

    def _fits(self, id_: int, type_ids: Sequence[int]) -> bool:
        return fits(self.view.definitions, id_, closure(self.view.definitions, type_ids))

    def _mismatch(self, id_: int, type_ids: Sequence[int], role: str) -> TypeMismatchError:
        definitions = self.view.definitions
        wanted = either_text(definitions.types.live(each).name for each in type_ids)
        name = definitions.objects.live(id_).name
        return TypeMismatchError(f"{role} has {name}, which is not a {wanted}")

    def _value(
        self,
        item: EffectItem,
        function: FunctionDefinition,
        objects: Mapping[Slot, int],
        values: Mapping[NumberOf, Decimal],
        text: str,
    ) -> Exact | int:
        if isinstance(item.value, Slot | Known):
            [id_] = self._objects([item.value], objects)
            if not self._fits(id_, function.type_ids):
                raise self._mismatch(id_, function.type_ids, f"({item.operator} {text} ...)")
            return id_
        assert item.value is not None
        number = exact(item.value, values, self.numbers)
        if number is None:
            failed = FailedCondition(f"({item.operator} {text} ...)", UNDEFINED)
            raise not_applicable(self.step, [failed])
        return number


def not_applicable(step: object, failed: Sequence[FailedCondition]) -> NotApplicableError:
    """Make the error for a step."""
    return NotApplicableError(
        f"{step} cannot be applied: {few_of(failed, 5)}; the state is unchanged", failed
    )


def write(transaction: Transaction, step: object, changes: StepChanges) -> None:
    """Write the changes of a step."""
    propositions, adds = transaction.propositions, changes.adds
    atoms = propositions.find({**changes.deletes, **adds})
    propositions.load(atoms.values())
    for key, atom in atoms.items():
        propositions.set(atom, key in adds)
    if not adds.keys() <= atoms.keys():
        propositions.add_all({key: text for key, text in adds.items() if key not in atoms})
    if not changes.assignments:
        return
    found = transaction.values.find(changes.assignments)
    entries = []
    for key, (text, made) in changes.assignments.items():
        fluent = found.get(key)
        before = None if fluent is None else transaction.values.value(fluent)
        number = None if before is None or before.object_id is not None else Decimal(before.text)
        value = combined(text, made, number)
        if isinstance(value, FailedCondition):
            raise not_applicable(step, [value])
        if isinstance(value, int):
            given = FluentValue(transaction.definitions.objects.live(value).name, value)
        else:
            given = FluentValue(decimal_text(value))
        entries.append((key, text, given))
    transaction.values.set_many(entries)


def combined(
    text: str, made: Sequence[tuple[str, Exact | int]], before: Decimal | None
) -> Decimal | int | FailedCondition:
    """Return the new value of a fluent, or why it has none."""
    operators = {operator for operator, _ in made}
    if "assign" in operators:
        values = {value for _, value in made}
        if len(operators) > 1 or len(values) > 1:
            return FailedCondition(text, "the step assigns it several values")
        value = values.pop()
        return value if isinstance(value, int) else decimal_of(value)
    if len(made) > 1 and not (operators <= ADDITIVE or operators <= SCALING):
        return FailedCondition(text, "the step both adds to it and scales it")
    # The cost of a plan begins at 0, as in VAL, even if the problem does not set it.
    if before is None and fold(text) != f"({TOTAL_COST})":
        return FailedCondition(text, NO_VALUE)
    number: Exact | None = Decimal(0) if before is None else before
    for operator, by in made:
        if operator == "scale-down" and not by:
            return FailedCondition(text, BY_ZERO)
        assert number is not None
        assert not isinstance(by, int)
        number = EXACT.apply(CHANGES[operator], number, by)
    assert number is not None
    return decimal_of(number)


# The number of each fluent before a step, and its value after it, or why it has none.
NewValues = Mapping[FluentKey, tuple[Decimal | None, Decimal | int | FailedCondition]]


def new_values(view: View, changes: StepChanges) -> NewValues:
    """Return the new values of the fluents that a step changes."""
    numbers = {
        key: NumberOf(key.function_id, tuple(map(Known, objects_of(key))))
        for key, (_, made) in changes.assignments.items()
        if any(isinstance(value, Decimal | Fraction) for _, value in made)
    }
    values = read_numbers(view, list(numbers.values())) or {}
    found = {}
    for key, (text, made) in changes.assignments.items():
        before = values.get(numbers[key]) if key in numbers else None
        found[key] = before, combined(text, made, before)
    return found


def settled(view: View, changes: StepChanges) -> tuple[list[EffectItem], list[FailedCondition]]:
    """Return changes as ground effects with the new values of fluents, or why they have none."""
    items = [ground_item("delete", key.predicate_id, objects_of(key)) for key in changes.deletes]
    items += [ground_item("add", key.predicate_id, objects_of(key)) for key in changes.adds]
    failed = []
    for key, (_, value) in new_values(view, changes).items():
        if isinstance(value, FailedCondition):
            failed.append(value)
        else:
            given = Known(value) if isinstance(value, int) else value
            items.append(ground_item("assign", key.function_id, objects_of(key), given))
    return items, failed


def objects_of(key: AtomKey | FluentKey) -> tuple[int, ...]:
    """Return the objects of a fact or a fluent."""
    return tuple(map(int, key.arguments.split()))
