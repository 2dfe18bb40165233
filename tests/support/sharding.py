"""The tables that a statement does not restrict to a knowledge base: Citus reads all shards.

Citus sends a statement to one shard if each distributed table in it has `kb_id = :kb`, or a join
with one that has. It ignores correlations: `x.kb_id = outer.kb_id` in a subquery does not count.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from kant_sql.sql.audit_views import AUDIT_VIEWS
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.query import Insert, Query
from kant_sql.sql.tables import TABLES
from tests.support.modules import import_all

# Each node has a full copy of these.
REFERENCE = {"knowledge_base"}
DISTRIBUTED = {name for name in TABLES if name not in REFERENCE} | {*AUDIT_VIEWS}
# Statements about all knowledge bases, or that find one by its name.
OF_ALL = {
    "kant_sql.history.anchors._HEADS",
    "kant_sql.history.replication.service._HEADS",
    "kant_sql.history.verify.structure._STRAYS",
    "kant_sql.sql.catalog._COMPLETE",
    "kant_sql.sql.catalog._REVISIONS",
    "kant_sql.sql.catalog._STATES",
    "kant_sql.sql.inventory._BY_ID",
    "kant_sql.sql.inventory._COUNTS",
    "kant_sql.sql.inventory._EVERY",
    "kant_sql.sql.inventory._FOUND",
    "kant_sql.sql.inventory._NAMED",
    "kant_sql.sql.inventory._PAGE",
    "kant_sql.sql.inventory._TOTAL",
}
DIALECT = create_backend("postgresql://").dialect
T = TypeVar("T")
# The depth to which constants are searched for statements.
DEEPEST = 6

_PARENTHESES = re.compile(r"\(([^()]*)\)")
_PARTS = re.compile(r"\b(?:UNION ALL|UNION|EXCEPT|INTERSECT)\b")
_CLAUSE = re.compile(
    r"\b(?:FROM|JOIN|UPDATE|USING|INTO)\s+((?:\w+(?:\s+AS\s+\w+)?)(?:\s*,\s*\w+(?:\s+AS\s+\w+)?)*)"
)
_TABLE = re.compile(r"(\w+)(?:\s+AS\s+(\w+))?")
_OWN = re.compile(r"(?:\b(\w+)\.)?\bkb_id = (?::kb\b|%\(kb\)s)")
_EQUAL = re.compile(r"\b(\w+)\.kb_id = (\w+)\.kb_id\b")
_STRING = re.compile(r"'(?:[^']|'')*'")


def unbound(sql: str) -> list[str]:
    """Return the tables of a statement, with aliases, without a single knowledge base."""
    found: list[str] = []
    text = _STRING.sub("''", " ".join(sql.split())).replace("%(kb)s::BIGINT", ":kb")
    text = re.sub(r"%\((\w+)\)s", r":\1", text).replace('"', "")
    while match := _PARENTHESES.search(text):
        inside = match[1]
        found += _unbound_in(inside)
        # A condition in parentheses belongs to the query around it, unless it is a choice.
        is_part = not re.search(r"\b(?:SELECT|OR)\b", inside)
        kept = f" {inside} " if is_part and ".kb_id = " in inside else " _ "
        text = f"{text[: match.start()]}{kept}{text[match.end() :]}"
    return [*found, *_unbound_in(text)]


def _unbound_in(text: str) -> Iterator[str]:
    """Check one query; queries within it are blanked."""
    for part in _PARTS.split(text):
        tables = {
            alias or name: name
            for clause in _CLAUSE.findall(part)
            for name, alias in _TABLE.findall(clause)
            if name in DISTRIBUTED
        }
        bound = {alias for alias in _OWN.findall(part) if alias}
        if "" in _OWN.findall(part) and len(tables) == 1:
            bound |= set(tables)
        equal = _EQUAL.findall(part)
        for _ in equal:
            bound |= {other for pair in equal if bound & {*pair} for other in pair}
        yield from (f"{name} AS {alias}" for alias, name in tables.items() if alias not in bound)


def every_query() -> list[tuple[str, Query]]:
    """Return all statements that are constants of a module, with the names of both."""
    return [*_constants(Query)]


def every_insert() -> list[Insert]:
    """Return all inserts among the constants of modules."""
    return [found for _, found in _constants(Insert)]


def _constants(kind: type[T]) -> Iterator[tuple[str, T]]:
    import_all()
    importlib.import_module("kant_sql_plugins.mcap")
    found: set[int] = set()
    for module in [name for name in sys.modules if name.startswith("kant_sql")]:
        for name, value in [*vars(sys.modules[module]).items()]:
            for each in _within(value, kind, DEEPEST):
                if id(each) not in found:
                    found.add(id(each))
                    yield f"{module}.{name}", each


def _within(value: Any, kind: type[T], depth: int) -> Iterator[T]:
    """Yield the parts of a constant that have a type."""
    inside: Iterable[Any] = ()
    if isinstance(value, kind):
        yield value
    elif isinstance(value, dict):
        inside = value.values()
    elif isinstance(value, list | tuple | set):
        inside = value
    elif (value if isinstance(value, type) else type(value)).__module__.startswith("kant_sql"):
        slots = getattr(type(value), "__slots__", ())
        own = [getattr(value, slot) for slot in slots if hasattr(value, slot)]
        inside = [*own, *getattr(value, "__dict__", {}).values()]
    if depth:
        for each in inside:
            yield from _within(each, kind, depth - 1)
