"""The competitions' files, if they are beside the checkout."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

CORPUS = Path(__file__).resolve().parents[3] / "shared" / "pddl"
WITHOUT_CORPUS = "no competition files: ../shared/pddl, beside the checkout, is absent"


class Pair(NamedTuple):
    """A domain and one of its problems.

    Attributes:
        name: the problem's path below the corpus.
        domain: the domain's file.
        problem: the problem's file.
        features: the features of both in the index.
    """

    name: str
    domain: Path
    problem: Path
    features: frozenset[str]

    @property
    def size(self) -> int:
        """The bytes of both files."""
        return self.domain.stat().st_size + self.problem.stat().st_size


def _pairs() -> Iterator[Pair]:
    index = CORPUS / "index.json"
    for entry in json.loads(index.read_text()) if index.exists() else ():
        domain, problem = CORPUS / entry["domain"], CORPUS / entry["problem"]
        yield Pair(entry["problem"], domain, problem, frozenset(entry["features"]))


PAIRS = tuple(_pairs())
each_pair = pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.name)
needs_corpus = pytest.mark.skipif(not PAIRS, reason=WITHOUT_CORPUS)


def small_pairs(size: int) -> list[Pair]:
    """Return the pairs up to a number of bytes, the smallest first."""
    return sorted((pair for pair in PAIRS if pair.size <= size), key=lambda pair: pair.size)
