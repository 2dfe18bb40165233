"""Roles on PostgreSQL: nobody but the owner can change what is past."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest

import kant_sql
from kant_sql.knowledge.definitions import KINDS
from kant_sql.sql.dialects import postgresql_roles
from kant_sql.sql.dialects.postgresql_roles import NO_DEFINITIONS
from kant_sql.sql.rows import KIND_TABLES
from tests.support.processes.workers import PATIENCE
from tests.support.roles import (
    OTHER,
    TABLES,
    Members,
    contents,
    members,
    mutations,
    query,
    refused,
    rows_of,
)
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at, waypoint

EVERY_ROLE = pytest.mark.parametrize("role", range(8))


def test_each_table_holds_something_to_lose(role_store: str) -> None:
    assert [name for name, rows in contents(role_store).items() if len(rows) < 2] == []


@pytest.mark.more
@pytest.mark.parametrize("role", range(6))
def test_nobody_changes_or_removes_what_is_written(
    role: int, role_store: str, role_users: Members, limited_users: Members
) -> None:
    before = contents(role_store)
    users = [*role_users[:3], *limited_users[:3]]
    with psycopg.connect(users[role], autocommit=True) as connection:
        for table in TABLES:
            for statement in mutations(table, connection.info.server_version):
                # Of a writer's statements, those may pass that find no row they are for.
                if not refused(connection, statement):
                    assert role % 3 == 0, statement
                    assert rows_of(role_store, table.name) == before[table.name], statement
    assert contents(role_store) == before


FILLS = (
    "CREATE TEMP TABLE head AS SELECT 1",
    "CREATE TEMP VIEW head AS SELECT 1",
    "SELECT lo_create(0)",
    "SELECT lo_creat(-1)",
    r"SELECT lo_from_bytea(0, '\x00')",
    "CREATE TABLE more ()",
    "CREATE FUNCTION more() RETURNS integer RETURN 1",
    "CREATE SCHEMA more",
)


@EVERY_ROLE
def test_nobody_fills_the_disk_beside_the_tables(
    role: int, role_users: Members, limited_users: Members
) -> None:
    with psycopg.connect([*role_users, *limited_users][role], autocommit=True) as connection:
        for statement in FILLS:
            assert refused(connection, statement), statement


# Columns of a head that is not empty.
HEADS = {
    **dict.fromkeys(
        ["revision", "definition_revision", "archived_revision", "origin_revision"], "5"
    ),
    **dict.fromkeys(["origin_committed_at", "heard_at"], "now()"),
    **{"next_id": "9", "hash": "'x'", "origin": "'x'", "committed_at": "'infinity'"},
}


def begun(column: str, value: str) -> str:
    """Write how a knowledge base would begin with a value in its head."""
    head = {"revision": "0", "definition_revision": "0", "next_id": "1"} | {column: value}
    return (
        "INSERT INTO knowledge_base (id, name) "
        "SELECT max(id) + 1, clock_timestamp()::text FROM knowledge_base; "
        f"INSERT INTO head (kb_id, {', '.join(head)}) "
        f"SELECT max(id), {', '.join(head.values())} FROM knowledge_base"
    )


# What a writer could try within a transaction; `{kb}` is the knowledge base's id.
ATTACKS = {
    "open again what has ended": """
        UPDATE proposition_version SET until = NULL WHERE until IS NOT NULL""",
    "let it have ended at another time": """
        UPDATE proposition_version SET until = until + 1 WHERE until IS NOT NULL""",
    "let something end in the last revision": """
        UPDATE proposition_version SET until = revision FROM head
        WHERE until IS NULL AND head.kb_id = proposition_version.kb_id AND since < revision""",
    "assert something in the last revision": """
        INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id, is_goal)
        SELECT v.kb_id, proposition_id, revision, NULL, predicate_id, is_goal
        FROM proposition_version AS v JOIN head ON head.kb_id = v.kb_id
        WHERE until < revision""",
    "add a time at which it held": """
        INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id, is_goal)
        SELECT kb_id, proposition_id, 1, since, predicate_id, is_goal
        FROM proposition_version WHERE since > 1""",
    "hide what holds from past states": "UPDATE proposition_version SET fork = 1",
    "hide what ended from past states": """
        UPDATE proposition_version SET until = NULL, fork = fork + 1 WHERE until IS NOT NULL""",
    "add an argument to a fact": """
        INSERT INTO proposition_argument
        SELECT kb_id, proposition_id, 7, min(object_id) FROM proposition_argument GROUP BY 1, 2""",
    "add an argument to the step of a plan": """
        INSERT INTO execution_argument
        SELECT kb_id, plan_id, position, 7, object_id, value FROM execution_argument""",
    "add a term to a definition": """
        INSERT INTO action_term (kb_id, action_id, since, section, position, term, parameter)
        SELECT kb_id, action_id, since, section, position, 7, 0 FROM action_term WHERE term = 0""",
    "say that a step of a plan was running then": """
        INSERT INTO revision_execution
        SELECT kb_id, number, 9001, 0 FROM revision WHERE number <> 2""",
    "confirm a fact in an earlier revision": """
        INSERT INTO confirmation SELECT kb_id, id, 1 FROM proposition""",
    "leave a hole in the revisions": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 2, now(), 2, 'hash' FROM head""",
    "date a revision ahead": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, now() + interval '1 day', 2, 'hash' FROM head""",
    "date a revision before the one before": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, committed_at - interval '1 second', 2, 'hash' FROM head""",
    "date a revision before all times": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, '-infinity', 2, 'hash' FROM head""",
    "date what a revision says after all times": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash, observed_at)
        SELECT kb_id, revision + 1, now(), 2, 'hash', 'infinity' FROM head""",
    "date what a revision says before all times that Python knows": """
        INSERT INTO revision (kb_id, number, committed_at, form, hash, observed_at)
        SELECT kb_id, revision + 1, now(), 2, 'hash', '4000-01-01 BC' FROM head""",
    "assert what has an id ahead of the head": """
        INSERT INTO proposition (kb_id, id, predicate_id, is_goal, arguments, text)
        SELECT head.kb_id, next_id + 5, min(predicate.id), false, '', '(p)'
        FROM head JOIN predicate ON predicate.kb_id = head.kb_id GROUP BY head.kb_id;
        INSERT INTO proposition_version (kb_id, proposition_id, since, predicate_id, is_goal)
        SELECT p.kb_id, p.id, revision + 1, p.predicate_id, false
        FROM proposition AS p JOIN head ON head.kb_id = p.kb_id WHERE p.id >= next_id;
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, now(), 2, 'hash' FROM head;
        UPDATE head SET revision = revision + 1, next_id = next_id + 1, hash = 'hash',
        committed_at = now()""",
    "end an object, unseen by those who cache what is defined": """
        UPDATE object_version SET until = revision + 1 FROM head
        WHERE head.kb_id = object_version.kb_id AND until IS NULL;
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, now(), 2, 'hash' FROM head;
        UPDATE head SET revision = revision + 1, hash = 'hash', committed_at = now()""",
    "end an object in a revision that the head passes over": """
        UPDATE object_version SET until = revision + 1 FROM head
        WHERE head.kb_id = object_version.kb_id AND until IS NULL;
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 1, now(), 2, 'hash' FROM head;
        INSERT INTO revision (kb_id, number, committed_at, form, hash)
        SELECT kb_id, revision + 2, now(), 2, 'hash' FROM head;
        UPDATE head SET revision = revision + 2, hash = 'hash', committed_at = now()""",
    **{f"begin with {column} in the head": begun(column, HEADS[column]) for column in HEADS},
    "move the head on without a revision": "UPDATE head SET revision = revision + 1",
    "give the head another hash": "UPDATE head SET hash = 'hash'",
    "give out ids again": "UPDATE head SET next_id = 1",
    "lower the head, to delete what is behind it": """
        UPDATE head SET revision = 0, definition_revision = 0;
        DELETE FROM proposition_version""",
    "say that all was archived": "UPDATE head SET archived_revision = revision",
    "record an archive": """
        INSERT INTO archive (kb_id, id, since, revision, target, versions, rest, text)
        SELECT kb_id, next_id, revision + 1, 1, 'x', 1, 'x', 'x' FROM head""",
    "record a promotion": """
        INSERT INTO promotion (kb_id, id, since, revision, origin, text)
        SELECT kb_id, next_id, revision + 1, 1, 'x', 'x' FROM head""",
    "make it a replica": "UPDATE head SET origin = 'x'",
    "say that it was verified": "UPDATE verification SET verified_at = now()",
    "let it have ended at another time, with another text": """
        UPDATE function_value_version SET text = 'x', until = until + 1 WHERE until IS NOT NULL""",
    "let something end, with another text": """
        UPDATE object_version SET text = 'x', until = since + 1""",
    "let another have written, and keep the seed": """
        UPDATE revision SET actor = 'x' WHERE seed IS NOT NULL""",
    "date a revision again": "UPDATE revision SET committed_at = now()",
    "rename what an erasure does not": "UPDATE predicate SET name = name || 'x', key = key || 'x'",
    "say that another text was erased": """
        UPDATE commitment SET salt = NULL, commitment = 'x', erasure_id = e.id FROM erasure AS e
        WHERE e.kb_id = commitment.kb_id""",
    "say that an erasure took more": """
        INSERT INTO commitment SELECT kb_id, 2, -1, '', 'source', 0, 0, NULL, 'x', id
        FROM erasure""",
    "put something else in its place": "UPDATE replacement SET salt = 'x'",
    "add what took its place": """
        INSERT INTO replacement SELECT kb_id, number, position, erasure_id + 1, 'x', NULL
        FROM replacement""",
    "record an erasure in a revision that is there": """
        INSERT INTO erasure (kb_id, id, since, revision, kind, pseudonym, parts, digest, text)
        SELECT kb_id, next_id, revision, 1, 'texts', 'x', 1, 'x', 'x' FROM head""",
    "forget an erasure": "DELETE FROM replacement; DELETE FROM erasure",
    "take the policies away": "SET row_security = off; DELETE FROM proposition_version",
    "delete by a view": "DELETE FROM audit_revision",
    "be another": "SET SESSION AUTHORIZATION postgres",
    "take the rights": "GRANT ALL ON proposition_version TO kant_sql_writer",
    "take a wider role": "GRANT postgres TO current_user",
}


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS)
@pytest.mark.more
def test_writers_and_erasers_cannot(
    attack: str, role_store: str, role_users: Members, limited_users: Members
) -> None:
    before = contents(role_store)
    for url in (*role_users[::3], *limited_users[::3]):
        with psycopg.connect(url, autocommit=True) as connection:
            refused(connection, attack)
    assert contents(role_store) == before


def test_each_definition_counts_for_those_who_cache_them() -> None:
    definitions = {KIND_TABLES[kind].version.table.name for kind in KINDS}
    versions = {table.name for table in TABLES if "until" in table.c}
    assert versions - definitions == NO_DEFINITIONS


def test_to_begin_a_revision_brings_no_past_row_within_reach(
    role_store: str, role_users: Members
) -> None:
    with (
        psycopg.connect(role_users.writer) as connection,
        connection.transaction(force_rollback=True),
    ):
        connection.execute(
            "INSERT INTO revision (kb_id, number, committed_at, form, hash) "
            "SELECT kb_id, revision + 1, now(), 2, 'hash' FROM head"
        )
        assert connection.execute("DELETE FROM proposition_version").rowcount == 0


def test_a_transaction_that_stays_open_dates_no_revision_back(
    server: Server, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(postgresql_roles, "LEEWAY", "interval '0.1 seconds'")
    url = server.new_store()
    connect(url, knowledge_base="tiago").propositions.save(robot_at())
    dated = REVISION.format(kb=1).replace("clock_timestamp()", "{}")
    with (
        members(url, kant_sql.operations.create_roles(url)) as users,
        psycopg.connect(users.writer) as writer,
    ):
        writer.execute("SELECT pg_sleep(0.3)")
        assert refused(writer, dated.format("transaction_timestamp()"))
        writer.rollback()
        assert not refused(writer, dated.format("clock_timestamp()"))


# Each begins before a revision is committed, and finds out about it afterwards.
LATE = {
    "open again what another has ended": """
        UPDATE proposition_version SET until = NULL, fork = 0 FROM {late}
        WHERE kb_id = {kb}""",
    "assert something in the revision of another": """
        INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id, is_goal)
        SELECT kb_id, min(proposition_id), {next}, NULL, min(predicate_id), false
        FROM proposition_version, {late} WHERE kb_id = {kb} GROUP BY kb_id""",
    "add an argument to the fact of another": """
        INSERT INTO proposition_argument SELECT head.kb_id, next_id + 1, 9, object.id
        FROM {late}, head JOIN object ON object.kb_id = head.kb_id AND object.key = 'rb1'
        WHERE head.kb_id = {kb}""",
    "add a type to the object of another": """
        INSERT INTO object_type SELECT kb_id, next_id, {next}, 1, 1 FROM head, {late}
        WHERE kb_id = {kb}""",
}
LOCK, OTHER_ID = 4711, 2
WAIT = f"pg_advisory_xact_lock({LOCK}) AS l"


@pytest.mark.parametrize("attack", LATE.values(), ids=LATE)
def test_what_is_committed_while_a_statement_runs_is_out_of_its_reach(
    attack: str, role_store: str, role_users: Members, connect: Connect
) -> None:
    kb = connect(role_store, knowledge_base=OTHER)
    kb.propositions.save(robot_at())
    before = len(kb.store.verify().findings)
    values = {"kb": OTHER_ID, "next": kb.revision + 1, "late": WAIT}
    with (
        psycopg.connect(role_store, autocommit=True) as owner,
        psycopg.connect(role_users.writer, autocommit=True) as writer,
        ThreadPoolExecutor() as pool,
    ):
        owner.execute(f"SELECT pg_advisory_lock({LOCK})".encode())
        trying = pool.submit(refused, writer, attack.format_map(values))
        waiting = "SELECT FROM pg_locks WHERE locktype = 'advisory' AND NOT granted"
        while not query(role_store, waiting):
            assert not trying.done()
        with kb.transaction():
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at(place=waypoint(kb.revision)))
        owner.execute(f"SELECT pg_advisory_unlock({LOCK})".encode())
        trying.result(PATIENCE)
    assert len(kb.store.verify().findings) == before


END = """
    UPDATE object_version SET until = revision + 1 FROM head
    WHERE head.kb_id = object_version.kb_id AND until IS NULL AND head.kb_id = {kb}"""
REVISION = """
    INSERT INTO revision (kb_id, number, committed_at, form, hash)
    SELECT kb_id, revision + 1, clock_timestamp(), 2, 'hash' FROM head WHERE kb_id = {kb}"""


def test_nobody_else_adds_the_revision_of_rows_that_are_not_committed(
    role_store: str, role_users: Members, connect: Connect
) -> None:
    """Else the head could be moved to it before these rows are seen."""
    connect(role_store, knowledge_base=OTHER).propositions.save(robot_at())
    with psycopg.connect(role_users.writer) as first, psycopg.connect(role_users.writer) as second:
        assert first.execute(END.format(kb=OTHER_ID).encode()).rowcount > 0
        second.execute("SET lock_timeout = '200ms'")
        with pytest.raises(psycopg.errors.LockNotAvailable):
            second.execute(REVISION.format(kb=OTHER_ID).encode())
        first.rollback()
        second.rollback()
        assert second.execute(REVISION.format(kb=OTHER_ID).encode()).rowcount == 1
        second.rollback()


def test_policies_are_what_stops_these_attacks(role_store: str) -> None:
    """The owner, who has no policies, could do what they say."""
    done = []
    with psycopg.connect(role_store) as owner:
        for name, attack in ATTACKS.items():
            with owner.transaction(force_rollback=True):
                try:
                    owner.execute("SET CONSTRAINTS ALL DEFERRED")
                    owner.execute(attack.encode())
                    done.append(name)
                except psycopg.Error:
                    pass
    assert len(done) >= len(ATTACKS) - 6, set(ATTACKS) - set(done)


PLANT = """
    INSERT INTO proposition (kb_id, id, predicate_id, is_goal, arguments, text)
    SELECT head.kb_id, next_id + 1000, min(predicate.id), false, '', '(planted)'
    FROM head JOIN predicate ON predicate.kb_id = head.kb_id
    WHERE head.kb_id = {kb} GROUP BY head.kb_id"""
ADD = """
    INSERT INTO proposition_argument
    SELECT p.kb_id, p.id, 0, min(object.id) FROM proposition AS p
    JOIN object ON object.kb_id = p.kb_id WHERE p.kb_id = {kb} AND p.text = '(planted)'
    GROUP BY p.kb_id, p.id"""


def test_what_is_planted_ahead_of_the_head_gets_no_argument_later(
    role_store: str, role_users: Members
) -> None:
    plant, add = PLANT.format(kb=OTHER_ID), ADD.format(kb=OTHER_ID)
    with psycopg.connect(role_users.writer) as writer, psycopg.connect(role_store) as owner:
        with writer.transaction(force_rollback=True):
            writer.execute(plant.encode())
            with writer.transaction():
                assert writer.execute(add.encode()).rowcount == 1
        with writer.transaction(force_rollback=True):
            with writer.transaction():
                writer.execute(plant.encode())
            # What a savepoint has made is of this transaction, too.
            assert writer.execute(add.encode()).rowcount == 1
        writer.execute(plant.encode())
        writer.commit()
        try:
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                writer.execute(add.encode())
            writer.rollback()
            writer.execute("SELECT pg_current_xact_id()")
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                writer.execute(add.encode())
        finally:
            writer.rollback()
            owner.execute("DELETE FROM proposition WHERE text = '(planted)'")
