"""Runs an example as a user does: in a process of its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tests.warm import MODULES, python

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run(name: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run an example to its end, away from the repository's root."""
    return subprocess.run(
        [python(*MODULES), str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=EXAMPLES,
        env={**os.environ, **environment},
        timeout=120,
        check=False,
    )
