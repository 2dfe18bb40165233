"""Other parsers read from our text what they read from the originals.

- unified-planning: the two problems are `==`, which does not count the order of declarations.
- Fast Downward's translator: the two ground tasks are equal under the names of their atoms.
- pyperplan: so are its two ground tasks.

Where a parser refuses an original, nothing is compared. unified-planning's takes a minute for a
megabyte, so only small pairs are read, unless the profile `long` asks for all of them.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.meaning import others
from tests.meaning.material import ALL, Pair, Workshop, corpus_pairs, own_pairs, small
from tests.meaning.others import Answer
from tests.support.corpus import WITHOUT_CORPUS

OWN = own_pairs()
# Bytes of a pair that are read in a moment.
SMALL = 3_000
PATIENT = pytest.mark.timeout(1800)


def test_unified_planning_reads_the_same(workshop: Workshop) -> None:
    others.need("unified_planning")
    answers = others.unified_planning(OWN, [workshop.ours(pair) for pair in OWN])
    _check(answers, ["conditional", "numbers", "process", "strips", "temporal", "timed"])


@PATIENT
def test_unified_planning_reads_the_same_of_the_competitions(workshop: Workshop) -> None:
    others.need("unified_planning")
    pairs = small(_corpus(), SMALL)
    answers = others.unified_planning(pairs, [workshop.ours(pair) for pair in pairs])
    _check(answers, [], least=65 if ALL else 18)


def test_unified_planning_sees_a_change(workshop: Workshop, tmp_path: Path) -> None:
    others.need("unified_planning")
    pair = _own("conditional")
    changed = workshop.ours(pair).changed("problem", "(dirty mug)", "", tmp_path)
    (answer,) = others.unified_planning([pair], [changed])
    assert answer.outcome == "differs"


@PATIENT
def test_fast_downward_reads_the_same(workshop: Workshop, tmp_path: Path) -> None:
    others.need("fast_downward")
    answers = [
        _by_fast_downward(pair, workshop.ours(pair), tmp_path)
        for pair in [*OWN, *small(corpus_pairs(), SMALL)]
    ]
    _check(answers, ["conditional", "derived", "untyped"], least=12 if corpus_pairs() else 3)


def test_fast_downward_sees_a_change(workshop: Workshop, tmp_path: Path) -> None:
    others.need("fast_downward")
    pair = _own("derived")
    changed = workshop.ours(pair).changed("problem", "(burnt hall)", "", tmp_path)
    assert _by_fast_downward(pair, changed, tmp_path).outcome == "differs"


@PATIENT
def test_pyperplan_reads_the_same(workshop: Workshop) -> None:
    others.need("pyperplan")
    answers = [
        others.compare(pair.name, others.pyperplan(pair), others.pyperplan(workshop.ours(pair)))
        for pair in [*OWN, *small(corpus_pairs(), SMALL)]
    ]
    _check(answers, ["strips"], least=5 if corpus_pairs() else 1)


def _corpus() -> list[Pair]:
    pairs = corpus_pairs()
    if not pairs:
        pytest.skip(WITHOUT_CORPUS)
    return pairs


def _own(name: str) -> Pair:
    return next(pair for pair in OWN if pair.name == name)


def _by_fast_downward(pair: Pair, ours: Pair, folder: Path) -> Answer:
    original = others.fast_downward(pair, folder)
    return others.compare(pair.name, original, others.fast_downward(ours, folder))


def _check(answers: list[Answer], expected: list[str], least: int = 0) -> None:
    counted = Counter(answer.outcome for answer in answers)
    print(dict(counted))
    wrong = [answer for answer in answers if answer.outcome not in ("equal", "refused")]
    assert not wrong, "\n".join(map(str, wrong))
    equal = {answer.name for answer in answers if answer.outcome == "equal"}
    assert equal >= set(expected), [answer for answer in answers if answer.name in expected]
    assert counted["equal"] >= least
