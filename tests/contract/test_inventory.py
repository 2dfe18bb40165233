"""The knowledge bases of a store at a glance: heads, facts, goals."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import pytest
from fastapi.testclient import TestClient

from kant_sql import limited, open_store
from kant_sql.errors import QuestionCancelledError, SchemaMissingError
from kant_sql.json_values import json_value
from kant_sql.knowledge.canonical import time_text
from kant_sql.operations import knowledge_bases
from kant_sql.sql import inventory
from kant_sql.sql.inventory import Catalog
from kant_sql.web.application import create_app
from tests.support.faults import change
from tests.support.processes.commands import run
from tests.support.reading import present
from tests.support.statements import count, fill
from tests.support.stores import CITUS, Connect
from tests.support.worlds.robots import RB1, WP2, robot_at, waypoint


@contextmanager
def catalog_of(url: str) -> Iterator[Catalog]:
    with open_store(url, read_only=True) as store:
        yield store.catalog


def write(url: str, connect: Connect, *names: str) -> None:
    """Save a fact in each of some knowledge bases."""
    for name in names:
        connect(url, knowledge_base=name).propositions.save(robot_at())


def test_it_says_who_changed_what_and_what_there_is(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(robot_at())
    kb.goals.save(robot_at(is_goal=True))
    source = {"topic": "/missions", "stamp": 2.0**60}
    with kb.transaction(actor="operator", reason="a new mission", source=source):
        kb.goals.save(robot_at(place=WP2, is_goal=True))
    connect(shared_url, knowledge_base="never written")
    with catalog_of(shared_url) as catalog:
        [one], has_more = catalog.overview()
        assert not has_more
        assert (one.name, one.revision) == ("tiago", 3)
        assert (one.actor, one.reason, one.source) == ("operator", "a new mission", source)
        assert one.committed_at == kb.store.revisions()[-1].committed_at
        assert (one.facts, one.has_more_facts, one.goals, one.reached) == (1, False, 2, 1)
        assert catalog.find("tiago") == one
        assert catalog.find("never written") is None
        assert (catalog.has("tiago"), catalog.has("nobody")) == (True, False)
        assert catalog.total() == (1, 3)


def test_reached_is_unknown_where_counting_does_not_tell(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    kb.goals.save("(not (robot_at rb1 wp1))")
    with catalog_of(shared_url) as catalog:
        assert [one.reached for one in catalog.overview()[0]] == [None]
    kb.goals.delete_all()
    with catalog_of(shared_url) as catalog:
        assert [one.reached for one in catalog.overview()[0]] == [0]


def test_pages_go_through_all_and_can_be_searched(shared_url: str, connect: Connect) -> None:
    write(shared_url, connect, *(f"Robot %{number}" for number in range(7)))
    with catalog_of(shared_url) as catalog:
        names, after, has_more = [], None, True
        while has_more:
            page, has_more = catalog.overview(after=after, limit=3)
            names += [one.name for one in page]
            after = names[-1]
        assert names == [f"Robot %{number}" for number in range(7)]
        assert catalog.first_names(2) == names[:2]
        found, has_more = catalog.overview(part="robot %4")
        assert ([one.name for one in found], has_more) == (["Robot %4"], False)
        assert catalog.overview(part="x")[0] == []
        found, has_more = catalog.overview(part="%", limit=2, after="Robot %1")
        assert ([one.name for one in found], has_more) == (["Robot %2", "Robot %3"], True)


def test_counting_ends_at_a_limit(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save_all(robot_at(RB1, waypoint(number)) for number in range(30))
    monkeypatch.setattr(inventory, "COUNTED_TOGETHER", 20)
    monkeypatch.setattr(inventory, "COUNTED_EACH", 10)
    with catalog_of(shared_url) as catalog:
        [one], _ = catalog.overview()
        assert (one.facts, one.has_more_facts) == (20, True)
        connect(shared_url, knowledge_base="other").propositions.save(robot_at())
        one, other = catalog.overview()[0]
        assert (one.facts, one.has_more_facts) == (10, True)
        assert (other.facts, other.has_more_facts) == (1, False)


REPLICA = (
    "UPDATE head SET origin = 'postgresql://fleet@server/robots', origin_revision = 5,"
    " origin_committed_at = '{at}', heard_at = '2026-03-02T15:00:00.000000Z' WHERE kb_id = 1"
)


def test_it_says_how_far_a_replica_is_behind(shared_url: str, connect: Connect) -> None:
    write(shared_url, connect, "tiago", "pepper")
    one, other = knowledge_bases(shared_url)
    later = present(one.committed_at) + timedelta(seconds=90)
    change(shared_url, REPLICA.format(at=time_text(later)))
    one, other = knowledge_bases(shared_url)
    assert (one.origin, one.origin_revision) == ("postgresql://fleet@server/robots", 5)
    assert (one.origin_committed_at, one.behind, one.lag) == (later, 4, 90)
    assert one.heard_at == datetime(2026, 3, 2, 15, tzinfo=UTC)
    assert (other.origin, other.behind, other.lag, other.heard_at) == (None,) * 4
    change(
        shared_url,
        REPLICA.format(at=time_text(later - timedelta(seconds=90))),
        "UPDATE head SET origin_revision = 1",
    )
    one, _ = knowledge_bases(shared_url)
    assert (one.behind, one.lag) == (0, 0)
    # Not heard of yet.
    change(shared_url, "UPDATE head SET origin_revision = NULL")
    assert (knowledge_bases(shared_url)[0].behind, knowledge_bases(shared_url)[0].lag) == (
        None,
    ) * 2


def test_it_says_how_far_each_was_verified(shared_url: str, connect: Connect) -> None:
    write(shared_url, connect, "tiago", "pepper")
    change(
        shared_url,
        "INSERT INTO verification (kb_id, revision, hash, verified_at, complete_at)"
        " VALUES (2, 1, 'abc', '2026-03-02T15:00:00.000000Z', NULL)",
    )
    one, other = knowledge_bases(shared_url)
    assert (one.verified_revision, one.verified_at) == (None, None)
    assert other.verified_revision == 1
    assert (other.verified_at, other.complete_at) == (datetime(2026, 3, 2, 15, tzinfo=UTC), None)


@pytest.mark.parametrize("size", [1, 2_000])
@pytest.mark.more
def test_it_takes_two_statements_whatever_there_is(
    shared_url: str, connect: Connect, size: int
) -> None:
    for number in range(4):
        fill(connect(shared_url, knowledge_base=f"robot {number}"), size)
    with catalog_of(shared_url) as catalog:
        assert count(lambda: catalog.overview(limit=1)) == 2
        assert count(lambda: catalog.overview(limit=3)) == 2
        assert count(catalog.every) == 2
        assert count(lambda: catalog.find("robot 1")) == 2
        assert count(catalog.total) == 1


def test_it_obeys_limits_and_creates_nothing(shared_url: str, connect: Connect) -> None:
    with catalog_of(shared_url) as catalog:
        with limited() as limit:
            limit.cancel()
            with pytest.raises(QuestionCancelledError):
                catalog.overview()
        assert catalog.overview() == ([], False)
        with limited() as limit:
            assert catalog.total() == (0, 0)
            limit.cancel()
        # It has the same connection.
        assert catalog.total() == (0, 0)
    with pytest.raises(SchemaMissingError):
        knowledge_bases("sqlite:///none.db")


UNKNOWN = {
    ("sqlite-file", "head"): (
        *("heard_at='x'", "origin_committed_at='9999'", "origin_revision='x'", "origin=x'00ff'"),
    ),
    ("sqlite-file", "verification"): (
        *("verified_at='x'", "complete_at='x'", "revision=9e999", "revision='x'"),
    ),
    # Times that Python does not have.
    ("postgresql", "head"): ("heard_at='infinity'", "origin_committed_at='-infinity'"),
    ("postgresql", "verification"): (
        *("verified_at='infinity'", "complete_at='4713-01-01 00:00:00 BC'"),
    ),
}
UNREADABLE = [(*where, sql) for where, statements in UNKNOWN.items() for sql in statements]


def make_fleet(url: str, connect: Connect) -> None:
    """Write two knowledge bases: a verified replica, and another one."""
    write(url, connect, "tiago", "pepper")
    change(
        url,
        REPLICA.format(at="2026-03-02T15:00:00.000000Z"),
        "INSERT INTO verification (kb_id, revision, hash, verified_at, complete_at)"
        " VALUES (1, 1, 'abc', '2026-03-02T15:00:00.000000Z', '2026-03-02T15:00:00.000000Z')",
    )


@pytest.mark.parametrize(("shared_url", "table", "sql"), UNREADABLE, indirect=["shared_url"])
def test_an_unreadable_origin_or_verification_is_not_known_and_hides_nothing(
    shared_url: str, connect: Connect, table: str, sql: str
) -> None:
    make_fleet(shared_url, connect)
    change(shared_url, f"UPDATE {table} SET {sql} WHERE kb_id = 1")
    one, other = knowledge_bases(shared_url)
    assert (one.name, one.revision, other.name, other.revision) == ("tiago", 1, "pepper", 1)
    column = sql.partition("=")[0]
    told = {"revision": "verified_revision"}.get(column, column)
    assert getattr(one, told) is None
    # What is shown is counted with, and written as JSON.
    assert one.behind in (None, 4)
    assert one.lag is None or one.lag >= 0
    json.dumps(json_value(one), allow_nan=False)


# What is damaged of the first of two knowledge bases: its name from then on, and what is said.
DAMAGED = {
    "no head": ("DELETE FROM head WHERE kb_id = 1", "tiago", "table head, .*tiago"),
    "no revision": ("UPDATE head SET revision = 99 WHERE kb_id = 1", "tiago", "99, which is miss"),
}
DAMAGED_FILES = {
    "a time": ("UPDATE revision SET committed_at = 'x' WHERE kb_id = 1", "tiago", "table revision"),
    "an actor": ("UPDATE revision SET actor = x'ff' WHERE kb_id = 1", "tiago", "column actor has"),
    "an actor in no code": (
        "UPDATE revision SET actor = CAST(x'ff' AS TEXT) WHERE kb_id = 1",
        "tiago",
        "decode .*actor",
    ),
    "a name": ("UPDATE knowledge_base SET name = x'ff' WHERE id = 1", "id 1", "column name has"),
    "a name in no code": (
        "UPDATE knowledge_base SET name = CAST(x'ff' AS TEXT) WHERE id = 1",
        "id 1",
        "decode .*name",
    ),
    "a number": ("UPDATE head SET revision = 'x' WHERE kb_id = 1", "tiago", "table head .*tiago"),
    "a large number": ("UPDATE head SET revision = 9e999 WHERE kb_id = 1", "tiago", "table head"),
}


ANY = [
    (url, *damage) for url in ("sqlite-file", "postgresql", *CITUS) for damage in DAMAGED.values()
]
FILES = [("sqlite-file", *damage) for damage in DAMAGED_FILES.values()]


@pytest.mark.parametrize(
    ("shared_url", "sql", "name", "said"), [*ANY, *FILES], indirect=["shared_url"]
)
def test_damage_of_one_is_a_line_among_all_others(
    shared_url: str, connect: Connect, sql: str, name: str, said: str
) -> None:
    write(shared_url, connect, "tiago", "pepper", "rosie")
    pragma = ["PRAGMA ignore_check_constraints = ON"] if shared_url.startswith("sqlite") else []
    change(shared_url, *pragma, sql)
    listed = knowledge_bases(shared_url)
    assert [(one.name, one.error is None) for one in listed] == [
        (name, False),
        ("pepper", True),
        ("rosie", True),
    ]
    damaged = listed[0]
    assert re.search(said, damaged.error or "")
    assert shared_url not in str(damaged.error)
    assert (damaged.revision, damaged.committed_at, damaged.behind, damaged.lag) == (None,) * 4
    json.dumps(json_value(damaged), allow_nan=False)
    with catalog_of(shared_url) as catalog:
        assert catalog.overview(limit=1) == ([damaged], True)
        assert catalog.overview(limit=1, after=name) == ([listed[1]], True)
        assert catalog.find("pepper") == listed[1]
        assert catalog.find("tiago") == (damaged if name == "tiago" else None)
        assert catalog.first_names(3) == [
            each for each in (name, "pepper", "rosie") if each != "id 1"
        ]
        assert catalog.total()[0] in (2, 3)
    told = run("kbs", shared_url)
    assert (told.exit_code, told.stderr) == (0, "")
    assert all(each in told.stdout for each in (name, "pepper", "rosie", "error"))
    with TestClient(create_app(shared_url), base_url="http://127.0.0.1") as client:
        page = client.get("/")
        assert page.status_code == 200
        assert "pepper" in page.text
        assert "damaged" in page.text
        found = client.get("/api/").json()["knowledge_bases"]
        assert [one["error"] for one in found] == [damaged.error, None, None]
