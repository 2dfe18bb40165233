"""Which types are above which, compared with a walk through all that are above."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from kant_sql.pddl.symbols import Ancestry


def above(parents: dict[int, tuple[int, ...]], type_: int) -> set[int]:
    found, pending = {type_}, [type_]
    while pending:
        new = set(parents.get(pending.pop(), ())) - found
        found |= new
        pending += new
    return found


@st.composite
def hierarchies(draw: st.DrawFn) -> dict[int, tuple[int, ...]]:
    """Up to 30 types, each with up to three parents of smaller numbers."""
    parents: dict[int, tuple[int, ...]] = {0: ()}
    for number in range(1, draw(st.integers(1, 30))):
        lowest = draw(st.sampled_from([0, number - 1]))
        parents[number] = tuple(
            draw(st.lists(st.integers(lowest, number - 1), max_size=3, unique=True))
        )
    return parents


@given(hierarchies())
def test_it_agrees_with_a_walk(parents: dict[int, tuple[int, ...]]) -> None:
    ancestry = Ancestry(lambda type_: parents[type_])
    for lower in parents:
        expected = above(parents, lower)
        assert {upper for upper in parents if ancestry.is_below(lower, upper)} == expected


def test_a_check_looks_at_few_types() -> None:
    asked: list[int] = []

    def parents(type_: int) -> tuple[int, ...]:
        asked.append(type_)
        return (type_ - 1,) if type_ else ()

    ancestry = Ancestry(parents)
    assert all(ancestry.is_below(lower, 5_000) for lower in range(5_000, 10_000))
    assert not any(ancestry.is_below(lower, 5_000) for lower in range(5_000))
    assert len(asked) == 10_000


def test_a_type_that_comes_to_be_again_is_looked_up_again() -> None:
    parents = {0: (), 1: (), 2: (0,)}
    ancestry = Ancestry(lambda type_: parents[type_])
    assert not ancestry.is_below(2, 1)
    parents[2] = (1,)
    ancestry.forget(2)
    assert ancestry.is_below(2, 1)


def test_types_above_themselves_come_to_an_end() -> None:
    parents = {0: (2, 1), 1: (0, 2), 2: (1, 0), 3: (0,), 4: ()}
    ancestry = Ancestry(lambda type_: parents[type_])
    assert not ancestry.is_below(3, 4)
    assert ancestry.is_below(3, 0)
