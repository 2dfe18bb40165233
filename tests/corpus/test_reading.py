"""Every pair of the corpus is read; what violates the standard is noted, and refused if strict."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from kant_sql.errors import PddlError
from kant_sql.pddl import read_domain, read_problem

CORPUS = Path(__file__).parents[2] / ".." / "shared" / "pddl"
PAIRS = json.loads((CORPUS / "index.json").read_text()) if (CORPUS / "index.json").exists() else []
VIOLATIONS = {
    "odd:-type-no-space",
    "odd:action-name-clash",
    "odd:dup-pred-params",
    "odd:name-chars",
    "odd:object=type-name",
    "odd:section-order",
    "odd:several-toplevel",
    "odd:type=predicate-name",
}

pytestmark = pytest.mark.skipif(
    not PAIRS, reason=f"there is no corpus beside the checkout: {CORPUS}"
)


def test_all_pairs_are_read(record_property: Callable[[str, object], None]) -> None:
    failures = []
    for pair in PAIRS:
        try:
            domain = read_domain(CORPUS / pair["domain"])
            read_problem(CORPUS / pair["problem"], domain=domain)
            read_problem(CORPUS / pair["problem"])
        except PddlError as error:
            failures.append(str(error))
    record_property("pairs", len(PAIRS))
    print(f"{len(PAIRS) - len(failures)} of {len(PAIRS)} pairs are read")
    assert failures == []


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair["problem"])
def test_strict_reading_refuses_what_violates_the_standard(pair: dict[str, object]) -> None:
    domain = read_domain(CORPUS / str(pair["domain"]))
    problem = read_problem(CORPUS / str(pair["problem"]), domain=domain)
    warnings = domain.warnings + problem.warnings
    features = pair["features"]
    assert isinstance(features, list)
    if VIOLATIONS.intersection(features):
        assert warnings
    try:
        domain = read_domain(CORPUS / str(pair["domain"]), strict=True)
        read_problem(CORPUS / str(pair["problem"]), domain=domain, strict=True)
    except PddlError:
        assert warnings
    else:
        assert not warnings
