"""The versions at a valid time, as known at a revision, in place of the version tables.

A statement about one state names tables of versions. For a state of valid time, `ValidTime`
replaces each by a subquery with the same columns: the versions at the last revision committed by
that time, without those that sayings override, and the sayings. They are open and have fork 0, so a
statement about any revision from the known one on finds them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from copy import copy
from datetime import datetime
from functools import cache
from typing import Any, Literal

from sqlalchemy import Dialect, text

from ..knowledge.canonical import time_text
from ..knowledge.definitions import DECLARED, Definitions
from .definition_rows import Ends, read_ends, with_lost
from .dialects.base import Session
from .dialects.words import COVERS, Words
from .intervals import forks_at, forks_at_time
from .periods import PARTS, fits, touch_of
from .query import Query
from .rows import FACT, VALUE
from .tables import TABLES

# Of what something may be said, and what owns it: the first columns of an index.
_OWNERS = {"proposition": "predicate", "function_value": "function"}
# What a statement calls the versions of one proposition, of which it gives the id.
OWN = "own_version"
_TEXT = (
    "CAST('(= ' || (SELECT f.text FROM function_value AS f WHERE f.kb_id = :kb AND "
    "f.id = s.function_value_id) || ' ' || COALESCE(s.value, (SELECT o.name FROM object AS o "
    "WHERE o.kb_id = :kb AND o.id = s.object_id)) || ')' AS TEXT)"
)


def _columns(table: str, row: str, **own: str) -> str:
    """Write the columns of a version that holds, from those of a row or as they are given."""
    own = {"until": "CAST(NULL AS BIGINT)", "fork": "0", **own}
    names = TABLES[f"{table}_version"].c.keys()
    return ", ".join(f"{own.get(name, f'{row}.{name}')} AS {name}" for name in names)


def _held(table: str, rows: str, at: str, forks: str) -> str:
    """Write the versions that held at a revision, as `v`, found as in `intervals.py`."""
    versions = rows.format(table=f"{table}_version", forks=f":{forks}")
    # As sums, neither end chooses an index: without statistics it would be as good as another.
    until = f"(v.until IS NULL OR v.until + 0 > :{at})"
    return f"FROM {versions} AND v.kb_id = :kb AND v.since + 0 <= :{at} AND {until}"


def _is_none_of(words: Words, id_: str, listed: str) -> str:
    """Write that an id is not in a list parameter."""
    return f"({words.in_list.format(id_, f':{listed}')}) IS NOT TRUE"


def _decides(table: str, row: str, newer: str = "") -> str:
    """Write that nothing else was said of an element that covers the time."""
    # With an offset, PostgreSQL makes no join of it, which without statistics it orders badly.
    return (
        f"NOT EXISTS (SELECT 1 FROM {table}_saying AS l WHERE {COVERS.format('l')} AND "
        f"l.{table}_id = {row}.{table}_id{newer} LIMIT 1 OFFSET 0)"
    )


def _said(words: Words, table: str, is_found: bool) -> str:
    """Write what was last said of the time, as versions; or of one element, which is found."""
    owner, own = _OWNERS[table], {}
    rows = f"{table}_saying AS s WHERE"
    if not is_found:
        rows, column = words.of_owners
        rows = f"{rows.format(owner=owner, table=f'{table}_saying', forks=':valid_periods')} AND"
        own[f"{owner}_id"] = column.format(owner=owner)
        own["since"] = "CAST(s.since + 0 AS BIGINT)"
    if table == "proposition":
        # Cast: SQLite looks into a UNION whose columns have the same affinities.
        own["is_goal"], holds = "CAST(0 AS BOOLEAN)", words.is_true.format("s.holds")
    else:
        own["text"], holds = _TEXT, "(s.number IS NOT NULL OR s.object_id IS NOT NULL)"
    last = _decides(table, "s", " AND l.since + 0 > s.since")
    fits = _is_none_of(words, f"s.{table}_id", f"misfit_{table}")
    where = f"{COVERS.format('s')} AND {holds} AND {fits} AND {last}"
    return f"SELECT {_columns(table, 's', **own)} FROM {rows} {where}"


# The versions of one element, whose key another condition gives.
_BY_KEY = "{table} AS v WHERE TRUE"
# How much was said of a time, of facts or of values: nothing, what is listed once, or more, so that
# each version looks for its own.
_Amount = Literal["nothing", "few", "many"]
FEW = 1_000


def _overlaid(said: _Amount, words: Words, table: str, rows: str, has_goals: bool = False) -> str:
    """Write what held of facts or values; goals are those of what is known."""
    is_found = rows == _BY_KEY
    own = {"since": "CAST(v.since + 0 AS BIGINT)"}
    stays = _is_none_of(words, f"v.{table}_id", f"replaced_{table}")
    held = f"{_held(table, rows, 'valid_state', 'valid_forks')} AND {stays}"
    if said == "many":
        held = f"{held} AND {_decides(table, 'v')}"
    if table == "proposition":
        held = f"{held} AND {words.is_fact.format('v')}"
    parts = [f"SELECT {_columns(table, 'v', **({} if is_found else own))} {held}"]
    if has_goals:
        own = {"predicate_id": "CAST(v.predicate_id + 0 AS BIGINT)"}
        goals = _held(table, rows, "valid_known", "valid_goals")
        is_goal = words.is_true.format("v.is_goal")
        parts.append(f"SELECT {_columns(table, 'v', **own)} {goals} AND {is_goal}")
    if said != "nothing":
        parts.append(_said(words, table, is_found))
    return " UNION ALL ".join(parts)


def _definitions(kind: str) -> str:
    """Write what was last defined of the elements that were known between two revisions."""
    later = (
        f"SELECT 1 FROM {kind}_version AS l WHERE l.kb_id = :kb AND l.{kind}_id = v.{kind}_id "
        "AND l.since > v.since AND l.since <= :valid_known LIMIT 1 OFFSET 0"
    )
    return (
        f"SELECT {_columns(kind, 'v')} FROM {kind}_version AS v WHERE v.kb_id = :kb "
        "AND v.since <= :valid_known AND (v.until IS NULL OR v.until > :valid_state) "
        f"AND NOT EXISTS ({later})"
    )


@cache
def _subqueries(words: Words, facts: _Amount, values: _Amount) -> dict[str, Query]:
    """Return what takes the place of each table."""
    found = {f"{kind}_version": _definitions(kind) for kind in DECLARED}
    all_, by_object = words.held
    found |= {
        "proposition_version": _overlaid(facts, words, "proposition", all_, has_goals=True),
        "proposition_held": _overlaid(facts, words, "proposition", all_),
        "proposition_found": _overlaid(facts, words, "proposition", by_object),
        OWN: _overlaid(facts, words, "proposition", _BY_KEY, has_goals=True),
        "function_value_version": _overlaid(values, words, "function_value", all_),
        "function_value_found": _overlaid(values, words, "function_value", _BY_KEY),
    }
    return {name: Query(text(sql)) for name, sql in found.items()}


@cache
def _true(words: Words) -> Query:
    """Select what was true of some predicates and functions."""
    parts = []
    for part in (PARTS[0], PARTS[2]):
        leading = part.select("v.since AS revision, 0 AS is_end", f", v.{part.id} AS id")
        which = words.in_list.format(f"v.{part.owner}", ":owners")
        rows = f"{part.table} AS v WHERE v.kb_id = :kb{part.condition} AND {which}"
        parts.append(f"{leading} FROM {rows}")
    return Query(text(" UNION ALL ".join(parts)))


# Where rows are read from one of the tables.
_NAMED = re.compile(
    rf"(?<![\w.'/])((?:{'|'.join([*DECLARED, *_OWNERS])})_version|"
    rf"(?:{'|'.join(_OWNERS)})_(?:held|found))(?![\w.'])(?: AS (\w+))?"
)
# The statements that were written, by dialect; conditions are of any form.
_WRITTEN: dict[tuple[str, tuple[_Amount, _Amount], str], str] = {}
_KEPT = 2_000


class ValidTime:
    """The state at a valid time, as known at a revision.

    Attributes:
        moment: the time.
        known: the revision.
        state: the last revision up to it that was committed by that time.
        oldest: the first revision that it is read from; something may be said of before the first.
        kb_id: the knowledge base; None before it has been written to.
        misfits: the ids of facts and of fluents that were so at the time, and do not fit what is
            known of their predicates, functions, types and objects; None before they are found.
        said: the ids of those of which something was said that covers the time, by table; empty
            where they are more than a few, and None before they are found.
        forks: where these sayings are kept.
    """

    def __init__(self, moment: datetime, known: int, state: int) -> None:
        self.moment, self.known, self.state = moment, known, state
        self.oldest = max(1, state)
        self.kb_id: int | None = None
        self.misfits: dict[str, list[int]] | None = None
        self.said: dict[str, list[int]] | None = None
        self.forks = forks_at_time(moment)
        self._parameters: dict[str, Any] = {}

    def __str__(self) -> str:
        return f"{time_text(self.moment)}, as known at revision {self.known}"

    def text(self, sql: str, dialect: Dialect, words: Words) -> str:
        """Replace the tables that a statement names."""
        amounts = self._amount("proposition"), self._amount("function_value")
        key = dialect.name, amounts, sql
        made = _WRITTEN.get(key)
        if made is None:
            if len(_WRITTEN) > _KEPT:
                _WRITTEN.clear()

            def written(found: re.Match[str]) -> str:
                name, alias = found.groups()
                name = OWN if alias == OWN else name
                return f"({_subqueries(words, *amounts)[name].text(dialect)}) AS {alias or name}"

            made = _WRITTEN[key] = _NAMED.sub(written, sql)
        return made

    def _amount(self, table: str) -> _Amount:
        """Return how much was said."""
        ids = (self.said or {}).get(table)
        return "many" if ids is None else "few" if ids else "nothing"

    def covered(self, session: Session) -> dict[str, Any]:
        """Return the parameters that find the sayings that cover the time."""
        return {
            "valid_known": self.known,
            "valid_moment": session.from_time(self.moment),
            "valid_periods": session.list_value(self.forks),
        }

    def parameters(self, session: Session) -> dict[str, Any]:
        """Return the additional parameters."""
        if self._parameters:
            return self._parameters
        misfits, said = self.misfits or {}, self.said or {}
        made = {
            **self.covered(session),
            "kb": self.kb_id,
            "valid_state": self.state,
            "valid_forks": session.list_value(forks_at(self.state)),
            "valid_goals": session.list_value(forks_at(self.known)),
        }
        for table in _OWNERS:
            unfit = misfits.get(table, [])
            made[f"misfit_{table}"] = session.list_value(unfit)
            made[f"replaced_{table}"] = session.list_value(unfit + said.get(table, []))
        if self.misfits is not None:
            self._parameters = made
        return made

    def with_said(self, session: Session) -> ValidTime:
        """Return the same with the elements of sayings; running reads continue without."""
        given, found = self.covered(session), copy(self)
        rows = session.rows(_of_what(session.words), **given, kb=self.kb_id, limit=FEW + 1)
        found.said, found._parameters = {}, {}
        if len(rows) <= FEW:
            found.said = {table: [row[1] for row in rows if row[0] == table] for table in _OWNERS}
            found.forks = sorted({fork for _, _, fork in rows})
        return found

    def find_misfits(self, session: Session, definitions: Definitions) -> bool:
        """Find elements that do not fit, in the tables and in the true state.

        Returns:
            Whether an element ended since that time that is not in the definitions of the revision.
        """
        assert self.kb_id is not None
        found: dict[str, list[int]] = {table: [] for table in _OWNERS}
        bounds = session, self.kb_id
        changed = self.known if definitions.revision is None else definitions.revision
        span = self.state, self.known
        lost, redefined = read_ends(*bounds, *span) if self.state < changed else Ends([], [])
        if redefined:
            last = with_lost(*bounds, definitions, *span) if lost else definitions
            owners = [id_ for _, id_ in redefined]
            if not {kind for kind, _ in redefined} <= {*_OWNERS.values()}:
                # The arguments of any may be of other types than they were.
                every = (last.predicates, last.functions)
                owners = [one.id for of_kind in every for one in of_kind]
            with session.overlaid(self):
                given = {"owners": session.list_value(owners), "is_goal": False}
                rows = session.rows(_true(session.words), **given, kb=self.kb_id)
            for *row, id_ in rows:
                touch = touch_of(row)
                if not fits(last, touch):
                    found["proposition" if touch.is_fact else "function_value"].append(id_)
        self.misfits = found
        return bool(lost)


def _covering(words: Words, columns: Callable[[str], str]) -> str:
    """Select something of what was said of the time, by the name of the table."""
    parts = []
    for table, owner in _OWNERS.items():
        table_ = f"{table}_saying"
        rows = words.of_owners[0].format(owner=owner, table=table_, forks=":valid_periods")
        parts.append(f"SELECT {columns(table)} FROM {rows} AND {COVERS.format('s')}")
    return " UNION ALL ".join(parts)


@cache
def _of_what(words: Words) -> Query:
    """Select of what something was said, and where it is kept, of so many sayings at most."""
    rows = _covering(words, lambda table: f"'{table}' AS kind, s.{table}_id AS id, s.fork AS fork")
    return Query(text(f"{rows} LIMIT :limit"))


@cache
def _texts(words: Words) -> Query:
    """Select what was said of the time: the element, when, and the text of what held."""
    atom = "SELECT a.text FROM proposition AS a WHERE a.kb_id = :kb AND a.id = s.proposition_id"
    held = f"CASE WHEN {words.is_true.format('s.holds')} THEN ({atom}) END"
    shown = {"proposition": (FACT, held), "function_value": (VALUE, _TEXT)}

    def columns(table: str) -> str:
        kind, held = shown[table]
        return f"'{kind}' AS kind, s.{table}_id AS id, s.since + 0 AS since, {held} AS text"

    return Query(text(f"{_covering(words, columns)} ORDER BY since"))


def read_said(session: Session, kb_id: int, valid: ValidTime) -> dict[tuple[str, int], str | None]:
    """Read what was last said of a time, by kind and id: a text, or None for what did not hold."""
    rows = session.rows(_texts(session.words), **valid.covered(session), kb=kb_id)
    return {(kind, id_): said for kind, id_, _, said in rows}
