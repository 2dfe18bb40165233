"""The identities of a knowledge base: what each id is called."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from sqlalchemy import Select, Table, func, literal_column, select

from ..backends import Query, Session
from ..dto.name import fold
from ..knowledge.definitions import KINDS, Definitions
from ..knowledge.document import DOMAIN, PROBLEM
from ..knowledge.elements import Elements
from ..knowledge.function import FunctionDefinition
from ..knowledge.loading import KB
from ..knowledge.object import ObjectDefinition
from ..knowledge.predicate import PredicateDefinition
from ..knowledge.rows import KIND_TABLES, table_of
from ..knowledge.type import TypeDefinition
from ..tables import FunctionTypeRow, FunctionVersionRow
from .findings import Report
from .wording import is_word


def _identities(kind: str) -> Query:
    tables = KIND_TABLES[kind]
    identity, version = tables.identity.c, tables.version.table.c
    versions = select(version.since).where(
        version.kb_id == identity.kb_id, tables.version.owner == identity.id
    )
    return Query(
        select(identity.id, identity.name, identity.key, versions.exists())
        .where(identity.kb_id == KB)
        .order_by(identity.id)
    )


def doubles(table: Table, *key: str) -> Select[Any]:
    """Find identities that there are several of, where there should be one.

    Args:
        table: the identity table.
        *key: the columns that only one identity has the values of.

    Returns:
        The query of the first and the last id of each.
    """
    return (
        select(func.min(table.c.id), func.max(table.c.id))
        .where(table.c.kb_id == KB)
        .group_by(*(table.c[name] for name in key))
        .having(func.count() > literal_column("1"))
    )


def _doubles(kind: str) -> Query:
    identity = KIND_TABLES[kind].identity
    key = identity.c.key
    return Query(doubles(identity, "key").add_columns(key).order_by(key))


_IDENTITIES = {kind: _identities(kind) for kind in KINDS}
_DOUBLES = {kind: _doubles(kind) for kind in KINDS}
_FUNCTION, _VALUE_TYPE = table_of(FunctionVersionRow).c, table_of(FunctionTypeRow).c
_FUNCTIONS = Query(
    select(
        _FUNCTION.function_id,
        _FUNCTION.since,
        select(func.count())
        .where(
            _VALUE_TYPE.kb_id == _FUNCTION.kb_id,
            _VALUE_TYPE.function_id == _FUNCTION.function_id,
            _VALUE_TYPE.since == _FUNCTION.since,
        )
        .scalar_subquery(),
    )
    .where(_FUNCTION.kb_id == KB)
    .order_by(_FUNCTION.function_id, _FUNCTION.since)
)
# Only the names of these are asked for by id.
_NAMED: dict[str, Callable[[int, str], Any]] = {
    "type": lambda id_, name: TypeDefinition(id_, name, None, ""),
    "object": lambda id_, name: ObjectDefinition(id_, name, 0, ""),
    "predicate": lambda id_, name: PredicateDefinition(id_, name, (), ""),
    "function": lambda id_, name: FunctionDefinition(id_, name, (), (), ""),
}


class NamesById(dict[int, str]):
    """What the elements of one kind are called; what has no name is shown as such."""

    def __missing__(self, id_: int) -> str:
        """Give what no name is."""
        return f"?{id_}"


class Names(NamedTuple):
    """What ids are called.

    Attributes:
        known: those of each kind.
        held: definitions of which only names are known: of what has a version, for a definition
            can refer to nothing else.
    """

    known: dict[str, NamesById]
    held: Definitions


def check_names(session: Session, kb_id: int, report: Report) -> Names:
    """Check the identities of all kinds, and give their names.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        report: takes what is wrong.

    Returns:
        The names.
    """
    known: dict[str, NamesById] = {}
    made: list[Elements[Any]] = []
    for kind in KINDS:
        for first, second, key in session.rows(_DOUBLES[kind], kb=kb_id):
            report.add(None, kind, f"{kind} {key!r} has two rows, {first} and {second}")
        make = _NAMED.get(kind)
        names = NamesById()
        base: dict[int, Any] = {}
        for id_, name, key, is_held in session.stream(_IDENTITIES[kind], kb=kb_id):
            if fold(name) != key:
                report.add(None, kind, f"{kind} {id_}, {name!r}, has the key {key!r}")
            if kind == "document" and name not in (DOMAIN, PROBLEM):
                report.add(None, kind, f"there is no document {name!r}")
            if not is_word(name):
                report.add(None, kind, f"no {kind} can be called {name!r}")
            names[id_] = name
            if make is not None and is_held:
                base[id_] = make(id_, name)
        known[kind] = names
        made.append(Elements(base=base))
    return Names(known, Definitions(*made))


class ObjectFunctions:
    """Tells which functions had objects for values."""

    def __init__(self, session: Session, kb_id: int) -> None:
        """Read it.

        Args:
            session: the session, in a transaction.
            kb_id: the knowledge base.
        """
        self._versions: defaultdict[int, list[tuple[int, bool]]] = defaultdict(list)
        for id_, since, types in session.rows(_FUNCTIONS, kb=kb_id):
            self._versions[id_].append((since, bool(types)))
        self._sinces = sorted({since for id_ in self._versions for since, _ in self._versions[id_]})
        self._known: dict[int, frozenset[int]] = {}

    def at(self, revision: int) -> frozenset[int]:
        """Give these functions at a revision.

        Args:
            revision: the revision.

        Returns:
            Their ids; of a function whose version of then was moved elsewhere, as it was next.
        """
        epoch = bisect_right(self._sinces, revision)
        if epoch not in self._known:
            self._known[epoch] = frozenset(self._at(revision))
        return self._known[epoch]

    def _at(self, revision: int) -> Iterator[int]:
        for id_, versions in self._versions.items():
            held = [has for since, has in versions if since <= revision]
            if held[-1] if held else versions[0][1]:
                yield id_
