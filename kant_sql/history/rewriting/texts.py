"""Renames an object: rewrites every text with the old name from its rows."""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from json.encoder import encode_basestring, encode_basestring_ascii
from typing import Any, NamedTuple
from unicodedata import normalize

from sqlalchemy import Table, bindparam, false, or_, select, update

from ...dao.base import batches
from ...dto.elements import atom_text, value_text
from ...dto.lexical import fold
from ...knowledge.canonical import canonical_text
from ...knowledge.definitions import KINDS, Definitions, formula_name
from ...knowledge.sayings import Period
from ...sql import tables as t
from ...sql.changes import ASSERTED, CONFIRMATION, PLAN, RETRACTED, SAYING
from ...sql.definition_rows import load_at
from ...sql.dialects.base import Row, Session
from ...sql.executions import (
    NO_PLAN,
    PLAN_STEP,
    ExecutionDefinition,
    Key,
    PlanDefinition,
    outcome_text,
    quoted,
)
from ...sql.query import Query, constant, in_list, integer
from ...sql.rows import ATOM_TABLES, FACT, GOAL, KB, KIND_TABLES, PROPOSITION, VALUE, table_of
from ...store.snapshot import View
from ..verify.definition_check import names_alone

# Revision, sign, kind, owner and place of a change.
ChangeKey = tuple[int, str, str, int, int]


class Renaming(NamedTuple):
    """An object with its old and its new name."""

    id: int
    name: str
    pseudonym: str

    def in_text(self, text: str | None) -> str | None:
        """Replace the name in a text where it is a whole name."""
        return None if text is None else _whole(self.name).sub(self.pseudonym, text)

    def is_in(self, *texts: str | None) -> bool:
        """Return whether one of some texts contains the name."""
        return any(has_word(text, self.name) for text in texts if text is not None)


def spellings(name: str) -> list[str]:
    """Return the spellings of a name in texts and in JSON, except for the case of letters."""
    cased = {name} if name.isascii() else {name, name.casefold(), name.upper()}
    spelled = {normalize(form, each) for each in cased for form in ("NFC", "NFD")}
    # JSON may write letters outside of ASCII directly, or as \u00fc.
    return sorted(spelled | {write(each)[1:-1] for each in spelled for write in _JSON})


_JSON = encode_basestring, encode_basestring_ascii


@cache
def _whole(name: str) -> re.Pattern[str]:
    spelled = "|".join(map(re.escape, spellings(name)))
    return re.compile(rf"(?<![\w-])({spelled})(?![\w-])", re.IGNORECASE)


def has_word(text: str, name: str) -> bool:
    """Return whether a text contains a name as a whole name."""
    return _whole(name).search(text) is not None


_FACTS, _ARGUMENTS, _HELD, _SAID, *_ = ATOM_TABLES[PROPOSITION]
_FLUENTS, _PLACES, _VALUES, _SAID_VALUES, *_ = ATOM_TABLES[VALUE]
_SEEN = table_of(t.ConfirmationRow)
_EXECUTIONS, _GIVEN = table_of(t.ExecutionRow), table_of(t.ExecutionArgumentRow)
_OUTCOMES, _PLANS = table_of(t.ExecutionVersionRow), table_of(t.PlanRow)
_OBJECTS, _ITEMS = t.TABLES["object"], t.TABLES["document_item"]
_LIVED = t.TABLES["object_version"].c
WITH_TREES = "action", "formula", "rule"
# Texts by people and planners, which may contain the name.
_FREE = (_EXECUTIONS, ("name",)), (_GIVEN, ("value",)), (_OUTCOMES, ("code", "message"))
_FREE_OF_PLANS = (
    *("planner", "planner_version", "objective", "status"),
    *("domain_pddl", "problem_pddl"),
)

_OBJECT: Any = integer("object")
_IS_IT = (
    _LIVED.kb_id == KB,
    _LIVED.object_id == _OBJECT,
    _LIVED.since <= _PLANS.c.revision,
    or_(_LIVED.until.is_(None), _LIVED.until > _PLANS.c.revision),
)
# Plans made from a state with the object.
_PLANS_WITH = Query(
    select(_PLANS.c.id).where(_PLANS.c.kb_id == KB, select(_LIVED.since).where(*_IS_IT).exists())
)


@cache
def _of(table: Table, owner: str, *names: str, **also: int) -> Query:
    """Read some columns of a table, or all but the first, by a list of ids."""
    columns = [table.c[name] for name in names or [*table.c.keys()][1:]]
    own = (table.c[name] == constant(value) for name, value in also.items())
    which = table.c.kb_id == KB, in_list(table.c[owner], "ids"), *own
    return Query(select(*columns).where(*which).order_by(*[*table.primary_key.columns][1:]))


@cache
def _mentions(table: Table, *owner: str) -> Query:
    """Read the owners of rows that mention the object."""
    is_it = table.c.kb_id == KB, table.c.object_id == _OBJECT
    return Query(select(*(table.c[name] for name in owner)).where(*is_it).distinct())


@cache
def _all(table: Table, *names: str, given: tuple[str, ...] = ()) -> Query:
    """Read some columns of all rows, or of those in which one of some columns is not NULL."""
    rows = select(*(table.c[name] for name in names)).where(table.c.kb_id == KB)
    some = or_(false(), *(table.c[name].is_not(None) for name in given))
    return Query(rows.where(some) if given else rows)


@cache
def _set(table: Table, key: tuple[str, ...], *names: str) -> Query:
    """Set columns of one row; the parameters of its key begin with `own_`."""
    own = (table.c[name] == bindparam(f"own_{name}") for name in key)
    values: dict[str, Any] = {name: bindparam(f"new_{name}") for name in names}
    return Query(update(table).where(table.c.kb_id == bindparam("kb"), *own).values(values))


@dataclass(eq=False)
class TextWriter:
    """Renames an object in one knowledge base, in an open transaction."""

    _session: Session
    _kb: int
    _name: str
    _to: Renaming
    # Called with the statement and the new values, to repeat the write elsewhere.
    _also: Callable[[Table, Query, list[dict[str, Any]]], None] | None = None
    # The old texts of changed texts, by change.
    old: dict[ChangeKey, str] = field(default_factory=dict)
    # Names in documents that change: of a formula its hash, of a ground goal its text.
    _items: dict[str, str] = field(default_factory=dict)

    def run(self) -> None:
        """Rename it, and rewrite all texts."""
        id_, _, pseudonym = self._to
        self._set(_OBJECTS, [({"id": id_}, {"name": pseudonym, "key": fold(pseudonym)})])
        names = self._names()
        self._definitions("object", [id_], names)
        for kind in WITH_TREES:
            owners = self._mentions(t.TABLES[f"{kind}_term"], f"{kind}_id")
            self._definitions(kind, [owner for (owner,) in owners], names)
        for rows, texts in self._atoms(_FACTS, _ARGUMENTS, "predicate"):
            self._fact_changes(rows, texts)
        for _, texts in self._atoms(_FLUENTS, _PLACES, "function"):
            self._values(texts)
        # Fluents of other objects whose value was this one.
        tables = _VALUES, _SAID_VALUES
        others = {row[0] for each in tables for row in self._mentions(each, "function_value_id")}
        for ids in batches(sorted(others)):
            self._values(dict(self._rows(_of(_FLUENTS, "id", "id", "text"), ids)))
        self._documents(names)
        self._plans(self._executions(names))

    def run_atoms(self) -> None:
        """Rewrite the texts of facts and fluents, including those without a version."""
        for tables in ((_FACTS, _ARGUMENTS, "predicate"), (_FLUENTS, _PLACES, "function")):
            deque(self._atoms(*tables), maxlen=0)

    def _rows(self, query: Query, ids: Iterable[int]) -> list[Row]:
        listed = [*ids]
        if not listed:
            return []
        return self._session.rows(query, kb=self._kb, ids=self._session.list_value(listed))

    def _dicts(self, table: Table, owner: str, ids: Iterable[int]) -> list[dict[str, Any]]:
        names = [*table.c.keys()][1:]
        return [dict(zip(names, row, strict=True)) for row in self._rows(_of(table, owner), ids)]

    def _mentions(self, table: Table, *owner: str) -> list[Row]:
        return self._session.rows(_mentions(table, *owner), kb=self._kb, object=self._to.id)

    def _called(self, ids: Iterable[int | None]) -> dict[int, str]:
        """Return the names of objects."""
        known = sorted({id_ for id_ in ids if id_ is not None})
        return dict(self._rows(_of(_OBJECTS, "id", "id", "name"), known))

    def _set(self, table: Table, rows: list[tuple[dict[str, Any], dict[str, Any]]]) -> None:
        """Set columns of rows, by their keys."""
        if not rows:
            return
        key, values = rows[0]
        given = [
            {
                "kb": self._kb,
                **{f"own_{name}": value for name, value in own.items()},
                **{f"new_{name}": value for name, value in new.items()},
            }
            for own, new in rows
        ]
        query = _set(table, tuple(key), *values)
        self._session.run_many(query, given)
        if self._also is not None:
            self._also(table, query, given)

    def _note(
        self, since: int, until: int | None, kind: str, old: str, owner: int, place: int = 0
    ) -> None:
        """Keep the old text of a version, for its two changes."""
        self.old[since, ASSERTED, kind, owner, place] = old
        if until is not None:
            self.old[until, RETRACTED, kind, owner, place] = old

    def _names(self) -> Definitions:
        """Return the names of all elements; for objects, those in formulas, rules and actions."""
        made: list[dict[int, str]] = []
        for kind in KINDS:
            identity = KIND_TABLES[kind].identity
            if kind == "object":
                terms = (t.TABLES[f"{each}_term"] for each in WITH_TREES)
                queries = (_all(table, "object_id", given=("object_id",)) for table in terms)
                ids = (row[0] for q in queries for row in self._session.rows(q, kb=self._kb))
                made.append(self._called([*ids, self._to.id]))
            else:
                made.append(dict(self._session.rows(_all(identity, "id", "name"), kb=self._kb)))
        return names_alone(made)

    def _definitions(self, kind: str, owners: Sequence[int], names: Definitions) -> None:
        """Rewrite the texts of all versions of some definitions."""
        tables, changed, renamed = KIND_TABLES[kind], [], {}
        version, owner = tables.version, tables.version.owner.name
        called: dict[int, str] = dict(self._rows(_of(tables.identity, "id", "id", "name"), owners))
        parts: dict[Table, defaultdict[tuple[int, int], list[Row]]] = {}
        for child in version.children:
            own = parts[child] = defaultdict(list)
            for row in self._rows(_of(child, owner), owners):
                own[row[0], row[1]].append((row[0], *row[2:]))
        for id_, since, until, *fields in self._rows(_of(version.table, owner), owners):
            rows = {child: own[id_, since] for child, own in parts.items()}
            rows[version.table] = [(id_, called[id_], *fields)]
            (made,) = tables.definitions(rows)
            text = canonical_text(names, made)
            if text == made.text:
                continue
            section = getattr(made, "section", kind)
            self._note(since, until, section, made.text, id_)
            changed.append(({owner: id_, "since": since}, {"text": text}))
            if kind == "formula":
                renamed[id_] = self._items[made.name] = formula_name(section, text)
        self._set(version.table, changed)
        keys = [({"id": id_}, {"name": name, "key": name}) for id_, name in renamed.items()]
        self._set(tables.identity, keys)

    def _atoms(
        self, identity: Table, arguments: Table, kind: str
    ) -> Iterator[tuple[list[dict[str, Any]], dict[int, str]]]:
        """Rewrite the texts of facts or fluents; yield their rows and new texts, in batches."""
        owner = arguments.primary_key.columns.values()[1].name
        heads = KIND_TABLES[kind].identity
        of: dict[int, str] = dict(self._session.rows(_all(heads, "id", "name"), kb=self._kb))
        for some in batches(self._mentions(arguments, owner)):
            ids = [row[0] for row in some]
            places = self._rows(_of(arguments, owner), ids)
            names = self._called(row[2] for row in places)
            given: defaultdict[int, list[str]] = defaultdict(list)
            for id_, _, object_id in places:
                given[id_].append(names[object_id])
            rows = self._dicts(identity, "id", ids)
            texts = {row["id"]: atom_text(of[row[f"{kind}_id"]], given[row["id"]]) for row in rows}
            self._set(identity, [({"id": id_}, {"text": text}) for id_, text in texts.items()])
            yield rows, texts

    def _fact_changes(self, rows: list[dict[str, Any]], texts: dict[int, str]) -> None:
        before = {row["id"]: row["text"] for row in rows}
        goals = {row["id"] for row in rows if row["is_goal"]}
        self._items.update((before[id_], texts[id_]) for id_ in goals)
        owner = "proposition_id"
        for id_, since, until in self._rows(_of(_HELD, owner, owner, "since", "until"), texts):
            self._note(since, until, GOAL if id_ in goals else FACT, before[id_], id_)
        for id_, since in self._rows(_of(_SEEN, owner, owner, "since"), texts):
            self._note(since, None, CONFIRMATION, before[id_], id_)
        self._sayings(_SAID, texts, lambda row: texts[row["proposition_id"]])

    def _values(self, texts: dict[int, str]) -> None:
        """Rewrite the texts of the values of fluents."""
        held, said = (self._dicts(table, _VALUE, texts) for table in (_VALUES, _SAID_VALUES))
        names = self._called(row["object_id"] for row in (*held, *said))

        def text_of(row: dict[str, Any]) -> str:
            fluent, object_id = texts[row[_VALUE]], row["object_id"]
            value = row["value"] if object_id is None else names[object_id]
            return fluent if value is None else value_text(fluent, value)

        changed = []
        for row in held:
            text = text_of(row)
            if text != row["text"]:
                self._note(row["since"], row["until"], VALUE, row["text"], row[_VALUE])
                own = {_VALUE: row[_VALUE], "since": row["since"]}
                changed.append((own, {"text": text}))
        self._set(_VALUES, changed)
        self._sayings(_SAID_VALUES, texts, text_of)

    def _sayings(
        self, table: Table, ids: Iterable[int], said: Callable[[dict[str, Any]], str]
    ) -> None:
        """Rewrite the texts of sayings."""
        owner = table.primary_key.columns.values()[1].name
        changed = []
        for row in self._dicts(table, owner, ids):
            holds = row.get("holds", (row.get("value"), row.get("object_id")) != (None, None))
            begin, end = (
                self._session.to_time(row[name]) for name in ("valid_from", "valid_until")
            )
            text = Period(begin, end, False).text(said(row), bool(holds))
            if text != row["text"]:
                self._note(row["since"], None, SAYING, row["text"], row[owner])
                changed.append(({owner: row[owner], "since": row["since"]}, {"text": text}))
        self._set(table, changed)

    def _documents(self, names: Definitions) -> None:
        """Rename the places of documents, and rewrite the texts of these documents."""
        changed, owners = [], set()
        key = "document_id", "since", "section", "position"
        for *own, name in self._session.rows(_all(_ITEMS, *key, "name"), kb=self._kb):
            new = self._items.get(name)
            if own[2] in ("object", "constant"):
                new = self._to.pseudonym if fold(name) == fold(self._to.name) else None
            if new is not None:
                owners.add(own[0])
                changed.append((dict(zip(key, own, strict=True)), {"name": new}))
        self._set(_ITEMS, changed)
        self._definitions("document", sorted(owners), names)

    def _executions(self, names: Definitions) -> set[int]:
        """Rewrite the texts of executions; return their plans."""
        key = "plan_id", "position"
        keys: set[Key] = {(row[0], row[1]) for row in self._mentions(_GIVEN, *key)}
        for table, columns in _FREE:
            query = _all(table, *key, *columns, given=columns)
            for plan, position, *texts in self._session.rows(query, kb=self._kb):
                if self._to.is_in(*texts):
                    keys.add((plan, position))
        for some in batches(sorted(keys)):
            self._of_executions({*some}, names)
        return {plan for plan, _ in keys if plan != NO_PLAN}

    def _of_executions(self, keys: set[Key], names: Definitions) -> None:
        given, outcomes = (self._by_key(table, keys) for table in (_GIVEN, _OUTCOMES))
        called = self._called(row[3] for rows in given.values() for row in rows)
        arguments, acts = [], []
        for key, rows in self._by_key(_EXECUTIONS, keys).items():
            ((_, _, since, start, duration, action_id, name, _),) = rows
            own, name = {"plan_id": key[0], "position": key[1]}, self._to.in_text(name)
            head = names.actions.live(action_id).name if name is None else quoted(name)
            words = [head]
            for _, _, argument, id_, value in given[key]:
                new = self._to.in_text(value)
                words.append(called[id_] if new is None else quoted(new))
                if new != value:
                    arguments.append(({**own, "argument": argument}, {"value": new}))
            text = f"({' '.join(words)})"
            acts.append((own, {"name": name, "text": text}))
            made = ExecutionDefinition(start, duration, action_id, name, (), text)
            self._outcomes(outcomes[key], key, since, made)
        self._set(_GIVEN, arguments)
        self._set(_EXECUTIONS, acts)

    def _by_key(self, table: Table, keys: set[Key]) -> defaultdict[Key, list[Row]]:
        """Read the rows of some executions."""
        of_none = (position for plan, position in sorted(keys) if plan == NO_PLAN)
        found = self._rows(_of(table, "position", plan_id=NO_PLAN), of_none)
        found += self._rows(_of(table, "plan_id"), sorted({plan for plan, _ in keys} - {NO_PLAN}))
        rows: defaultdict[Key, list[Row]] = defaultdict(list)
        for row in found:
            if (row[0], row[1]) in keys:
                rows[row[0], row[1]].append(row)
        return rows

    def _outcomes(
        self, rows: list[Row], key: Key, recorded: int, made: ExecutionDefinition
    ) -> None:
        """Rewrite the texts of the outcomes of an execution."""
        changed = []
        for _, _, since, until, kind, outcome, code, message, *times, text in rows:
            if kind == PLAN_STEP:
                continue
            moments = (None if at is None else self._session.to_time(at) for at in times)
            free = self._to.in_text(code), self._to.in_text(message)
            new = outcome_text(key, made, recorded, since, outcome, *free, *moments)
            if new != text:
                self._note(since, until, kind, text, *key)
                own = {"plan_id": key[0], "position": key[1], "since": since}
                changed.append((own, {"code": free[0], "message": free[1], "text": new}))
        self._set(_OUTCOMES, changed)

    def _plans(self, plans: set[int]) -> None:
        """Rewrite plans with these steps or texts, or made from a state with the object."""
        session, kb = self._session, self._kb
        plans |= {row[0] for row in session.rows(_PLANS_WITH, kb=kb, object=self._to.id)}
        free = _all(_PLANS, "id", *_FREE_OF_PLANS, given=_FREE_OF_PLANS)
        plans |= {row[0] for row in session.rows(free, kb=kb) if self._to.is_in(*row[1:])}
        step = "start", "duration", "action_id", "name", "text"
        for id_ in sorted(plans):
            ((_, since, *said, text),) = self._rows(_of(_PLANS, "id"), [id_])
            steps = tuple(
                ExecutionDefinition._make((*row[:4], (), row[4]))
                for row in self._rows(_of(_EXECUTIONS, "plan_id", *step), [id_])
            )
            given: dict[str, Any] = dict(zip(PlanDefinition._fields, (id_, *said), strict=False))
            given |= {name: self._to.in_text(given[name]) for name in _FREE_OF_PLANS}
            plan = PlanDefinition(**given, steps=steps)
            plan = plan._replace(problem_hash=self._problem_hash(plan))
            if plan.text != text:
                self._note(since, None, PLAN, text, id_)
                names = "problem_hash", *_FREE_OF_PLANS, "text"
                self._set(_PLANS, [({"id": id_}, {name: getattr(plan, name) for name in names})])

    def _problem_hash(self, plan: PlanDefinition) -> str:
        """Hash the planner's present input: the old hash would allow guesses of the name."""
        given: tuple[str | None, ...] = (plan.domain_pddl, plan.problem_pddl)
        if None in given:
            from ...documents.exchange import given_texts

            definitions = load_at(self._session, self._kb, plan.revision)
            view = View(self._session, self._kb, definitions, plan.revision)
            written = given_texts(view, self._name)
            given = tuple(b if a is None else a for a, b in zip(given, written, strict=True))
        return sha256("".join(map(str, given)).encode()).hexdigest()


_VALUE = "function_value_id"
