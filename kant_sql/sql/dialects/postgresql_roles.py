"""Roles on PostgreSQL: grants and row policies, and the locks of schema changes.

A schema change first locks the version table, in a mode that needs more than the right to read: a
reader can neither take that lock nor block it. It locks the other tables last, when all statements
are known, and each attempt waits only briefly: an open transaction that has read a table blocks the
change, and all later statements on the table queue behind the waiting lock.

A grant selects tables and columns, a policy rows. Policies for writing are bounded by the last row
of `revision`, to which a writer can only add, and by the head's revision, read with its lock: a
statement sees `revision` as of its start. Versions of a later revision belong to the open
transaction; a writer may delete or reopen these and no others.
"""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

from sqlalchemy import Column, Connection, MetaData, Table, text

from ...errors import KantSqlError
from ..tables import EMPTY_HEAD, Base
from ..tables.base import VERSION_TABLE
from .base import Roles
from .postgresql_structure import PostgresqlViews, Qualifier, cluster_of

# The prefix of roles, and of all that is created for them.
PREFIX = "kant_sql_"
# With the longest prefix and suffix, 63 bytes: PostgreSQL truncates longer names.
_LONGEST_PART = 40
_PLAIN = re.compile(rf"[a-z][a-z0-9_]{{0,{_LONGEST_PART - 1}}}")
_LOOKS_MADE = re.compile(r".*_[0-9a-f]{12}")
_STRANGE = re.compile(r"[^a-z0-9]+")


def safe_part(knowledge_base: str) -> str:
    """Convert a knowledge base's name into a part of identifiers, unique to it."""
    if _PLAIN.fullmatch(knowledge_base) and not _LOOKS_MADE.fullmatch(knowledge_base):
        return knowledge_base
    digest = hashlib.sha256(knowledge_base.encode()).hexdigest()[:12]
    plain = _STRANGE.sub("_", knowledge_base.lower()).strip("_")
    return f"{plain[: _LONGEST_PART - 13].strip('_') or 'kb'}_{digest}"


class RoleScope(NamedTuple):
    """The knowledge bases of four roles: all, or one by name and id."""

    knowledge_base: str | None = None
    kb_id: int | None = None

    @property
    def suffix(self) -> str:
        """The suffix of its roles and policies."""
        return "" if self.knowledge_base is None else f"_{safe_part(self.knowledge_base)}"

    @property
    def schema(self) -> str | None:
        """The schema of its auditor's views; None for that of the tables."""
        return None if self.knowledge_base is None else f"{PREFIX}{self.suffix[1:]}"

    def roles(self, *, has_writer: bool) -> Roles:
        """Return its roles; there is no writer where the tables are distributed."""
        return Roles(
            f"{PREFIX}writer{self.suffix}" if has_writer else None,
            f"{PREFIX}reader{self.suffix}",
            f"{PREFIX}auditor{self.suffix}",
            f"{PREFIX}eraser{self.suffix}" if has_writer else None,
            self.schema,
            self.knowledge_base,
        )


# Waiting for another migration blocks no other session.
WAIT_FOR_SCHEMA = "10min"
# All other statements on a table queue behind a waiting lock.
WAIT_FOR_TABLE = "500ms"

_TABLES = text("SELECT tablename FROM pg_tables WHERE schemaname = :schema")
# NULL without the right to see other users' transactions.
_HOLDERS = text(
    "SELECT a.pid, a.usename, nullif(a.application_name, ''), "
    "extract(epoch FROM clock_timestamp() - a.xact_start)::bigint "
    "FROM pg_stat_activity AS a WHERE a.pid <> pg_backend_pid() AND EXISTS ("
    "SELECT FROM pg_locks AS l JOIN pg_class AS c ON c.oid = l.relation "
    "WHERE l.pid = a.pid AND l.granted AND l.database = a.datid "
    "AND a.datname = current_database() AND c.relname = ANY(:names)) "
    "ORDER BY a.xact_start NULLS LAST, a.pid LIMIT 3"
)


def lock_schema(run: Callable[[str], bool]) -> None:
    """Wait for other schema changes; afterwards, wait for tables only briefly."""
    run(f"SET LOCAL lock_timeout = '{WAIT_FOR_SCHEMA}'")
    # Of two migrations that create it, one waits and is retried.
    if run(f"SELECT to_regclass('{VERSION_TABLE}') IS NOT NULL"):
        run(f"LOCK TABLE {VERSION_TABLE} IN SHARE UPDATE EXCLUSIVE MODE")
    run(f"SET LOCAL lock_timeout = '{WAIT_FOR_TABLE}'")


def lock_tables(connection: Connection) -> None:
    """Lock all tables exclusively, before the first is changed."""
    names = Qualifier.of(connection)
    there = {row[0] for row in connection.execute(_TABLES, {"schema": names.schema})}
    # Writers begin with the head: once it is locked, none holds other tables.
    wanted = [name for name in ("head", *sorted(Base.metadata.tables)) if name in there]
    if wanted:
        listed = ", ".join(map(names.relation, dict.fromkeys(wanted)))
        connection.exec_driver_sql(f"LOCK TABLE {listed}")


def holders(connection: Connection) -> str:
    """Describe who holds locks on tables."""
    names = [*Base.metadata.tables, VERSION_TABLE]
    return "; ".join(_shown(*row) for row in connection.execute(_HOLDERS, {"names": names}))


def _shown(pid: int, user: str | None, program: str | None, seconds: int | None) -> str:
    called = f" ({program})" if program else ""
    since = "" if seconds is None else f", in a transaction for {seconds} s"
    return f"process {pid} of user {user}{called}{since}"


READ = "read"
# The purposes of roles, in the order of `Roles`.
RIGHTS = "writer", "reader", "auditor", "eraser"
ALWAYS = "true"
# The columns that each revision changes: not `kb_id`, nor those of archives and origins.
HEAD_COLUMNS = ("revision", "definition_revision", "next_id", "hash", "committed_at")
# Only the tables' owner archives: no other role may delete, promote a replica, or keep a
# verification; erasers have their own rights.
NOT_WRITTEN = frozenset({"archive", "promotion", "verification", "erasure", "replacement"})
# The columns that an erasure rewrites.
REWRITTEN = {
    **dict.fromkeys(("object", "formula"), ("name", "key")),
    **dict.fromkeys((f"{each}_version" for each in ("object", "action", "formula")), ("text",)),
    **dict.fromkeys((f"{each}_version" for each in ("rule", "document")), ("text",)),
    "document_item": ("name",),
    **dict.fromkeys(("proposition", "proposition_saying", "function_value"), ("text",)),
    **dict.fromkeys(("function_value_version", "function_value_saying"), ("text",)),
    "plan": (
        *("problem_hash", "planner", "planner_version", "objective", "status"),
        *("domain_pddl", "problem_pddl", "text"),
    ),
    "execution": ("name", "text"),
    "execution_argument": ("value",),
    "execution_version": ("code", "message", "text"),
    "revision": ("actor", "reason", "source", "seed"),
    "commitment": ("salt", "commitment", "erasure_id"),
    "replacement": ("salt", "commitment"),
}
# From this version of the server on, others than the owner may get the right to rewrite a table.
MAINTAIN_SINCE = 17
# How far the time of a revision may be from the server's clock when its row is added. Times never
# go back, so a time far ahead would hold for all later revisions; a time long ago would change what
# `at` returns for times since the previous one. A writer reads the clock when its transaction
# begins, adds the time since, during which the clock may be adjusted, and then hashes the changes.
LEEWAY = "interval '1 minute'"
# The range of Python's datetime: no driver reads other times.
_WITHIN = "BETWEEN '0001-01-01 00:00:00+00' AND '9999-12-31 23:59:59.999999+00'"
# Versions that do not move `head.definition_revision`.
NO_DEFINITIONS = frozenset({"proposition_version", "function_value_version", "execution_version"})
# One row per knowledge base: roles of one knowledge base insert none.
FOR_ALL_ONLY = frozenset({"knowledge_base", "head"})


class Right(NamedTuple):
    """A right to write some columns, with conditions on the old and the new row."""

    verb: str
    columns: tuple[str, ...] = ()
    using: str | None = None
    check: str | None = None


# The prefix of its policies, its roles, and their rights on a table.
Writing = tuple[str, str, Callable[[Table], Iterable[Right]]]


class WriterRights:
    """Makes the rights of writers on a table, except reading."""

    def __init__(self, table: Table, tables: Sequence[Table], names: Qualifier) -> None:
        self._table = table
        self._tables = tables
        self._names = names
        self._mine = names.quote(table.name)
        self._last = f"(SELECT coalesce(max(r.number), 0) {self._own('revision', 'r')})"

    def __iter__(self) -> Iterator[Right]:
        table, mine = self._table, self._mine
        if table.name in NOT_WRITTEN:
            return
        yield Right("insert", check=self._insertable())
        if table.name == "head":
            check = " AND ".join(self._head_checks())
            yield Right("update", HEAD_COLUMNS, using=ALWAYS, check=check)
        if "until" in table.c:
            # An open version may be closed, and one closed in this transaction reopened.
            columns = tuple(name for name in ("until", "fork") if name in table.c)
            using = f"{mine}.until IS NULL OR {self._is_not_past('until')}"
            yield Right("update", columns, using, self._closable())
        if "since" in table.primary_key.columns:
            yield Right("delete", using=f"{mine}.since > {self._last}")

    def _own(self, table: str, alias: str) -> str:
        """Write the FROM clause of another table, with the same knowledge base."""
        relation = self._names.relation(table)
        return f"FROM {relation} AS {alias} WHERE {alias}.kb_id = {self._mine}.kb_id"

    def _locked_head(self, column: str) -> str:
        """Read a column of the head under its lock, not as of the statement's start.

        Otherwise a slow statement would treat versions that others committed meanwhile as its own.
        """
        return f"(SELECT h.{column} {self._own('head', 'h')} FOR NO KEY UPDATE)"

    def _is_not_past(self, column: str) -> str:
        """Write the condition that a column is an uncommitted revision."""
        revision = f"{self._mine}.{column}"
        return f"{revision} > {self._last} AND {revision} > {self._locked_head('revision')}"

    def _insertable(self) -> str:
        """Write the condition that a new row does not change the past."""
        table, mine = self._table, self._mine
        if table.name == "head":
            return f"{self._is_empty()} AND {self._last} = 0"
        if table.name in FOR_ALL_ONLY:
            return ALWAYS
        if table.name == "revision":
            return f"{mine}.number = 1 + {self._last} AND {self._is_dated()}"
        if table.name in ("revision_execution", "commitment", "request"):
            return f"{mine}.number > {self._locked_head('revision')}"
        if "since" in table.c:
            is_new = self._is_not_past("since")
            if table.name == "execution":
                # A plan gets no further steps.
                of_plan = self._is_of_new_row("plan", f"i.id = {mine}.plan_id")
                return f"{is_new} AND ({mine}.plan_id = 0 OR {of_plan})"
            return f"{is_new} AND {self._open()}" if "until" in table.c else is_new
        # Identities and their parts: only new ones.
        owner = _owner(table)
        if owner == "plan_id":
            # Plans have their own numbers, not from the head.
            same = f"i.plan_id = {mine}.plan_id AND i.position = {mine}.position"
            return self._is_of_new_row("execution", same)
        is_new = f"{mine}.{self._names.quote(owner)} >= {self._locked_head('next_id')}"
        if owner == "id":
            return is_new
        same = f"i.id = {mine}.{self._names.quote(owner)}"
        return f"{is_new} AND {self._is_of_new_row(owner.removesuffix('_id'), same)}"

    def _is_empty(self) -> str:
        """Write the condition that a head belongs to a knowledge base without a revision."""
        return " AND ".join(
            f"{self._mine}.{self._names.quote(column.name)} "
            + (f"= {EMPTY_HEAD[column.name]}" if column.name in EMPTY_HEAD else "IS NULL")
            for column in self._table.columns
            if not column.primary_key
        )

    def _is_dated(self) -> str:
        """Write the condition that a revision's times follow the previous ones and are readable.

        It locks the head, so that only the transaction with the versions of this revision adds it;
        otherwise a statement that does not see these versions could move the head to it.
        """
        mine, head = self._mine, self._locked_head("committed_at")
        at, observed = f"{mine}.committed_at", f"{mine}.observed_at"
        before = (
            f"(SELECT r.committed_at {self._own('revision', 'r')} AND r.number = {mine}.number - 1)"
        )
        # `greatest` ignores NULL: the first revision has no previous one.
        condition = (
            f"{at} >= greatest({head}, {before}, clock_timestamp() - {LEEWAY}) "
            f"AND {at} <= greatest(clock_timestamp() + {LEEWAY}, {head}) AND {at} {_WITHIN}"
        )
        if "observed_at" in self._table.c:
            condition += f" AND ({observed} IS NULL OR {observed} {_WITHIN})"
        return condition

    def _is_of_new_row(self, table: str, same: str) -> str:
        """Write the condition that a row is part of an identity that this transaction inserted.

        The head does not show that: an identity beyond `next_id` may be committed alone. A visible
        row of a transaction in progress is one's own, also from a savepoint, which has its own
        number. `xmin` has 32 bits of that number: it is completed near the current one.
        """
        this = "pg_current_xact_id()::text::bigint"
        distance = f"(i.xmin::text::bigint - {this} + {1 << 31})"
        number = f"({this} + (({distance} % {1 << 32}) + {1 << 32}) % {1 << 32} - {1 << 31})"
        return (
            f"EXISTS (SELECT {self._own(table, 'i')} AND {same} "
            f"AND pg_xact_status({number}::text::xid8) = 'in progress')"
        )

    def _open(self) -> str:
        mine = self._mine
        return f"{mine}.until IS NULL" + (
            f" AND {mine}.fork = 0" if "fork" in self._table.c else ""
        )

    def _closable(self) -> str:
        """Write the condition that a version is open, or ends in an uncommitted revision."""
        mine, closed = self._mine, self._is_not_past("until")
        if "fork" in self._table.c:
            # Otherwise a past state would not find the version. `x & -x` is the largest power of
            # two that divides x: the fork is the only number whose span of that size covers both
            # ends.
            power = f"({mine}.fork & -{mine}.fork)"
            closed += (
                f" AND {mine}.since <= {mine}.fork AND {mine}.fork < {mine}.until AND {mine}.since"
                f" > {mine}.fork - {power} AND {mine}.until <= {mine}.fork + {power}"
            )
        return f"({self._open()}) OR ({closed})"

    def _head_checks(self) -> Iterator[str]:
        """Yield the conditions that the head moves to the last revision, by one.

        Otherwise a definition could change, or an id be allocated, in a revision that the head
        skips. The subquery sees the old row.
        """
        mine = self._mine
        yield (
            f"EXISTS (SELECT {self._own('revision', 'r')} "
            f"AND r.number = {mine}.revision AND r.hash = {mine}.hash "
            f"AND r.committed_at = {mine}.committed_at) AND {mine}.revision = {self._last}"
        )
        yield (
            f"EXISTS (SELECT {self._own('head', 'h')} "
            f"AND h.revision = {mine}.revision - 1 AND h.next_id <= {mine}.next_id "
            f"AND h.definition_revision <= {mine}.definition_revision "
            f"AND {mine}.definition_revision <= {mine}.revision)"
        )
        versions = [table for table in self._tables if "until" in table.c]
        # Caches of definitions rely on it.
        changed = [
            f"EXISTS (SELECT {self._own(table.name, 'v')} AND v.{end} = {mine}.revision)"
            for table in versions
            if table.name not in NO_DEFINITIONS
            for end in ("since", "until")
        ]
        yield f"({mine}.definition_revision = {mine}.revision OR NOT ({' OR '.join(changed)}))"
        # An id that is not allocated could be inserted later.
        ahead = [
            f"EXISTS (SELECT {self._own(table.name, 'v')} AND v.since = {mine}.revision "
            f"AND v.{_owner(table)} >= {mine}.next_id)"
            for table in versions
        ]
        yield f"NOT ({' OR '.join(ahead)})"


class EraserRights(WriterRights):
    """Makes the rights of erasers on a table, beyond those of writers.

    They rewrite texts, and `verify` compares these with the digest of the erasure. They cannot
    change anything else in the past, such as the end of a version or the row of an erasure.
    """

    def __iter__(self) -> Iterator[Right]:
        name = self._table.name
        if all(table.name != "erasure" for table in self._tables):
            return
        if name == "erasure":
            yield Right("insert", check=self._is_not_past("since"))
        elif name == "replacement":
            yield Right("insert", check=self._is_of_this_erasure())
        elif name == "commitment":
            # The rows that replace the seed of a revision belong to no erasure.
            kept = f"{self._mine}.erasure_id IS NULL"
            yield Right("insert", check=f"{kept} OR {self._is_of_this_erasure()}")
        if name in REWRITTEN:
            yield Right("update", REWRITTEN[name], using=ALWAYS, check=self._is_rewritten())

    def _is_of_this_erasure(self) -> str:
        return (
            f"EXISTS (SELECT {self._own('erasure', 'e')} AND e.id = {self._mine}.erasure_id "
            f"AND e.since > {self._locked_head('revision')})"
        )

    def _is_rewritten(self) -> str:
        """Write the condition that a row differs from the old one only as after an erasure."""
        table, mine = self._table, self._mine
        if table.name == "commitment":
            return self._is_of_this_erasure()
        if table.name in ("revision", "replacement"):
            return f"{mine}.{'seed' if table.name == 'revision' else 'salt'} IS NULL"
        if "until" not in table.c:
            return ALWAYS
        # Writers may set the end of an open version, so erasers may name that column, too. The
        # subquery sees the old row, as of the statement's start: nobody may have written since.
        own = [*[*table.primary_key.columns.keys()][1:], "until", "fork"]
        same = (f"v.{name} IS NOT DISTINCT FROM {mine}.{name}" for name in own if name in table.c)
        return (
            f"{self._last} >= {self._locked_head('revision')} "
            f"AND EXISTS (SELECT {self._own(table.name, 'v')} AND {' AND '.join(same)})"
        )


def _owner(table: Table) -> str:
    """Return the column of the identity in a table."""
    return str([*table.primary_key.columns][1].name)


def _both(own: str, condition: str) -> str:
    if ALWAYS in (own, condition):
        return condition if own == ALWAYS else own
    return f"{own} AND ({condition})"


_COLUMNS = text(
    "SELECT c.relname, array_agg(a.attname::text) FROM pg_class AS c "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "JOIN pg_attribute AS a ON a.attrelid = c.oid AND a.attnum > 0 AND NOT a.attisdropped "
    "WHERE n.nspname = :schema AND c.relkind = 'r' GROUP BY c.relname"
)
# Found by their sources: their knowledge base may be gone.
_OWN_VIEWS = text(
    "SELECT DISTINCT n.nspname, c.relname FROM pg_depend AS d "
    "JOIN pg_class AS shown ON shown.oid = d.refobjid "
    "JOIN pg_namespace AS s ON s.oid = shown.relnamespace "
    "JOIN pg_rewrite AS r ON r.oid = d.objid AND d.classid = 'pg_rewrite'::regclass "
    "JOIN pg_class AS c ON c.oid = r.ev_class AND starts_with(c.relname, 'audit_') "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "WHERE d.refclassid = 'pg_class'::regclass AND s.nspname = :schema "
    f"AND n.nspname <> :schema AND starts_with(n.nspname, '{PREFIX}') ORDER BY 1, 2"
)
# The column distinguishes them from other views of these names.
_AUDIT_VIEWS = text(
    "SELECT c.relname FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    "JOIN pg_attribute AS a ON a.attrelid = c.oid AND a.attname = 'knowledge_base' "
    "WHERE n.nspname = :schema AND c.relkind = 'v' AND starts_with(c.relname, 'audit_') "
    "ORDER BY c.relname"
)
_VIEW_QUERY = text("SELECT pg_get_viewdef(to_regclass(:view), true)")
_POLICIES = text(
    "SELECT c.relname, p.polname FROM pg_policy AS p JOIN pg_class AS c ON c.oid = p.polrelid "
    "JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE n.nspname = :schema AND starts_with(p.polname, '{PREFIX}') ORDER BY 1, 2"
)
_ROLE_NAMES = text(f"SELECT rolname FROM pg_roles WHERE starts_with(rolname, '{PREFIX}')")
# Rights of PUBLIC that could fill a disk or hide a table behind another: the statement that revokes
# each, whether PUBLIC has it, and whether this user may revoke it.
_FOR_EVERYBODY = text(
    "SELECT format('REVOKE TEMPORARY ON DATABASE %I FROM PUBLIC', datname), "
    "has_database_privilege('public', oid, 'TEMPORARY'), pg_has_role(datdba, 'USAGE') "
    "FROM pg_database WHERE datname = current_database() UNION ALL "
    # Granted before PostgreSQL 15.
    "SELECT format('REVOKE CREATE ON SCHEMA %I FROM PUBLIC', nspname), "
    "has_schema_privilege('public', oid, 'CREATE'), pg_has_role(nspowner, 'USAGE') "
    "FROM pg_namespace WHERE nspname IN ('public', :schema) UNION ALL "
    "SELECT format('REVOKE EXECUTE ON FUNCTION %s FROM PUBLIC', oid::regprocedure), "
    "has_function_privilege('public', oid, 'EXECUTE'), pg_has_role(proowner, 'USAGE') "
    "FROM pg_proc WHERE pronamespace = 'pg_catalog'::regnamespace "
    "AND proname IN ('lo_creat', 'lo_create', 'lo_from_bytea', 'lo_import') ORDER BY 1"
)
_KNOWLEDGE_BASES = text("SELECT id, name FROM knowledge_base ORDER BY id")


class RoleMaker:
    """Makes the statements that create roles in the present database."""

    def __init__(self, connection: Connection, *, has_writers: bool | None = None) -> None:
        self._connection = connection
        self._names = Qualifier.of(connection)
        present = {row[0]: row[1] for row in self._query(_COLUMNS)}
        tables = Base.metadata.tables.values()
        self._tables = [_as_it_is(t, present[t.name]) for t in tables if t.name in present]
        self._version = [VERSION_TABLE] if VERSION_TABLE in present else []
        self._views = [row[0] for row in self._query(_AUDIT_VIEWS)]
        self._generated = PostgresqlViews().list_generated(connection)
        self._old = [(row[0], row[1]) for row in self._query(_POLICIES)]
        self._own = [(row[0], row[1]) for row in self._query(_OWN_VIEWS)]
        # Policies of writers have subqueries, which tables on several nodes cannot have. There, a
        # node asks for a user's own rights on tables, not for those of a view's owner.
        self._cluster = cluster_of(connection)
        if has_writers is None:
            schema = self._names.schema
            has_writers = not (self._cluster and self._cluster.is_distributed(connection, schema))
        self.has_writers = has_writers

    @property
    def in_force(self) -> bool:
        """Whether this database has roles already."""
        return bool(self._old)

    def scopes(self) -> list[RoleScope]:
        """List the scopes that have roles, and the one of all knowledge bases."""
        known = self._known_suffixes()
        return [RoleScope(), *(scope for scope in self._all_scopes() if scope.suffix in known)]

    def scope(self, knowledge_base: str | None) -> RoleScope:
        """Return the scope of a knowledge base, or of all."""
        if knowledge_base is None:
            return RoleScope()
        scopes = {scope.knowledge_base: scope for scope in self._all_scopes()}
        if knowledge_base not in scopes:
            listed = ", ".join(repr(name) for name in [*scopes][:20]) or "none yet"
            raise KantSqlError(
                f"there is no knowledge base {knowledge_base!r} in this store to limit roles to: "
                f"write to it once, as the tables' owner or kant_sql_writer; there are: {listed}"
            )
        return scopes[knowledge_base]

    def withdraw(self) -> Iterator[str]:
        """Yield the statements that drop policies and auditors' own views, if there are any.

        The roles of a removed or renamed knowledge base lose their rights: another knowledge base
        may get its id.
        """
        if not (self._old or self._own):
            return
        for table, policy in self._old:
            yield f"DROP POLICY {self._names.quote(policy)} ON {self._names.relation(table)}"
        if self._own:
            own = (self._names.relation(view, schema) for schema, view in self._own)
            yield f"DROP VIEW {', '.join(own)}"
        there = {scope.suffix for scope in self._all_scopes()}
        for suffix in sorted(self._known_suffixes() - there - {""}):
            gone = {f"{PREFIX}{right}{suffix}" for right in RIGHTS}
            roles = sorted(gone & self._roles())
            if roles:
                named = ", ".join(map(self._names.quote, roles))
                yield f"REVOKE ALL ON TABLE {self._listed(self._relations())} FROM {named}"

    def make(self, scopes: Iterable[RoleScope], *, is_upgrade: bool = False) -> Iterator[str]:
        """Yield the statements that create roles, grants and policies, if there are tables.

        An upgrade needs no right to create roles: it makes no erasers.
        """
        if not self._tables:
            return
        existing = self._roles()
        for table in self._tables:
            yield f"ALTER TABLE {self._names.relation(table.name)} ENABLE ROW LEVEL SECURITY"
        for scope in scopes:
            roles = scope.roles(has_writer=self.has_writers)
            if is_upgrade and roles.eraser not in existing:
                roles = roles._replace(eraser=None)
            for role in _names_of(roles):
                if role is not None and role not in existing:
                    yield f"CREATE ROLE {self._names.quote(role)} NOLOGIN"
            yield from self._grants(scope, roles)
            for table in self._tables:
                yield from self._policies(table, scope, roles)
            if scope.schema is not None:
                yield from self._own_views(scope, roles)

    def _policies(self, table: Table, scope: RoleScope, roles: Roles) -> Iterator[str]:
        """Yield the statements that create a table's policies for the roles of one scope."""
        names, own = self._names, ALWAYS
        if scope.kb_id is not None:
            column = "id" if table.name == "knowledge_base" else "kb_id"
            own = f"{names.quote(table.name)}.{column} = {scope.kb_id}"

        def create(verb: str, command: str, to: str, conditions: str) -> str:
            policy = (
                f"{names.quote(f'{PREFIX}{verb}{scope.suffix}')} ON {names.relation(table.name)}"
            )
            return f"CREATE POLICY {policy} FOR {command} TO {to} {conditions}"

        readers = self._quoted(*self._table_readers(roles))
        yield create(READ, "SELECT", readers, f"USING ({own})")
        for prefix, to, rights in self._writing(scope, roles):
            for right in rights(table):
                parts = (("USING", right.using), ("WITH CHECK", right.check))
                conditions = (
                    f"{part} ({_both(own, each)})" for part, each in parts if each is not None
                )
                verb = right.verb
                yield create(f"{prefix}{verb}", verb.upper(), to, " ".join(conditions))

    def _writing(self, scope: RoleScope, roles: Roles) -> Iterator[Writing]:
        """Yield the roles of a scope that may write: erasers also have the rights of writers."""

        def of_writers(table: Table) -> Iterator[Right]:
            for right in WriterRights(table, self._tables, self._names):
                if scope.kb_id is None or right.verb != "insert" or table.name not in FOR_ALL_ONLY:
                    yield right

        if roles.writer is not None:
            yield "", self._quoted(roles.writer, roles.eraser), of_writers
        if roles.eraser is not None:
            own = partial(EraserRights, tables=self._tables, names=self._names)
            yield "erase_", self._quoted(roles.eraser), own

    def revocations(self, by_caller: bool) -> list[str]:
        """List the statements that revoke temporary tables and large objects from PUBLIC.

        A role cannot lack a right that PUBLIC has.
        """
        rows = self._query(_FOR_EVERYBODY)
        return [row[0] for row in rows if row[1] and row[2] == by_caller]

    def _grants(self, scope: RoleScope, roles: Roles) -> Iterator[str]:
        quote, listed = self._names.quote, self._listed
        everyone = self._quoted(*_names_of(roles))
        tables, all_views = self._named(), [*self._views, *sorted(self._generated)]
        yield f"GRANT USAGE ON SCHEMA {quote(self._names.schema)} TO {everyone}"
        yield f"REVOKE ALL ON TABLE {listed(self._relations())} FROM {everyone}"
        readers = self._quoted(*self._table_readers(roles))
        yield f"GRANT SELECT ON TABLE {listed(tables)} TO {readers}"
        # A view shows the rows that its owner sees: all knowledge bases, or its own.
        own = (name for name, mark in self._generated.items() if mark.kb_id == scope.kb_id)
        views = all_views if scope.kb_id is None else sorted(own)
        if views:
            yield f"GRANT SELECT ON TABLE {listed(views)} TO {everyone}"
        if scope.kb_id is not None:
            # Otherwise a function of the reader could see rows before the policy filters them.
            relations = map(self._names.relation, views)
            yield from (f"ALTER VIEW {view} SET (security_barrier)" for view in relations)
        for _, to, rights in self._writing(scope, roles):
            granted: defaultdict[str, list[str]] = defaultdict(list)
            for table in self._tables:
                for right in rights(table):
                    columns = f" ({', '.join(map(quote, right.columns))})" if right.columns else ""
                    granted[f"{right.verb.upper()}{columns}"].append(table.name)
            for privilege, names in granted.items():
                yield f"GRANT {privilege} ON TABLE {listed(names)} TO {to}"
        version = self._connection.dialect.server_version_info or (0,)
        if roles.eraser is not None and int(version[0]) >= MAINTAIN_SINCE:
            yield f"GRANT MAINTAIN ON TABLE {listed(tables)} TO {quote(roles.eraser)}"

    def _own_views(self, scope: RoleScope, roles: Roles) -> Iterator[str]:
        """Yield the statements that create the audit views of one knowledge base."""
        assert scope.schema is not None
        schema, names = self._names.quote(scope.schema), self._names
        everyone = self._quoted(*_names_of(roles))
        yield f"CREATE SCHEMA IF NOT EXISTS {schema}"
        yield f"GRANT USAGE ON SCHEMA {schema} TO {everyone}"
        for view in self._views:
            own = names.relation(view, scope.schema)
            query = (
                f"SELECT * FROM {names.relation(view)} WHERE knowledge_base = (SELECT k.name FROM "
                f"{names.relation('knowledge_base')} AS k WHERE k.id = {scope.kb_id})"
            )
            if self._cluster is not None and not self.has_writers:
                whole = self._connection.scalar(_VIEW_QUERY, {"view": names.relation(view)})
                query = str(whole).rstrip().rstrip(";")
                query = self._cluster.of_one_shard(query, names.schema, int(scope.kb_id or 0))
            yield f"CREATE VIEW {own} WITH (security_barrier) AS {query}"
            yield f"GRANT SELECT ON TABLE {own} TO {everyone}"

    def _table_readers(self, roles: Roles) -> tuple[str | None, ...]:
        """Return the roles that read tables: for distributed tables, also the auditor."""
        if not self.has_writers:
            return (roles.reader, roles.auditor)
        return (roles.reader, roles.writer, roles.eraser)

    def _quoted(self, *roles: str | None) -> str:
        return ", ".join(self._names.quote(role) for role in roles if role is not None)

    def _all_scopes(self) -> Iterator[RoleScope]:
        if any(table.name == "knowledge_base" for table in self._tables):
            for kb_id, name in self._connection.execute(_KNOWLEDGE_BASES):
                yield RoleScope(name, kb_id)

    def _known_suffixes(self) -> set[str]:
        """Return the suffixes of the scopes that have roles."""
        reading = f"{PREFIX}{READ}"
        return {name.removeprefix(reading) for _, name in self._old if name.startswith(reading)}

    def _roles(self) -> set[str]:
        return {row[0] for row in self._connection.execute(_ROLE_NAMES)}

    def _named(self) -> list[str]:
        return [*(table.name for table in self._tables), *self._version]

    def _relations(self) -> list[str]:
        return [*self._named(), *self._views, *sorted(self._generated)]

    def _listed(self, relations: Iterable[str]) -> str:
        return ", ".join(map(self._names.relation, relations))

    def _query(self, query: Any) -> list[Any]:
        return [*self._connection.execute(query, {"schema": self._names.schema})]


def _names_of(roles: Roles) -> tuple[str | None, ...]:
    return roles.writer, roles.reader, roles.auditor, roles.eraser


def _as_it_is(table: Table, columns: Sequence[str]) -> Table:
    """Return a table with its present columns, perhaps of an earlier version."""
    present = (column for column in table.columns if column.name in columns)
    copies = (Column(c.name, c.type, primary_key=c.primary_key) for c in present)
    return Table(table.name, MetaData(), *copies)


def make_roles(connection: Connection, knowledge_base: str | None, dry_run: bool) -> Roles:
    """Create the roles of a scope, and update all that exist."""
    maker = RoleMaker(connection)
    wanted = maker.scope(knowledge_base)
    scopes = maker.scopes()
    if wanted not in scopes:
        scopes.append(wanted)
    statements = [*maker.withdraw(), *maker.make(scopes), *maker.revocations(by_caller=True)]
    if not dry_run:
        lock_tables(connection)
        run_all(connection, statements)
    roles = wanted.roles(has_writer=maker.has_writers)
    remaining = maker.revocations(by_caller=False)
    return roles._replace(statements=tuple(statements), remaining=tuple(remaining))


@contextmanager
def roles_set_aside(connection: Connection) -> Iterator[None]:
    """Drop policies and auditors' own views for the length of a migration, and recreate them.

    Otherwise their columns and tables could not be changed. It locks all tables first, so the
    migration fails early if one is in use.
    """
    maker = RoleMaker(connection)
    scopes = maker.scopes() if maker.in_force else []
    lock_tables(connection)
    run_all(connection, maker.withdraw())
    yield
    if scopes:
        run_all(connection, RoleMaker(connection).make(scopes, is_upgrade=True))


def run_all(connection: Connection, statements: Iterable[str]) -> None:
    """Run statements given as text."""
    for statement in statements:
        # Without parameters, so that a percent sign in a name is not a placeholder.
        connection.exec_driver_sql(statement, execution_options={"no_parameters": True})
