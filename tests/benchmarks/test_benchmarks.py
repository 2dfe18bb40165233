"""Small runs of the benchmarks: what they compare with says the same as the library."""

from __future__ import annotations

import importlib

import pytest

from tests.benchmarks import present, web
from tests.support.crawling import PATHS

SMALL = {
    "acting": ["--repeat", "1", "--pairs", "0", "--backend", "sqlite"],
    "answering": ["--facts", "2000", "--edges", "90", "--rounds", "3", "--backend", "sqlite"],
    "asof": ["--changes", "30000", "--small", "20000", "--backend", "sqlite"],
    "documents": ["--facts", "50", "--repeat", "1", "--backend", "sqlite"],
    "exporting": ["--revisions", "500", "--repeat", "1", "--backend", "sqlite"],
    "following": ["--readers", "3", "--windows", "2", "--backend", "sqlite"],
    "held": ["--changes", "30000", "--small", "20000", "--backend", "sqlite"],
    "present": ["--repeat", "1", "--backends", "sqlite-file", "sqlite-memory"],
    "timeline": ["--intervals", "500", "--backend", "sqlite"],
    "verifying": ["200", "sqlite"],
    "web": ["--changes", "4000", "--repeat", "1", "--requests", "50", "--backend", "sqlite"],
}


@pytest.mark.parametrize("name", SMALL)
def test_a_benchmark_runs(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(present, "CALLS", 20)
    assert importlib.import_module(f"tests.benchmarks.{name}").main(SMALL[name]) == 0
    assert "sqlite" in capsys.readouterr().out


def test_the_time_of_each_page_is_measured() -> None:
    measured = web.pages(web.Known(100, ["(robot_at robot1 wp1)"], [1]))
    assert {name.split()[0].rstrip(",") for name in measured} == set(PATHS)
