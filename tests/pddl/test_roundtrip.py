"""What is written reads back as an equal document, and is written again as the same text."""

from __future__ import annotations

import pytest
from hypothesis import example, given

from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Domain, PddlWarning, Problem
from tests.support.generators.documents import domains_and_problems
from tests.support.profile import PROFILE, hunting

# As in the property test of the store: a number here hunts for longer.

Warnings = tuple[PddlWarning, ...]


def check(domain: Domain, problem: Problem, strict: bool) -> tuple[Warnings, Warnings]:
    text = write(domain)
    read = read_domain(text, strict=strict)
    assert read == domain
    assert write(read) == text
    text = write(problem)
    again = read_problem(text, domain=read, strict=strict)
    assert again == problem
    assert write(again) == text
    return read.warnings, again.warnings


@hunting(PROFILE.texts)
@given(domains_and_problems())
@example((Domain("d", (":strips",)), Problem("p", "d")))
def test_what_is_well_formed_round_trips_without_a_warning(
    documents: tuple[Domain, Problem],
) -> None:
    domain, problem = documents
    check(domain, problem, strict=True)
    assert check(domain, problem, strict=False) == ((), ())


@pytest.mark.more
@hunting(PROFILE.texts)
@given(domains_and_problems(repeats=True))
def test_parameters_that_share_a_name_round_trip(documents: tuple[Domain, Problem]) -> None:
    check(*documents, strict=False)
