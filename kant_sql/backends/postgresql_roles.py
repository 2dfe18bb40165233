"""Roles on PostgreSQL: made by grants and row policies, and brought up to date by the same."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Column, Connection, MetaData, Table, text

from ..errors import KantSqlError
from ..tables import Base
from .postgresql_locks import SCHEMA_OF_TABLES, VERSION_TABLE, lock_tables
from .postgresql_names import PREFIX, Names, Scope
from .postgresql_policies import FOR_ALL_ONLY, READ, policies, writer_rights
from .roles import Roles
from .views import generated_views

_COLUMNS = text(
    "SELECT c.relname, array_agg(a.attname::text) FROM pg_class AS c "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "JOIN pg_attribute AS a ON a.attrelid = c.oid AND a.attnum > 0 AND NOT a.attisdropped "
    "WHERE n.nspname = :schema AND c.relkind = 'r' GROUP BY c.relname"
)
# Found by what they show, for the knowledge base that they are of may be gone.
_OWN_VIEWS = text(
    "SELECT DISTINCT n.nspname, c.relname FROM pg_depend AS d "
    "JOIN pg_class AS shown ON shown.oid = d.refobjid AND shown.relkind = 'v' "
    "JOIN pg_namespace AS s ON s.oid = shown.relnamespace "
    "JOIN pg_rewrite AS r ON r.oid = d.objid AND d.classid = 'pg_rewrite'::regclass "
    "JOIN pg_class AS c ON c.oid = r.ev_class AND c.relname = shown.relname "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "WHERE d.refclassid = 'pg_class'::regclass AND s.nspname = :schema "
    f"AND n.nspname <> :schema AND starts_with(n.nspname, '{PREFIX}') ORDER BY 1, 2"
)
# The column tells them from what somebody else has called so.
_AUDIT_VIEWS = text(
    "SELECT c.relname FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "JOIN pg_attribute AS a ON a.attrelid = c.oid AND a.attname = 'knowledge_base' "
    "WHERE n.nspname = :schema AND c.relkind = 'v' AND starts_with(c.relname, 'audit_') "
    "ORDER BY c.relname"
)
_POLICIES = text(
    "SELECT c.relname, p.polname FROM pg_policy AS p JOIN pg_class AS c ON c.oid = p.polrelid "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE n.nspname = :schema AND starts_with(p.polname, '{PREFIX}') ORDER BY 1, 2"
)
_ROLE_NAMES = text(f"SELECT rolname FROM pg_roles WHERE starts_with(rolname, '{PREFIX}')")
# What PostgreSQL gives to everybody, and what fills a disk or hides a table behind another: the
# statement that takes it away, whether everybody has it, and whether this user may take it.
_FOR_EVERYBODY = text(
    "SELECT format('REVOKE TEMPORARY ON DATABASE %I FROM PUBLIC', datname), "
    "has_database_privilege('public', oid, 'TEMPORARY'), pg_has_role(datdba, 'USAGE') "
    "FROM pg_database WHERE datname = current_database() UNION ALL "
    "SELECT format('REVOKE EXECUTE ON FUNCTION %s FROM PUBLIC', oid::regprocedure), "
    "has_function_privilege('public', oid, 'EXECUTE'), pg_has_role(proowner, 'USAGE') "
    "FROM pg_proc WHERE pronamespace = 'pg_catalog'::regnamespace "
    "AND proname IN ('lo_creat', 'lo_create', 'lo_from_bytea', 'lo_import') ORDER BY 1"
)
_KNOWLEDGE_BASES = text("SELECT id, name FROM knowledge_base ORDER BY id")


class RoleMaker:
    """Writes the statements that make roles in a database as it is now."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._names = Names(connection.scalar(SCHEMA_OF_TABLES) or "public")
        present = {row[0]: row[1] for row in self._query(_COLUMNS)}
        tables = Base.metadata.tables.values()
        self._tables = [_as_it_is(t, present[t.name]) for t in tables if t.name in present]
        self._version = [VERSION_TABLE] if VERSION_TABLE in present else []
        self._views = [row[0] for row in self._query(_AUDIT_VIEWS)]
        self._generated = generated_views(connection)
        self._old = [(row[0], row[1]) for row in self._query(_POLICIES)]
        self._own = [(row[0], row[1]) for row in self._query(_OWN_VIEWS)]

    @property
    def in_force(self) -> bool:
        """Whether roles were made in this database before."""
        return bool(self._old)

    @property
    def is_in_the_way(self) -> bool:
        """Whether there is anything that keeps tables or views from being changed."""
        return bool(self._old or self._own)

    @property
    def has_tables(self) -> bool:
        """Whether there is anything to have rights on."""
        return bool(self._tables)

    def scopes(self) -> list[Scope]:
        """Give the scopes for which roles were made before, and the one of all.

        Returns:
            The scopes.
        """
        known = self._known_suffixes()
        return [Scope(), *(scope for scope in self._all_scopes() if scope.suffix in known)]

    def scope(self, knowledge_base: str | None) -> Scope:
        """Find a scope.

        Args:
            knowledge_base: the name of the one that it is; None for all.

        Returns:
            The scope.

        Raises:
            KantSqlError: there is no such knowledge base.
        """
        if knowledge_base is None:
            return Scope()
        scopes = {scope.knowledge_base: scope for scope in self._all_scopes()}
        if knowledge_base not in scopes:
            listed = ", ".join(repr(name) for name in [*scopes][:20]) or "none yet"
            raise KantSqlError(
                f"there is no knowledge base {knowledge_base!r} in this store to limit roles to: "
                f"write to it once, as the tables' owner or kant_sql_writer; there are: {listed}"
            )
        return scopes[knowledge_base]

    def withdraw(self) -> Iterator[str]:
        """Give the statements that remove policies and auditors' own views.

        What was made for a knowledge base that is gone, or is called otherwise now, is made no
        more: another may have its id.

        Yields:
            The statements.
        """
        for table, policy in self._old:
            yield f"DROP POLICY {self._names.quote(policy)} ON {self._names.relation(table)}"
        if self._own:
            own = (self._names.relation(view, schema) for schema, view in self._own)
            yield f"DROP VIEW {', '.join(own)}"
        there = {scope.suffix for scope in self._all_scopes()}
        for suffix in sorted(self._known_suffixes() - there - {""}):
            gone = {f"{PREFIX}{right}{suffix}" for right in ("writer", "reader", "auditor")}
            roles = sorted(gone & self._roles())
            if roles:
                named = ", ".join(map(self._names.quote, roles))
                yield f"REVOKE ALL ON TABLE {self._listed(self._relations())} FROM {named}"

    def make(self, scopes: Iterable[Scope]) -> Iterator[str]:
        """Give the statements that make roles, their grants and their policies.

        Args:
            scopes: the scopes.

        Yields:
            The statements.
        """
        existing = self._roles()
        for table in self._tables:
            yield f"ALTER TABLE {self._names.relation(table.name)} ENABLE ROW LEVEL SECURITY"
        for scope in scopes:
            roles = scope.roles()
            for role in roles[:3]:
                if role not in existing:
                    yield f"CREATE ROLE {self._names.quote(role)} NOLOGIN"
            yield from self._grants(scope, roles)
            writer, reader = map(self._names.quote, roles[:2])
            for table in self._tables:
                yield from policies(
                    table,
                    self._tables,
                    self._names,
                    scope.suffix,
                    scope.kb_id,
                    f"{reader}, {writer}",
                    writer,
                )
            if scope.schema is not None:
                yield from self._own_views(scope, roles)

    def revocations(self, by_caller: bool) -> list[str]:
        """Give the statements that take temporary tables and large objects from everybody.

        No role can be without what everybody has.

        Args:
            by_caller: whether those that the caller may run are wanted, or those that it may not.

        Returns:
            The statements.
        """
        rows = self._connection.execute(_FOR_EVERYBODY)
        return [row[0] for row in rows if row[1] and row[2] == by_caller]

    def _grants(self, scope: Scope, roles: Roles) -> Iterator[str]:
        quote, listed = self._names.quote, self._listed
        writer, reader, auditor = map(quote, roles[:3])
        everyone = f"{writer}, {reader}, {auditor}"
        tables = [*(table.name for table in self._tables), *self._version]
        all_views = [*self._views, *sorted(self._generated)]
        yield f"GRANT USAGE ON SCHEMA {quote(self._names.schema)} TO {everyone}"
        yield f"REVOKE ALL ON TABLE {listed(self._relations())} FROM {everyone}"
        yield f"GRANT SELECT ON TABLE {listed(tables)} TO {writer}, {reader}"
        # A view shows what its owner sees: all knowledge bases, or the one that it was made for.
        views = all_views if scope.kb_id is None else self._generated_of(scope.kb_id)
        if views:
            yield f"GRANT SELECT ON TABLE {listed(views)} TO {everyone}"
        if scope.kb_id is not None:
            # Else a function of the asker's own could be shown rows before they are left out.
            relations = map(self._names.relation, views)
            yield from (f"ALTER VIEW {view} SET (security_barrier)" for view in relations)
        granted: defaultdict[str, list[str]] = defaultdict(list)
        for table in self._tables:
            for right in writer_rights(table, self._tables, self._names):
                if scope.kb_id is None or right.verb != "insert" or table.name not in FOR_ALL_ONLY:
                    columns = f" ({', '.join(map(quote, right.columns))})" if right.columns else ""
                    granted[f"{right.verb.upper()}{columns}"].append(table.name)
        for privilege, names in granted.items():
            yield f"GRANT {privilege} ON TABLE {listed(names)} TO {writer}"

    def _own_views(self, scope: Scope, roles: Roles) -> Iterator[str]:
        """Give views of the same names that show one knowledge base only."""
        assert scope.schema is not None
        schema, names = self._names.quote(scope.schema), self._names
        everyone = ", ".join(map(names.quote, roles[:3]))
        yield f"CREATE SCHEMA IF NOT EXISTS {schema}"
        yield f"GRANT USAGE ON SCHEMA {schema} TO {everyone}"
        for view in self._views:
            own = names.relation(view, scope.schema)
            yield (
                f"CREATE VIEW {own} WITH (security_barrier) AS SELECT * FROM "
                f"{names.relation(view)} WHERE knowledge_base = (SELECT k.name FROM "
                f"{names.relation('knowledge_base')} AS k WHERE k.id = {scope.kb_id})"
            )
            yield f"GRANT SELECT ON TABLE {own} TO {everyone}"

    def _generated_of(self, kb_id: int) -> list[str]:
        return sorted(name for name, mark in self._generated.items() if mark.kb_id == kb_id)

    def _all_scopes(self) -> Iterator[Scope]:
        if any(table.name == "knowledge_base" for table in self._tables):
            for kb_id, name in self._connection.execute(_KNOWLEDGE_BASES):
                yield Scope(name, kb_id)

    def _known_suffixes(self) -> set[str]:
        """Give the suffixes of the scopes for which roles were made before."""
        reading = f"{PREFIX}{READ}"
        return {name.removeprefix(reading) for _, name in self._old if name.startswith(reading)}

    def _roles(self) -> set[str]:
        return {row[0] for row in self._connection.execute(_ROLE_NAMES)}

    def _relations(self) -> list[str]:
        tables = [*(table.name for table in self._tables), *self._version]
        return [*tables, *self._views, *sorted(self._generated)]

    def _listed(self, relations: Iterable[str]) -> str:
        return ", ".join(map(self._names.relation, relations))

    def _query(self, query: Any) -> list[Any]:
        return [*self._connection.execute(query, {"schema": self._names.schema})]


def _as_it_is(table: Table, columns: Sequence[str]) -> Table:
    """Give a table with the columns that it has, which may be those of an earlier version."""
    present = (column for column in table.columns if column.name in columns)
    copies = (Column(c.name, c.type, primary_key=c.primary_key) for c in present)
    return Table(table.name, MetaData(), *copies)


def make_roles(connection: Connection, knowledge_base: str | None, dry_run: bool) -> Roles:
    """Make the roles of a database, or bring them up to date, with all that were made before.

    Args:
        connection: a connection of the tables' owner, in a transaction.
        knowledge_base: the knowledge base that three more are to be limited to; None for none.
        dry_run: whether nothing is to be changed.

    Returns:
        The roles that were asked for.

    Raises:
        KantSqlError: there is no such knowledge base.
    """
    maker = RoleMaker(connection)
    wanted = maker.scope(knowledge_base)
    scopes = maker.scopes()
    if wanted not in scopes:
        scopes.append(wanted)
    statements = [*maker.withdraw(), *maker.make(scopes), *maker.revocations(by_caller=True)]
    if not dry_run:
        lock_tables(connection)
        _run(connection, statements)
    return wanted.roles(statements, maker.revocations(by_caller=False))


@contextmanager
def roles_set_aside(connection: Connection) -> Iterator[None]:
    """Take policies and auditors' own views out of the way of a migration, and set them anew.

    Tables, columns and views that these speak of could not be changed else. All tables are locked
    first, so that nothing is done in vain when one of them cannot be had.

    Args:
        connection: a connection of the tables' owner, in a transaction.

    Yields:
        Nothing.
    """
    maker = RoleMaker(connection)
    scopes = maker.scopes() if maker.in_force else []
    lock_tables(connection)
    if maker.is_in_the_way:
        _run(connection, maker.withdraw())
    yield
    after = RoleMaker(connection)
    if scopes and after.has_tables:
        _run(connection, after.make(scopes))


def _run(connection: Connection, statements: Iterable[str]) -> None:
    for statement in statements:
        # Without parameters, so that a percent sign in a name is one.
        connection.exec_driver_sql(statement, execution_options={"no_parameters": True})
