"""Roles on PostgreSQL: how they are made, kept through migrations, and used at work."""

from __future__ import annotations

import os
from contextlib import closing
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import (
    KantSqlError,
    KnowledgeBase,
    PddlFunctionValueDto,
    PddlPredicateDto,
    PddlPropositionDto,
    StoreError,
)
from kant_sql.errors import ReadOnlyStoreError, SchemaMissingError
from kant_sql.sql.audit_views import AUDIT_VIEWS
from kant_sql.sql.predicate_views import update_views
from kant_sql.store import transaction as propositions
from tests.support.chain import check_chain
from tests.support.pages import Page
from tests.support.processes.commands import run
from tests.support.reading import present, state, undone
from tests.support.roles import (
    MINE,
    MINE_ID,
    OTHER,
    TABLES,
    Members,
    as_form_1,
    as_user,
    contents,
    fill,
    members,
    named,
    query,
    refused,
    rows_of,
    say,
    views,
)
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.missions import arrive, recorded
from tests.support.worlds.robots import (
    BATTERY,
    RB1,
    ROBOT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
    waypoint,
)


def rights(url: str) -> list[tuple[Any, ...]]:
    """All grants and policies of a database, and which tables have the latter in force."""
    return [
        *query(
            url,
            "SELECT relname, relrowsecurity, relacl::text FROM pg_class "
            "WHERE relnamespace::regnamespace::text !~ '^pg_' ORDER BY 1, 3",
        ),
        *query(
            url,
            "SELECT attname, attacl::text, attrelid::regclass::text FROM pg_attribute "
            "WHERE attacl IS NOT NULL ORDER BY 3, 1",
        ),
        *query(
            url,
            "SELECT tablename, policyname, roles::text, cmd, qual, with_check "
            "FROM pg_policies ORDER BY 1, 2",
        ),
    ]


def test_a_second_run_brings_rights_up_to_date(role_store: str, limited_users: Members) -> None:
    before = rights(role_store)
    assert not any(
        "CREATE ROLE" in sql for sql in kant_sql.operations.create_roles(role_store).statements
    )
    assert rights(role_store) == before
    with psycopg.connect(role_store) as owner:
        owner.execute("GRANT DELETE, UPDATE (hash) ON revision TO kant_sql_writer")
        owner.execute("GRANT SELECT ON revision TO kant_sql_auditor")
        owner.execute("DROP POLICY kant_sql_read ON head")
    assert rights(role_store) != before
    kant_sql.operations.create_roles(role_store, dry_run=True)
    assert rights(role_store) != before
    kant_sql.operations.create_roles(role_store)
    assert rights(role_store) == before


@pytest.mark.more
def test_rights_survive_migrations(server: Server, connect: Connect) -> None:
    url = server.new_store()
    connect(url, knowledge_base=MINE).propositions.save(robot_at())
    roles = kant_sql.operations.create_roles(url, knowledge_base=MINE)
    kant_sql.operations.create_roles(url)
    before = rights(url)
    kant_sql.upgrade(url)
    assert rights(url) == before
    as_form_1(url)
    kant_sql.operations.downgrade(url, revision="0001")
    kant_sql.upgrade(url)
    assert rights(url) == before
    with members(url, roles) as own:
        connect(own.writer, knowledge_base=MINE).propositions.delete(robot_at())
    as_form_1(url)
    kant_sql.operations.downgrade(url, revision="0001")
    kant_sql.operations.downgrade(url, revision="base")
    kant_sql.upgrade(url)
    assert query(url, "SELECT polname FROM pg_policy") == []


def test_what_was_made_for_a_knowledge_base_that_is_gone_is_for_no_other(
    server: Server, connect: Connect
) -> None:
    url = server.new_store()
    with closing(connect(url, knowledge_base="tiago")) as kb:
        kb.propositions.save(robot_at())
        update_views(url)
    roles = kant_sql.operations.create_roles(url, knowledge_base="tiago")
    with members(url, roles) as own, psycopg.connect(url, autocommit=True) as owner:
        owner.execute("UPDATE knowledge_base SET name = 'pepper'")
        kant_sql.operations.create_roles(url)
        assert query(url, "SELECT FROM pg_views WHERE schemaname = 'kant_sql_tiago'") == []
        for name in ("object", "fact_robot_at"):
            for user in own:
                with psycopg.connect(user, autocommit=True) as connection:
                    assert refused(connection, f"SELECT FROM {name}"), (name, user)
    # Nor is it in the way of a migration.
    as_form_1(url)
    kant_sql.operations.downgrade(url, revision="0001")


def test_what_cannot_be_done_is_refused_with_the_remedy(
    server: Server, role_store: str, role_users: Members, shared_url: str
) -> None:
    if shared_url.startswith("sqlite"):
        with pytest.raises(StoreError, match=r"SQLite has no roles.*\?mode=ro"):
            kant_sql.operations.create_roles(shared_url)
        return
    with pytest.raises(KantSqlError, match=r"no knowledge base 'tiagi'.*there are: .*'tiago'"):
        kant_sql.operations.create_roles(role_store, knowledge_base="tiagi")
    with pytest.raises(SchemaMissingError):
        kant_sql.operations.create_roles(server.new_database())
    with pytest.raises(StoreError, match=r"connect as the owner of the tables.*CREATEROLE"):
        kant_sql.operations.create_roles(role_users.reader)


def test_the_statements_of_the_page_run(server: Server, connect: Connect) -> None:
    url = server.new_store()
    connect(url, knowledge_base="tiago").propositions.save(robot_at())
    roles = kant_sql.operations.create_roles(url, knowledge_base="tiago")
    page = Page("roles.md")
    assert all(name in page.text for name in roles[:5] if name is not None)
    with psycopg.connect(url) as owner, owner.transaction(force_rollback=True):
        blocks = page.of("sql")
        assert len(blocks) == 3
        owner.execute("CREATE ROLE other_program")
        for block in blocks:
            # The page's database, by the name that it has here.
            owner.execute(block.replace(" fleet ", f' "{owner.info.dbname}" ').encode())


def test_what_others_may_revoke_is_left_to_them_by_name(server: Server, connect: Connect) -> None:
    url = server.new_database()
    user = f"maker_{os.getpid()}"
    with psycopg.connect(url, autocommit=True) as admin:
        admin.execute(named("CREATE ROLE {} LOGIN CREATEROLE", user))
        admin.execute(named("GRANT CREATE ON SCHEMA public TO {}", user))
        try:
            own = as_user(url, user)
            kant_sql.upgrade(own)
            roles = kant_sql.operations.create_roles(own)
            assert not {*roles.statements} & {*roles.remaining}
            is_public = admin.info.server_version < 150_000
            assert [sql.split(" FROM ")[0] for sql in roles.remaining] == [
                *(["REVOKE CREATE ON SCHEMA public"] if is_public else [])
            ] + [
                f"REVOKE EXECUTE ON FUNCTION lo_creat{arguments}"
                for arguments in ("(integer)", "e(oid)")
            ] + [
                "REVOKE EXECUTE ON FUNCTION lo_from_bytea(oid,bytea)",
                f"REVOKE TEMPORARY ON DATABASE {admin.info.dbname}",
            ]
            shown = run("db", "roles", own).stderr.splitlines()
            assert [line.split(": ", 1)[1] for line in shown] == [f"{s};" for s in roles.remaining]
            for statement in roles.remaining:
                admin.execute(statement.encode())
            assert kant_sql.operations.create_roles(own).remaining == ()
        finally:
            admin.execute(named("DROP OWNED BY {} CASCADE", user))
            admin.execute(named("DROP ROLE {}", user))


# Writers.


def program(kb: KnowledgeBase, patch: pytest.MonkeyPatch) -> None:
    """Write in every way."""
    plan = recorded(kb)
    assert kb.plans.set_status(plan.steps[0], status="running")
    with kb.transaction(execution=plan.steps[0]):
        arrive(kb, "wp2")
        assert kb.plans.set_status(plan.steps[0], status="succeeded")
    change(kb, patch)
    kb.restore(kb.revision - 2, reason="by mistake")
    say(kb)


def change(kb: KnowledgeBase, patch: pytest.MonkeyPatch) -> None:
    """Change facts and definitions, and take that back before and after it was written."""
    fill(kb)
    kb.actions.save(navigation())
    kb.propositions.save(robot_at())
    kb.function_values.save(PddlFunctionValueDto(BATTERY, [RB1], 80))
    with kb.transaction():
        kb.propositions.save(robot_at(place=WP2))
        kb.propositions.delete(robot_at())
        kb.function_values.save(PddlFunctionValueDto(BATTERY, [RB1], 70))
        kb.predicates.save(PddlPredicateDto("near", [WAYPOINT, WAYPOINT]))
        state(kb)
        # What was written is taken back: rows of this revision go, what it has closed is opened.
        kb.propositions.delete(robot_at(place=WP2))
        kb.propositions.save(robot_at())
        kb.function_values.save(PddlFunctionValueDto(BATTERY, [RB1], 80))
        kb.predicates.update(PddlPredicateDto("near", [WAYPOINT, ROBOT]))
        kb.types.save("drone - robot")
        state(kb)
        kb.types.delete("drone")
        kb.propositions.save(robot_at(place=WP2))
    with undone(kb):
        kb.propositions.delete_all()
        state(kb)
    kb.predicates.update(PddlPredicateDto("near", [ROBOT, ROBOT]))
    near = PddlPredicateDto("near", [ROBOT, ROBOT])
    kb.propositions.save(PddlPropositionDto(near, [RB1, RB1]))
    kb.predicates.update(PddlPredicateDto("near", [WAYPOINT]), cascade=True)
    kb.objects.delete("wp2")
    with patch.context() as tight:
        # As if there were many more: they are written and forgotten, and some taken back later.
        tight.setattr(propositions, "SPILL_AT", 500)
        with kb.transaction():
            kb.propositions.save_all(robot_at(place=waypoint(number)) for number in range(1_500))
            for number in range(0, 1_500, 30):
                kb.propositions.delete(robot_at(place=waypoint(number)))
    kb.propositions.delete_all()


def test_a_writer_can_do_all_that_the_library_does(
    server: Server, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = server.new_store()
    owned = connect(url, knowledge_base="owned")
    program(owned, monkeypatch)
    roles = kant_sql.operations.create_roles(url)
    with members(url, roles) as own:
        written = connect(own.writer, knowledge_base="written")
        program(written, monkeypatch)
        assert state(written) == state(owned)
        assert written.problem_pddl() == owned.problem_pddl()
        assert [entry.changes for entry in written.log()] == [e.changes for e in owned.log()]
        assert written.store.verify().is_intact
        assert check_chain(url) == {"owned": owned.revision, "written": owned.revision}
        program(connect(own.writer, knowledge_base="owned"), monkeypatch)
        written.close()


def test_a_limited_writer_can_do_so_in_its_knowledge_base_only(
    role_store: str, limited_users: Members, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(limited_users.writer, knowledge_base=MINE)
    before = query(role_store, f"SELECT count(*) FROM proposition WHERE kb_id <> {MINE_ID}")
    with undone(kb):
        change(kb, monkeypatch)
    kb.propositions.save(robot_at(place=WP1))
    assert query(role_store, f"SELECT count(*) FROM proposition WHERE kb_id <> {MINE_ID}") == before
    for name in (OTHER, "a new one"):
        # It is not there, for this user; and there is none to be made.
        other = connect(limited_users.writer, knowledge_base=name)
        assert other.revision == 0
        with pytest.raises(ReadOnlyStoreError, match="permission denied for table knowledge_base"):
            other.propositions.save(robot_at())
    with psycopg.connect(limited_users.writer, autocommit=True) as connection:
        for statement in (
            "INSERT INTO object SELECT 2, 1000000, 'o', 'o'",
            "INSERT INTO revision (kb_id, number, committed_at, form, hash) "
            "SELECT 2, 1 + max(number), now(), 2, 'hash' FROM revision",
            "UPDATE object_version SET kb_id = 2",
        ):
            assert refused(connection, statement), statement


# Readers.


def readings(kb: KnowledgeBase) -> list[Any]:
    """What the library can read."""
    then = kb.at(2)
    return [
        state(kb),
        state(then),
        kb.revision,
        kb.domain_pddl(),
        then.problem_pddl(),
        [(entry.revision, entry.changes) for entry in kb.log()],
        [str(dto) for dto in kb.function_values.get_all()],
        [str(dto) for dto in kb.propositions.get_by_predicate("at")],
        kb.objects.get("t1"),
        kb.diff(1, 2),
        kb.history("t1"),
        kb.blame("(at t1 p2)"),
        [entry.revision for entry in kb.changes(after=1)],
        kb.watch(after=0, timeout=0),
        kb.store.verify(),
    ]


def test_readers_read_all_that_the_library_reads_and_write_nothing(
    role_store: str, role_users: Members, limited_users: Members, connect: Connect
) -> None:
    for url in (role_users.reader, limited_users.reader):
        kb = connect(url, knowledge_base=MINE)
        assert readings(kb) == readings(connect(role_store, knowledge_base=MINE))
        with pytest.raises(ReadOnlyStoreError, match="permission denied"):
            kb.propositions.save(robot_at())
        with psycopg.connect(url, autocommit=True) as connection:
            for table in TABLES:
                statement = named("INSERT INTO {} SELECT * FROM {}", table.name, table.name)
                assert refused(connection, statement), table.name


@pytest.mark.more
def test_readers_of_all_have_tables_of_views(
    role_store: str, role_users: Members, limited_users: Members, connect: Connect
) -> None:
    owned = connect(role_store, knowledge_base=MINE)
    for url in (role_users.reader, role_users.writer):
        kb = connect(url, knowledge_base=MINE)
        for view in AUDIT_VIEWS:
            assert kb.store.to_arrow(view) == owned.store.to_arrow(view)
    with pytest.raises(ReadOnlyStoreError, match="permission denied for view audit_fact"):
        connect(limited_users.reader, knowledge_base=MINE).store.to_arrow("fact")
    schema = kant_sql.operations.create_roles(role_store, knowledge_base=MINE).schema
    with psycopg.connect(role_store, autocommit=True) as connection:
        user = make_url(limited_users.reader).username
        connection.execute(f"ALTER ROLE {user} SET search_path = {schema}, public".encode())
    try:
        limited = connect(limited_users.reader, knowledge_base=MINE)
        for view in AUDIT_VIEWS:
            assert limited.store.to_arrow(view) == owned.store.to_arrow(view)
    finally:
        with psycopg.connect(role_store, autocommit=True) as connection:
            connection.execute(f"ALTER ROLE {user} RESET search_path".encode())


def test_readers_see_all_rows_or_those_of_their_knowledge_base(
    role_store: str, role_users: Members, limited_users: Members
) -> None:
    everything = contents(role_store)
    mine = {name: [row for row in rows if row[0] == MINE_ID] for name, rows in everything.items()}
    assert all(0 < len(mine[name]) < len(rows) for name, rows in everything.items())
    for url in (role_users.reader, role_users.writer):
        assert contents(url) == everything
    for url in (limited_users.reader, limited_users.writer):
        assert contents(url) == mine


# Auditors.


def test_auditors_read_views_and_no_table(role_store: str, role_users: Members) -> None:
    for view in views(role_store):
        assert rows_of(role_users.auditor, view) == rows_of(role_store, view)
    for table in [*(table.name for table in TABLES), "kant_sql_version"]:
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            rows_of(role_users.auditor, table)


@pytest.mark.more
def test_a_limited_auditor_reads_views_of_its_own(role_store: str, limited_users: Members) -> None:
    schema = present(kant_sql.operations.create_roles(role_store, knowledge_base=MINE).schema)
    assert views(role_store, schema) == views(role_store)
    for view in views(role_store):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            rows_of(limited_users.auditor, view)
        names = {row[0] for row in query(role_store, "SELECT knowledge_base FROM {}", view)}
        assert names == {MINE, OTHER}
        kb = f"SELECT name FROM knowledge_base WHERE id = {MINE_ID}"
        wanted = query(role_store, f"SELECT * FROM {{}} WHERE knowledge_base = ({kb})", view)
        found = query(limited_users.auditor, "SELECT * FROM {}.{}", schema, view)
        assert sorted(map(str, found)) == sorted(map(str, wanted))


def seen_by_a_function(url: str) -> list[int]:
    """Each `since` that the server shows a function which costs less than the view's condition."""
    seen: list[int] = []
    with psycopg.connect(url) as connection:
        connection.add_notice_handler(lambda notice: seen.append(int(notice.message_primary or 0)))
        connection.execute(
            "CREATE FUNCTION pg_temp.see(bigint) RETURNS boolean LANGUAGE plpgsql COST 1e-9 AS "
            "$$ BEGIN RAISE NOTICE '%', $1; RETURN true; END $$"
        )
        for kind in ("indexscan", "bitmapscan", "indexonlyscan"):
            connection.execute(f"SET enable_{kind} = off".encode())
        connection.execute("SELECT FROM fact_robot_at WHERE pg_temp.see(since)")
    return seen


def test_auditors_read_generated_views(server: Server, connect: Connect) -> None:
    url = server.new_store()
    for kb_name in (MINE, OTHER):
        connect(url, knowledge_base=kb_name).propositions.save(robot_at())
    connect(url, knowledge_base=OTHER).propositions.save(robot_at(place=WP2))
    all_roles, limited_roles = (
        kant_sql.operations.create_roles(url),
        kant_sql.operations.create_roles(url, knowledge_base=MINE),
    )
    made = [view for view in update_views(url) if view.kind == "fact"]
    assert {view.knowledge_base for view in made} == {MINE, OTHER}
    kant_sql.operations.create_roles(url)
    with members(url, all_roles) as all_users, members(url, limited_roles) as limited:
        for view in made:
            assert len(rows_of(url, view.name)) == (1 if view.knowledge_base == MINE else 2)
            assert rows_of(all_users.auditor, view.name) == rows_of(url, view.name)
            if view.knowledge_base == MINE:
                assert rows_of(limited.auditor, view.name) == rows_of(url, view.name)
            else:
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    rows_of(limited.auditor, view.name)
        with psycopg.connect(url, autocommit=True) as owner:
            user = str(make_url(limited.auditor).username)
            owner.execute(named("GRANT TEMPORARY ON DATABASE {} TO {}", owner.info.dbname, user))
            assert seen_by_a_function(limited.auditor) == [1]
            owner.execute(named("REVOKE ALL ON DATABASE {} FROM {}", owner.info.dbname, user))
        # What auditors may read is not in the way of making them anew.
        connect(url, knowledge_base=MINE).predicates.save(PddlPredicateDto("near", [WAYPOINT]))
        update_views(url)
