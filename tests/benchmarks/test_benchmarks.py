"""Small runs of the benchmarks: what they compare with says the same as the library."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from tests.benchmarks import engines, sizing

SMALL = {
    "adding": ["--rounds", "2", "--backend", "sqlite"],
    "causing": ["--acts", "20", "--backend", "sqlite"],
    "answering": ["--facts", "2000", "--edges", "90", "--rounds", "3", "--backend", "sqlite"],
    "asof": ["--changes", "30000", "--small", "20000", "--backend", "sqlite"],
    "documents": ["--facts", "50", "--repeat", "1", "--backend", "sqlite"],
    "knowledge_bases": ["--robots", "4", "--revisions", "4", "--backend", "sqlite"],
    "past": ["--boxes", "40", "--facts", "500", "--revisions", "30", "--backend", "sqlite"],
    "pushing": ["--changes", "2000", "--one", "500", "--backend", "sqlite"],
    "sizing": ["--revisions", "120", "--backend", "sqlite"],
    "successors": ["--pairs", "ipc1998-gripper-round-1-strips", "--successors", "200"],
    "timeline": ["--intervals", "500", "--backend", "sqlite"],
    "two_clocks": ["--boxes", "20", "--revisions", "240", "--backend", "sqlite"],
    "verifying": ["200", "sqlite"],
}


@pytest.mark.parametrize("name", SMALL)
def test_a_benchmark_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert importlib.import_module(f"tests.benchmarks.{name}").main(SMALL[name]) == 0
    assert "sqlite" in capsys.readouterr().out


def test_engines_are_counted_by_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("unified_planning")
    for name, condition in (("easy", ""), ("hard", "(b)")):
        (tmp_path / f"{name}.pddl").write_text(
            f"(define (domain d) (:predicates (a) (b)) (:action x :parameters () "
            f":precondition (and {condition}) :effect (a)))"
        )
    (tmp_path / "p.pddl").write_text("(define (problem p) (:domain d) (:init) (:goal (a)))")
    (tmp_path / "list").write_text("# one\neasy.pddl\tp.pddl\n# two\nhard.pddl\tp.pddl\n")
    engines_run = ["--engines", "fast-downward", "echoes: echo {domain} {problem}"]
    assert engines.main([str(tmp_path / "list"), *engines_run]) == 0
    printed = capsys.readouterr().out
    assert "| one | 1 solved | 1 failed |\n| two | 1 no plan | 1 failed |" in printed
    assert "| fast-downward | no plan | unsolvable_proven | 1 |" in printed


def test_the_needs_of_fleets_in_the_guide_follow_from_what_was_measured() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "fleet.md").read_text()
    [row] = re.findall(r"^\| pushed to PostgreSQL \| (.*) \|$", guide, re.MULTILINE)
    disk, log, client, server = (float(cell.split()[0]) for cell in row.split(" | "))
    spent = sizing.Spent(disk, log, client / 1e3, server / 1e3)
    for cells in sizing.needs(spent):
        assert f"| {' | '.join(cells)} |" in guide
