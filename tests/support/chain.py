"""Recomputes the chain of revisions from the tables, with only SQL, `json` and `hashlib`.

It uses nothing of the library, as an auditor would not use it either.
"""

from __future__ import annotations

import json
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import closing
from hashlib import sha256
from typing import Any, NamedTuple

import psycopg
from sqlalchemy import make_url

Execute = Callable[[str], Iterable[tuple[Any, ...]]]
_Change = tuple[str, str, str]

_DEFINITIONS = ("type", "object", "predicate", "function", "action", "formula", "rule", "document")
_IDENTITIES = (*_DEFINITIONS, "proposition", "function_value", "plan", "archive")

_KNOWLEDGE_BASES = """
    SELECT knowledge_base.id, knowledge_base.name, head.revision, head.definition_revision,
           head.next_id, head.hash, {head_time}
    FROM knowledge_base JOIN head ON head.kb_id = knowledge_base.id
"""
_REVISIONS = """
    SELECT revision.kb_id, revision.number, {time}, actor, reason, {source}, form, hash,
           {observed_at}, seed, plan_id, position
    FROM revision
    LEFT JOIN revision_execution AS step
        ON step.kb_id = revision.kb_id AND step.number = revision.number
    ORDER BY revision.kb_id, revision.number
"""
_DEFINITION_CHANGES = "SELECT kb_id, since, until, {kind}, text FROM {table}_version"
_OTHER_CHANGES = (
    "SELECT kb_id, since, until, 'value', text FROM function_value_version",
    "SELECT kb_id, since, until, kind, text FROM execution_version",
    "SELECT kb_id, since, NULL, 'saying', text FROM proposition_saying",
    "SELECT kb_id, since, NULL, 'saying', text FROM function_value_saying",
    "SELECT kb_id, since, NULL, 'plan', text FROM plan",
    "SELECT kb_id, since, NULL, 'archive', text FROM archive",
    "SELECT seen.kb_id, since, NULL, 'confirmation', text FROM confirmation AS seen"
    " JOIN proposition ON proposition.kb_id = seen.kb_id AND id = proposition_id",
)
_PROPOSITION_CHANGES = """
    SELECT version.kb_id, since, until,
           CASE WHEN proposition.is_goal THEN 'goal' ELSE 'fact' END, text
    FROM proposition_version AS version
    JOIN proposition ON proposition.kb_id = version.kb_id AND id = proposition_id
"""
_WRONG_COPIES = """
    SELECT text FROM proposition_version AS version
    JOIN proposition ON proposition.kb_id = version.kb_id AND id = proposition_id
    WHERE version.is_goal <> proposition.is_goal OR version.predicate_id <> proposition.predicate_id
"""
_DEFINED = " UNION ALL ".join(
    f"SELECT kb_id, since, until FROM {table}_version" for table in _DEFINITIONS
)
_IDS = " UNION ALL ".join(f"SELECT kb_id, id FROM {table}" for table in _IDENTITIES)


class Dialect(NamedTuple):
    """How to read a time and a JSON document as the hashed texts from a database."""

    time: str
    source: str


SQLITE = Dialect("{}", "source")
POSTGRESQL = Dialect(
    """to_char({} AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"')""", "source::text"
)


def check_chain(url: str) -> dict[str, int]:
    """Recompute all hashes of a store, and check the conditions on its revisions.

    Args:
        url: the database URL.

    Returns:
        The number of revisions of each knowledge base, by name.

    Raises:
        AssertionError: a revision is wrong; the message names the first one.
    """
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        with closing(sqlite3.connect(str(parsed.database), isolation_level=None)) as connection:
            connection.execute("BEGIN")
            return check_sqlite(connection)
    plain = parsed.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(plain) as server:
        server.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ READ ONLY")
        return check_tables(lambda sql: server.execute(sql.encode()), POSTGRESQL)


def check_sqlite(connection: sqlite3.Connection) -> dict[str, int]:
    """The same on an open connection to SQLite, even to a store in memory."""
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    return check_tables(connection.execute, SQLITE)


def check_tables(execute: Execute, dialect: Dialect) -> dict[str, int]:
    """The same with a function that runs SQL, in a transaction that sees one state."""
    revisions = defaultdict(list)
    time, observed_at = map(dialect.time.format, ("committed_at", "observed_at"))
    sql = _REVISIONS.format(time=time, observed_at=observed_at, source=dialect.source)
    for kb_id, *revision in execute(sql):
        revisions[kb_id].append(revision)
    changes = _changes(execute)
    assert list(execute(_WRONG_COPIES)) == []
    largest: defaultdict[int, int] = defaultdict(int)
    for kb_id, id_ in execute(_IDS):
        largest[kb_id] = max(largest[kb_id], id_)
    redefined: defaultdict[int, int] = defaultdict(int)
    for kb_id, since, until in execute(_DEFINED):
        redefined[kb_id] = max(redefined[kb_id], since, until or 0)
    heads = list(
        execute(_KNOWLEDGE_BASES.format(head_time=dialect.time.format("head.committed_at")))
    )
    for kb_id, name, number, definition_revision, next_id, digest, committed_at in heads:
        found = _check_revisions(name, revisions[kb_id], changes[kb_id])
        expected = found or (0, None, None)
        assert (number, digest, committed_at) == expected, f"{name}: the head is not {expected}"
        assert definition_revision == redefined[kb_id], f"{name}: {redefined[kb_id]}"
        assert next_id > largest[kb_id], f"{name}: the next id {next_id} is given out already"
    assert revisions.keys() | changes.keys() <= {kb_id for kb_id, *_ in heads}
    return {name: number for _, name, number, *_ in heads}


def _changes(execute: Execute) -> defaultdict[int, defaultdict[int, list[_Change]]]:
    """Return the change lines of each revision of each knowledge base."""
    changes: defaultdict[int, defaultdict[int, list[_Change]]] = defaultdict(
        lambda: defaultdict(list)
    )
    queries = [
        # A formula's kind is its section.
        _DEFINITION_CHANGES.format(
            kind="section" if table == "formula" else f"'{table}'", table=table
        )
        for table in _DEFINITIONS
    ]
    for query in [*queries, *_OTHER_CHANGES, _PROPOSITION_CHANGES]:
        for kb_id, since, until, kind, text in execute(query):
            changes[kb_id][since].append(("+", kind, text))
            if until is not None:
                changes[kb_id][until].append(("-", kind, text))
    return changes


def _check_revisions(
    name: str, revisions: list[list[Any]], changes: dict[int, list[_Change]]
) -> tuple[int, str, str] | None:
    """Check one knowledge base; return number, hash and time of its last revision."""
    assert set(changes) == {revision[0] for revision in revisions}, f"{name}: half a revision"
    last: tuple[int, str, str] | None = None
    for count, revision in enumerate(revisions):
        number, committed_at, actor, reason, source, form, digest, *rest = revision
        observed_at, seed, *step = rest
        at = f"{name}: revision {number}"
        assert number == count + 1, f"{at} comes after {count}"
        assert form == (1 if seed is None else 2), f"{at} has form {form}"
        said: list[Any] = [actor, reason, source]
        lines = sorted(changes[number])
        if seed is not None:
            labels = ("actor", "reason", "source")
            said = [_sealed(seed, *each) for each in zip(labels, said, strict=True)]
            lines = [(*line[:2], _sealed(seed, line[0] + line[1], line[2])) for line in lines]
        assert last is None or last[2] <= committed_at, f"{at} is older than the one before"
        members = {
            "actor": _json(said[0]),
            "changes": _json(lines),
            "committed_at": _json(committed_at),
            "form": str(form),
            "knowledge_base": _json(name),
            "number": str(number),
            "observed_at": _json(observed_at),
            "plan_step": _json(None if step == [None, None] else step),
            "previous": _json(last and last[1]),
            "reason": _json(said[1]),
            # It is stored in canonical form, and parsing could change its numbers.
            "source": said[2] or "null" if seed is None else _json(said[2]),
        }
        document = ",".join(f'"{key}":{value}' for key, value in members.items())
        expected = sha256(f"{{{document}}}".encode()).hexdigest()
        assert digest == expected, f"{at} does not have the hash of what it says"
        last = (number, digest, committed_at)
    return last


def _sealed(seed: bytes, label: str, text: Any) -> Any:
    if text is None:
        return None
    salt = sha256(seed + label.encode() + b"\0" + text.encode()).digest()[:16]
    return sha256(salt + text.encode()).hexdigest()


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
