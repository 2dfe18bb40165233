"""What roles may do with the rows of a table on PostgreSQL: grants, and policies beside them.

A grant says which table and column, a policy which rows. The bound of all policies for writing is
the last revision that has a row: a writer can only add to that table, so the bound never goes back;
and the head's revision, read with its lock, for a statement sees that table as it was at its start.
Rows of a later revision are those of the transaction that is being made, which nobody else has
seen; a writer may take these back, and no others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sqlalchemy import Table

from .postgresql_names import PREFIX, Names

READ = "read"
ALWAYS = "true"
# What moves with each revision; not `kb_id`, nor what an archive alone may set.
HEAD_COLUMNS = ("revision", "definition_revision", "next_id", "hash", "committed_at")
# What an archive leaves behind is written by the tables' owner, who alone can delete.
NOT_WRITTEN = frozenset({"archive"})
# A time far ahead would be that of all later revisions, too, for times never go back. A writer
# counts the time since its transaction began, during which the server's clock may be put right.
_LATEST = "clock_timestamp() + interval '1 minute'"
# A time long ago would change what `at` gives for a time since the revision before.
_EARLIEST = "least(transaction_timestamp(), clock_timestamp()) - interval '1 minute'"
# What Python's datetime holds: no driver could read another time back.
_WITHIN = "BETWEEN '0001-01-01 00:00:00+00' AND '9999-12-31 23:59:59.999999+00'"
# The versions that `head.definition_revision` does not count.
NO_DEFINITIONS = frozenset({"proposition_version", "function_value_version", "plan_step_version"})
# What there is one of for each knowledge base: there is nothing to add for who has only one.
FOR_ALL_ONLY = frozenset({"knowledge_base", "head"})


class Right(NamedTuple):
    """What a writer may do with the rows of a table.

    Attributes:
        verb: `insert`, `update` or `delete`.
        columns: the columns that it is limited to; empty for whole rows.
        using: the condition on a row as it was.
        check: the condition on a row as it becomes.
    """

    verb: str
    columns: tuple[str, ...] = ()
    using: str | None = None
    check: str | None = None


def writer_rights(table: Table, tables: Sequence[Table], names: Names) -> Iterator[Right]:
    """Give what a writer may do with the rows of a table, beside reading them.

    Args:
        table: the table.
        tables: all tables that there are.
        names: how relations are called.

    Yields:
        The rights, one for each verb at most.
    """
    if table.name in NOT_WRITTEN:
        return
    mine = names.quote(table.name)
    last = _last_revision(mine, names)
    yield Right("insert", check=_insertable(table, mine, last, names))
    if table.name == "head":
        check = " AND ".join(_head_checks(mine, last, tables, names))
        yield Right("update", HEAD_COLUMNS, using=ALWAYS, check=check)
    if "until" in table.c:
        # An open row may be closed, and what this transaction has closed may be opened again.
        columns = tuple(name for name in ("until", "fork") if name in table.c)
        ends_now = _is_not_past("until", mine, last, names)
        using = f"{mine}.until IS NULL OR {ends_now}"
        yield Right("update", columns, using, _closable(table, mine, ends_now))
    if "since" in table.primary_key.columns:
        yield Right("delete", using=f"{mine}.since > {last}")


def own_rows(table: Table, names: Names, kb_id: int | None) -> str:
    """Give the condition that a row is of one knowledge base.

    Args:
        table: the table.
        names: how relations are called.
        kb_id: the knowledge base; None for all of them.

    Returns:
        The condition.
    """
    if kb_id is None:
        return ALWAYS
    column = "id" if table.name == "knowledge_base" else "kb_id"
    return f"{names.quote(table.name)}.{column} = {kb_id}"


def _last_revision(mine: str, names: Names) -> str:
    revision = names.relation("revision")
    return f"(SELECT coalesce(max(r.number), 0) FROM {revision} AS r WHERE r.kb_id = {mine}.kb_id)"


def _head(mine: str, names: Names) -> str:
    return f"FROM {names.relation('head')} AS h WHERE h.kb_id = {mine}.kb_id"


def _locked_head(column: str, mine: str, names: Names) -> str:
    """Read the head as it is now: after its lock, and not as it was when the statement began.

    A statement that takes its time would else think its own what others have committed meanwhile.
    """
    return f"(SELECT h.{column} {_head(mine, names)} FOR NO KEY UPDATE)"


def _is_not_past(column: str, mine: str, last: str, names: Names) -> str:
    """Give the condition that a column is a revision that is being made."""
    revision = f"{mine}.{column}"
    return f"{revision} > {last} AND {revision} > {_locked_head('revision', mine, names)}"


def _insertable(table: Table, mine: str, last: str, names: Names) -> str:
    """Give the condition that a new row adds nothing to what is past."""
    if table.name in FOR_ALL_ONLY:
        return ALWAYS
    if table.name == "revision":
        return f"{mine}.number = 1 + {last} AND {_is_dated(table, mine, names)}"
    if table.name == "revision_plan_step":
        return f"{mine}.number > {_locked_head('revision', mine, names)}"
    if "since" in table.c:
        is_new = _is_not_past("since", mine, last, names)
        return f"{is_new} AND {_open(table, mine)}" if "until" in table.c else is_new
    # An identity, or a part of one: new ones only.
    owner = _owner(table)
    is_new = f"{mine}.{names.quote(owner)} >= {_locked_head('next_id', mine, names)}"
    return is_new if owner == "id" else f"{is_new} AND {_is_of_new_row(mine, owner, names)}"


def _is_dated(table: Table, mine: str, names: Names) -> str:
    """Give the condition that a revision's times follow the one before, and can be read back.

    The head is locked: who has written rows of this revision, and not committed them, adds it.
    Else the head could be moved to it by a statement that does not see these rows.
    """
    at = f"{mine}.committed_at"
    head = _locked_head("committed_at", mine, names)
    before = (
        f"(SELECT r.committed_at FROM {names.relation('revision')} AS r "
        f"WHERE r.kb_id = {mine}.kb_id AND r.number = {mine}.number - 1)"
    )
    # `greatest` leaves out what is NULL: the first revision has none before it.
    condition = (
        f"{at} >= greatest({head}, {before}, {_EARLIEST}) AND {at} <= greatest({_LATEST}, {head}) "
        f"AND {at} {_WITHIN}"
    )
    if "observed_at" in table.c:
        condition += f" AND ({mine}.observed_at IS NULL OR {mine}.observed_at {_WITHIN})"
    return condition


def _is_of_new_row(mine: str, owner: str, names: Names) -> str:
    """Give the condition that a row is part of an identity that this very transaction has made.

    The head does not say so: an identity ahead of it stays ahead when it is committed alone. A row
    that is seen, and whose transaction is in progress, is one's own; savepoints have numbers of
    their own. `xmin` is 32 bits of a transaction's number, so it is taken as near the current one.
    """
    this = "pg_current_xact_id()::text::bigint"
    distance = f"(i.xmin::text::bigint - {this} + {1 << 31})"
    number = f"({this} + (({distance} % {1 << 32}) + {1 << 32}) % {1 << 32} - {1 << 31})"
    return (
        f"EXISTS (SELECT FROM {names.relation(owner.removesuffix('_id'))} AS i "
        f"WHERE i.kb_id = {mine}.kb_id AND i.id = {mine}.{names.quote(owner)} "
        f"AND pg_xact_status({number}::text::xid8) = 'in progress')"
    )


def _open(table: Table, mine: str) -> str:
    return f"{mine}.until IS NULL" + (f" AND {mine}.fork = 0" if "fork" in table.c else "")


def _closable(table: Table, mine: str, ends_now: str) -> str:
    """Give the condition that a row is open, or ends in a revision that is not past."""
    closed = ends_now
    if "fork" in table.c:
        # Else a past state would not find the row. `x & -x` is the power of two that divides x:
        # the fork is the one number whose span of that size, to both sides, has both ends.
        power = f"({mine}.fork & -{mine}.fork)"
        closed += (
            f" AND {mine}.since <= {mine}.fork AND {mine}.fork < {mine}.until "
            f"AND {mine}.since > {mine}.fork - {power} AND {mine}.until <= {mine}.fork + {power}"
        )
    return f"({_open(table, mine)}) OR ({closed})"


def _head_checks(mine: str, last: str, tables: Sequence[Table], names: Names) -> Iterator[str]:
    """Give the conditions that the head has moved on to the last revision, one at a time.

    Else a definition could change, and an id be given out, in one that the head has passed over.
    A statement sees the row as it was before it, so that the subquery gives what it was.
    """
    yield (
        f"EXISTS (SELECT FROM {names.relation('revision')} AS r WHERE r.kb_id = {mine}.kb_id "
        f"AND r.number = {mine}.revision AND r.hash = {mine}.hash "
        f"AND r.committed_at = {mine}.committed_at) AND {mine}.revision = {last}"
    )
    yield (
        f"EXISTS (SELECT FROM {names.relation('head')} AS h WHERE h.kb_id = {mine}.kb_id "
        f"AND h.revision = {mine}.revision - 1 AND h.next_id <= {mine}.next_id "
        f"AND h.definition_revision <= {mine}.definition_revision "
        f"AND {mine}.definition_revision <= {mine}.revision)"
    )
    versions = [table for table in tables if "until" in table.c]
    # Who caches definitions believes the head that none has changed.
    changed = [
        _has_rows(table, f"v.{end} = {mine}.revision", mine, names)
        for table in versions
        if table.name not in NO_DEFINITIONS
        for end in ("since", "until")
    ]
    yield f"({mine}.definition_revision = {mine}.revision OR NOT ({' OR '.join(changed)}))"
    # An id that is not given out stays within reach of who adds new identities.
    ahead = [
        _has_rows(
            table,
            f"v.since = {mine}.revision AND v.{_owner(table)} >= {mine}.next_id",
            mine,
            names,
        )
        for table in versions
    ]
    yield f"NOT ({' OR '.join(ahead)})"


def _has_rows(table: Table, condition: str, mine: str, names: Names) -> str:
    relation = names.relation(table.name)
    return f"EXISTS (SELECT FROM {relation} AS v WHERE v.kb_id = {mine}.kb_id AND {condition})"


def _owner(table: Table) -> str:
    """Give the column of the identity that the rows of a table are of."""
    return str([*table.primary_key.columns][1].name)


def policies(
    table: Table,
    tables: Sequence[Table],
    names: Names,
    suffix: str,
    kb_id: int | None,
    readers: str,
    writer: str,
) -> Iterator[str]:
    """Give the statements that make the policies of a table for the roles of one scope.

    Args:
        table: the table.
        tables: all tables that there are.
        names: how relations are called.
        suffix: what tells the names of the scope's policies from those of others.
        kb_id: the knowledge base that the scope is; None for all of them.
        readers: the roles that read rows, quoted, with commas between.
        writer: the role that writes rows, quoted.

    Yields:
        The statements.
    """
    relation, own = names.relation(table.name), own_rows(table, names, kb_id)

    def create(verb: str, command: str, roles: str, conditions: str) -> str:
        policy = names.quote(f"{PREFIX}{verb}{suffix}")
        return f"CREATE POLICY {policy} ON {relation} FOR {command} TO {roles} {conditions}"

    yield create(READ, "SELECT", readers, f"USING ({own})")
    for right in writer_rights(table, tables, names):
        if kb_id is not None and table.name in FOR_ALL_ONLY and right.verb == "insert":
            continue
        parts = ((part, condition) for part, condition in _parts(right) if condition is not None)
        conditions = " ".join(f"{part} ({_both(own, condition)})" for part, condition in parts)
        yield create(right.verb, right.verb.upper(), writer, conditions)


def _parts(right: Right) -> tuple[tuple[str, str | None], ...]:
    return ("USING", right.using), ("WITH CHECK", right.check)


def _both(own: str, condition: str) -> str:
    if ALWAYS in (own, condition):
        return condition if own == ALWAYS else own
    return f"{own} AND ({condition})"
