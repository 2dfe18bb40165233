"""Every public callable is called with junk: only errors of the library come of it.

`KANT_SQL_TEST_NONSENSE=all` makes all calls, some tens of thousands, instead of a sample.
"""

from __future__ import annotations

import os
from pathlib import Path
from unittest import mock

from kant_sql import NoPlanError
from kant_sql.planning import plan
from tests.conftest import Connect
from tests.nonsense import Calling, World, cases, sample

ALL = os.environ.get("KANT_SQL_TEST_NONSENSE") == "all"
SIZE = 250


def test_only_errors_of_the_library_come_of_nonsense(
    url: str, connect: Connect, tmp_path: Path
) -> None:
    numbers = iter(range(1_000_000))

    def make() -> World:
        return World(connect(url, knowledge_base=f"robot {next(numbers)}", actor="test"), tmp_path)

    calling = Calling(make)
    found = cases(make())
    assert len(found) > 10_000
    # No planner is started: what is wrong is refused before.
    refused = NoPlanError("no planner here", "internal_error")
    with mock.patch.object(plan, "_run", side_effect=refused):
        for case in found if ALL else sample(found, SIZE, seed=8):
            calling.call(case)
    assert calling.faults == []
