"""Reads a knowledge base for comparisons: its state, its log, and its rows.

It also makes calls that must leave no trace.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

import pytest
from sqlalchemy import text

import kant_sql
from kant_sql import DaoFactory, KnowledgeBase
from kant_sql.factory import SqlDaoFactory
from kant_sql.history.verify.sides import Finding
from kant_sql.sql.catalog import every_name
from kant_sql.store.store import Store

State = dict[str, list[str]]
T = TypeVar("T")
E = TypeVar("E", bound=Exception)


def present(found: T | None) -> T:
    """Check that something was found, and return it."""
    assert found is not None
    return found


def loaded(kb: KnowledgeBase, domain: str, problem: str) -> KnowledgeBase:
    """Load a domain and one of its problems, as two revisions; return the knowledge base."""
    kb.load_domain(domain)
    kb.load_problem(problem)
    return kb


def documents(kb: KnowledgeBase) -> tuple[str, str]:
    """Return the texts of its domain and its problem."""
    return kb.domain_pddl(), kb.problem_pddl()


class SameStore(SqlDaoFactory):
    """A factory on the connections of another one."""

    def __init__(self, of: DaoFactory, name: str, actor: str | None) -> None:
        other: Any = of
        self._at = None
        self._store = Store(other._store.backend, name, actor)


def store_of(kb: KnowledgeBase) -> Store:
    """Return the store of a knowledge base."""
    factory = kb.store.factory
    assert isinstance(factory, SqlDaoFactory)
    return factory._store


def beside(kb: KnowledgeBase, name: str, actor: str | None = "test") -> KnowledgeBase:
    """Return another knowledge base in the same store, even in memory, on the same connections."""
    return KnowledgeBase(SameStore(kb.store.factory, name, actor))


def as_actor(kb: KnowledgeBase, actor: str) -> KnowledgeBase:
    """Return the same knowledge base for another writer."""
    return beside(kb, store_of(kb).name, actor)


def state(kb: KnowledgeBase) -> State:
    """Return everything that holds, as PDDL text, in the order of reading."""
    return {
        "types": [str(dto) for dto in kb.types.get_all()],
        "objects": [str(dto) for dto in kb.objects.get_all()],
        "predicates": [str(dto) for dto in kb.predicates.get_all()],
        "actions": [str(dto) for dto in kb.actions.get_all()],
        "facts": [str(dto) for dto in kb.propositions.get_all()],
        "goals": [str(dto) for dto in kb.goals.get_propositions()],
    }


def facts(kb: KnowledgeBase) -> list[str]:
    """Return the facts that hold, sorted."""
    return sorted(str(dto) for dto in kb.propositions.get_all())


def last_changes(kb: KnowledgeBase) -> list[str]:
    """Return the change lines of the last revision."""
    return [" ".join(change) for change in next(iter(kb.log(limit=1))).changes]


def rows(kb: KnowledgeBase, sql: str) -> list[tuple[Any, ...]]:
    """Return the rows of a SELECT on one knowledge base, whose id is `:kb`."""
    # There is no other access to a store in memory.
    store: Any = kb.store.factory._store  # type: ignore[attr-defined]
    with store.backend.engine.connect() as connection:
        id_ = connection.scalar(
            text("SELECT id FROM knowledge_base WHERE name = :name"), {"name": store.name}
        )
        return [tuple(row) for row in connection.execute(text(sql), {"kb": id_})]


def versions(kb: KnowledgeBase, kind: str) -> list[tuple[str, int, int | None]]:
    """Return text, since and until of every version of one kind, oldest first."""
    if kind == "proposition":
        found = rows(
            kb,
            "SELECT CASE WHEN proposition.is_goal THEN 'goal ' ELSE '' END || text, since, until "
            "FROM proposition_version AS version JOIN proposition "
            "ON proposition.kb_id = version.kb_id AND id = proposition_id "
            "WHERE version.kb_id = :kb",
        )
    else:
        found = rows(kb, f"SELECT text, since, until FROM {kind}_version WHERE kb_id = :kb")
    return sorted(found, key=lambda row: (row[1], row[0]))


@contextmanager
def nothing_changes(kb: KnowledgeBase) -> Iterator[None]:
    """Check that a block does not change state and head."""
    before, revision = state(kb), kb.revision
    yield
    assert state(kb) == before
    assert kb.revision == revision


def refuses(
    kb: KnowledgeBase, error: type[E], call: Callable[..., object], *arguments: object
) -> E:
    """Check that a call raises an error of exactly this class and leaves no trace; return it."""
    with nothing_changes(kb), pytest.raises(error) as caught:
        call(*arguments)
    assert type(caught.value) is error
    return caught.value


class Undone(Exception):
    """Ends a transaction that must fail."""


@contextmanager
def undone(kb: KnowledgeBase) -> Iterator[None]:
    """Run a transaction that fails at its end, so nothing of it has happened."""
    with suppress(Undone), kb.transaction():
        yield
        raise Undone


def findings(url: str) -> list[Finding]:
    """Return the findings of a verification: none, unless somebody has tampered with the store."""
    found: list[Finding] = []
    for name in every_name(url):
        with kant_sql.connect(url, knowledge_base=name) as kb:
            found += kb.store.verify().findings
    return found
