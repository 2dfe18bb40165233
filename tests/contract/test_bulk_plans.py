"""PostgreSQL checks foreign keys of a bulk load by the right index, whatever it has seen before."""

from __future__ import annotations

import time

import psycopg
import pytest

from kant_sql import PddlActionDto, PddlObjectDto, PddlPropositionDto, PddlTypeDto
from kant_sql.dto.formulas import Not
from tests.support.stores import Connect, make_store_url
from tests.support.worlds.depot import IDLE, T, at, load
from tests.support.worlds.robots import RB1, ROBOT_AT, robot_at, waypoint

SIZE = 3_000


def reads_per_scan(url: str, table: str) -> float:
    """How many entries of its indexes each look-up in a table has read."""
    statement = (
        "SELECT sum(idx_scan), sum(idx_tup_read) FROM pg_stat_user_indexes WHERE relname = %s"
    )
    for _ in range(100):
        with psycopg.connect(url) as connection:
            scans, reads = connection.execute(statement, [table]).fetchone() or (0, 0)
        if scans >= SIZE:
            return float(reads / scans)
        # A server process reports when it ends.
        time.sleep(0.1)
    pytest.fail(f"only {scans} scans of {table} were reported")


@pytest.fixture
def server_url(request: pytest.FixtureRequest) -> str:
    return make_store_url(request, "postgresql", request.getfixturevalue("tmp_path"))


def test_facts_of_many_objects(server_url: str, connect: Connect) -> None:
    kb = connect(server_url)
    # Enough for COPY, and so few that the server takes any index for as good as the other.
    kb.propositions.save_all(robot_at(place=waypoint(number)) for number in range(60))
    kb.propositions.save_all(
        PddlPropositionDto(ROBOT_AT, [RB1, waypoint(number)]) for number in range(SIZE)
    )
    kb.close()
    assert reads_per_scan(server_url, "object") < 10


def test_parts_of_many_actions(server_url: str, connect: Connect) -> None:
    kb = connect(server_url)
    load(kb)
    truck, place = PddlTypeDto("truck"), PddlTypeDto("place")
    parameters = [PddlObjectDto(truck, "t"), PddlObjectDto(place, "p")]
    effect = at(T)
    kb.actions.save_all(
        PddlActionDto(f"act{number}", parameters, [Not(effect), IDLE], [effect], durative=False)
        for number in range(SIZE // 4)
    )
    kb.close()
    assert reads_per_scan(server_url, "action_version") < 10
