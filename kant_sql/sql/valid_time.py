"""What held at a time, as it is known at a revision: in the place of the tables of versions.

A statement about one state names tables of versions. For a state of valid time, `ValidTime` puts a
subquery in the place of each, with the same columns: the versions of the revision that was last
committed at that time, without those of which something else was said since, and what was said.
They are open and of fork 0, so a statement about any revision from the known one on finds them.
"""

from __future__ import annotations

import re
from datetime import datetime
from functools import cache
from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    ColumnElement,
    Dialect,
    Select,
    Table,
    Text,
    and_,
    bindparam,
    cast,
    false,
    func,
    literal_column,
    null,
    or_,
    select,
    union_all,
)

from ..knowledge.canonical import time_text
from .dialects.base import Session
from .intervals import forks_at, forks_at_time
from .query import Query, first_rows, in_list
from .rows import KB, KIND_TABLES, table_of
from .tables import (
    TABLES,
    FunctionValueRow,
    FunctionValueSayingRow,
    FunctionValueVersionRow,
    PropositionSayingRow,
    PropositionVersionRow,
)
from .tables.base import UtcTime


def _revision(name: str) -> ColumnElement[int]:
    return bindparam(f"valid_{name}", type_=BigInteger)


_KNOWN, _STATE = map(_revision, ("known", "state"))
_MOMENT: ColumnElement[datetime] = bindparam("valid_moment", type_=UtcTime())
_KINDS = "type", "object", "predicate", "function"
# The columns of a version that holds: it has no end.
_OPEN = {"until": cast(null(), BigInteger), "fork": literal_column("0")}


def _columns(version: Table, row: Any, **own: Any) -> list[Any]:
    """Select the columns of a table of versions: of a row, or what is given."""
    values = {**_OPEN, **own}
    return [
        (values[column.name] if column.name in values else row[column.name]).label(column.name)
        for column in version.c
    ]


def _held(row: Any, at: ColumnElement[int], forks: str | None) -> ColumnElement[bool]:
    among = [] if forks is None else [in_list(row.fork, forks, bounded=row.since)]
    until = or_(row.until.is_(None), row.until > at)
    return and_(row.kb_id == KB, *among, row.since <= at, until)


def _hidden(column: ColumnElement[int]) -> ColumnElement[int]:
    """Write a column so that no index of it is used: that of another one finds fewer rows."""
    return cast(column + literal_column("0"), BigInteger)


def _covers(saying: Any) -> ColumnElement[bool]:
    """Return whether a saying is known, and about the time."""
    is_known = and_(saying.kb_id == KB, _hidden(saying.since) <= _KNOWN)
    return and_(is_known, saying.valid_from <= _MOMENT, saying.valid_until > _MOMENT)


def _unsaid(sayings: Table, owner: str, row: Any, *newer: Any) -> ColumnElement[bool]:
    """Return whether nothing was said of an element that covers the time."""
    said = sayings.alias("l").c
    found: Select[Any] = select(literal_column("1")).where(_covers(said), said[owner] == row[owner])
    for each in newer:
        found = found.where(said.since > each)
    return _none(found)


def _none(found: Select[Any]) -> ColumnElement[bool]:
    """Return whether there is no row, which is looked up for each one that asks."""
    # With an offset, PostgreSQL makes no join of it, which without statistics it orders badly.
    return ~first_rows(found, literal_column("1")).exists()


def _said(version: Table, sayings: Table, owner: str, holds: Any, **own: Any) -> Select[Any]:
    """Select what was last said of the time, as versions."""
    said = sayings.alias("s").c
    own = {name: value(said) for name, value in own.items()}
    rows = select(*_columns(version, said, since=_hidden(said.since), **own))
    among = in_list(said.fork, "valid_periods", bounded=said.valid_from)
    return rows.where(among, _covers(said), holds(said), _unsaid(sayings, owner, said, said.since))


def _facts() -> Any:
    version, sayings = table_of(PropositionVersionRow), table_of(PropositionSayingRow)
    fact, goal = version.alias("v").c, version.alias("g").c
    facts = select(*_columns(version, fact)).where(
        ~fact.is_goal,
        _held(fact, _STATE, "valid_forks"),
        _unsaid(sayings, "proposition_id", fact),
    )
    goals = select(*_columns(version, goal, predicate_id=_hidden(goal.predicate_id))).where(
        goal.is_goal, _held(goal, _KNOWN, "valid_goals")
    )
    said = _said(
        *(version, sayings, "proposition_id", lambda row: row.holds),
        # Cast: SQLite looks into a UNION whose columns have the same affinities.
        is_goal=lambda _: cast(false(), Boolean),
    )
    return union_all(facts, goals, said)


def _values() -> Any:
    version, sayings = table_of(FunctionValueVersionRow), table_of(FunctionValueSayingRow)
    owner, value = "function_value_id", version.alias("v").c
    values = select(*_columns(version, value)).where(
        _held(value, _STATE, "valid_forks"), _unsaid(sayings, owner, value)
    )
    said = _said(
        *(version, sayings, owner),
        lambda row: or_(row.number.is_not(None), row.object_id.is_not(None)),
        text=_text_of_value,
    )
    return union_all(values, said)


def _text_of_value(said: Any) -> ColumnElement[str]:
    """Write a value as its version has it."""
    fluent, object_ = table_of(FunctionValueRow).alias("f").c, TABLES["object"].alias("o").c
    applied, name = (
        select(column).where(row.kb_id == KB, row.id == own).scalar_subquery()
        for column, row, own in (
            (fluent.text, fluent, said.function_value_id),
            (object_.name, object_, said.object_id),
        )
    )
    # As `value_text` writes it.
    begin, blank, end = [literal_column(f"'{part}'", Text) for part in ("(= ", " ", ")")]
    value = func.coalesce(said.value, name)
    return cast(begin.concat(applied).concat(blank).concat(value).concat(end), Text)


def _definitions(version: Table, owner: str) -> Select[Any]:
    """Select what was last defined of the elements that were known between two revisions."""
    row, later = version.alias("v").c, version.alias("l").c
    newer: Select[Any] = select(literal_column("1")).where(
        *(later.kb_id == KB, later[owner] == row[owner]),
        *(later.since > row.since, later.since <= _KNOWN),
    )
    return select(*_columns(version, row)).where(
        *(row.kb_id == KB, row.since <= _KNOWN),
        or_(row.until.is_(None), row.until > _STATE),
        _none(newer),
    )


@cache
def _subqueries() -> dict[str, Query]:
    """Return what takes the place of each table."""
    found = {
        table_of(PropositionVersionRow).name: Query(_facts()),
        table_of(FunctionValueVersionRow).name: Query(_values()),
    }
    for kind in _KINDS:
        version = KIND_TABLES[kind].version
        found[version.table.name] = Query(_definitions(version.table, version.owner.name))
    return found


@cache
def _named() -> re.Pattern[str]:
    """Return what finds the tables where rows are read from them."""
    return re.compile(rf"(?<![\w.'])({'|'.join(_subqueries())})(?![\w.'])(?: AS (\w+))?")


# The statements that were written, by dialect; conditions are of any form.
_WRITTEN: dict[tuple[str, str], str] = {}
_KEPT = 2_000


class ValidTime:
    """What held at a time, as it is known at a revision.

    Attributes:
        moment: the time.
        known: the revision.
        state: the last revision up to it that was committed by that time.
        kb_id: the knowledge base; None before it has been written to.
    """

    def __init__(self, moment: datetime, known: int, state: int) -> None:
        self.moment, self.known, self.state = moment, known, state
        self.kb_id: int | None = None

    def __str__(self) -> str:
        return f"{time_text(self.moment)}, as known at revision {self.known}"

    def text(self, sql: str, dialect: Dialect) -> str:
        """Put it in the place of the tables that a statement names."""
        text = _WRITTEN.get((dialect.name, sql))
        if text is None:
            if len(_WRITTEN) > _KEPT:
                _WRITTEN.clear()

            def written(found: re.Match[str]) -> str:
                name, alias = found.groups()
                return f"({_subqueries()[name].text(dialect)}) AS {alias or name}"

            text = _named().sub(written, sql)
            _WRITTEN[dialect.name, sql] = text
        return text

    def parameters(self, session: Session) -> dict[str, Any]:
        """Return the parameters that this adds to those of a statement."""
        return {
            "kb": self.kb_id,
            "valid_known": self.known,
            "valid_state": self.state,
            "valid_moment": session.from_time(self.moment),
            "valid_forks": session.list_value(forks_at(self.state)),
            "valid_goals": session.list_value(forks_at(self.known)),
            "valid_periods": session.list_value(forks_at_time(self.moment)),
        }
