"""Every pair of the corpus is read, written, and read again as the same documents."""

from __future__ import annotations

from kant_sql.pddl import read_domain, read_problem, write
from tests.support.corpus import Pair, each_pair, needs_corpus


@needs_corpus
@each_pair
def test_a_pair_round_trips(pair: Pair) -> None:
    domain = read_domain(pair.domain)
    text = write(domain)
    again = read_domain(text)
    assert again == domain
    assert write(again) == text
    problem = read_problem(pair.problem, domain=domain)
    text = write(problem)
    read = read_problem(text, domain=again)
    assert read == problem
    assert write(read) == text
