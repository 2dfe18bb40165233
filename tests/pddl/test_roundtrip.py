"""What is written reads back as an equal document, and is written again as the same text."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, Phase, example, given, settings

from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Domain, PddlWarning, Problem
from tests.documents import domains_and_problems

# As in the property test of the store: a number here hunts for longer.
HUNT = int(os.environ.get("KANT_SQL_TEST_EXAMPLES", "0"))

Warnings = tuple[PddlWarning, ...]


# Shrinking a document takes minutes: that is for those who hunt.
PHASES = tuple(Phase) if HUNT else (Phase.explicit, Phase.generate)


def hunting(examples: int) -> settings:
    return settings(
        max_examples=HUNT or examples,
        derandomize=not HUNT,
        database=None,
        deadline=None,
        phases=PHASES,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )


def check(domain: Domain, problem: Problem, strict: bool) -> tuple[Warnings, Warnings]:
    text = write(domain)
    read = read_domain(text, strict=strict)
    assert read == domain
    assert write(read) == text
    text = write(problem)
    again = read_problem(text, read, strict=strict)
    assert again == problem
    assert write(again) == text
    return read.warnings, again.warnings


@hunting(200)
@given(domains_and_problems())
@example((Domain("d", (":strips",)), Problem("p", "d")))
def test_what_is_well_formed_round_trips_without_a_warning(
    documents: tuple[Domain, Problem],
) -> None:
    domain, problem = documents
    check(domain, problem, strict=True)
    assert check(domain, problem, strict=False) == ((), ())


@hunting(100)
@given(domains_and_problems(repeats=True))
def test_parameters_that_share_a_name_round_trip(documents: tuple[Domain, Problem]) -> None:
    check(*documents, strict=False)
