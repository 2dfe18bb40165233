"""The distribution of a store's tables over the nodes of a Citus cluster."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from typing import NamedTuple

from sqlalchemy import CheckConstraint, Connection, text
from sqlalchemy.dialects.postgresql.base import PGDialect
from sqlalchemy.exc import DBAPIError

from kant_sql.arguments import flag, whole_number
from kant_sql.errors import InvalidArgumentError, StoreError
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import retrying
from kant_sql.sql.dialects.postgresql import PostgresqlBackend
from kant_sql.sql.dialects.postgresql_roles import RoleMaker, lock_tables, run_all
from kant_sql.sql.dialects.postgresql_structure import Qualifier
from kant_sql.sql.predicate_views import CHANGES_AT_ONCE, recreated_views, update_views
from kant_sql.sql.query import text_literal
from kant_sql.sql.schema import check, upgrade_sql
from kant_sql.sql.tables import Base

from .cluster import FIRST, REFERENCE_TABLES, SEQUENTIAL, distribution_of, own_tables, read_layout

OLDEST = (13, 1)
MOST_SHARDS = 64_000
_QUIET = "SET LOCAL client_min_messages = 'warning'"
_EXTENSION = text("SELECT extversion FROM pg_extension WHERE extname = 'citus'")
_SHARDS = text("SELECT current_setting('citus.shard_count')")
_GROUP = text("SELECT groupid FROM pg_dist_local_group")
_NODES = text(
    "SELECT groupid, nodename || ':' || nodeport, "
    "isactive AND (metadatasynced OR NOT hasmetadata), shouldhaveshards "
    "FROM pg_dist_node WHERE noderole = 'primary' ORDER BY groupid, nodeid"
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
# A list of words: the server rewrites it when it reads its own text again.
_LISTS = text(
    "SELECT c.relname, k.conname FROM pg_constraint AS k JOIN pg_class AS c ON c.oid = k.conrelid "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace WHERE k.contype = 'c' "
    "AND n.nspname = :schema AND c.relname = ANY(:names) "
    "AND strpos(pg_get_constraintdef(k.oid), 'ARRAY[') > 0 "
    'ORDER BY c.relname COLLATE "C", k.conname COLLATE "C"'
)
# Rights on the dropped views, except those of the owner, which the views have anyway.
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
# Objects that are not the library's, and that Citus cannot distribute or bring back.
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


_VIEW_CHANGES = re.compile(
    r"^(CREATE|CREATE OR REPLACE|DROP) VIEW (\w+)(?: AS(.*?))?;$", re.MULTILINE | re.DOTALL
)


class Distribution(NamedTuple):
    """The distribution of a store's tables over the nodes of a Citus cluster.

    Attributes:
        shards: the number of shards of each table; 0 if none is distributed.
        nodes: host and port of each node that may hold shards.
        tables: the moved tables.
        statements: the SQL, in one transaction; empty if there is nothing to do.
        views: the SQL that recreates the generated views afterwards.
    """

    shards: int
    nodes: tuple[str, ...]
    tables: tuple[str, ...]
    statements: tuple[str, ...]
    views: tuple[str, ...] = ()


class ClusterNode(NamedTuple):
    """A server of the cluster: group 0 is the coordinator."""

    group: int
    address: str
    is_active: bool
    holds_shards: bool


def distribute(
    url: str, *, shards: int | None = None, undo: bool = False, dry_run: bool = False
) -> Distribution:
    """Distribute the tables of a store over the nodes of a Citus cluster, or bring them together.

    It is one transaction, and needs a moment without other open transactions. Distributed tables do
    not change. Generated views are dropped, and recreated afterwards. Make a backup first.

    Args:
        url: the URL of the database on the coordinator, of the owner of the tables.
        shards: the number of shards of each table; None for the server's `citus.shard_count`.
        undo: whether to bring the tables together, in the coordinator's database.
        dry_run: whether to return the statements without running them.

    Returns:
        The distribution, and its statements.

    Raises:
        InvalidArgumentError: the number of shards is not a number from 1 on.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreBusyError: a session, which the message names, holds a table's lock; nothing was
            changed.
        StoreError: this is not a coordinator of a cluster, or an obstacle, which the message names,
            prevents the distribution; nothing was changed.
    """
    if shards is not None:
        whole_number(shards, "shards", least=1, expected="a whole number of shards from 1 on")
    flag(undo, "undo", InvalidArgumentError)
    flag(dry_run, "dry_run", InvalidArgumentError)
    with closing(create_backend(url)) as backend:
        if not isinstance(backend, PostgresqlBackend):
            raise StoreError(
                f"{backend.label}: nothing was changed: only PostgreSQL with the extension citus "
                "distributes tables"
            )
        check(url)
        views = _view_queries(url)
        generated = recreated_views(url)

        def run() -> Distribution:
            return _run(backend, shards, undo, dry_run, views)

        done = retrying(backend, run)
        if not done.statements:
            return done
        if not dry_run:
            for name in dict.fromkeys(view.knowledge_base for view in generated):
                update_views(url, knowledge_base=name)
        statements = (statement for view in generated for statement in view.statements)
        return done._replace(views=(*statements,))


def script(distribution: Distribution) -> Iterator[str]:
    """Yield the statements of a distribution with those that begin and end its transactions."""
    if distribution.statements:
        yield from ("BEGIN", *distribution.statements, "COMMIT")
    views = distribution.views
    for start in range(0, len(views), CHANGES_AT_ONCE):
        yield from ("BEGIN", *views[start : start + CHANGES_AT_ONCE], "COMMIT")


def _run(
    backend: PostgresqlBackend,
    shards: int | None,
    undo: bool,
    dry_run: bool,
    views: Mapping[str, str],
) -> Distribution:
    """Run the statements of a distribution in one transaction."""
    try:
        with backend.migration_connection() as connection:
            distributor = Distributor(connection, backend.label, views)
            wanted = distributor.undistribute() if undo else distributor.distribute(shards)
            if not wanted.statements:
                return wanted
            generated = sorted(backend.views.list_generated(connection))
            withdrawn, made = _around(connection, has_writers=undo)
            drops = (backend.views.drop(name) for name in generated)
            statements = (*withdrawn, *drops, *wanted.statements, *made)
            if not dry_run:
                lock_tables(connection)
                run_all(connection, statements)
            return wanted._replace(statements=statements)
    except DBAPIError as error:
        raise backend.translate_connect(error) from error


def _view_queries(url: str) -> dict[str, str]:
    """Return the views of the migrations, in order, each with its query."""
    out = io.StringIO()
    upgrade_sql(url, out)
    found: dict[str, str] = {}
    for change, name, query in _VIEW_CHANGES.findall(out.getvalue()):
        if change == "DROP":
            del found[name]
        else:
            found[name] = query
    return found


def _around(connection: Connection, has_writers: bool) -> tuple[list[str], list[str]]:
    """Write the statements that drop policies and auditors' own views, and that recreate them."""
    maker = RoleMaker(connection, has_writers=has_writers)
    scopes = maker.scopes() if maker.in_force else []
    withdrawn = [*maker.withdraw()]
    return withdrawn, [*maker.make(scopes)] if scopes else []


class Distributor:
    """Writes the statements that distribute the tables of a database, or bring them together."""

    def __init__(self, connection: Connection, label: str, views: Mapping[str, str]) -> None:
        self._connection = connection
        self._label = label
        self._views = views
        self._require_citus()
        self._names = Qualifier.of(connection)
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
        count = self.layout.shards or shards or self._connection.scalar(_SHARDS)
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
        """Check that this is the coordinator of a working cluster."""
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
        """Check that no foreign objects are in the way."""
        owners = [row[0] for row in self._connection.execute(_OWNERS, self._named)]
        if owners:
            raise self._refused("the tables are not yours", f"connect as {' and '.join(owners)}")
        views = {**self._named, "views": [*self._views]}
        found = [row[0] for row in self._connection.execute(_IN_THE_WAY, views)]
        if found:
            raise self._refused(
                f"objects of other programs are in the way: {'; '.join(found)}",
                f"drop these objects at {len(tables)} tables, and create them again afterwards",
            )

    def _check_writers(self) -> None:
        writers = [row[0] for row in self._connection.execute(_WRITERS, self._named)]
        if writers:
            named = ", ".join(map(self._names.quote, writers))
            raise self._refused(
                f"the row policies of {named} look up other rows, which those of a distributed "
                "table cannot do; readers and auditors stay",
                f"DROP OWNED BY {named}; DROP ROLE {named}; and let writers connect as the owner",
            )

    def _distribution(self, due: Sequence[str], shards: int | None) -> Iterator[str]:
        yield from (SEQUENTIAL, _QUIET)
        yield from self._drop_foreign_keys(due)
        for table in due:
            yield distribution_of(self._names, table, shards)
        for table in due:
            # The rows are in the shards now; on the coordinator, they are hidden.
            yield f"SELECT truncate_local_data_after_distributing_table({self._literal(table)})"
        yield from self._add_foreign_keys(due)

    def _reunion(self, due: Sequence[str]) -> Iterator[str]:
        """Yield the statements that turn shards into the tables of the migrations."""
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
                relation = self._names.relation(table)
                what = f"TABLE {relation}"
                if column is not None:
                    what = f"COLUMN {relation}.{self._names.quote(column)}"
                yield f"COMMENT ON {what} IS {text_literal(comment)}"

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
        return text_literal(self._names.relation(table))

    def _refused(self, what: str, remedy: str) -> StoreError:
        return StoreError(f"{self._label}: nothing was changed: {what}; {remedy}")


def _in_order() -> list[str]:
    """List all tables in the order of distribution."""
    first = (*REFERENCE_TABLES, FIRST)
    return [*first, *(table for table in own_tables() if table not in first)]
