"""What the start of a running step leaves, and taking it back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

from ..dto import formulas as f
from ..dto.elements import atom_text, value_text
from ..dto.formulas import AT_START
from ..errors import (
    ArchivedError,
    InvalidKnowledgeError,
    NotApplicableError,
    PddlError,
    PlanError,
)
from ..history.diff import diff
from ..plans import RecordedStep
from ..sql.changes import ASSERTED, RETRACTED, Change
from ..store.caches import AtomKey, FluentKey, FluentValue, read_value
from ..store.snapshot import View
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .effects import EffectReader, StepChanges, combined, settled, unchanged
from .failures import FailedCondition
from .steps import ground


@dataclass(frozen=True)
class Aborted(RecordedStep):
    """An aborted step, and what that leaves.

    Attributes:
        left: the changes of its start that still stand, as a log has them; None if they are not
            known, because the state before the start was archived, or was not committed.
        undone: the changes of its start that were taken back.
    """

    left: tuple[Change, ...] | None
    undone: tuple[Change, ...] = ()

    def __str__(self) -> str:
        step = super().__str__()
        if self.undone:
            return f"{step} was aborted, and {_listed(self.undone)} taken back"
        if self.left is None:
            return f"{step} was aborted; what it leaves is not known"
        return f"{step} was aborted; it leaves {_listed(self.left) or 'nothing'}"


def _listed(changes: tuple[Change, ...]) -> str:
    return ", ".join(f"{change.sign}{change.text}" for change in changes)


@dataclass(frozen=True)
class _Effect:
    """What the start of a step changed of one element.

    Attributes:
        key: the fact or the fluent.
        before: whether the fact held, or the value, before.
        after: the same since.
        changes: the change as a log has it.
        is_alone: whether nothing else of that revision changed the element, too.
    """

    key: AtomKey | FluentKey
    before: bool | FluentValue | None
    after: bool | FluentValue | None
    changes: tuple[Change, ...]
    is_alone: bool = True


def start_effects(store: Store, step: RecordedStep) -> list[_Effect] | None:
    """Find what the start of a running step changed; None if the state before is not known."""
    if not step.outcomes:
        return None
    number = step.outcomes[-1].since.number

    def work(view: View) -> tuple[StepChanges, dict[AtomKey, str], set[FluentKey]]:
        found = ground(view.definitions, step)
        numbers = {} if step.duration is None else {f.DURATION: step.duration}
        read = EffectReader(view, found, numbers).read(found.action.items(AT_START))
        deleted = {key: _text(view, key) for key in read.deletes if key not in read.adds}
        items, _ = settled(view, read)
        same = unchanged(view, items)
        return read, {**read.adds, **deleted}, same

    try:
        read, texts, same = store.read_in_snapshot(work, number - 1)
        changes = diff(State(store, None), number - 1, number)
        lines = {(each.sign, each.text): each for each in changes}
    except (ArchivedError, InvalidKnowledgeError, NotApplicableError, PddlError):
        # Archived, or the start is of the revision that declares what it needs.
        return None
    return [*_facts(read, texts, lines), *_values(store, read, lines, same)]


_Lines = dict[tuple[str, str], Change]


def _text(view: View, key: AtomKey) -> str:
    live = view.definitions.objects.live
    names = [live(int(id_)).name for id_ in key.arguments.split()]
    return atom_text(view.definitions.predicates.live(key.predicate_id).name, names)


def _facts(read: StepChanges, texts: dict[AtomKey, str], lines: _Lines) -> Iterator[_Effect]:
    for key, text in texts.items():
        is_added = key in read.adds
        line = lines.get((ASSERTED if is_added else RETRACTED, text))
        if line is not None:
            yield _Effect(key, not is_added, is_added, (line,))


def _values(
    store: Store, read: StepChanges, lines: _Lines, same: set[FluentKey]
) -> Iterator[_Effect]:
    for key, (text, made) in read.assignments.items():
        begin = value_text(text, "")[:-1]
        found = {
            sign: (line, read_value(text, line.text, _object(store, line.text[len(begin) : -1])))
            for (sign, _), line in lines.items()
            if line.text.startswith(begin)
        }
        if not found and (key in same or any(isinstance(by, int) for _, by in made)):
            continue
        (before, after) = (
            found[sign][1] if sign in found else None for sign in (RETRACTED, ASSERTED)
        )
        is_number = before is not None and before.object_id is None
        number = Decimal(before.text) if before is not None and is_number else None
        expected = combined(text, made, number)
        is_alone = after is not None and _is(after, expected)
        yield _Effect(key, before, after, tuple(line for line, _ in found.values()), is_alone)


def _is(value: FluentValue, expected: Decimal | int | FailedCondition) -> bool:
    if isinstance(expected, int):
        return value.object_id == expected
    return isinstance(expected, Decimal) and value.is_same(FluentValue(str(expected)))


def _object(store: Store, text: str) -> int | None:
    """Return the object that a value is; None for a number."""
    found = store.read_definitions(lambda definitions: definitions.objects.named(text))
    return None if found is None else found.id


def standing(transaction: Transaction, effects: list[_Effect]) -> list[bool]:
    """Return which effects still stand."""
    atoms = transaction.propositions.find([e.key for e in effects if isinstance(e.key, AtomKey)])
    fluents = transaction.values.find([e.key for e in effects if isinstance(e.key, FluentKey)])
    found = []
    for effect in effects:
        if isinstance(effect.key, AtomKey):
            atom = atoms.get(effect.key)
            holds = atom is not None and transaction.propositions.holds(atom)
            found.append(holds == effect.after)
            continue
        fluent = fluents.get(effect.key)
        value = None if fluent is None else transaction.values.value(fluent)
        after = effect.after
        is_same = value.is_same(after) if value and isinstance(after, FluentValue) else False
        found.append(is_same or value is after)
    return found


def take_back(transaction: Transaction, step: RecordedStep, effects: list[_Effect] | None) -> None:
    """Take back what the start of a step changed, unless something else changed it."""
    if effects is None:
        raise PlanError(
            f"{step} cannot be undone: the state before its start is archived or not committed; "
            "abort it without undo, and correct what it left"
        )
    stands = standing(transaction, effects)
    others = [e for e, is_so in zip(effects, stands, strict=True) if not (is_so and e.is_alone)]
    if others:
        texts = ", ".join(f"{line.sign}{line.text}" for each in others for line in each.changes)
        raise PlanError(
            f"{step} cannot be undone: something else changed what its start did ({texts}); "
            "nothing was written: abort it without undo, and correct what it left"
        )
    atoms = transaction.propositions.find([e.key for e in effects if isinstance(e.key, AtomKey)])
    fluents = transaction.values.find([e.key for e in effects if isinstance(e.key, FluentKey)])
    for effect in effects:
        if isinstance(effect.key, AtomKey):
            transaction.propositions.set(atoms[effect.key], bool(effect.before))
        else:
            assert not isinstance(effect.before, bool)
            transaction.values.spell(fluents[effect.key], effect.before)
