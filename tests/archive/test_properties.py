"""After any history, archived twice at any revisions, nothing reads otherwise than it did before.

The same program runs on a knowledge base that is never archived. KANT_SQL_TEST_EXAMPLES=5000 hunts
for longer.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.factory import SqlDaoFactory
from kant_sql.history.replication.copy import Identities
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import Backend, Row
from kant_sql.sql.rows import AtomTables
from kant_sql.store.store import Store
from tests.support.archives import target_url
from tests.support.generators.programs import At, Block, Call, Program, programs, run, state_of
from tests.support.profile import PROFILE, hunting
from tests.support.servers import Server

# Nothing is left then but names: what is asserted again comes back.
WIPE = [Call(dao, "delete_all") for dao in ("actions", "propositions", "objects")]

REST = st.sampled_from([0, 0, 1, 2, 3, 5, 8])

_numbers = itertools.count(1)


class SharedFactory(SqlDaoFactory):
    """A knowledge base on connections that others share."""

    def __init__(self, backend: Backend, name: str) -> None:
        self._at = None
        self._store = Store(backend, name, "test")


def alike(step: Any) -> Any:
    """The step without the numbers of revisions, which archiving moves on."""
    if isinstance(step, Block):
        return Block([alike(inner) for inner in step.steps], step.fails)
    return step.call if isinstance(step, At) else step


def unordered(state: dict[str, str]) -> dict[str, list[str]]:
    """What was moved and came back may stand at another place in a list."""
    return {dao: sorted(text) for dao, text in state.items()}


class Pair:
    """A knowledge base that is archived, and one with the same history that is not."""

    def __init__(self, backend: Backend, target: Backend) -> None:
        name = f"program {next(_numbers)}"
        self._opened = [
            KnowledgeBase(SharedFactory(backend, name)),
            KnowledgeBase(SharedFactory(backend, f"{name}, whole")),
        ]
        self.kb, self.whole = self._opened
        self._target, self._name = target, name
        # For each revision of the one, the revision of the other.
        self.number = {0: 0}

    def run(self, steps: list[Any]) -> None:
        for step in steps:
            outcomes = [run(kb, alike(step))[:-1] for kb in self._opened]
            assert str(outcomes[0]).count("Error") == str(outcomes[1]).count("Error")
        for revision in range(max(self.number) + 1, self.kb.revision + 1):
            self.number[revision] = self.number[revision - 1] + 1

    def archive(self, rest: int, is_exact: bool) -> bool:
        """Archive all but the last revisions, and compare; tell whether anything moved."""
        url = self._target.url.render_as_string(hide_password=False)
        upto = max(0, self.kb.revision - rest)
        before = upto + 1 if upto < self.kb.revision else datetime.now(UTC)
        done = self.kb.store.archive(before, to=url)
        assert done.upto == upto
        if done.revision is None:
            return False
        self.number[done.revision] = self.number[done.revision - 1]
        there = KnowledgeBase(SharedFactory(self._target, self._name))
        assert there.revision == upto
        self._compare(there, range(upto + 1), is_exact)
        assert there.store.verify().findings == ()
        self._compare(self.kb, range(upto, self.kb.revision + 1), is_exact)
        assert self.kb.store.verify().findings == ()
        return True

    def _compare(self, kb: KnowledgeBase, revisions: range, is_exact: bool) -> None:
        for revision in revisions:
            was = state_of(self.whole.at(self.number[revision]))
            now = state_of(kb.at(revision))
            if is_exact:
                assert now == was
            else:
                assert unordered(now) == unordered(was)


# Where one of the two is on a server.
FEWER = PROFILE.archived // 4


@pytest.fixture(scope="module")
def backends(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Backend]]:
    folder: Path = tmp_path_factory.mktemp("archives")
    urls = [target_url(folder, "store.db"), target_url(folder), server.new_database()]
    kant_sql.upgrade(urls[2])
    opened = [create_backend(url) for url in urls]
    for backend in opened:
        kant_sql.upgrade(backend.url.render_as_string(hide_password=False))
    yield opened
    for backend in opened:
        backend.close()


@pytest.mark.more
@pytest.mark.parametrize(
    ("here", "there", "examples"), [(0, 1, PROFILE.archived), (0, 2, FEWER), (2, 1, FEWER)]
)
def test_nothing_reads_otherwise(
    backends: list[Backend], here: int, there: int, examples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = returned = 0
    recognise = Identities._recognise

    def count_returned(self: Identities, atoms: AtomTables, rows: list[Row]) -> list[Row]:
        nonlocal returned
        new = recognise(self, atoms, rows)
        returned += len(rows) - len(new)
        return new

    monkeypatch.setattr(Identities, "_recognise", count_returned)

    @hunting(examples)
    @given(programs(), programs(), REST, REST)
    def holds_for(first: Program, then: Program, one: int, another: int) -> None:
        nonlocal moved
        pair = Pair(backends[here], backends[there])
        pair.run([*(step for _, step in first.steps), *WIPE])
        moved += pair.archive(one, is_exact=True)
        pair.run([step for program in (first, then) for _, step in program.steps])
        pair.run(WIPE)
        moved += pair.archive(another, is_exact=False)

    holds_for()
    assert moved > 0
    assert returned > 0
