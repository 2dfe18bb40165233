"""Each statement names its knowledge base in every query of it, so that Citus asks one shard."""

from __future__ import annotations

import pytest

from tests.support.sharding import DIALECT, OF_ALL, every_insert, every_query, unbound

OWN = "kb_id = %(kb)s::BIGINT"
# A statement, and what it leaves without a knowledge base.
STATEMENTS = {
    f"SELECT head.revision FROM head WHERE head.{OWN}": [],
    "SELECT head.revision FROM head": ["head AS head"],
    "SELECT head.revision FROM head WHERE head.kb_id = %(other)s": ["head AS head"],
    f"UPDATE head SET revision=1 WHERE head.{OWN}": [],
    "UPDATE head SET revision=1 WHERE head.revision = 2": ["head AS head"],
    "DELETE FROM plan WHERE kb_id = :kb AND ctid = ANY(ARRAY(SELECT p.ctid FROM plan AS p))": [
        "plan AS p"
    ],
    f"SELECT r.number FROM head AS h JOIN revision AS r ON r.kb_id = h.kb_id WHERE h.{OWN}": [],
    "SELECT r.number FROM head AS h JOIN revision AS r ON r.kb_id = h.kb_id": [
        "head AS h",
        "revision AS r",
    ],
    # What Citus does not follow: a correlation with the query around it.
    "SELECT o.id, (SELECT v.text FROM object_version AS v WHERE v.kb_id = o.kb_id LIMIT 1) "
    f"FROM object AS o WHERE o.{OWN}": ["object_version AS v"],
    f"SELECT o.id, (SELECT v.text FROM object_version AS v WHERE v.{OWN}) "
    f"FROM object AS o WHERE o.{OWN}": [],
    f"SELECT id FROM type WHERE {OWN} UNION ALL SELECT id FROM object WHERE id = 1": [
        "object AS object"
    ],
    # A choice does not hold it to one.
    f"SELECT id FROM type WHERE (type.{OWN} OR type.id = 1)": ["type AS type"],
    "SELECT name FROM knowledge_base": [],
    "SELECT max(revision) FROM audit_revision WHERE knowledge_base = :name": [
        "audit_revision AS audit_revision"
    ],
    f"SELECT id FROM type WHERE type.name = ' (' AND type.{OWN}": [],
}


@pytest.mark.parametrize("statement", STATEMENTS)
def test_what_names_no_knowledge_base_is_found(statement: str) -> None:
    assert unbound(statement) == STATEMENTS[statement]


def test_every_statement_names_its_knowledge_base() -> None:
    queries = every_query()
    assert len(queries) > 250
    faults = {
        f"{name}: {query.text(DIALECT)}": tables
        for name, query in queries
        if name not in OF_ALL and (tables := unbound(query.text(DIALECT)))
    }
    assert not faults


def test_what_concerns_all_knowledge_bases_is_listed_rightly() -> None:
    asked = {name for name, query in every_query() if unbound(query.text(DIALECT))}
    assert asked >= OF_ALL


def test_every_inserted_row_names_its_knowledge_base() -> None:
    inserts = every_insert()
    assert len(inserts) > 15
    assert {insert.into for insert in inserts if "kb_id" not in insert.columns[0].name} == {
        "knowledge_base (id, name)"
    }
