"""Roles on PostgreSQL: how they are made, brought up to date, and kept through migrations."""

from __future__ import annotations

import os
from contextlib import closing
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql import KantSqlError, StoreError
from kant_sql.errors import SchemaMissingError
from kant_sql.sql.predicate_views import update_views
from tests.support.pages import Page
from tests.support.processes.commands import run
from tests.support.roles import MINE, Members, as_user, members, named, query, refused
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at


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
    kant_sql.operations.downgrade(url, revision="0001")
    kant_sql.upgrade(url)
    assert rights(url) == before
    with members(url, roles) as own:
        connect(own.writer, knowledge_base=MINE).propositions.delete(robot_at())
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
    assert all(name in page.text for name in roles[:4] if name is not None)
    with psycopg.connect(url) as owner, owner.transaction(force_rollback=True):
        blocks = page.of("sql")
        assert len(blocks) == 3
        owner.execute("CREATE ROLE other_program")
        for block in blocks:
            # The page's database, by the name that it has here.
            owner.execute(block.replace(" fleet ", f' "{owner.info.dbname}" ').encode())


def test_what_only_others_may_revoke_is_left_to_them_by_name(
    server: Server, connect: Connect
) -> None:
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
                *(["REVOKE CREATE ON SCHEMA public"] if is_public else []),
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
