"""The competitions' files, where they are beside the checkout."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NamedTuple

import pytest

EVERYTHING = os.environ.get("KANT_SQL_TEST_CORPUS") == "all"
_ROOT = Path(__file__).parents[2] / ".." / "shared" / "pddl"


class Pair(NamedTuple):
    name: str
    domain: Path
    problem: Path
    size: int


def pairs() -> list[Pair]:
    index = _ROOT / "index.json"
    if not index.exists():
        pytest.skip(f"the competitions' files are not at {_ROOT}")
    found = []
    for entry in json.loads(index.read_text()):
        domain, problem = _ROOT / entry["domain"], _ROOT / entry["problem"]
        size = domain.stat().st_size + problem.stat().st_size
        found.append(Pair(entry["problem"], domain, problem, size))
    return found


def small_pairs(size: int) -> list[Pair]:
    return sorted((pair for pair in pairs() if pair.size <= size), key=lambda pair: pair.size)
