"""The pairs of the corpus are stored, and come back as the same documents and the same text."""

from __future__ import annotations

from pathlib import Path

import pytest

from kant_sql import KnowledgeBase
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.writer import write
from tests.support.corpus import PAIRS, needs_corpus, small_pairs
from tests.support.profile import PROFILE
from tests.support.reading import beside
from tests.support.stores import Connect, make_store_url

# Bytes of a pair: all but six in a file, a third of them on PostgreSQL. The six are larger than all
# others together; the profile `long` stores all pairs.
USUAL = {"sqlite-file": 20_000, "postgresql": 4_000}


@needs_corpus
@pytest.mark.parametrize("backend", ["sqlite-file", "postgresql"])
def test_all_pairs_are_stored_and_regenerated(
    request: pytest.FixtureRequest, tmp_path: Path, connect: Connect, backend: str
) -> None:
    first = connect(make_store_url(request, backend, tmp_path), knowledge_base="first")
    faults = {}
    chosen = PAIRS if PROFILE.is_whole else small_pairs(USUAL[backend])
    for pair in chosen:
        try:
            _check(beside(first, pair.name), pair.domain, pair.problem)
        except Exception as error:
            faults[pair.name] = f"{type(error).__name__}: {error}"
    print(f"{len(chosen) - len(faults)} of {len(chosen)} pairs are stored on {backend}")
    assert faults == {}


def _check(kb: KnowledgeBase, domain_path: Path, problem_path: Path) -> None:
    domain = read_domain(domain_path)
    problem = read_problem(problem_path, domain=domain)
    assert kb.load_domain(domain_path) == (1, domain.warnings)
    # A problem that says nothing, of which there is none here, would make no revision.
    assert kb.load_problem(problem_path) == (2, problem.warnings)
    assert (kb.pddl.domain(), kb.pddl.problem()) == (domain, problem)
    domain_text, problem_text = kb.domain_pddl(), kb.problem_pddl()
    assert domain_text == write(domain)
    assert problem_text == write(kb.pddl.problem())
    assert read_domain(domain_text) == domain
    assert read_problem(problem_text, domain=domain) == problem
    # What was written says all of what is stored, and nothing else.
    assert kb.load_domain(domain_text).revision is None
    assert kb.load_problem(problem_text).revision is None
    assert (kb.domain_pddl(), kb.problem_pddl()) == (domain_text, problem_text)
