"""Verification finds each change of what an erasure leaves, and of the seeds of the others."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import kant_sql
from tests.support.servers import Server
from tests.support.worlds.robots import WP2, robot_at
from tests.support.worlds.story import NAME
from tests.verify.bare import Bare, bare_store
from tests.verify.mutations import ERASED, mutations


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def erased(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """A store with erased names and reasons, without constraints."""
    url = f"sqlite:///{tmp_path_factory.mktemp('erased') / 'store.db'}"
    if request.param == "postgresql":
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
    with kant_sql.connect(url, knowledge_base=NAME, actor="camera") as kb:
        with kb.transaction(reason="seen", source={"sensor": "lidar"}):
            kb.propositions.save(robot_at())
        with kb.transaction(reason="moved rb1"):
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at(place=WP2))
        kb.types.save("crane")
        kb.erase("rb1", reason="sold", also=["reason"])
        kb.erase(revisions=[1], parts=["actor"], reason="asked for", actor="office")
    with bare_store(url) as store:
        yield store


def test_every_column_of_what_an_erasure_left(erased: Bare) -> None:
    with erased.tampering():
        assert erased.findings() == []
        chosen = list(mutations(erased, {*ERASED, "revision"}))
    missed = set()
    for each in chosen:
        with erased.tampering():
            each.apply(erased)
            if erased.is_intact():
                missed.add((each.table, each.column))
    assert missed == set()
    assert len(chosen) > 60
