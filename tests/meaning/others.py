"""Other parsers as judges, each in a process of its own: nothing of theirs is imported here."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.meaning.material import HERE, Pair
from tests.support.processes.warm import PLANNING, python

SECONDS = 1800
WITHOUT_PLANNING = "install kant-sql[planning] for this"


class Answer(NamedTuple):
    """What a parser makes of an original and ours.

    `outcome` is `refused` (the original, so there is nothing to compare), `equal`, `differs` or
    `ours refused`.
    """

    name: str
    outcome: str
    message: str


def need(*packages: str) -> None:
    """Skip the test where packages are missing."""
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        pytest.skip(f"no {', '.join(missing)}: {WITHOUT_PLANNING}")


def unified_planning(originals: Sequence[Pair], ours: Sequence[Pair]) -> list[Answer]:
    """Have unified-planning read all pairs, in one process, for it takes a second to start."""
    files = [
        [left.name, *map(str, (left.domain, left.problem, right.domain, right.problem))]
        for left, right in zip(originals, ours, strict=True)
    ]
    program = python(*PLANNING)
    done = run([str(program), str(HERE / "child_unified_planning.py")], json.dumps(files))
    assert done.returncode == 0, done.stderr
    return [Answer(*json.loads(line)) for line in done.stdout.splitlines()]


@dataclass(frozen=True)
class Reading:
    """What a parser has read, in a normal form; None when it refuses."""

    task: frozenset[str] | None
    message: str


def compare(name: str, original: Reading, ours: Reading) -> Answer:
    """Compare what was read of an original and of ours."""
    if original.task is None:
        return Answer(name, "refused", original.message)
    if ours.task is None:
        return Answer(name, "ours refused", ours.message)
    if original.task == ours.task:
        return Answer(name, "equal", "")
    lost, won = sorted(original.task - ours.task), sorted(ours.task - original.task)
    return Answer(name, "differs", f"original: {lost[:5]}, ours: {won[:5]}")


def fast_downward(pair: Pair, folder: Path) -> Reading:
    """Have Fast Downward's translator read a pair and ground it.

    With no invariants to look for, each variable is one ground atom under its own name, so that
    the numbers of variables, which depend on the order of the initial state, can be left out.
    """
    output = folder / "output.sas"
    options = ["--sas-file", str(output), "--invariant-generation-max-candidates", "0"]
    command = [sys.executable, "-m", "fast_downward.translate", *options]
    done = run([*command, str(pair.domain), str(pair.problem)])
    if done.returncode != 0:
        return Reading(None, (done.stdout + done.stderr)[-500:])
    return Reading(frozenset(_normal_sas(output.read_text().splitlines())), "")


def pyperplan(pair: Pair) -> Reading:
    """Have pyperplan read a pair and ground it."""
    command = [sys.executable, str(HERE / "child_pyperplan.py")]
    done = run([*command, str(pair.domain), str(pair.problem)])
    if done.returncode != 0:
        return Reading(None, (done.stdout + done.stderr)[-500:])
    return Reading(frozenset(done.stdout.splitlines()), "")


def run(
    command: Sequence[str], text: str = "", folder: Path | None = None, seconds: int = SECONDS
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        input=text,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        cwd=folder,
        timeout=seconds,
        check=False,
    )


def _normal_sas(lines: list[str]) -> list[str]:
    """Write a task in Fast Downward's format 3 with the names of its atoms for their numbers."""
    values: list[list[str]] = []
    said = [f"metric {lines[lines.index('begin_metric') + 1]}"]
    at = 0
    while at < len(lines):
        if lines[at] == "begin_variable":
            count = int(lines[at + 3])
            values.append(lines[at + 4 : at + 4 + count])
            # An atom of a layer above the base is derived.
            said.append(f"variable {sorted(values[-1])} {lines[at + 2] == '-1'}")
        elif lines[at] == "begin_state":
            said += [f"init {values[n][int(lines[at + 1 + n])]}" for n in range(len(values))]
        elif lines[at] == "begin_goal":
            said += [f"goal {name}" for name in _atoms(values, lines[at + 2 :])]
        elif lines[at] == "begin_operator":
            end = lines.index("end_operator", at)
            said.append(f"operator {lines[at + 1]} {_operator(values, lines[at + 2 : end])}")
        elif lines[at] == "begin_rule":
            count = int(lines[at + 1])
            body = sorted(_atoms(values, lines[at + 2 : at + 2 + count]))
            head, _, after = map(int, lines[at + 2 + count].split())
            said.append(f"rule {values[head][after]} {body}")
        at += 1
    return said


def _atoms(values: list[list[str]], lines: Sequence[str]) -> list[str]:
    found = []
    for line in lines:
        if line.startswith("end_"):
            break
        variable, value = map(int, line.split())
        found.append(values[variable][value])
    return found


def _operator(values: list[list[str]], lines: list[str]) -> str:
    count = int(lines[0])
    required = _atoms(values, lines[1 : 1 + count])
    effects = []
    for line in lines[2 + count : -1]:
        numbers = [int(number) for number in line.split()]
        conditions = 2 * numbers[0]
        when = [
            values[variable][value]
            for variable, value in zip(
                numbers[1 : 1 + conditions : 2], numbers[2 : 2 + conditions : 2], strict=False
            )
        ]
        variable, before, after = numbers[1 + conditions :]
        if before >= 0:
            required.append(values[variable][before])
        effects.append(f"{sorted(when)} {values[variable][after]}")
    return f"{sorted(required)} {sorted(effects)} cost {lines[-1]}"
