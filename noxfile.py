"""The tests on each Python, and with the lowest versions that pyproject allows: `uvx nox`."""

from __future__ import annotations

import nox

nox.needs_version = ">=2025.2"
nox.options.default_venv_backend = "uv"
nox.options.error_on_missing_interpreters = False
# As `make test` runs it.
SUITE = ["-n", "2", "--dist", "worksteal", "--most"]


@nox.session(python=["3.11", "3.12", "3.13", "3.14"])
def tests(session: nox.Session) -> None:
    """Run the tests; `uvx nox -s tests-3.14 -- tests/unit` runs a part."""
    session.install("--editable", ".[test]")
    session.run("pytest", *(session.posargs or SUITE))


@nox.session(python="3.11")
def lowest(session: nox.Session) -> None:
    """Run the tests with the lowest versions of the dependencies."""
    session.install("--resolution", "lowest-direct", "--editable", ".[test]")
    session.run("pytest", *(session.posargs or SUITE))
