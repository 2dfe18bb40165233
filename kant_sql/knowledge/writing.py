"""Writing definitions: from what a transaction has changed to rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

from sqlalchemy import Table, select

from ..backends import Query, Row, Session, in_list
from ..dto.name import fold
from .changes import ASSERTED, RETRACTED, Change
from .definitions import KINDS, PendingDefinitions
from .loading import KB
from .rows import KIND_TABLES

_IDENTITIES = {
    kind: Query(
        select(tables.identity.c.key, tables.identity.c.id, tables.identity.c.name).where(
            tables.identity.c.kb_id == KB, in_list(tables.identity.c.key, "keys")
        )
    )
    for kind, tables in KIND_TABLES.items()
}


def find_identities(
    session: Session, kb_id: int, kind: str, keys: set[str]
) -> dict[str, tuple[int, str] | None]:
    """Find the identities of names, in one statement.

    Args:
        session: the session.
        kb_id: the knowledge base.
        kind: the kind of element.
        keys: the folded names.

    Returns:
        For each, the id and the first spelling; None for a name that nothing ever had.
    """
    found: dict[str, tuple[int, str] | None] = dict.fromkeys(keys)
    rows = session.rows(_IDENTITIES[kind], kb=kb_id, keys=session.list_value(sorted(keys)))
    found.update((key, (id_, name)) for key, id_, name in rows)
    return found


class DefinitionWriter:
    """Writes the definitions that a transaction has changed, as often as it has to.

    Attributes:
        written: (kind, id) -> the definition that the tables hold now, of what was written.
    """

    def __init__(
        self, session: Session, kb_id: int, number: int, definitions: PendingDefinitions
    ) -> None:
        self._session = session
        self._kb_id = kb_id
        self._number = number
        self._definitions = definitions
        self.written: dict[tuple[str, int], Any] = {}

    def changes(self) -> Iterator[Change]:
        """Give what the transaction has changed so far.

        Yields:
            The changes, in no order.
        """
        for kind, elements in self._definitions.changed():
            for id_, now in elements.changes.items():
                before = elements.origin.get(id_)
                if now != before:
                    for sign, definition in ((RETRACTED, before), (ASSERTED, now)):
                        if definition is not None:
                            section = getattr(definition, "section", kind)
                            yield Change(sign, section, definition.text)

    def pending(self) -> bool:
        """Tell whether there is anything to write."""
        return any(True for _ in self._steps())

    def write(self) -> None:
        """Write what is pending."""
        for kind, elements in self._definitions.used():
            self._write_identities(kind, elements.unwritten)
        inserts: defaultdict[Table, list[Row]] = defaultdict(list)
        for kind, id_, origin, before, now in list(self._steps()):
            self._close(kind, id_, origin, before)
            for table, row in self._open(kind, id_, origin, now):
                inserts[table].append(row)
            self.written[kind, id_] = now
        for kind in KINDS:
            version = KIND_TABLES[kind].version
            if inserts.get(version.table):
                for table in (version.table, *version.children):
                    self._session.insert(table, inserts[table])

    def _close(self, kind: str, id_: int, origin: Any, before: Any) -> None:
        """Let what is written hold no more: a row of before, or one of this very revision."""
        version = KIND_TABLES[kind].version
        queries = () if before is None else (version.close,) if before == origin else version.unmake
        for query in queries:
            self._session.run(query, kb=self._kb_id, id=id_, at=self._number)

    def _open(self, kind: str, id_: int, origin: Any, now: Any) -> Iterator[tuple[Table, Row]]:
        """Let a definition hold: by the row that was closed here, or by the rows that are given."""
        tables = KIND_TABLES[kind]
        if now is None:
            return
        if now == origin:
            self._session.run(tables.version.reopen, kb=self._kb_id, id=id_, at=self._number)
        else:
            yield from tables.rows(self._kb_id, self._number, now)

    def _steps(self) -> Iterator[tuple[str, int, Any, Any, Any]]:
        """Give kind, id, origin, what is written and what is to be, where these two differ."""
        for kind, elements in self._definitions.changed():
            for id_, now in elements.changes.items():
                origin = elements.origin.get(id_)
                before = self.written.get((kind, id_), origin)
                if now != before:
                    yield kind, id_, origin, before, now

    def _write_identities(self, kind: str, names: dict[int, str]) -> None:
        rows = [(self._kb_id, id_, name, fold(name)) for id_, name in names.items()]
        self._session.insert(KIND_TABLES[kind].identity, rows)
        names.clear()
