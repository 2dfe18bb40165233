"""Citus, the extension of PostgreSQL that distributes tables over several servers (nodes).

`head` is distributed by `kb_id`, and all other tables are colocated with it, so that what belongs
to a knowledge base is in one shard on one node. `knowledge_base` and the version table are
reference tables, which each node has whole.

Citus distributes no table that has a foreign key to one that is not: they are dropped and added
again. What it brings back to one table it makes from a text: comments are lost, and lists of words
are written in another way. So a store that is distributed no more gets these as its migrations make
them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from sqlalchemy import CheckConstraint, Connection, event, text
from sqlalchemy.dialects.postgresql.base import PGDialect
from sqlalchemy.schema import AddConstraint, CreateTable, DropTable

from ...errors import SchemaError, StoreError
from ..tables import Base
from ..tables.base import VERSION_TABLE
from .base import Distribution
from .postgresql_structure import SCHEMA_OF_TABLES, Qualifier

# Each node has these whole, so what refers to them does not leave its shard.
REFERENCE_TABLES = ("knowledge_base", VERSION_TABLE)
# The table that the others are colocated with.
FIRST = "head"
KEY = "kb_id"
OLDEST = (13, 1)
MOST_SHARDS = 64_000
# Statements of a transaction use one connection to each node: it sees what earlier ones changed.
SEQUENTIAL = "SET LOCAL citus.multi_shard_modify_mode = 'sequential'"
_QUIET = "SET LOCAL client_min_messages = 'warning'"

_EXTENSION = text("SELECT extversion FROM pg_extension WHERE extname = 'citus'")
_IS_DISTRIBUTED = text(
    "SELECT EXISTS (SELECT FROM pg_dist_partition AS p JOIN pg_class AS c "
    "ON c.oid = p.logicalrelid JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE c.relname = '{FIRST}' AND n.nspname = :schema)"
)
_GROUP = text("SELECT groupid FROM pg_dist_local_group")
_NODES = text(
    "SELECT groupid, nodename || ':' || nodeport, "
    "isactive AND (metadatasynced OR NOT hasmetadata), shouldhaveshards "
    "FROM pg_dist_node WHERE noderole = 'primary' ORDER BY groupid, nodeid"
)
_TABLES = text(
    "SELECT c.relname, p.partmethod::text, p.colocationid, g.shardcount "
    "FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "LEFT JOIN pg_dist_partition AS p ON p.logicalrelid = c.oid "
    "LEFT JOIN pg_dist_colocation AS g ON g.colocationid = p.colocationid "
    "WHERE n.nspname = :schema AND c.relkind = 'r' AND c.relname = ANY(:names)"
)
_FOREIGN_KEYS = text(
    "SELECT c.relname, k.conname, pg_get_constraintdef(k.oid), f.relname "
    "FROM pg_constraint AS k JOIN pg_class AS c ON c.oid = k.conrelid "
    "JOIN pg_class AS f ON f.oid = k.confrelid JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "WHERE k.contype = 'f' AND n.nspname = :schema AND c.relname = ANY(:names) "
    'ORDER BY c.relname COLLATE "C", k.conname COLLATE "C"'
)
_COMMENTS = text(
    "SELECT c.relname, a.attname, d.description FROM pg_description AS d "
    "JOIN pg_class AS c ON c.oid = d.objoid JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "LEFT JOIN pg_attribute AS a ON a.attrelid = c.oid AND a.attnum = d.objsubid "
    "AND d.objsubid > 0 WHERE d.classoid = 'pg_class'::regclass AND c.relkind = 'r' "
    "AND n.nspname = :schema AND c.relname = ANY(:names) "
    'ORDER BY c.relname COLLATE "C", d.objsubid'
)
# A list of words, which the server writes in another way when it reads its own text again.
_LISTS = text(
    "SELECT c.relname, k.conname FROM pg_constraint AS k JOIN pg_class AS c ON c.oid = k.conrelid "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace WHERE k.contype = 'c' "
    "AND n.nspname = :schema AND c.relname = ANY(:names) "
    "AND strpos(pg_get_constraintdef(k.oid), 'ARRAY[') > 0 "
    'ORDER BY c.relname COLLATE "C", k.conname COLLATE "C"'
)
# Rights on views, which are dropped: the owner has his own anyway.
_GRANTS = text(
    "SELECT c.relname, a.privilege_type, a.is_grantable, CASE a.grantee WHEN 0 THEN 'PUBLIC' "
    "ELSE quote_ident(pg_get_userbyid(a.grantee)) END FROM pg_class AS c "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace, aclexplode(c.relacl) AS a "
    "WHERE n.nspname = :schema AND c.relkind = 'v' AND c.relname = ANY(:names) "
    "AND a.grantee <> c.relowner ORDER BY 1, 4, 2"
)
_OWNERS = text(
    "SELECT DISTINCT pg_get_userbyid(c.relowner) FROM pg_class AS c "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace WHERE c.relowner <> current_user::regrole "
    "AND n.nspname = :schema AND c.relkind = 'r' AND c.relname = ANY(:names) ORDER BY 1"
)
# What is not the library's, and what Citus cannot distribute or bring back with it.
_IN_THE_WAY = text(
    "WITH own AS (SELECT c.oid, c.relname FROM pg_class AS c "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace WHERE n.nspname = :schema "
    "AND c.relkind = 'r' AND c.relname = ANY(:names)) "
    "SELECT 'foreign key ' || k.conname || ' of table ' || k.conrelid::regclass "
    "FROM pg_constraint AS k WHERE k.contype = 'f' "
    "AND (k.conrelid IN (SELECT oid FROM own)) <> (k.confrelid IN (SELECT oid FROM own)) "
    "UNION ALL SELECT 'trigger ' || t.tgname || ' on table ' || o.relname "
    "FROM pg_trigger AS t JOIN own AS o ON o.oid = t.tgrelid WHERE NOT t.tgisinternal "
    "UNION ALL SELECT 'policy ' || p.polname || ' on table ' || o.relname "
    "FROM pg_policy AS p JOIN own AS o ON o.oid = p.polrelid "
    "WHERE NOT starts_with(p.polname, 'kant_sql_') "
    "UNION ALL SELECT 'table ' || h.inhrelid::regclass || ', which inherits from ' || o.relname "
    "FROM pg_inherits AS h JOIN own AS o ON o.oid = h.inhparent "
    "UNION ALL SELECT DISTINCT 'view ' || c.oid::regclass FROM pg_depend AS d "
    "JOIN pg_rewrite AS r ON r.oid = d.objid AND d.classid = 'pg_rewrite'::regclass "
    "JOIN pg_class AS c ON c.oid = r.ev_class JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "WHERE d.refclassid = 'pg_class'::regclass AND c.oid <> d.refobjid "
    "AND (d.refobjid IN (SELECT oid FROM own) OR d.refobjid IN (SELECT v.oid FROM pg_class AS v "
    "JOIN pg_namespace AS m ON m.oid = v.relnamespace "
    "WHERE m.nspname = :schema AND v.relname = ANY(:views))) "
    "AND NOT (n.nspname = :schema AND c.relname = ANY(:views)) "
    "AND NOT starts_with(n.nspname, 'kant_sql_') "
    "AND coalesce(obj_description(c.oid, 'pg_class'), '') NOT LIKE 'generated by kant-sql views:%' "
    "ORDER BY 1"
)
_WRITERS = text(
    "SELECT DISTINCT w.rolname FROM pg_policy AS p JOIN pg_class AS c ON c.oid = p.polrelid "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "JOIN pg_roles AS w ON w.oid = ANY(p.polroles) "
    "WHERE n.nspname = :schema AND starts_with(w.rolname, 'kant_sql_writer') ORDER BY 1"
)


class ClusterNode(NamedTuple):
    """A server of the cluster.

    Attributes:
        group: 0 for the coordinator.
        address: host and port.
        is_active: whether it takes part and has the metadata.
        holds_shards: whether new shards may be on it.
    """

    group: int
    address: str
    is_active: bool
    holds_shards: bool


class Layout(NamedTuple):
    """Where the tables are.

    Attributes:
        local: tables that are on the coordinator alone.
        reference: reference tables.
        colocated: tables that are distributed as `head` is.
        others: tables that are distributed in another way.
        shards: how many shards `head` has; 0 where it is not distributed.
    """

    local: frozenset[str]
    reference: frozenset[str]
    colocated: frozenset[str]
    others: frozenset[str]
    shards: int

    @property
    def is_distributed(self) -> bool:
        """Whether some table is."""
        return bool(self.reference or self.colocated or self.others)

    @property
    def misplaced(self) -> frozenset[str]:
        """The tables that are distributed in another way than a distributed store has them."""
        whole = frozenset(REFERENCE_TABLES)
        return self.others | (self.reference - whole) | (self.colocated & whole)


class HandedOn(NamedTuple):
    """The settings of a connection to a node of a cluster that the other nodes need, too.

    `SET LOCAL` is sent to another node with the statement that begins its transaction there.

    Attributes:
        search_path: the schemas in which names are looked up.
        synchronous_commit: what a commit waits for, where it is not the servers' own setting.
    """

    search_path: str
    synchronous_commit: str | None

    def settings(self, *, is_durable: bool = False) -> dict[str, str]:
        """Return what a transaction that writes sets: what follows it is handed on."""
        settings = {"citus.propagate_set_commands": "local"}
        commit = self.synchronous_commit
        if is_durable and commit in (None, "off"):
            commit = "on"
        if commit is not None:
            settings["synchronous_commit"] = commit
        return settings

    def replanning(self, is_other: bool) -> str:
        """Write the statement after which a node makes its plans again.

        None discards another node's plans. A cached plan is made again under another search path:
        a schema at its end, in which nothing is looked up, makes it another.
        """
        schemas = f"{self.search_path}, information_schema" if is_other else self.search_path
        return f"SET LOCAL search_path = {schemas}"


# No row where there is no cluster.
_HANDED_ON = (
    "SELECT current_setting('search_path'), (SELECT setting FROM pg_settings "
    "WHERE name = 'synchronous_commit' "
    "AND source IN ('client', 'user', 'database', 'database user', 'session')) "
    "FROM pg_extension WHERE extname = 'citus'"
)


# How a coordinator tells of a node that it has lost when it has no state for it: in words of its
# own, or in those of its driver.
_LOST_NODE = re.compile(
    "failure on connection marked as essential|server closed the connection unexpectedly"
    "|connection not open|no connection to the server|could not (receive|send) data"
)


def has_lost_a_node(state: str, message: str) -> bool:
    """Return whether an internal error is that of a connection to another node."""
    return state == "XX000" and _LOST_NODE.search(message) is not None


def read_handed_on(connection: Any) -> HandedOn | None:
    """Read what a new connection of the driver hands on; None where there is no cluster."""
    row = connection.execute(_HANDED_ON).fetchone()
    return None if row is None else HandedOn(*row)


def own_tables() -> list[str]:
    """Name the tables of the newest version, those first that others refer to."""
    return [VERSION_TABLE, *(table.name for table in Base.metadata.sorted_tables)]


def has_citus(connection: Connection) -> bool:
    """Return whether this database has the extension."""
    return connection.scalar(_EXTENSION) is not None


def is_distributed(connection: Connection, schema: str) -> bool:
    """Return whether the tables of a schema are distributed."""
    return has_citus(connection) and bool(connection.scalar(_IS_DISTRIBUTED, {"schema": schema}))


def use_one_connection(connection: Connection) -> None:
    """Let a transaction of schema changes use one connection to each node."""
    if has_citus(connection):
        connection.exec_driver_sql(SEQUENTIAL)


def read_layout(connection: Connection, schema: str, names: Sequence[str] | None = None) -> Layout:
    """Read where the tables are."""
    wanted = own_tables() if names is None else [*names]
    rows = connection.execute(_TABLES, {"schema": schema, "names": wanted}).all()
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
        # A table that Citus knows and that is on the coordinator alone has no colocation.
        return "reference" if colocation else "other"
    return "colocated" if place == first and method == "h" else "other"


class Distributor:
    """Writes the statements that distribute the tables of a database, or bring them together."""

    def __init__(self, connection: Connection, label: str, views: Mapping[str, str]) -> None:
        self._connection = connection
        self._label = label
        self._views = views
        self._require_citus()
        self._names = Qualifier(connection.scalar(SCHEMA_OF_TABLES) or "public")
        self._named = {"schema": self._names.schema, "names": own_tables()}
        self.nodes = [ClusterNode(*row) for row in connection.execute(_NODES)]
        self.layout = read_layout(connection, self._names.schema)
        self._foreign_keys = connection.execute(_FOREIGN_KEYS, self._named).all()

    def distribute(self, shards: int | None) -> Distribution:
        """Write the statements that distribute the tables that are not distributed yet."""
        self._check_cluster()
        self._check_shards(shards)
        due = [table for table in _in_order() if table in self.layout.local]
        statements: tuple[str, ...] = ()
        if due:
            self._check_tables(due)
            self._check_writers()
            statements = (*self._distribution(due, shards),)
        count = self.layout.shards or shards or self._scalar("current_setting('citus.shard_count')")
        return self._result(int(count), due, statements)

    def undistribute(self) -> Distribution:
        """Write the statements that bring all tables back to the coordinator."""
        self._check_cluster()
        due = [table for table in reversed(_in_order()) if table not in self.layout.local]
        statements: tuple[str, ...] = ()
        if due:
            self._check_tables(due)
            statements = (*self._reunion(due),)
        return self._result(0, due, statements)

    def _result(
        self, shards: int, tables: Sequence[str], statements: tuple[str, ...]
    ) -> Distribution:
        nodes = (node.address for node in self.nodes if node.holds_shards)
        return Distribution(shards, (*nodes,), (*sorted(tables),), statements)

    def _require_citus(self) -> None:
        version = self._connection.scalar(_EXTENSION)
        oldest = ".".join(map(str, OLDEST))
        if version is None:
            raise self._refused(
                "this database has no extension citus",
                f"CREATE EXTENSION citus, version {oldest} or later, in this database on each node",
            )
        if tuple(map(int, re.findall(r"\d+", version)[:2])) < OLDEST:
            raise self._refused(
                f"the extension citus is of version {version}", f"install {oldest} or later"
            )

    def _check_cluster(self) -> None:
        """Check that this is the coordinator of a cluster that works."""
        coordinator = next((node.address for node in self.nodes if node.group == 0), None)
        if self._connection.scalar(_GROUP) != 0:
            raise self._refused(
                "this is a worker node", f"connect to the coordinator, {coordinator or 'of it'}"
            )
        if coordinator is None:
            raise self._refused(
                "the coordinator has no address, at which workers find it",
                "SELECT citus_set_coordinator_host('HOST', PORT)",
            )
        inactive = [node.address for node in self.nodes if not node.is_active]
        if inactive:
            raise self._refused(
                f"these nodes are not active: {', '.join(inactive)}",
                "SELECT citus_activate_node('HOST', PORT) or citus_remove_node('HOST', PORT)",
            )
        if not any(node.holds_shards for node in self.nodes):
            raise self._refused(
                "no node may hold shards",
                "SELECT citus_add_node('HOST', PORT), or for a cluster of one node "
                "citus_set_node_property('HOST', PORT, 'shouldhaveshards', true)",
            )

    def _check_shards(self, shards: int | None) -> None:
        there = self.layout.shards
        if shards is not None and shards > MOST_SHARDS:
            raise self._refused(f"{shards} shards are too many", f"choose at most {MOST_SHARDS}")
        if there and shards not in (None, there):
            raise self._refused(
                f"the tables are distributed over {there} shards already, not {shards}",
                "bring them back with --undo first",
            )
        if self.layout.misplaced:
            raise self._refused(
                f"distributed in another way: {', '.join(sorted(self.layout.misplaced))}",
                "bring the tables back with --undo first",
            )

    def _check_tables(self, tables: Sequence[str]) -> None:
        """Check that nothing of others is in the way."""
        owners = [row[0] for row in self._connection.execute(_OWNERS, self._named)]
        if owners:
            raise self._refused("the tables are not yours", f"connect as {' and '.join(owners)}")
        views = {**self._named, "views": [*self._views]}
        found = [row[0] for row in self._connection.execute(_IN_THE_WAY, views)]
        if found:
            raise self._refused(
                f"in the way, and not of kant_sql: {'; '.join(found)}",
                f"drop what is in the way of {len(tables)} tables, and create it again afterwards",
            )

    def _check_writers(self) -> None:
        writers = [row[0] for row in self._connection.execute(_WRITERS, self._named)]
        if writers:
            quoted = ", ".join(map(self._names.quote, writers))
            raise self._refused(
                f"the row policies of {quoted} look up other rows, which those of a distributed "
                "table cannot do; readers and auditors stay",
                f"DROP OWNED BY {quoted}; DROP ROLE {quoted}; and let writers connect as the owner",
            )

    def _distribution(self, due: Sequence[str], shards: int | None) -> Iterator[str]:
        yield from (SEQUENTIAL, _QUIET)
        yield from self._drop_foreign_keys(due)
        for table in due:
            yield self.distribution_of(table, shards)
        for table in due:
            # The rows are in the shards now, and on the coordinator out of sight.
            yield f"SELECT truncate_local_data_after_distributing_table({self._literal(table)})"
        yield from self._add_foreign_keys(due)

    def distribution_of(self, table: str, shards: int | None = None) -> str:
        """Write the statement that distributes a table."""
        if table in REFERENCE_TABLES:
            return f"SELECT create_reference_table({self._literal(table)})"
        how = f"colocate_with => {self._literal(FIRST)}"
        if table == FIRST:
            count = "" if shards is None else f", shard_count => {shards:d}"
            how = f"colocate_with => 'none'{count}"
        return f"SELECT create_distributed_table({self._literal(table)}, '{KEY}', {how})"

    def _reunion(self, due: Sequence[str]) -> Iterator[str]:
        """Yield the statements that make of shards the tables that migrations make."""
        views = ", ".join(map(self._names.relation, self._views))
        grants = self._connection.execute(_GRANTS, {**self._named, "names": [*self._views]}).all()
        yield from (SEQUENTIAL, _QUIET, f"DROP VIEW {views}")
        yield from self._drop_foreign_keys(due)
        for table in due:
            yield f"SELECT undistribute_table({self._literal(table)})"
        yield from self._comments(due)
        yield from self._lists(due)
        yield from self._add_foreign_keys(due)
        for name, query in self._views.items():
            yield f"CREATE VIEW {self._names.relation(name)} AS{query}"
        for view, privilege, is_grantable, role in grants:
            more = " WITH GRANT OPTION" if is_grantable else ""
            yield f"GRANT {privilege} ON TABLE {self._names.relation(view)} TO {role}{more}"

    def _comments(self, due: Sequence[str]) -> Iterator[str]:
        for table, column, comment in self._connection.execute(_COMMENTS, self._named):
            if table in due:
                relation, said = self._names.relation(table), comment.replace("'", "''")
                what = f"TABLE {relation}"
                if column is not None:
                    what = f"COLUMN {relation}.{self._names.quote(column)}"
                yield f"COMMENT ON {what} IS '{said}'"

    def _lists(self, due: Sequence[str]) -> Iterator[str]:
        """Yield the statements that make the conditions with lists as the migrations do."""
        made = {
            (table.name, constraint.name): constraint
            for table in Base.metadata.sorted_tables
            for constraint in table.constraints
            if isinstance(constraint, CheckConstraint)
        }
        dialect = PGDialect(paramstyle="named")  # type: ignore[no-untyped-call]
        for table, name in self._connection.execute(_LISTS, self._named):
            if table in due and (table, name) in made:
                relation, constraint = self._names.relation(table), self._names.quote(name)
                yield f"ALTER TABLE {relation} DROP CONSTRAINT {constraint}"
                condition = made[table, name].sqltext.compile(dialect=dialect)
                yield f"ALTER TABLE {relation} ADD CONSTRAINT {constraint} CHECK ({condition})"

    def _drop_foreign_keys(self, tables: Sequence[str]) -> Iterator[str]:
        for table, name, _, other in self._foreign_keys:
            if table in tables or other in tables:
                constraint = self._names.quote(name)
                yield f"ALTER TABLE {self._names.relation(table)} DROP CONSTRAINT {constraint}"

    def _add_foreign_keys(self, tables: Sequence[str]) -> Iterator[str]:
        for table, name, definition, other in self._foreign_keys:
            if table in tables or other in tables:
                constraint = f"{self._names.quote(name)} {definition}"
                yield f"ALTER TABLE {self._names.relation(table)} ADD CONSTRAINT {constraint}"

    def _literal(self, table: str) -> str:
        quoted = self._names.relation(table).replace("'", "''")
        return f"'{quoted}'"

    def _scalar(self, expression: str) -> Any:
        return self._connection.exec_driver_sql(f"SELECT {expression}").scalar()

    def _refused(self, what: str, remedy: str) -> StoreError:
        return StoreError(f"{self._label}: nothing was changed: {what}; {remedy}")


def _in_order() -> list[str]:
    """Name all tables in the order in which they are distributed."""
    first = (*REFERENCE_TABLES, FIRST)
    return [*first, *(table for table in own_tables() if table not in first)]


def of_one_shard(query: str, names: Qualifier, kb_id: int) -> str:
    """Restrict each table of a view's query to one knowledge base, whose shard then answers it.

    Within a subquery, Citus does not conclude from `x.kb_id = y.kb_id` which shard it needs.
    """

    def restricted(found: re.Match[str]) -> str:
        before, table, alias = found.groups()
        key = "id" if table == "knowledge_base" else KEY
        rows = f"SELECT * FROM {names.relation(table)} WHERE {key} = {kb_id:d}"
        return f"{before}({rows}) AS {names.quote(alias or table)}"

    return _table_in(names.schema).sub(restricted, query)


def _table_in(schema: str) -> re.Pattern[str]:
    """Find tables where a query reads them, each with its alias."""
    tables = "|".join(sorted(Base.metadata.tables, key=len, reverse=True))
    qualified = rf'(?:"?{re.escape(schema)}"?\.)?'
    alias = r"(?: (?:AS )?(?!(?:ON|WHERE|JOIN|LEFT|CROSS|GROUP|ORDER|LIMIT|UNION)\b)(\w+))?"
    return re.compile(rf'(\b(?:FROM|JOIN)\s+\(*){qualified}"?\b({tables})\b"?{alias}')


def layout_fault(connection: Connection, label: str) -> str | None:
    """Say what is wrong with a store of which some tables are distributed; None for nothing."""
    if not has_citus(connection):
        return None
    layout = read_layout(connection, connection.scalar(SCHEMA_OF_TABLES) or "public")
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
    """Let migrations that know nothing of distribution change a distributed store.

    A new table is created without foreign keys, distributed as the others are, and then given
    them.
    """
    schema = connection.scalar(SCHEMA_OF_TABLES) or "public"
    if not is_distributed(connection, schema):
        yield
        return
    names = Qualifier(schema)

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
            place = names.relation(table.name).replace("'", "''")
            first = names.relation(FIRST).replace("'", "''")
            connection.exec_driver_sql(
                f"SELECT create_distributed_table('{place}', '{KEY}', colocate_with => '{first}')"
            )
            for key in table.foreign_key_constraints:
                connection.execute(AddConstraint(key))

    event.listen(connection, "before_execute", before, retval=True)
    event.listen(connection, "after_execute", after)
    try:
        yield
    finally:
        event.remove(connection, "before_execute", before)
        event.remove(connection, "after_execute", after)
