"""The statements of questions: whether a condition holds, and for which objects.

A statement begins with the head, so the reader sees whether its definitions are still those of the
state.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ..knowledge.resolved import Bound, Column, NumberOf, Part, Slot
from .dialects.base import Row, Session
from .intervals import forks_at
from .relations import (
    ConditionCompiler,
    ConditionStatement,
    Iteration,
    delta_parameter,
    rows_parameter,
)

_HEAD = "(SELECT h.{0} FROM head AS h WHERE h.kb_id = :kb)"
_GUARD = f"{_HEAD.format('definition_revision')}, {_HEAD.format('archived_revision')}"
# The number of columns before those of the answers.
GUARDS = 2
_TO_JSON = json.JSONEncoder(separators=(",", ":")).encode


class Question(ConditionCompiler):
    """Writes one statement about one state."""

    def truths(self, parts: Iterable[Part], places: Mapping[Slot, str]) -> ConditionStatement:
        """Write the statement of whether parts hold, as 0 or 1."""
        found = [f"CASE WHEN {self.truth(part, places)} THEN 1 ELSE 0 END" for part in parts]
        return self.statement(f"SELECT {', '.join([_GUARD, *found])}")

    def answers(
        self, part: Part, columns: Sequence[Column], places: Mapping[Slot, str], is_limited: bool
    ) -> ConditionStatement:
        """Write the statement that finds the objects for which a part holds, as ids, in order.

        Its first row is the head.
        """
        select = self._answers(part, columns, places)
        width = max(len(columns), GUARDS)
        numbers = range(width)
        own = ", ".join(f"c{n}" if n < len(columns) else f"0 AS c{n}" for n in numbers)
        order = ", ".join(f"c{n}" for n in range(len(columns))) or "present"
        if is_limited:
            select = f"SELECT * FROM ({select}) AS found ORDER BY {order} LIMIT :most"
        head = ", ".join(
            f"{name} AS c{n}" for n, name in enumerate(["definition_revision", "archived_revision"])
        )
        head += "".join(f", 0 AS c{n}" for n in range(GUARDS, width))
        sorted_by = ", ".join(str(n + 1) for n in range(width + 1))
        return self.statement(
            f"SELECT 0 AS part, {head} FROM head WHERE kb_id = :kb "
            f"UNION ALL SELECT 1 AS part, {own} FROM ({select}) AS answers ORDER BY {sorted_by}"
        )

    def readable(
        self, part: Part, columns: Sequence[Column], places: Mapping[Slot, str], is_limited: bool
    ) -> ConditionStatement:
        """Write the statement that finds the names of those objects, for people."""
        select = self._answers(part, columns, places)
        if not columns:
            return self.statement(f"SELECT CASE WHEN EXISTS ({select}) THEN 1 ELSE 0 END AS holds")
        # No join: together with the condition's joins there might be too many tables.
        names = ", ".join(
            f"(SELECT o{n}.name FROM object AS o{n} WHERE o{n}.kb_id = :kb "
            f"AND o{n}.id = answers.c{n}) "
            f'AS "{column.name.replace(chr(34), chr(34) * 2)}"'
            for n, column in enumerate(columns)
        )
        order = ", ".join(f"answers.c{n}" for n in range(len(columns)))
        limit = " LIMIT :most" if is_limited else ""
        return self.statement(f"SELECT {names} FROM ({select}) AS answers ORDER BY {order}{limit}")

    def effects(
        self,
        condition: Part,
        bound: Sequence[Bound],
        numbers: Sequence[NumberOf],
        places: Mapping[Slot, str],
    ) -> ConditionStatement:
        """Write the statement of the objects and of exact numbers for which effects happen."""
        selection = self.selection([condition], bound, places)
        found = [selection.places[each.slot] for each in bound]
        found += [self.value_of(number, selection.places, "value") for number in numbers]
        distinct = "" if selection.is_distinct else "DISTINCT "
        return self.statement(selection.text(f"{distinct}{', '.join(found) or '1'}"))

    def touched(self, part: Part, places: Mapping[Slot, int], width: int) -> ConditionStatement:
        """Write the statement of the first row of the parameter `touched` for which a part holds.

        A row has the objects of the variables in `places`, among others.
        """
        relation = self.words.loops.rows("touched", width)
        truth = self.truth(part, {slot: f"touched.c{n}" for slot, n in places.items()})
        return self.statement(
            f"SELECT touched.place FROM {relation} AS touched WHERE {truth} LIMIT 1"
        )

    def held_facts(self, predicate: int, keys: Iterable[str]) -> ConditionStatement:
        """Write the statement of which facts of a predicate hold, by their arguments."""
        where = [*self._listed(predicate, keys), self.atom_holds("p")]
        return self.statement(
            f"SELECT p.arguments FROM proposition AS p WHERE {' AND '.join(where)}"
        )

    def ended_facts(self, predicate: int, keys: Iterable[str]) -> ConditionStatement:
        """Write the statement of the revision that last retracted each fact of a predicate."""
        until = " AND v.until <= :at" if self.is_past else ""
        last = (
            "SELECT v.until FROM proposition_version AS v WHERE v.kb_id = :kb AND "
            f"v.proposition_id = p.id AND v.until IS NOT NULL{until} "
            "ORDER BY v.since DESC LIMIT 1"
        )
        where = " AND ".join(self._listed(predicate, keys))
        return self.statement(f"SELECT p.arguments, ({last}) FROM proposition AS p WHERE {where}")

    def _listed(self, predicate: int, keys: Iterable[str]) -> list[str]:
        among = self.words.in_list.format("p.arguments", self.list_parameter(keys))
        return [*self.atom("p", predicate), among]

    def _answers(self, part: Part, columns: Sequence[Column], places: Mapping[Slot, str]) -> str:
        return self.rows([part], [column.bound for column in columns], places)


class Reader(NamedTuple):
    """Runs statements on a state, each after the computations that it needs."""

    session: Session
    kb: int | None
    at: int | None = None  # the revision; None for now

    def run(self, statement: ConditionStatement, given: Mapping[str, Any]) -> list[Row]:
        """Run a statement with the given parameters."""
        values = self._parameters(statement, given)
        for step in statement.steps:
            values.update(self._computed(step, values))
        return self.session.rows(statement.query, **values)

    def literal_values(
        self, statement: ConditionStatement, given: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the values of a statement's parameters, including computed ones."""
        values = {"kb": self.kb, **statement.values, **given}
        if self.at is not None:
            values |= {"at": self.at, "forks": forks_at(self.at)}
        computed: dict[str, Any] = {}
        for step in statement.steps:
            computed |= self._computed(step, {**given, **computed})
        return values | computed

    def _parameters(
        self, statement: ConditionStatement, given: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the values of a statement's parameters, in the driver's forms."""
        session, at = self.session, self.at
        values: dict[str, Any] = {"kb": self.kb, **given}
        for name, value in statement.values.items():
            values[name] = session.list_value(value) if isinstance(value, tuple) else value
        if at is not None:
            values["at"] = at
            if ":forks" in statement.sql:
                values["forks"] = session.list_value(forks_at(at))
        return values

    def _computed(self, step: Iteration, known: Mapping[str, Any]) -> dict[str, str]:
        """Compute a recursive component round by round; return the parameters of its facts."""
        found: dict[int, set[Row]] = {each: set() for each in step.arities}
        newest: dict[int, set[Row]] = {each: set() for each in step.arities}
        statement = step.first
        while True:
            values = self._parameters(statement, {**known, **_lists(found, newest)})
            rows = self.session.rows(statement.query, **values)
            for each in newest.values():
                each.clear()
            for predicate, *terms in rows:
                fact = tuple(terms[: step.arities[predicate]])
                if fact not in found[predicate]:
                    newest[predicate].add(fact)
            if step.further is None or not any(newest.values()):
                return _lists(found, {})
            for predicate, facts in newest.items():
                found[predicate] |= facts
            statement = step.further


def _lists(found: Mapping[int, set[Row]], newest: Mapping[int, set[Row]]) -> dict[str, str]:
    lists = {rows_parameter(each): _TO_JSON([*facts]) for each, facts in found.items()}
    lists |= {delta_parameter(each): _TO_JSON([*facts]) for each, facts in newest.items()}
    return lists
