"""VAL reads our text as it reads the originals, and says the same of plans.

Each pair is written by kant_sql and judged beside its original. The profile `long` judges
the pairs too that take VAL or other parsers long (`test_other_parsers.py`), and has planners plan
for all pairs that they can (`test_planners.py`).
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.meaning import val
from tests.meaning.material import ALL, Workshop, corpus_pairs, own_pairs, small
from tests.support.corpus import WITHOUT_CORPUS

OWN = {pair.name: pair for pair in own_pairs()}
# Bytes of a pair: the six larger ones take half of the time, one of them as long as all others.
USUAL = 20_000
# A plan that VAL carries out in seconds.
LONG_PLANS = frozenset() if ALL else {"ipc2004-psr-middle-compiled-adl.instance-2"}
# What a change in the text of a pair must be seen by.
CHANGES = [
    ("derived", "domain", "(not (burnt", "(and (burnt"),
    ("timed", "problem", "8.5", "9.5"),
    ("timed", "domain", "<= ?duration", "< ?duration"),
    ("preferences", "problem", "2.5", "2.6"),
    ("constraints", "problem", "sometime-before", "sometime-after"),
    ("numeric", "domain", "scale-down", "scale-up"),
    ("conditional", "domain", "cup plate - ware", "cup - ware plate - staff"),
    ("process", "domain", ":event", ":process"),
]


@pytest.mark.parametrize("name", sorted(OWN))
def test_val_reads_the_same(name: str, workshop: Workshop) -> None:
    original = val.parse(OWN[name])
    assert original.accepted, original.message
    ours = val.parse(workshop.ours(OWN[name]))
    assert ours.accepted, ours.message
    assert ours.tree == original.tree


@pytest.mark.parametrize(("name", "which", "text", "instead"), CHANGES)
def test_val_sees_a_change(
    name: str, which: str, text: str, instead: str, tmp_path: Path, workshop: Workshop
) -> None:
    changed = workshop.ours(OWN[name]).changed(which, text, instead, tmp_path)
    assert val.parse(changed).tree != val.parse(OWN[name]).tree


def test_val_reads_the_same_of_the_competitions(workshop: Workshop) -> None:
    pairs = small(corpus_pairs(), USUAL)
    if not pairs:
        pytest.skip(WITHOUT_CORPUS)
    wrong = []
    accepted = ours_accepted = 0
    for pair in pairs:
        original, ours = val.parse(pair), val.parse(workshop.ours(pair))
        accepted += original.accepted
        ours_accepted += ours.accepted
        if original.accepted and not ours.accepted:
            wrong.append(f"{pair.name}: ours refused: {ours.message}")
        elif original.accepted and ours.tree != original.tree:
            wrong.append(f"{pair.name}: {_first_difference(original.tree, ours.tree)}")
    print(f"VAL accepts {accepted} of {len(pairs)} originals, {ours_accepted} of ours")
    assert not wrong, "\n".join(wrong)
    assert accepted >= 100


@pytest.mark.parametrize("name", sorted(name for name, pair in OWN.items() if pair.plan.exists()))
def test_a_plan_is_judged_the_same(name: str, workshop: Workshop) -> None:
    pair = OWN[name]
    original = val.validate(pair, pair.plan)
    assert original.valid, original.output
    ours = val.validate(workshop.ours(pair), pair.plan)
    assert ours.same(original), ours.output


def test_violated_preferences_have_their_price(workshop: Workshop) -> None:
    pair = OWN["preferences"]
    verdict = val.validate(workshop.ours(pair), pair.plan)
    # 2.5 * 2 for tidy, 10 for silence, 0 for tour, 4 for early, 7 for once, and 3 steps.
    assert verdict.valid
    assert verdict.value == "29"
    assert verdict.violations == ("early: 1", "once: 1", "silence: 1", "tidy: 2")


def test_plans_are_judged_the_same_for_the_competitions(workshop: Workshop) -> None:
    chosen = [pair for pair in small(corpus_pairs(), USUAL) if pair.name not in LONG_PLANS]
    pairs = [pair for pair in chosen if pair.plan.exists()]
    if not pairs:
        pytest.skip(WITHOUT_CORPUS)
    wrong = []
    for pair in pairs:
        original = val.validate(pair, pair.plan)
        ours = val.validate(workshop.ours(pair), pair.plan)
        if not original.valid:
            wrong.append(f"{pair.name}: the plan is invalid: {original.output[-500:]}")
        elif not ours.same(original):
            wrong.append(f"{pair.name}: {_first_difference(original.lines, ours.lines)}")
    print(f"VAL judges {len(pairs)} plans the same")
    assert not wrong, "\n".join(wrong)


def test_what_the_empty_plan_lacks_is_the_same(workshop: Workshop, tmp_path: Path) -> None:
    """The empty plan is judged by the initial state, the goal and the constraints alone."""
    pairs = [*OWN.values(), *small(corpus_pairs(), USUAL)]
    empty = tmp_path / "empty.plan"
    empty.write_text("")
    wrong = []
    for pair in filter(val.accepts, pairs):
        original = val.validate(pair, empty)
        if original.refused:
            continue
        ours = val.validate(workshop.ours(pair), empty)
        if not ours.same(original):
            wrong.append(f"{pair.name}: {_first_difference(original.lines, ours.lines)}")
    assert not wrong, "\n".join(wrong)


def _first_difference(original: tuple[str, ...], ours: tuple[str, ...]) -> str:
    for number, (left, right) in enumerate(zip(original, ours, strict=False)):
        if left != right:
            around = original[max(0, number - 8) : number]
            return f"at {number}: {left!r} became {right!r} after {list(around)}"
    return f"{len(original)} lines became {len(ours)}"
