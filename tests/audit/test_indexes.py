"""Conditions reach the indexes of the tables through the views, without any statistics."""

from __future__ import annotations

import re
from collections.abc import Iterator

import psycopg
import pytest

from tests.support.pages import rows_of

TIMES = "'2026-01-31T09:30:00.000000Z' AND '2026-01-31T09:31:00.000000Z'"
# What is asked, and the index that both databases have for it.
CONDITIONS = {
    "audit_fact WHERE predicate = 'p' AND": "predicate_name",
    "audit_fact WHERE predicate = 'p' AND until IS NULL AND": "predicate_name",
    "audit_fact WHERE text = '(p a)' AND": "proposition_text",
    "audit_fact WHERE since = 7 AND": "proposition_version_since",
    "audit_fact WHERE until BETWEEN 7 AND 9 AND": "proposition_version_until",
    f"audit_fact WHERE since_at BETWEEN {TIMES} AND": "revision_committed_at",
    f"audit_fact WHERE until_at BETWEEN {TIMES} AND": "revision_committed_at",
    "audit_goal WHERE until IS NULL AND": "proposition_version_goal",
    "audit_fact_argument WHERE object = 'a' AND": "proposition_argument_object",
    "audit_value WHERE fluent = '(f a)' AND": "function_value_text",
    "audit_value WHERE function = 'f' AND": "function_name",
    "audit_value_argument WHERE object = 'a' AND": "function_value_argument_object",
    "audit_object WHERE object = 'a' AND": "object_name",
    f"audit_revision WHERE committed_at BETWEEN {TIMES} AND": "revision_committed_at",
    "audit_change WHERE revision = 7 AND": "proposition_version_since",
    f"audit_change WHERE committed_at BETWEEN {TIMES} AND": "revision_committed_at",
    "audit_action_literal WHERE predicate = 'p' AND": "action_node_predicate",
}
# On these, a scan would take in all of the history, or all that was ever said.
LARGE = {"v", "p", "f", "a", "r", "s", "u", "o"}

MORE = """
INSERT INTO proposition
SELECT kb_id, 1000000 * id + n, id, false, 'x' || n, '(p ' || n || ')'
FROM predicate, generate_series(1, 5000) AS n;
INSERT INTO proposition_version
SELECT p.kb_id, p.id, 30, CAST(NULL AS bigint), p.predicate_id, false, 0, NULL, NULL
FROM proposition AS p WHERE p.id > 1000000;
INSERT INTO function_value
SELECT kb_id, 2000000 + n, id, 'x' || n, '(f ' || n || ')'
FROM function, generate_series(1, 5000) AS n;
INSERT INTO function_value_version
SELECT kb_id, id, 30, NULL, function_id, '1', 1, NULL, '(= ' || text || ' 1)', 0
FROM function_value WHERE id > 2000000;
"""


def query(condition: str) -> str:
    return f"SELECT * FROM {condition} knowledge_base = 'courier'"


@pytest.mark.parametrize("condition", CONDITIONS)
def test_sqlite_searches_by_the_index(sqlite_story: str, condition: str) -> None:
    rows = rows_of(sqlite_story, f"EXPLAIN QUERY PLAN {query(condition)}")
    plan = "\n".join(row[3] for row in rows)
    assert re.search(rf"USING (COVERING )?INDEX (ix|uq)_{CONDITIONS[condition]}", plan), plan
    assert not set(re.findall(r"^SCAN (\w+)", plan, re.MULTILINE)) & LARGE, plan


@pytest.fixture(scope="module")
def grown(postgresql_story: str) -> Iterator[psycopg.Connection]:
    """A connection that sees many more facts and values, without statistics of them."""
    with psycopg.connect(postgresql_story) as connection:
        connection.execute("SET session_replication_role = replica")
        connection.execute(MORE)
        yield connection
        connection.rollback()


@pytest.mark.parametrize("condition", CONDITIONS)
def test_postgresql_searches_by_the_index(grown: psycopg.Connection, condition: str) -> None:
    # What is small is read faster as it comes.
    grown.execute("SET LOCAL enable_seqscan = off")
    rows = grown.execute(f"EXPLAIN {query(condition)}".encode())
    plan = "\n".join(row[0] for row in rows)
    assert re.search(rf"(ix|uq)_{CONDITIONS[condition]}", plan), plan
