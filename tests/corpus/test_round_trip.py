"""Every pair of the corpus is read, written, and read again as the same documents."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from kant_sql.pddl import read_domain, read_problem, write

CORPUS = Path(__file__).parents[2] / ".." / "shared" / "pddl"
PAIRS = (
    [(pair["domain"], pair["problem"]) for pair in json.loads((CORPUS / "index.json").read_text())]
    if (CORPUS / "index.json").exists()
    else []
)


@pytest.mark.skipif(not PAIRS, reason=f"there is no corpus beside the checkout: {CORPUS}")
@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair[1])
def test_a_pair_round_trips(pair: tuple[str, str]) -> None:
    domain = read_domain(CORPUS / pair[0])
    text = write(domain)
    again = read_domain(text)
    assert again == domain
    assert write(again) == text
    problem = read_problem(CORPUS / pair[1], domain=domain)
    text = write(problem)
    read = read_problem(text, domain=again)
    assert read == problem
    assert write(read) == text
