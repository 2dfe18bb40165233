"""Plans for soft goals are valid for VAL, and as good as plans without these, or better."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from kant_sql import NoPlanError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.planning import solve
from tests.meaning import val
from tests.meaning.material import ALL, corpus_pairs
from tests.support.corpus import WITHOUT_CORPUS

pytest.importorskip("unified_planning")
pytest.importorskip("up_fast_downward")

PAIRS = {pair.name: pair for pair in corpus_pairs()}
SOLVED = (
    "ipc2006-rovers-metric-preferences-simple.instance-1",
    "ipc2006-storage-preferences-qualitative.instance-1",
    "ipc2006-tpp-preferences-qualitative.instance-1",
)
WISHING = sorted(
    name
    for name, pair in PAIRS.items()
    if "preference" in (pair.domain.read_text(errors="replace") + pair.problem.read_text()).lower()
)
SECONDS = 90


@pytest.mark.parametrize("name", WISHING if ALL else SOLVED)
def test_soft_goals_make_plans_better(name: str, tmp_path: Path) -> None:
    if name not in PAIRS:
        pytest.skip(WITHOUT_CORPUS)
    pair = PAIRS[name]
    domain = read_domain(pair.domain)
    problem = read_problem(pair.problem, domain=domain)
    try:
        plan = solve(domain, problem=problem, timeout=SECONDS)
    except NoPlanError as error:
        if error.status in {"unsupported_problem", "timeout"} and name not in SOLVED:
            pytest.skip(str(error))
        raise
    indifferent = solve(domain, problem=replace(problem, metric=None), timeout=SECONDS)
    # VAL says which of two values of a metric is which only by its sign.
    sign = 1 if problem.metric is None or problem.metric.optimization == "minimize" else -1
    values = [
        sign * float(val.carried_out(pair, found, tmp_path / "plan").value)
        for found in (plan, indifferent)
    ]
    assert values[0] <= values[1] or plan.ignored
    assert name not in SOLVED or not plan.ignored
