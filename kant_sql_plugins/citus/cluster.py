"""Citus, the extension of PostgreSQL that distributes tables over several servers (nodes).

`head` is distributed by `kb_id`, and all other tables are colocated with it, so each knowledge base
is in one shard on one node. `knowledge_base` and the version table are reference tables, complete
on each node.

Citus distributes no table with a foreign key to a table that is not distributed: the keys are
dropped and added again. To undistribute a table, Citus recreates it from a text, without comments
and with another form of word lists. So undistribution restores these as the migrations make them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from sqlalchemy import Connection, event, text
from sqlalchemy.schema import AddConstraint, CreateTable, DropTable

from kant_sql.errors import SchemaError
from kant_sql.sql.dialects.postgresql_structure import Qualifier
from kant_sql.sql.query import text_literal
from kant_sql.sql.tables import Base
from kant_sql.sql.tables.base import VERSION_TABLE

# Each node has a full copy of these, so references to them stay in the shard.
REFERENCE_TABLES = ("knowledge_base", VERSION_TABLE)
# The table that the others are colocated with.
FIRST = "head"
KEY = "kb_id"
# The statements of a transaction use one connection to each node: it sees earlier changes.
SEQUENTIAL = "SET LOCAL citus.multi_shard_modify_mode = 'sequential'"

_IS_DISTRIBUTED = text(
    "SELECT EXISTS (SELECT FROM pg_dist_partition AS p JOIN pg_class AS c "
    "ON c.oid = p.logicalrelid JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE c.relname = '{FIRST}' AND n.nspname = :schema)"
)
_TABLES = text(
    "SELECT c.relname, p.partmethod::text, p.colocationid, g.shardcount "
    "FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "LEFT JOIN pg_dist_partition AS p ON p.logicalrelid = c.oid "
    "LEFT JOIN pg_dist_colocation AS g ON g.colocationid = p.colocationid "
    "WHERE n.nspname = :schema AND c.relkind = 'r' AND c.relname = ANY(:names)"
)


class Layout(NamedTuple):
    """The places of tables: only on the coordinator, on each node, in shards as `head`, or other.

    `shards` is the number of `head`'s shards; 0 if it is not distributed.
    """

    local: frozenset[str]
    reference: frozenset[str]
    colocated: frozenset[str]
    others: frozenset[str]
    shards: int

    @property
    def is_distributed(self) -> bool:
        """Whether any table is distributed."""
        return bool(self.reference or self.colocated or self.others)

    @property
    def misplaced(self) -> frozenset[str]:
        """The tables that a distributed store distributes in another way."""
        whole = frozenset(REFERENCE_TABLES)
        return self.others | (self.reference - whole) | (self.colocated & whole)


class CitusNodes(NamedTuple):
    """The settings of a connection to a node that the other nodes need, too.

    `SET LOCAL` goes to another node with the statement that begins its transaction there. None
    means the servers' own setting of `synchronous_commit`.
    """

    search_path: str
    synchronous_commit: str | None

    def settings(self, *, is_durable: bool = False) -> dict[str, str]:
        """Return the settings of a transaction that writes; later settings go to other nodes."""
        settings = {"citus.propagate_set_commands": "local"}
        commit = self.synchronous_commit
        if is_durable and commit in (None, "off"):
            commit = "on"
        if commit is not None:
            settings["synchronous_commit"] = commit
        return settings

    def replanning(self, is_other: bool) -> str:
        """Write the statement after which a node replans.

        None discards another node's plans. A cached plan is remade for another search path: a
        schema at the end, where no lookup gets to, makes it another path.
        """
        schemas = f"{self.search_path}, information_schema" if is_other else self.search_path
        return f"SET LOCAL search_path = {schemas}"

    def committing(self, synchronous_commit: str) -> CitusNodes:
        """Return these settings with another `synchronous_commit`."""
        return self._replace(synchronous_commit=synchronous_commit)

    def whole_index(self, name: str) -> str:
        """Return the name of the whole index of a shard's index."""
        return _OF_SHARD.sub("", name)


# The suffix that Citus adds to the name of each part of an index.
_OF_SHARD = re.compile(r"_\d{6,}$")
_NODE_SETTINGS = (
    "SELECT current_setting('search_path'), (SELECT setting FROM pg_settings "
    "WHERE name = 'synchronous_commit' "
    "AND source IN ('client', 'user', 'database', 'database user', 'session'))"
)


# A coordinator without a state for a lost node reports it with these words, its own or those of
# its driver.
_LOST_NODE = re.compile(
    "failure on connection marked as essential|server closed the connection unexpectedly"
    "|connection not open|no connection to the server|could not (receive|send) data"
)


def has_lost_a_node(state: str, message: str) -> bool:
    """Return whether an internal error means a lost connection to another node."""
    return state == "XX000" and _LOST_NODE.search(message) is not None


def nodes(connection: Any) -> CitusNodes:
    """Read the settings that the other nodes need, from a new connection of the driver."""
    return CitusNodes(*connection.execute(_NODE_SETTINGS).fetchone())


def own_tables() -> list[str]:
    """List the tables of the newest version, referenced ones first."""
    return [VERSION_TABLE, *(table.name for table in Base.metadata.sorted_tables)]


def is_distributed(connection: Connection, schema: str) -> bool:
    """Return whether the tables of a schema are distributed."""
    return bool(connection.scalar(_IS_DISTRIBUTED, {"schema": schema}))


def use_one_connection(connection: Connection) -> None:
    """Make a transaction of schema changes use one connection to each node."""
    connection.exec_driver_sql(SEQUENTIAL)


def read_layout(connection: Connection, schema: str) -> Layout:
    """Read the places of the tables."""
    rows = connection.execute(_TABLES, {"schema": schema, "names": own_tables()}).all()
    places = {name: (method, colocation) for name, method, colocation, _ in rows}
    first = places.get(FIRST, (None, None))
    shards = next((count for name, method, _, count in rows if name == FIRST and method), 0)

    def named(kind: str) -> frozenset[str]:
        return frozenset(name for name, place in places.items() if _kind(place, first) == kind)

    return Layout(named("local"), named("reference"), named("colocated"), named("other"), shards)


def _kind(place: tuple[str | None, int | None], first: tuple[str | None, int | None]) -> str:
    method, colocation = place
    if method is None:
        return "local"
    if method == "n":
        # Citus knows tables only on the coordinator without a colocation.
        return "reference" if colocation else "other"
    return "colocated" if place == first and method == "h" else "other"


def distribution_of(names: Qualifier, table: str, shards: int | None = None) -> str:
    """Write the statement that distributes a table; `shards` is for the first one."""
    if table in REFERENCE_TABLES:
        return f"SELECT create_reference_table({text_literal(names.relation(table))})"
    how = f"colocate_with => {text_literal(names.relation(FIRST))}"
    if table == FIRST:
        count = "" if shards is None else f", shard_count => {shards:d}"
        how = f"colocate_with => 'none'{count}"
    return f"SELECT create_distributed_table({text_literal(names.relation(table))}, '{KEY}', {how})"


def of_one_shard(query: str, schema: str, kb_id: int) -> str:
    """Restrict each table of a view's query to one knowledge base, so its shard answers it.

    Within a subquery, Citus does not conclude from `x.kb_id = y.kb_id` which shard it needs.
    """
    names = Qualifier(schema)

    def restricted(found: re.Match[str]) -> str:
        before, table, alias = found.groups()
        key = "id" if table == "knowledge_base" else KEY
        rows = f"SELECT * FROM {names.relation(table)} WHERE {key} = {kb_id:d}"
        return f"{before}({rows}) AS {names.quote(alias or table)}"

    return _table_in(schema).sub(restricted, query)


def _table_in(schema: str) -> re.Pattern[str]:
    """Return the pattern of tables in a query, each with its alias."""
    tables = "|".join(sorted(Base.metadata.tables, key=len, reverse=True))
    qualified = rf'(?:"?{re.escape(schema)}"?\.)?'
    alias = r"(?: (?:AS )?(?!(?:ON|WHERE|JOIN|LEFT|CROSS|GROUP|ORDER|LIMIT|UNION)\b)(\w+))?"
    return re.compile(rf'(\b(?:FROM|JOIN)\s+\(*){qualified}"?\b({tables})\b"?{alias}')


def fault(connection: Connection, label: str) -> str | None:
    """Return the fault of a store with some distributed tables; None if it has none."""
    layout = read_layout(connection, Qualifier.of(connection).schema)
    command = f"kant-sql db distribute '{label}'"
    if layout.misplaced:
        return (
            f"distributed in another way than {FIRST}: {', '.join(sorted(layout.misplaced))}; "
            f"bring all tables together with: {command} --undo"
        )
    if layout.is_distributed and layout.local:
        return (
            f"not distributed, though other tables are: {', '.join(sorted(layout.local))}; "
            f"distribute them with: {command}"
        )
    return None


@contextmanager
def migrating(connection: Connection, label: str) -> Iterator[None]:
    """Let migrations that do not know about distribution change a distributed store.

    A new table is created without foreign keys, distributed like the others, and then gets its
    keys.
    """
    names = Qualifier.of(connection)
    if not is_distributed(connection, names.schema):
        yield
        return

    def before(_: object, statement: Any, multiparams: Any, params: Any, __: object) -> Any:
        if isinstance(statement, DropTable):
            raise SchemaError(
                f"{label}: this version has no table {statement.element.name}, and a distributed "
                f"table is not dropped; nothing was changed: bring the tables together first, with "
                f"kant-sql db distribute '{label}' --undo"
            )
        if isinstance(statement, CreateTable):
            statement = CreateTable(statement.element, include_foreign_key_constraints=[])
        return statement, multiparams, params

    def after(_: object, statement: Any, *__: object) -> None:
        if isinstance(statement, CreateTable):
            table = statement.element
            connection.exec_driver_sql(distribution_of(names, table.name))
            for key in table.foreign_key_constraints:
                connection.execute(AddConstraint(key))

    event.listen(connection, "before_execute", before, retval=True)
    event.listen(connection, "after_execute", after)
    try:
        yield
    finally:
        event.remove(connection, "before_execute", before)
        event.remove(connection, "after_execute", after)
