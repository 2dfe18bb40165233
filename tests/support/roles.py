"""A store with everything that roles have rights on, and forbidden statements of their members."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

import psycopg
from psycopg import errors, sql
from sqlalchemy import BigInteger, Boolean, Column, Integer, LargeBinary, String, Table, make_url

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.operations import Roles
from kant_sql.sql.tables import Base
from kant_sql.sql.tables.base import UtcTime

TABLES = list(Base.metadata.tables.values())
# The first knowledge base of the store, and the second.
MINE, OTHER = "Rosie's", "tiago"
MINE_ID = 1

# One of each construct that has its own table.
DOMAIN = """
(define (domain depot)
  (:types truck crane place - object lorry - (either truck crane))
  (:constants hub - place)
  (:predicates (at ?t - truck ?p - place) (open ?w - (either place crane)) (reachable ?p - place))
  (:functions (fuel ?t - truck) - number (home ?t - truck) - (either place crane) (total-cost))
  (:derived (reachable ?p - place) (exists (?t - truck) (at ?t ?p)))
  (:action go :parameters (?t - truck ?p - place)
    :precondition (forall (?c - crane) (open ?c))
    :effect (and (at ?t ?p) (increase (total-cost) 1))))
"""
PROBLEM = """
(define (problem monday) (:domain depot)
  (:objects t1 t2 - truck p1 p2 - place l1 - (either truck crane))
  (:init (at t1 p1) (= (fuel t1) 7.50) (= (home t1) hub))
  (:goal (and (at t1 p2) (forall (?p - place) (reachable ?p)))) (:metric minimize (total-cost)))
"""
# With a node, a term, a number and a variable of either of two types.
RULE = "(sometime (exists (?w - (either place crane)) (and (open ?w) (= (fuel t1) 3))))"
MOVED = PROBLEM.replace("(at t1 p1)", "(at t1 p2)").replace("7.50", "5").replace(" t2", "")
# For these, only the rows matter here.
BY_HAND = """
INSERT INTO plan (kb_id, id, since, revision, problem_hash, text)
    SELECT kb_id, 9001, revision, 2, 'hash', 'plan' FROM head;
INSERT INTO execution (kb_id, plan_id, position, since, action_id, text)
    SELECT a.kb_id, 9001, 0, h.revision, a.id, '(go t1 p2)'
    FROM action AS a JOIN head AS h ON h.kb_id = a.kb_id;
INSERT INTO execution_argument (kb_id, plan_id, position, argument, object_id)
    SELECT kb_id, 9001, 0, 0, min(id) FROM object GROUP BY kb_id;
INSERT INTO execution_version (kb_id, plan_id, position, since, until, kind, outcome, text)
    SELECT kb_id, 9001, 0, 1, 2, 'execution', 'running', 'text' FROM head
    UNION ALL SELECT kb_id, 9001, 0, 2, NULL, 'execution', 'succeeded', 'text' FROM head;
INSERT INTO revision_execution SELECT kb_id, 2, 9001, 0 FROM head;
INSERT INTO request (kb_id, key, number, digest, results)
    SELECT kb_id, 'key', 2, 'digest', '[]' FROM head;
INSERT INTO archive (kb_id, id, since, revision, target, versions, rest, text)
    SELECT kb_id, 9002, revision, 1, 'elsewhere', 0, 'rest', 'archive' FROM head;
INSERT INTO confirmation (kb_id, proposition_id, since)
    SELECT kb_id, min(id), 2 FROM proposition GROUP BY kb_id;
INSERT INTO promotion (kb_id, id, since, revision, origin, text)
    SELECT kb_id, 9001, revision, 1, 'elsewhere', 'promotion' FROM head;
INSERT INTO verification (kb_id, revision, hash, verified_at)
    SELECT kb_id, revision, hash, committed_at FROM head;
UPDATE head SET next_id = 9003;
"""
REFUSALS = (
    errors.InsufficientPrivilege,
    errors.IntegrityError,
    errors.WrongObjectType,
    errors.ObjectNotInPrerequisiteState,
    errors.FeatureNotSupported,
)

_ALL_ROWS = 'SELECT * FROM {} AS t ORDER BY t::text COLLATE "C"'
_numbers = itertools.count(1)
Contents = dict[str, list[tuple[Any, ...]]]


class Members(NamedTuple):
    """The URLs of users, each a member of one role."""

    writer: str
    reader: str
    auditor: str
    eraser: str


def fill(kb: KnowledgeBase) -> None:
    """Write some revisions in which elements come, change and go."""
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM)
    kb.rules.save("moved", RULE)
    kb.rules.save("moved", RULE.replace("t1", "t2"))
    kb.load_problem(MOVED)
    kb.load_domain(DOMAIN.replace("(open ?c)", "(not (open ?c))"))


def say(kb: KnowledgeBase) -> None:
    """State the facts of a past period, in one revision."""
    with kb.transaction(valid_from="2026-01-31T09:00:00Z", valid_until="2026-01-31T10:00:00Z"):
        kb.propositions.save("(at t1 p1)")
        kb.function_values.set("(fuel t1)", value=2)


def as_form_1(url: str) -> None:
    """Give all revisions form 1, so the tables can be downgraded."""
    with psycopg.connect(url) as owner:
        owner.execute("UPDATE revision SET form = 1, seed = NULL")


def fill_store(url: str) -> None:
    """Create tables, and fill each with rows of two knowledge bases."""
    kant_sql.upgrade(url)
    for name in (MINE, OTHER):
        with closing(kant_sql.connect(url, knowledge_base=name, actor="owner")) as kb:
            fill(kb)
            say(kb)
            kb.erase(revisions=[1], parts=["actor"], reason="asked", actor="clerk")
    with psycopg.connect(url) as owner:
        owner.execute(BY_HAND)


@contextmanager
def members(url: str, roles: Roles) -> Iterator[Members]:
    """Make users of this process members of roles for a while."""
    names = {role: f"user_{os.getpid()}_{next(_numbers)}" for role in roles[:4] if role}
    with psycopg.connect(url, autocommit=True) as owner:
        for role, user in names.items():
            owner.execute(named("CREATE ROLE {} LOGIN IN ROLE {}", user, role))
        try:
            yield Members(*(as_user(url, user) for user in names.values()))
        finally:
            for user in names.values():
                owner.execute(named("DROP ROLE {}", user))


def as_user(url: str, user: str) -> str:
    """Return the URL with another user."""
    return make_url(url).set(username=user, password=None).render_as_string(hide_password=False)


def named(statement: str, *identifiers: str) -> sql.Composed:
    """Return a statement with identifiers in place of `{}`."""
    return sql.SQL(statement).format(*map(sql.Identifier, identifiers))


def contents(url: str) -> Contents:
    """Return all rows of all tables, as a user sees them."""
    with psycopg.connect(url) as connection:
        return {
            table.name: connection.execute(named(_ALL_ROWS, table.name)).fetchall()
            for table in TABLES
        }


def refused(connection: psycopg.Connection[Any], statement: sql.Composed | str) -> bool:
    """Return whether a statement is refused, in its own transaction; otherwise it is committed."""
    try:
        connection.execute(statement)
    except REFUSALS:
        return True
    return False


def mutations(table: Table, server_version: int) -> Iterator[sql.Composed]:
    """Yield statements that would change or remove rows of a table, or the table."""
    merge = "MERGE INTO {} AS t USING (SELECT 1) AS s ON true WHEN MATCHED THEN DELETE"
    for statement in (
        "DELETE FROM {}",
        "TRUNCATE {} CASCADE",
        "DROP TABLE {} CASCADE",
        "ALTER TABLE {} ADD COLUMN more INTEGER",
        "ALTER TABLE {} DISABLE ROW LEVEL SECURITY",
        "CREATE POLICY more ON {} USING (true)",
        "CREATE RULE more AS ON INSERT TO {} DO NOTHING",
        *([merge] if server_version >= 150_000 else []),
    ):
        yield named(statement, table.name)
    for column in table.columns:
        for value in _other_values(column):
            yield sql.SQL("UPDATE {} SET {} = {}").format(
                *map(sql.Identifier, (table.name, column.name)),
                sql.SQL(value).format(sql.Identifier(column.name)),
            )


def _other_values(column: Column[Any]) -> tuple[str, ...]:
    if isinstance(column.type, Boolean):
        return ("NOT {}",)
    if isinstance(column.type, BigInteger | Integer):
        return ("{} + 1", "{} - 1", "0", "NULL", "1000")
    if isinstance(column.type, UtcTime):
        return ("now()", "NULL")
    if column.name == "sign":
        return ("'-'",)
    if column.name == "source":
        return ("'{{}}'",)
    if isinstance(column.type, String):
        return ("'other'", "NULL")
    if isinstance(column.type, LargeBinary):
        return ("'x'::bytea", "NULL")
    return ("0.5", "NULL")


def query(url: str, statement: str, *identifiers: str) -> list[tuple[Any, ...]]:
    """Return the rows of a query; identifiers replace `{}`."""
    with psycopg.connect(url) as connection:
        return connection.execute(named(statement, *identifiers)).fetchall()


def rows_of(url: str, relation: str) -> list[tuple[Any, ...]]:
    """Return all rows of a table or a view that a user sees."""
    return query(url, _ALL_ROWS, relation)


def views(url: str, schema: str = "public") -> list[str]:
    """Return the views for auditors in a schema."""
    found = query(
        url,
        "SELECT relname FROM pg_class WHERE relkind = 'v' AND relnamespace = "
        f"'{schema}'::regnamespace AND relname LIKE 'audit%' ORDER BY relname",
    )
    assert len(found) > 5
    return [row[0] for row in found]
