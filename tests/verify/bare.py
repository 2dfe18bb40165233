"""Stores without any constraint, as whoever may change tables can make them, to be tampered with.

What is changed is changed in a transaction, verified there, and rolled back.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

from sqlalchemy import make_url
from typing_extensions import override

from kant_sql.history.anchors import AnchoredHead
from kant_sql.history.verify.sides import Finding, Report
from kant_sql.history.verify.verify import Kept, verify_session
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import Backend, Session
from kant_sql.sql.tables import Base
from tests.support.worlds.story import NAME

TABLES = {table.name: table for table in Base.metadata.sorted_tables}
Row = dict[str, Any]


class _Found(BaseException):
    """Ends a verification whose other findings nobody asks for; no error that it would handle."""


class _Impatient(Report):
    @override
    def add(self, revision: int | None, table: str | None, message: str) -> None:
        raise _Found


class Bare(NamedTuple):
    """A store without constraints."""

    backend: Backend  # the database
    session: Session  # the session that tampers and verifies

    def run(self, sql: str, *values: Any) -> list[tuple[Any, ...]]:
        """Run a statement of SQLite, whose parameters are question marks."""
        text = sql if self.session.placeholder == "?" else sql.replace("?", "%s")
        self.session._execute(text, values)
        cursor: Any = self.session._cursor
        return cursor.fetchall() if cursor.description else []

    def rows(self, table: str) -> list[Row]:
        names = list(TABLES[table].c.keys())
        # A document as the text that it is.
        read = ["CAST(source AS text)" if name == "source" else name for name in names]
        found = self.run(f"SELECT {', '.join(read)} FROM {table} ORDER BY {', '.join(names[:4])}")
        return [dict(zip(names, row, strict=True)) for row in found]

    def update(self, table: str, row: Row, changes: Row) -> None:
        """Change a row, which is named by all that it has."""
        key = TABLES[table].primary_key.columns.keys()
        assignments = ", ".join(f"{name} = ?" for name in changes)
        where = " AND ".join(f"{name} = ?" for name in key)
        values = [*changes.values(), *(row[name] for name in key)]
        self.run(f"UPDATE {table} SET {assignments} WHERE {where}", *values)

    def delete(self, table: str, row: Row) -> None:
        key = TABLES[table].primary_key.columns.keys()
        where = " AND ".join(f"{name} = ?" for name in key)
        self.run(f"DELETE FROM {table} WHERE {where}", *(row[name] for name in key))

    def insert(self, table: str, row: Row) -> None:
        marks = ", ".join("?" for _ in row)
        self.run(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({marks})", *row.values())

    def findings(
        self,
        anchored: AnchoredHead | None = None,
        report: Report | None = None,
        kept: Kept | None = None,
    ) -> list[Finding]:
        """Verify all knowledge bases, in the open transaction; continue from what was kept."""
        kbs = self.run("SELECT id, name FROM knowledge_base ORDER BY id, name")
        if NAME not in {name for _, name in kbs}:
            kbs.append((None, NAME))
        return [
            finding
            for kb_id, name in kbs
            for finding in verify_session(
                self.session, kb_id, name, anchored, report, kept, kept.revision if kept else 0
            )[0].findings
        ]

    def is_intact(self, kept: Kept | None = None) -> bool:
        """Verify all knowledge bases, in the open transaction, until there is a finding."""
        try:
            return not self.findings(report=_Impatient(), kept=kept)
        except _Found:
            return False

    @contextmanager
    def tampering(self) -> Iterator[None]:
        """Undo what is done within."""
        self.session.begin(write=True)
        try:
            yield
        finally:
            self.session.rollback()


@contextmanager
def bare_store(url: str) -> Iterator[Bare]:
    """Copy a store into tables without any constraint: in memory, or in another schema."""
    is_sqlite = make_url(url).get_backend_name() == "sqlite"
    backend = create_backend("sqlite://" if is_sqlite else url)
    with closing(backend), backend.open_session() as session:
        bare = Bare(backend, session)
        if is_sqlite:
            bare.run("ATTACH ? AS story", str(make_url(url).database))
        else:
            bare.run("CREATE SCHEMA bare")
        source, target = ("story", "main") if is_sqlite else ("public", "bare")
        for table in TABLES:
            bare.run(f"CREATE TABLE {target}.{table} AS SELECT * FROM {source}.{table}")
        bare.run("DETACH story" if is_sqlite else "SET search_path TO bare")
        yield bare
