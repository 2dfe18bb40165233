"""Snapshots of named elements behave as a plain dict does, however many changes lie behind."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.errors import StoreIntegrityError
from kant_sql.knowledge.definitions import Elements, PendingElements

Plain = dict[int, "Thing"]


class Thing(NamedTuple):
    id: int
    name: str
    text: str


IDS = st.integers(1, 90)


TEXTS = st.none() | st.sampled_from(["a", "b"])


def thing(id_: int, text: str | None) -> Thing | None:
    # An identity keeps its name, whatever becomes of its definition.
    return None if text is None else Thing(id_, f"Thing-{id_}", text)


FEW = st.dictionaries(IDS, TEXTS, max_size=5)
# So many that they become the new bulk.
MANY = st.builds(lambda low, text: dict.fromkeys(range(low, 91), text), st.integers(1, 25), TEXTS)
CHANGES = st.one_of(FEW, FEW, MANY).map(
    lambda texts: {id_: thing(id_, text) for id_, text in texts.items()}
)


def plain_evolve(plain: Plain, changes: dict[int, Thing | None]) -> Plain:
    merged = {**plain, **changes}
    return {id_: thing for id_, thing in merged.items() if thing is not None}


def check(elements: Elements[Thing], plain: Plain) -> None:
    assert list(elements) == [plain[id_] for id_ in sorted(plain)]
    for id_ in range(1, 91):
        assert elements.get(id_) == plain.get(id_)
        assert elements.named(f"THING-{id_}") == plain.get(id_)
    assert elements.get(None) is None
    assert elements.named("never known") is None


@given(st.lists(CHANGES, max_size=8))
def test_any_changes_give_what_a_dict_has(sequence: list[dict[int, Thing | None]]) -> None:
    elements: Elements[Thing] = Elements()
    plain: Plain = {}
    history = [(elements, plain)]
    for changes in sequence:
        elements, plain = elements.evolve(changes), plain_evolve(plain, changes)
        history.append((elements, plain))
    # A snapshot stays as it was, for threads still read it.
    for snapshot, then in history:
        check(snapshot, then)


@given(CHANGES, st.lists(CHANGES, max_size=4))
def test_a_transaction_sees_its_own_changes_and_publishes_them(
    before: dict[int, Thing | None], sequence: list[dict[int, Thing | None]]
) -> None:
    origin: Elements[Thing] = Elements[Thing]().evolve(before)
    plain = plain_evolve({}, before)
    pending = PendingElements(origin)
    changed = plain
    for changes in sequence:
        pending.changes.update(changes)
        pending.interned.update({f"thing-{id_}": (id_, f"Thing-{id_}") for id_ in changes})
        changed = plain_evolve(changed, changes)
        check(pending, changed)
    check(origin, plain)
    check(pending.publish(), changed)
    check(origin, plain)


def test_the_name_of_a_rolled_back_element_is_known_to_nobody() -> None:
    origin: Elements[Thing] = Elements()
    pending = PendingElements(origin)
    pending.interned["cup"] = (7, "cup")
    pending.unwritten[7] = "cup"
    pending.changes[7] = Thing(7, "cup", "cup")
    assert pending.named("cup") is not None
    assert pending.id_of("CUP") == 7
    assert origin.named("cup") is None
    assert "cup" not in origin.ids


def test_an_identity_that_was_never_written_is_not_published() -> None:
    pending: PendingElements[Thing] = PendingElements(Elements())
    pending.interned.update({"cup": (7, "cup"), "mug": (8, "mug"), "jug": None})
    pending.unwritten[7] = "cup"
    assert pending.publish().ids == {"mug": 8}


def test_what_is_referred_to_must_be_live() -> None:
    elements = Elements[Thing]().evolve({1: Thing(1, "cup", "cup")})
    assert elements.live(1).name == "cup"
    with pytest.raises(StoreIntegrityError, match="element 2 is referred to but not live"):
        elements.live(2)


def test_no_change_is_the_same_snapshot() -> None:
    elements: Elements[Thing] = Elements()
    assert elements.evolve({}) is elements
