"""Every pair of the corpus is read and written; what violates the standard is refused if strict."""

from __future__ import annotations

from collections.abc import Callable

from kant_sql.errors import PddlError
from kant_sql.pddl import read_domain, read_problem, write
from tests.support.corpus import PAIRS, Pair, each_pair, needs_corpus

VIOLATIONS = {
    *("odd:-type-no-space", "odd:action-name-clash", "odd:dup-pred-params", "odd:name-chars"),
    *("odd:object=type-name", "odd:section-order", "odd:several-toplevel"),
    "odd:type=predicate-name",
}

pytestmark = needs_corpus


def test_all_pairs_are_read(record_property: Callable[[str, object], None]) -> None:
    failures = []
    for pair in PAIRS:
        try:
            domain = read_domain(pair.domain)
            read_problem(pair.problem, domain=domain)
            read_problem(pair.problem)
        except PddlError as error:
            failures.append(str(error))
    record_property("pairs", len(PAIRS))
    print(f"{len(PAIRS) - len(failures)} of {len(PAIRS)} pairs are read")
    assert failures == []


@each_pair
def test_a_pair_round_trips_and_strict_reading_refuses_what_breaks_the_standard(pair: Pair) -> None:
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
    warnings = domain.warnings + problem.warnings
    if VIOLATIONS & pair.features:
        assert warnings
    try:
        domain = read_domain(pair.domain, strict=True)
        read_problem(pair.problem, domain=domain, strict=True)
    except PddlError:
        assert warnings
    else:
        assert not warnings
