"""After any history, pushed at any moments and archived at any, the replica is the same.

KANT_SQL_TEST_EXAMPLES=5000 hunts for longer.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.history.replication import batch
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import Backend
from tests.archive.test_properties import WIPE, SharedFactory, alike
from tests.support.archives import VERSIONS, equal_histories, rows_of, target_url
from tests.support.generators.programs import Program, programs, run, state_of
from tests.support.profile import PROFILE, hunting
from tests.support.servers import Server

_numbers = itertools.count(1)
# Where one of the two is on a server.
FEWER = PROFILE.archived // 4


@pytest.fixture(scope="module")
def backends(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Backend]]:
    """A file, a server, another file and another server, each with the tables."""
    folder: Path = tmp_path_factory.mktemp("replicas")
    files = [target_url(folder, f"{name}.db") for name in ("source", "target", "archive")]
    urls = [*files, server.new_store(), server.new_store()]
    for url in files:
        kant_sql.upgrade(url)
    opened = [create_backend(url) for url in urls]
    yield opened
    for backend in opened:
        backend.close()


def _url(backend: Backend) -> str:
    return backend.url.render_as_string(hide_password=False)


def _check(kb: KnowledgeBase, replica: KnowledgeBase, name: str, is_whole: bool) -> None:
    here, there = (_url(each.store.factory._store.backend) for each in (kb, replica))  # type: ignore[attr-defined]
    if is_whole:
        equal_histories(here, there, name)
    else:
        rows = rows_of(here, name), rows_of(there, name)
        assert rows[0]["revision"] == rows[1]["revision"]
        for table in VERSIONS:
            assert rows[0][table.name].total() <= rows[1][table.name].total()
    assert replica.store.verify(kb.store.anchor()).findings == ()
    assert {dao: sorted(text) for dao, text in state_of(replica).items()} == {
        dao: sorted(text) for dao, text in state_of(kb).items()
    }


@pytest.mark.more
@pytest.mark.parametrize(
    ("here", "there", "examples"),
    [(0, 1, PROFILE.archived), (0, 3, FEWER), (3, 1, FEWER), (3, 4, FEWER)],
    ids=["file to file", "file to server", "server to file", "server to server"],
)
def test_a_replica_is_what_its_source_is(
    backends: list[Backend], here: int, there: int, examples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = 0

    @hunting(examples)
    @given(
        programs(),
        programs(),
        st.integers(1, 4),
        st.sampled_from([0, 1, 3, 8]),
        st.booleans(),
        st.booleans(),
    )
    def holds_for(
        first: Program,
        then: Program,
        size: int,
        rest: int,
        is_archived: bool,
        is_pushed_between: bool,
    ) -> None:
        nonlocal sent
        name = f"program {next(_numbers)}"
        kb, replica = (KnowledgeBase(SharedFactory(backends[at], name)) for at in (here, there))
        monkeypatch.setattr(batch, "FIRST_REVISIONS", size)
        monkeypatch.setattr(batch, "ROWS", 10 * size)
        for program in (first, then):
            for step in [*(step for _, step in program.steps), *WIPE]:
                run(kb, alike(step))
            if is_pushed_between:
                sent += kb.store.push(_url(backends[there])).revisions
                _check(kb, replica, name, is_whole=not (is_archived and program is then))
            if is_archived and program is first:
                kb.store.archive(max(0, kb.revision - rest), to=_url(backends[2]))
        sent += kb.store.push(_url(backends[there])).revisions
        _check(kb, replica, name, is_whole=not is_archived)

    holds_for()
    assert sent > 0
