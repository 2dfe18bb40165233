"""The pairs of domain and problem that are judged, and what kant_sql makes of them.

A pair is a domain's and a problem's file. Those in `pairs/` are small and belong to these tests;
those of the planning competitions lie in `shared/pddl`, beside the checkout, if at all.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import kant_sql
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.writer import write
from tests.support.corpus import CORPUS, PAIRS
from tests.support.profile import PROFILE

HERE = Path(__file__).parent
PLANS = HERE / "plans"
# Everything, instead of what takes little time.
ALL = PROFILE.is_whole

Regenerate = Callable[[Path, Path], tuple[str, str]]


@dataclass(frozen=True)
class Pair:
    """A domain and a problem in it."""

    name: str
    domain: Path
    problem: Path

    @property
    def size(self) -> int:
        """How many bytes the two files have."""
        return self.domain.stat().st_size + self.problem.stat().st_size

    @property
    def plan(self) -> Path:
        """Where a plan for it is kept, if one is."""
        return PLANS / f"{self.name}.plan"


def own_pairs() -> list[Pair]:
    """The pairs that belong to these tests."""
    domains = sorted((HERE / "pairs").glob("*-domain.pddl"))
    names = [domain.name.removesuffix("-domain.pddl") for domain in domains]
    return [
        Pair(name, domain, domain.with_name(f"{name}-problem.pddl"))
        for name, domain in zip(names, domains, strict=True)
    ]


def corpus_pairs() -> list[Pair]:
    """The pairs of the competitions; none where the files are absent."""
    return [
        Pair(f"{pair.problem.parent.name}.{pair.problem.stem}", pair.domain, pair.problem)
        for pair in PAIRS
    ]


def by_documents(domain: Path, problem: Path) -> tuple[str, str]:
    """Read the two files and write them, with no store in between."""
    document = read_domain(domain)
    return write(document), write(read_problem(problem, domain=document))


class ByStore:
    """Loads two files into a knowledge base, and has it say what it holds."""

    def __init__(self, folder: Path) -> None:
        self._url = f"sqlite:///{folder / 'store.db'}"
        self._numbers = itertools.count(1)

    def __call__(self, domain: Path, problem: Path) -> tuple[str, str]:
        kb = kant_sql.connect(self._url, knowledge_base=f"pair-{next(self._numbers)}")
        try:
            kb.load_domain(domain)
            kb.load_problem(problem)
            return kb.domain_pddl(), kb.problem_pddl()
        finally:
            kb.close()


class Workshop:
    """Makes our text of pairs, once each, in a folder.

    `way` is how kant_sql gets from two files to our text. Without one, the tests' own pairs go all
    the way through a store; those of the competitions do so in `corpus/test_store.py`, which sees
    that the text is the same, and are just read and written here.
    """

    def __init__(self, folder: Path, way: Regenerate | None = None) -> None:
        self._folder = folder
        self._way = way
        self._by_store = ByStore(folder)
        self._made: dict[str, Pair] = {}

    def ours(self, pair: Pair) -> Pair:
        """Write what kant_sql makes of a pair into files of the same names."""
        if pair.name not in self._made:
            folder = self._folder / pair.name
            folder.mkdir(parents=True)
            made = Pair(pair.name, folder / "domain.pddl", folder / "problem.pddl")
            given = by_documents if CORPUS in pair.domain.parents else self._by_store
            domain, problem = (self._way or given)(pair.domain, pair.problem)
            made.domain.write_text(domain, encoding="utf-8")
            made.problem.write_text(problem, encoding="utf-8")
            self._made[pair.name] = made
        return self._made[pair.name]


def small(pairs: Sequence[Pair], most: int) -> list[Pair]:
    """Choose what has at most so many bytes, or everything if that is asked for."""
    return [pair for pair in pairs if ALL or pair.size <= most]
