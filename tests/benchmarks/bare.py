"""The library's twin on the bare driver: hand-written SQL that keeps the very same history.

It writes the same rows into the same tables, one transaction for each call, with the head locked,
the names cached and the revision hashed. It leaves out what a program of one's own would leave out:
it checks nothing, redefines nothing, retries nothing, and its reads give PDDL text, not DTOs.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from functools import cache
from hashlib import sha256
from typing import Any

import kant_sql
from tests.benchmarks.drivers import Driver, Row

HEAD = "SELECT revision, definition_revision, next_id, hash, committed_at FROM head WHERE kb_id = ?"
MOVE_HEAD = (
    "UPDATE head SET revision = ?, definition_revision = ?, next_id = ?, hash = ?,"
    " committed_at = ? WHERE kb_id = ?"
)
ATOM = (
    "SELECT id FROM proposition"
    " WHERE kb_id = ? AND is_goal = ? AND predicate_id = ? AND arguments = ?"
)
# What differs between the revisions before `since` and before `until`, and all bits below.
BITS = "SELECT (since - 1 | (? - 1)) - (since - 1 & (? - 1)) AS bits"
for _shift in (1, 2, 4, 8, 16, 32):
    BITS = f"SELECT bits | (bits >> {_shift}) AS bits FROM ({BITS}) AS bits_{_shift}"
RETRACT_FACTS = (
    "UPDATE proposition_version SET until = ?,"
    f" fork = (SELECT ? - 1 - ((? - 1) & (bits >> 1)) FROM ({BITS}) AS bits)"
    " WHERE kb_id = ? AND until IS NULL"
)
RETRACT = RETRACT_FACTS + " AND proposition_id = ?"
RETRACT_ALL = "UPDATE {}_version SET until = ? WHERE kb_id = ? AND until IS NULL"
LIVE = "SELECT text FROM {}_version WHERE kb_id = ? AND until IS NULL"
LIVE_ATOMS = (
    "SELECT p.is_goal, p.text FROM proposition_version v"
    " JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id"
    " WHERE v.kb_id = ? AND v.until IS NULL"
)
OF_KIND = " AND v.is_goal = ?"
OF_PREDICATE = LIVE_ATOMS + " AND v.is_goal = false AND v.predicate_id = ?"
GOALS = LIVE_ATOMS + " AND v.is_goal = true"
DEFINITION = (
    "SELECT v.text FROM {0} e JOIN {0}_version v ON v.kb_id = e.kb_id AND v.{0}_id = e.id"
    " WHERE e.kb_id = ? AND e.key = ? AND v.until IS NULL"
)


ASSERT = "INSERT INTO proposition_version VALUES (?, ?, ?, ?, ?, ?, 0, ?, ?) ON CONFLICT DO NOTHING"


# Its id, its predicate, its text, and its first two arguments.
Atom = tuple[int, int, str, tuple[Any, ...]]


@cache
def insert(table: str, width: int) -> str:
    """Write the statement that inserts a row."""
    return f"INSERT INTO {table} VALUES ({', '.join('?' * width)})"


class Bare:
    """One component's own program: a connection, and the names that it has come to know."""

    def __init__(self, driver: Driver, name: str, actor: str) -> None:
        self.driver = driver
        self.run = driver.run
        self.name = name
        self.actor = actor
        self.kb = 1
        self.head_sql = HEAD + driver.lock
        self.ids: dict[tuple[str, str], int] = {}
        self.atoms: dict[Row, Atom] = {}
        self.changes: list[Row] = []
        self.number = self.next_id = 0
        self.defined = False

    def create(self) -> None:
        self.run(insert("knowledge_base", 2), (self.kb, self.name))
        # Written here, so without an origin.
        self.run(insert("head", 11), (self.kb, 0, 0, 1, None, None, 0, *[None] * 4))

    def close(self) -> None:
        self.driver.connection.close()

    # Writing: one transaction is one revision.

    def write(self, reason: str | None, calls: Iterable[tuple[Callable[..., None], Row]]) -> None:
        """Make calls in one transaction."""
        run = self.run
        run(self.driver.begin)
        head: Any = run(self.head_sql, (self.kb,)).fetchone()
        self.number, self.next_id = head[0] + 1, head[2]
        self.changes, self.defined = [], False
        for call, arguments in calls:
            call(*arguments)
        if not self.changes:
            run("ROLLBACK")
            return
        now = datetime.now(UTC).isoformat(timespec="microseconds")[:26] + "Z"
        seed = os.urandom(16)
        digest = self.digest(head[3], now, reason, seed)
        moment = self.driver.moment(now)
        revision = (self.kb, self.number, moment, self.actor, reason, None, 2, digest, None, seed)
        run(insert("revision", 10), revision)
        defined = self.number if self.defined else head[1]
        run(MOVE_HEAD, (self.number, defined, self.next_id, digest, moment, self.kb))
        run("COMMIT")

    def digest(self, previous: str | None, now: str, reason: str | None, seed: bytes) -> str:
        """Hash the revision, in form 2 of docs/hash.md."""

        def seal(label: str, text: str) -> str:
            salt = sha256(seed + label.encode() + b"\0" + text.encode()).digest()[:16]
            return sha256(salt + text.encode()).hexdigest()

        document = {
            "actor": seal("actor", self.actor),
            "changes": [
                (sign, kind, seal(sign + kind, text)) for sign, kind, text in sorted(self.changes)
            ],
            "committed_at": now,
            "form": 2,
            "knowledge_base": self.name,
            "number": self.number,
            "observed_at": None,
            "plan_step": None,
            "previous": previous,
            "reason": None if reason is None else seal("reason", reason),
            "source": None,
        }
        text = json.dumps(document, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
        return sha256(text.encode()).hexdigest()

    def save_proposition(self, dto: kant_sql.PddlPropositionDto) -> None:
        """Let a fact or a goal hold."""
        id_, predicate, text, first_two = self.atom(dto)
        row = (self.kb, id_, self.number, None, predicate, dto.is_goal, *first_two)
        if self.run(ASSERT, row).rowcount:
            self.changes.append(("+", "goal" if dto.is_goal else "fact", text))

    def delete_proposition(self, dto: kant_sql.PddlPropositionDto) -> None:
        """Let a fact or a goal hold no more."""
        id_, _, text, _ = self.atom(dto)
        if self.run(RETRACT, (*[self.number] * 5, self.kb, id_)).rowcount:
            self.changes.append(("-", "goal" if dto.is_goal else "fact", text))

    def atom(self, dto: kant_sql.PddlPropositionDto) -> Atom:
        """Find the identity of a proposition, or make it."""
        names = [object_.name.lower() for object_ in dto.objects]
        key = (dto.is_goal, dto.predicate.name.lower(), *names)
        known = self.atoms.get(key)
        if known is None:
            predicate, text = self.id("predicate", dto.predicate.name), str(dto)
            objects = [self.id("object", name) for name in names]
            arguments = " ".join(map(str, objects))
            row: Any = self.run(ATOM, (self.kb, dto.is_goal, predicate, arguments)).fetchone()
            id_ = row[0] if row else self.allocate()
            if not row:
                values = (self.kb, id_, predicate, dto.is_goal, arguments, text)
                self.run(insert("proposition", 6), values)
                self.driver.run_many(
                    insert("proposition_argument", 4),
                    [(self.kb, id_, place, object_) for place, object_ in enumerate(objects)],
                )
            known = self.atoms[key] = (id_, predicate, text, (*objects, None, None)[:2])
        return known

    def allocate(self) -> int:
        """Give out the next id."""
        self.next_id += 1
        return self.next_id - 1

    def id(self, kind: str, name: str) -> int:
        """Find the identity of a name, or make it."""
        key = name.lower()
        id_ = self.ids.get((kind, key))
        if id_ is None:
            sql = f"SELECT id FROM {kind} WHERE kb_id = ? AND key = ?"
            row: Any = self.run(sql, (self.kb, key)).fetchone()
            id_ = row[0] if row else self.allocate()
            if not row:
                self.run(insert(kind, 4), (self.kb, id_, name, key))
            self.ids[kind, key] = id_
        return id_

    def define(self, kind: str, id_: int, dto: kant_sql.Dto, *values: Any, after: Row = ()) -> None:
        """Write the version row of a definition: values before its text, and after it."""
        text = str(dto)
        row = (self.kb, id_, self.number, None, *values, text, *after)
        self.run(insert(f"{kind}_version", len(row)), row)
        self.changes.append(("+", kind, text))
        self.defined = True

    def save_type(self, dto: kant_sql.PddlTypeDto) -> None:
        parent = None if dto.parent is None else self.id("type", dto.parent.name)
        self.define("type", self.id("type", dto.name), dto, parent)

    def save_object(self, dto: kant_sql.PddlObjectDto) -> None:
        type_id = self.id("type", dto.type.name)
        self.define("object", self.id("object", dto.name), dto, type_id, after=(False,))

    def save_predicate(self, dto: kant_sql.PddlPredicateDto) -> None:
        id_ = self.id("predicate", dto.name)
        self.define("predicate", id_, dto)
        names = [f"{type_.name[:1]}{place}" for place, type_ in enumerate(dto.types)]
        self.save_parameters("predicate", id_, names, dto.types)

    def save_parameters(
        self, kind: str, id_: int, names: list[str], types: list[kant_sql.PddlTypeDto]
    ) -> None:
        """Write the parameters of a predicate or an action."""
        key, many = (self.kb, id_, self.number), self.driver.run_many
        rows = [(*key, place, name) for place, name in enumerate(names)]
        many(insert(f"{kind}_parameter", 5), rows)
        allowed = [
            (*key, place, 0, self.id("type", type_.name)) for place, type_ in enumerate(types)
        ]
        many(insert(f"{kind}_parameter_type", 6), allowed)

    def save_action(self, dto: kant_sql.PddlActionDto) -> None:
        """Define a durative action."""
        id_ = self.id("action", dto.name)
        self.define("action", id_, dto, after=(dto.keyword,))
        names = [parameter.name for parameter in dto.parameters]
        self.save_parameters("action", id_, names, [part.type for part in dto.parameters])
        key = (self.kb, id_, self.number)
        nodes: list[Row] = [
            (*key, "duration", 0, None, "=", None, None, None),
            (*key, "duration", 1, 0, "variable", None, None, "?duration"),
            (*key, "duration", 2, 0, "number", None, None, str(dto.duration)),
        ]
        terms: list[Row] = []
        for section, literals in (("condition", dto.conditions), ("effect", dto.effects)):
            literals_ = [
                part for part in literals if isinstance(part, kant_sql.PddlConditionEffectDto)
            ]
            self.add_tree((*key, section), names, literals_, nodes, terms)
        self.driver.run_many(insert("action_node", 10), nodes)
        self.driver.run_many(insert("action_term", 11), terms)

    def add_tree(
        self,
        key: Row,
        names: list[str],
        literals: Iterable[kant_sql.PddlConditionEffectDto],
        nodes: list[Row],
        terms: list[Row],
    ) -> None:
        """Add the nodes and the terms of a conjunction of literals, in preorder."""
        position = 0
        nodes.append((*key, 0, None, "and", None, None, None))
        for literal in literals:
            parent = 0
            for operator in [literal.time, *(["not"] if literal.is_negative else [])]:
                position += 1
                nodes.append((*key, position, parent, operator, None, None, None))
                parent = position
            position += 1
            predicate = self.id("predicate", literal.predicate.name)
            nodes.append((*key, position, parent, "predicate", predicate, None, None))
            for place, term in enumerate(literal.objects):
                is_parameter = term.name in names
                parameter = names.index(term.name) if is_parameter else None
                constant = None if is_parameter else self.id("object", term.name)
                terms.append((*key, position, place, parameter, constant, None, None, None))

    def delete_all_atoms(self, are_goals: bool) -> None:
        """Retract all facts, or all goals."""
        live = self.run(LIVE_ATOMS + OF_KIND, (self.kb, are_goals)).fetchall()
        self.changes += [("-", "goal" if is_goal else "fact", text) for is_goal, text in live]
        self.run(RETRACT_FACTS + " AND is_goal = ?", (*[self.number] * 5, self.kb, are_goals))

    def delete_all(self, kind: str) -> None:
        """Undefine all elements of a kind."""
        live = self.run(LIVE.format(kind), (self.kb,)).fetchall()
        self.changes += [("-", kind, text) for (text,) in live]
        self.defined = bool(live)
        self.run(RETRACT_ALL.format(kind), (self.number, self.kb))

    # Reading: one statement, which sees one state by itself.

    def get(self, kind: str, name: str) -> list[Row]:
        return self.run(DEFINITION.format(kind), (self.kb, name.lower())).fetchall()

    def get_by_predicate(self, name: str) -> list[Row]:
        """Read the facts of a predicate."""
        return self.run(OF_PREDICATE, (self.kb, self.id("predicate", name))).fetchall()

    def get_propositions(self) -> list[Row]:
        """Read the goals."""
        return self.run(GOALS, (self.kb,)).fetchall()
