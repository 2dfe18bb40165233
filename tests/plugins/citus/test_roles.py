"""Roles of a distributed store: readers and auditors, and no writer.

The auditor of one knowledge base has views of it, each of which one shard answers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import NamedTuple

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import StoreError
from kant_sql_plugins.citus import distribute
from tests.audit.story import record_store
from tests.audit.test_cookbook import QUESTIONS, TITLES
from tests.support.citus import Cluster
from tests.support.pages import ask
from tests.support.processes.commands import run
from tests.support.roles import as_user, members

STRANGER = "other"
NAME = "courier"


class Users(NamedTuple):
    """URLs of users who are members of a role."""

    reader: str
    auditor: str


def searching(url: str, *schemas: str) -> str:
    path = {"options": f"-csearch_path={','.join(schemas)}"}
    return make_url(url).update_query_dict(path).render_as_string(hide_password=False)


@pytest.fixture(scope="module")
def roles_url(cluster: Cluster) -> str:
    """The URL of a distributed store with a robot's day in it, and with roles."""
    url = record_store(cluster.new_store())
    kant_sql.operations.create_roles(url)
    kant_sql.operations.create_roles(url, knowledge_base=NAME)
    return url


@pytest.fixture(scope="module")
def users(cluster: Cluster, roles_url: str) -> Iterator[Users]:
    """Users who may see only one knowledge base."""
    names = {role: f"kant_sql_test_{role}" for role in ("reader", "auditor")}
    for role, user in names.items():
        cluster.run(f"DROP ROLE IF EXISTS {user}", roles_url)
        cluster.run(f"CREATE ROLE {user} LOGIN IN ROLE kant_sql_{role}_{NAME}", roles_url)
    yield Users(*(as_user(roles_url, user) for user in names.values()))
    for user in names.values():
        cluster.run(f"DROP ROLE {user}", roles_url)


@pytest.mark.parametrize(("question", "answer"), QUESTIONS, ids=TITLES)
def test_one_shard_answers_the_auditor_of_one_knowledge_base(
    users: Users, question: str, answer: str
) -> None:
    url = searching(users.auditor, f"kant_sql_{NAME}", "public")
    assert ask(url, question) == answer.splitlines()
    plan = "\n".join(ask(url, f"EXPLAIN {question}"))
    assert re.findall(r"Task Count: (\d+)", plan) == ["1"]


def test_readers_and_auditors_see_one_knowledge_base(roles_url: str, users: Users) -> None:
    assert ask(roles_url, "SELECT name FROM knowledge_base ORDER BY 1") == [NAME, STRANGER]
    for url in users:
        assert ask(url, "SELECT name FROM knowledge_base") == [NAME]
        assert len(ask(url, "SELECT DISTINCT kb_id FROM proposition_version")) == 1
        own = searching(url, f"kant_sql_{NAME}", "public")
        assert ask(own, "SELECT DISTINCT knowledge_base FROM audit_revision") == [NAME]
        for statement in ("INSERT INTO knowledge_base VALUES (99, 'x')", "DELETE FROM revision"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                ask(url, statement)
    with kant_sql.connect(users.reader, knowledge_base=NAME, read_only=True) as kb:
        assert kb.propositions.get_all()


def test_there_is_no_writer_and_the_command_says_why(roles_url: str) -> None:
    done = run("db", "roles", roles_url)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "reader   kant_sql_reader\nauditor  kant_sql_auditor\n"
    assert "no writer: the row policies of a distributed table cannot look up" in done.stderr
    assert json.loads(run("db", "roles", roles_url, "--json").stdout)["writer"] is None


def test_a_store_with_writers_is_not_distributed_until_they_are_gone(
    cluster: Cluster, local_url: str
) -> None:
    roles = kant_sql.operations.create_roles(local_url)
    with (
        members(local_url, roles),
        pytest.raises(StoreError, match="DROP OWNED BY kant_sql_writer; DROP ROLE") as caught,
    ):
        distribute(local_url)
    assert "let writers connect as the owner" in str(caught.value)
    cluster.run("DROP OWNED BY kant_sql_writer", local_url)
    policies = "SELECT count(DISTINCT polroles) FROM pg_policy WHERE starts_with(polname, 'kant')"
    distribute(local_url, shards=2)
    assert cluster.run(policies, local_url) == [(1,)]
    distribute(local_url, undo=True)
    assert cluster.run(policies, local_url) == [(2,)]
