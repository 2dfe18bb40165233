"""How fast a history is verified, next to the bare driver that reads the same rows, plus hashlib.

    python -m tests.benchmarks.verifying [CHANGES] [BACKEND ...]

The peak of memory is that of a process which does nothing but open the store and verify it.
"""

from __future__ import annotations

import json
import sqlite3
import sys
from collections.abc import Iterator
from hashlib import sha256
from itertools import groupby
from typing import Any

import psycopg
from sqlalchemy import make_url

import kant_sql
from kant_sql.history.verify.chain import stream_chain
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import Session
from tests.benchmarks.support import figures_of, print_table, seconds, status, stores
from tests.benchmarks.years import fill

NAME = "robot0"
CHANGES = 1_000_000
_REVISIONS = """
    SELECT number, committed_at, actor, reason, CAST(source AS text), form, hash, observed_at
    FROM revision
    WHERE kb_id = 1 ORDER BY number
"""
_ROWS = (
    "SELECT id, predicate_id, arguments, text, is_goal FROM proposition ORDER BY id",
    "SELECT proposition_id, position, object_id FROM proposition_argument ORDER BY 1, 2",
    "SELECT proposition_id, since, until, predicate_id, fork, is_goal, first_object_id,"
    " second_object_id FROM proposition_version ORDER BY 1, 2",
    "SELECT id, function_id, arguments, text FROM function_value ORDER BY id",
    "SELECT function_value_id, position, object_id FROM function_value_argument ORDER BY 1, 2",
    "SELECT function_value_id, since, until, function_id, fork, value, number, object_id, text"
    " FROM function_value_version ORDER BY 1, 2",
)
_ENDS = """
    SELECT {end}, {sign}, 'fact', p.text FROM proposition_version AS v
    JOIN proposition AS p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
    WHERE v.kb_id = 1 AND {end} IS NOT NULL
    UNION ALL
    SELECT {end}, {sign}, 'value', v.text FROM function_value_version AS v
    WHERE v.kb_id = 1 AND {end} IS NOT NULL
"""
_CHANGES = (
    f"{_ENDS.format(end='since', sign=0)} UNION ALL {_ENDS.format(end='until', sign=1)}"
    " ORDER BY 1, 2, 3, 4"
)


def seal(url: str) -> None:
    """Give the revisions of a generated store the hashes of what they say."""
    backend = create_backend(url)
    with backend.open_session() as session:
        session.begin(write=True)
        digests: list[tuple[str, int]] = []
        previous: str | None = None
        for step in stream_chain(session, 1):
            assert step.link is not None
            previous = step.link.digest(NAME, previous, step.changes)
            digests.append((previous, step.number))
        _write(session, digests)
        session.commit()
    backend.close()


def _write(session: Session, digests: list[tuple[str, int]]) -> None:
    cursor: Any = session._cursor
    head = "UPDATE head SET hash = ? WHERE kb_id = 1"
    if session.placeholder == "?":
        cursor.executemany("UPDATE revision SET hash = ? WHERE kb_id = 1 AND number = ?", digests)
        cursor.execute(head, (digests[-1][0],))
        return
    cursor.execute("CREATE TEMPORARY TABLE digest (hash text, number bigint) ON COMMIT DROP")
    with cursor.copy("COPY digest FROM STDIN") as copy:
        for digest in digests:
            copy.write_row(digest)
    cursor.execute(
        "UPDATE revision SET hash = digest.hash FROM digest WHERE digest.number = revision.number"
    )
    cursor.execute(head.replace("?", "%s"), (digests[-1][0],))


def verify(url: str, structure: bool) -> None:
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        verification = kb.store.verify(structure=structure)
    assert verification.findings == (), verification.findings[:3]


def read(url: str) -> None:
    """Read the same rows with the bare driver, and hash the same documents."""
    parsed = make_url(url)
    is_sqlite = parsed.get_backend_name() == "sqlite"
    connection: Any = sqlite3.connect(str(parsed.database)) if is_sqlite else psycopg.connect(url)

    def rows(sql: str) -> Iterator[tuple[Any, ...]]:
        if is_sqlite:
            yield from connection.execute(sql)
            return
        with connection.cursor(name=f"c{abs(hash(sql))}") as cursor:
            cursor.itersize = 5_000
            yield from cursor.execute(sql)

    changes = groupby(rows(_CHANGES), key=lambda row: row[0])
    number, group = next(changes)
    for row in rows(_REVISIONS):
        said = json.dumps([*map(str, row)])
        if number == row[0]:
            said += ",".join(f'["{sign}","{kind}","{text}"]' for _, sign, kind, text in group)
            number, group = next(changes, (0, iter(())))
        sha256(said.encode()).hexdigest()
    for sql in _ROWS:
        for _ in rows(sql):
            pass
    connection.close()


def measure(name: str, url: str, count: int) -> tuple[str, ...]:
    """Fill a store, and measure one line of the table."""
    fill(url, count, knowledge_bases=1)
    seal(url)
    bare, library = seconds(lambda: read(url)), seconds(lambda: verify(url, False))
    whole = seconds(lambda: verify(url, True))
    return (
        f"{name}, {count:,}",
        f"{bare:.1f} s",
        f"{library:.1f} s",
        f"{count / library:,.0f}",
        f"{library / bare:.2f}",
        f"{whole:.1f} s",
        f"{figures_of('tests.benchmarks.verifying', '--verify', url)[0]:.0f} MB",
    )


def main(argv: list[str]) -> int:
    if argv[:1] == ["--verify"]:
        verify(argv[1], True)
        print(status("VmHWM"))
        return 0
    changes = int(argv[0]) if argv else CHANGES
    names = argv[1:] or ["sqlite", "postgresql"]
    with stores(names) as new:
        rows = [
            measure(name, make(), count)
            for name, make in new.items()
            for count in (changes // 10, changes)
        ]
    header = (
        *("changes", "bare driver", "verify", "changes/s", "ratio"),
        "with indexes",
        "peak memory",
    )
    print_table("Verifying a history", header, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
