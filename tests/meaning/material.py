"""The pairs of domain and problem that are judged, and what kant_sql makes of them.

A pair is a domain's and a problem's file. Those in `pairs/` are small and belong to these tests;
those of the planning competitions lie in `shared/pddl`, beside the checkout, if at all.
"""

from __future__ import annotations

from collections.abc import Sequence
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


@dataclass(frozen=True)
class Pair:
    """A domain and a problem in it."""

    name: str
    domain: Path
    problem: Path

    @classmethod
    def written(cls, name: str, folder: Path, domain: str, problem: str) -> Pair:
        """Write a pair into a folder."""
        pair = cls(name, folder / "domain.pddl", folder / "problem.pddl")
        pair.domain.write_text(domain, encoding="utf-8")
        pair.problem.write_text(problem, encoding="utf-8")
        return pair

    def changed(self, which: str, text: str, instead: str, folder: Path) -> Pair:
        """Write it into a folder, with another text in the place of one in one of its files."""
        texts = {"domain": self.domain.read_text(), "problem": self.problem.read_text()}
        assert text in texts[which]
        texts[which] = texts[which].replace(text, instead)
        return Pair.written(self.name, folder, **texts)

    @property
    def size(self) -> int:
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


class Workshop:
    """Makes our text of pairs, once each, in a folder.

    The tests' own pairs go all the way through a store; those of the competitions do so in
    `corpus/test_store.py`, which sees that the text is the same; here they are read and written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._made: dict[str, Pair] = {}

    def ours(self, pair: Pair) -> Pair:
        """Write what kant_sql makes of a pair into files of the same names."""
        if pair.name not in self._made:
            folder = self._folder / pair.name
            folder.mkdir(parents=True)
            way = by_documents if CORPUS in pair.domain.parents else self._by_store
            texts = way(pair.domain, pair.problem)
            self._made[pair.name] = Pair.written(pair.name, folder, *texts)
        return self._made[pair.name]

    def _by_store(self, domain: Path, problem: Path) -> tuple[str, str]:
        """Load two files into a knowledge base, and have it say what it holds."""
        url, name = f"sqlite:///{self._folder / 'store.db'}", f"pair-{len(self._made)}"
        with kant_sql.connect(url, knowledge_base=name) as kb:
            kb.load_domain(domain)
            kb.load_problem(problem)
            return kb.domain_pddl(), kb.problem_pddl()


def small(pairs: Sequence[Pair], most: int) -> list[Pair]:
    """Choose what has at most so many bytes, or everything if that is asked for."""
    return [pair for pair in pairs if ALL or pair.size <= most]
