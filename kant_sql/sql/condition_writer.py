"""Conditions as SQL: one statement for a condition without recursion, whatever its size.

A conjunction becomes a join of the facts that give its variables their objects; all else becomes a
filter of those rows: `EXISTS` for what is bound, `NOT EXISTS` for what is negated. The order of the
join is ours, because SQLite without statistics takes every index for equally good: first what
constants bind, then what is connected to it. A variable that no positive atom binds ranges over the
objects of its types. A rule that is not recursive is put in the place of its predicate, a recursive
one is a relation of the WITH clause, or of a parameter that `sql/answers.py` computes.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions
from ..knowledge.rules import DerivationRule, DerivationRules
from .comparisons import ComparisonWriter
from .dialects.words import COVERS, HEAD, RAW, Words
from .estimates import COUNTED, Size, domain_size, sample
from .intervals import MOST_FORKS

# The first arguments of a fact that its version has, too.
ARGUMENT_COLUMNS = ("first_object_id", "second_object_id")
# Rules take the place of their predicates up to this many; then they become relations.
MAX_INLINED = 60
# From this many ground facts of one predicate on, one list replaces as many lookups.
FEW_GROUND = 8
# To look up when an atom held takes as long as to read so many facts that held at a revision; so
# does to find those of one of the first arguments, which looks at all forks.
LOOKED_UP, FOUND = 4, 4

Places = Mapping[r.Slot, str]
_ALIAS = re.compile(r"\b([a-z]\d+)\.")
# A row looked up in a relation.
_LISTED = re.compile(r"\([^()]*\) IN \(SELECT c0")
# A table of the schema with its alias.
_STORED = re.compile(r"[a-z_]+ AS [a-z]\d+")
_COLUMN = re.compile(r"\b[a-z]\d+\.\w+")
# The facts of a valid time with some object.
_FOUND = "proposition_found"
# What begins the name of the relation of what held of a predicate, and a table that is that or of
# the schema: not what a recursive statement has found.
PAST = "past_"
_PLAIN = re.compile(rf"(?:{PAST}\w+|object_version|(?:proposition|function_value)\w*) AS ")


class JoinedTables:
    """The tables that a conjunction joins, and the conditions on their rows."""

    def __init__(self, words: Words, places: Places) -> None:
        self._words = words
        self.places: dict[r.Slot, str] = dict(places)
        self.tables: list[str] = []
        self.where: list[str] = []
        # By the alias of a table: the column that only the right index of it sorts by.
        self.sorted: dict[str, str] = {}
        # Whether each assignment of the variables is found once only.
        self.is_distinct = True

    def text(self, columns: str) -> str:
        """Write it as a SELECT."""
        if self._words.fence:
            return _select(*self._fenced(columns))
        if self._words.is_one_state:
            return _select(*self._listed(columns))
        return _select(self.tables, self.where, columns)

    def _parted(self) -> tuple[list[list[str]], list[tuple[int, str]]]:
        """Part the conditions: those of each stored table, and the others by their last table."""
        number = {table.split()[-1]: n for n, table in enumerate(self.tables)}
        own: list[list[str]] = [[] for _ in self.tables]
        rest: list[tuple[int, str]] = []
        for condition in self.where:
            last = max((number.get(alias, -1) for alias in _ALIAS.findall(condition)), default=-1)
            if last >= 0 and _STORED.fullmatch(self.tables[last]):
                own[last].append(condition)
            else:
                rest.append((last, condition))
        return own, rest

    def _listed(self, columns: str) -> tuple[list[str], list[str], str]:
        """Look up facts of valid time by what the tables before them found.

        SQLite has no lateral subqueries, but a table-valued function takes one as its argument.
        """
        own, rest = self._parted()
        tables, where = [], [condition for _, condition in rest]
        for n, table in enumerate(self.tables):
            if not n or not table.startswith(_FOUND):
                tables.append(table)
                where += own[n]
                continue
            later = [*where, *chain(*own[n + 1 :]), columns]
            listed, rename = _as_list(table, own[n], later)
            tables.append(listed)
            own[n + 1 :] = [[*map(rename, texts)] for texts in own[n + 1 :]]
            where, columns = [*map(rename, where)], rename(columns)
        return tables, where, columns

    def _fenced(self, columns: str) -> tuple[list[str], list[str], str]:
        """Keep a planner to the order of the tables: each one looks up what those before found.

        Without statistics PostgreSQL takes every lookup for one row, whatever index finds it, and
        then any order and any index are as good to it as the best.
        """
        own, rest = self._parted()
        tables: list[str] = []
        for n, table in enumerate(self.tables):
            alias = table.split()[-1]
            if n and table.startswith(PAST) and all(map(_PLAIN.match, self.tables[:n])):
                # A relation is joined in this order, too, and by hashes: the planner takes what was
                # found before for many rows.
                where = [condition for last, condition in rest if last < n]
                later = [*(text for last, text in rest if last >= n), *chain(*own[n:]), columns]
                many = [*tables, f"{self._words.many} AS m{alias[1:]}"]
                group, rename = _grouped(f"g{alias[1:]}", many, where, later)
                tables = [f"({group}{self._words.fence}) AS g{alias[1:]}"]
                rest = [(last, rename(text)) for last, text in rest if last >= n]
                own[n:] = [[rename(text) for text in texts] for texts in own[n:]]
                columns = rename(columns)
            select = f"SELECT {alias}.* FROM {table} WHERE {balanced('AND', own[n])}"
            if alias in self.sorted:
                select += f" ORDER BY {alias}.{self.sorted[alias]}"
            fenced = f"LATERAL ({select}{self._words.fence}) AS {alias}"
            tables.append(fenced if own[n] else table)
        return tables, [condition for _, condition in rest], columns


def _select(tables: Sequence[str], where: Sequence[str], columns: str) -> str:
    sql = f"SELECT {columns}"
    if tables:
        sql += " FROM " + " CROSS JOIN ".join(tables)
    if where:
        sql += f" WHERE {balanced('AND', where)}"
    return sql


def _grouped(
    name: str, tables: Sequence[str], where: Sequence[str], later: Iterable[str]
) -> tuple[str, Callable[[str], str]]:
    """Write a join as one table; return what renames its columns in the texts that follow."""
    own = _used({table.split()[-1] for table in tables}, later)
    names = {one: f"{name}.{one.replace('.', '_')}" for one in own}
    listed = ", ".join(f"{one} AS {one.replace('.', '_')}" for one in own) or "1 AS present"
    return _select(tables, where, listed), _renaming(names)


def _as_list(
    table: str, where: Sequence[str], later: Iterable[str]
) -> tuple[str, Callable[[str], str]]:
    """Write rows of a table as a list; return what renames its columns in the texts that follow."""
    alias = table.split(" AS ")[1]
    own = _used({alias}, later)
    names = {one: f"json_extract({alias}.value, '$[{n}]')" for n, one in enumerate(own)}
    listed = ", ".join(f"{one} AS c{n}" for n, one in enumerate(own)) or "1 AS present"
    entry = f"json_array({', '.join(f'c{n}' for n in range(len(own)))})"
    # With a limit it stays apart from what lists it, but what it reads may become parts of it.
    rows = f"SELECT {listed} FROM {table} WHERE {balanced('AND', where)} LIMIT -1"
    sql = f"json_each((SELECT json_group_array({entry}) FROM ({rows})))"
    return f"{sql} AS {alias}", _renaming(names)


def _used(aliases: AbstractSet[str], later: Iterable[str]) -> list[str]:
    """Return the columns of some tables that texts name."""
    used = dict.fromkeys(found[0] for text in later for found in _COLUMN.finditer(text))
    return [one for one in used if one.split(".")[0] in aliases]


def _renaming(names: Mapping[str, str]) -> Callable[[str], str]:
    return lambda text: _COLUMN.sub(lambda found: names.get(found[0], found[0]), text)


def balanced(operator: str, parts: Sequence[str]) -> str:
    """Write a chain of operands as a balanced tree: a database limits the depth of expressions."""
    if len(parts) <= 100:
        return f" {operator} ".join(parts)
    half = len(parts) // 2
    sides = balanced(operator, parts[:half]), balanced(operator, parts[half:])
    return f"({sides[0]}) {operator} ({sides[1]})"


def _without_repeats(parts: Sequence[r.Part]) -> Sequence[r.Part]:
    """Leave out facts that repeat; other parts may be too deep to be compared."""
    seen: set[r.Part] = set()
    found = []
    for part in parts:
        if isinstance(part.part if isinstance(part, r.Lacks) else part, r.HoldsFact):
            if part in seen:
                continue
            seen.add(part)
        found.append(part)
    return found


@dataclass(eq=False)
class ConditionWriter(ABC):
    """Writes the conditions of one statement.

    A past state is that of the parameter `at`. `asked` is how often what is being written is
    evaluated, about.
    """

    words: Words
    definitions: Definitions
    is_past: bool
    size: Size | None
    rules: DerivationRules
    # Numbers that come with each evaluation, such as a duration: parameters of that name.
    known_numbers: frozenset[str] = frozenset()
    asked: float = 1.0
    values: dict[str, Any] = field(default_factory=dict)
    # Recursive predicates that are being computed -> the table that has them so far.
    growing: dict[int, str] = field(default_factory=dict)
    # The tables of the WITH clause, and their names by what they have.
    _tables: list[str] = field(default_factory=list)
    _relations: dict[Any, str] = field(default_factory=dict)
    _types: dict[r.Slot, tuple[r.TypeSet, ...]] = field(default_factory=dict)
    _parameters: dict[tuple[type[Any], Any, bool], str] = field(default_factory=dict)
    _aliases: int = 0
    _inlined: int = 0

    # Estimates.

    @contextmanager
    def asking(self, asked: float) -> Iterator[None]:
        """Write what is evaluated so many times."""
        before, self.asked = self.asked, asked
        try:
            yield
        finally:
            self.asked = before

    def facts_of(self, predicate: int, compared: float = 0) -> float:
        """Estimate how many facts of a predicate hold, to compare them with a number."""
        return COUNTED if self.size is None else self.size.facts(predicate, compared)

    def found_by(self, position: int, term: r.Place, types: r.TypeSet) -> float:
        """Estimate what it takes to find the facts with an object, in lookups of an atom.

        By an argument that has no index, all atoms of any time that mention it are looked up.
        """
        if position < len(ARGUMENT_COLUMNS):
            return FOUND
        if self.size is None:
            return 1
        is_known = isinstance(term, r.Known)
        objects = (term.id,) if is_known else sample(self.definitions, types)  # type: ignore[union-attr]
        return self.size.mentions(objects)

    def is_read(self, predicate: int, lookups: float, given: Iterable[int] = ()) -> bool:
        """Return whether to read all that held of a predicate, and not to look up some atoms.

        `given` are the arguments, of the first ones, that what is read has.
        """
        if not self.is_past or self.size is None or lookups <= 1:
            return False
        parameters = self.definitions.predicates.live(predicate).parameters
        for n in given:
            types = r.closure(self.definitions, parameters[n].type_ids)
            lookups *= domain_size(self.definitions, types)
        return LOOKED_UP * lookups > self.facts_of(predicate, LOOKED_UP * lookups)

    # Parameters and names.

    def parameter(self, value: Any, is_number: bool = False) -> str:
        """Bind a value; return the parameter as it stands in the text.

        A server gives a parameter one type: the text of a number is not that of an id.
        """
        key = (type(value), value, is_number)
        name = self._parameters.get(key)
        if name is None:
            name = self._parameters[key] = f"v{len(self._parameters)}"
            self.values[name] = value
        return f":{name}"

    def list_parameter(self, values: Iterable[Any]) -> str:
        """Bind a list."""
        return self.parameter(tuple(values))

    def alias(self, letter: str) -> str:
        """Make the alias of a table."""
        self._aliases += 1
        return f"{letter}{self._aliases}"

    def place(self, term: r.Place, places: Places) -> str:
        """Write a term that is bound."""
        return self.parameter(term.id) if isinstance(term, r.Known) else places[term]

    def held(self, alias: str, unsought: str = "") -> str:
        """Write that a version held in the state."""
        if not self.is_past:
            return f"{alias}.until IS NULL"
        return f"{unsought}{alias}.since <= :at AND ({alias}.until IS NULL OR {alias}.until > :at)"

    def facts(self, by_object: bool) -> str:
        """Name the table of the facts that held, or of those with some object."""
        if not self.words.is_one_state:
            return "proposition_version"
        return _FOUND if by_object else "proposition_held"

    def exists(self, tables: str, where: Sequence[str]) -> str:
        """Write that there is a row, which is looked up for each one that asks."""
        return f"EXISTS (SELECT 1 FROM {tables} WHERE {' AND '.join(where)}{self.words.fence})"

    def _key(self, terms: Sequence[r.Place], places: Places) -> str:
        """Write the text that interns an atom or a fluent: the ids of its objects."""
        if all(isinstance(term, r.Known) for term in terms):
            return self.parameter(" ".join(str(term.id) for term in terms))  # type: ignore[union-attr]
        parts = [f"CAST({self.place(term, places)} AS TEXT)" for term in terms]
        return " || ' ' || ".join(parts)

    # Conditions on what is bound.

    def truth(self, part: r.Part, places: Places) -> str:
        """Write a part whose variables are bound as a condition that is true or false."""
        match part:
            case r.HoldsFact():
                holds = self._derived_holds if self.is_derived(part) else self._stored_holds
                return holds(part, places)
            case r.FluentIs(function, terms, value):
                versions, where = self.value_version(function, terms, places)
                where.append(f"{versions.split()[-1]}.object_id = {self.place(value, places)}")
                return self.exists(versions, where)
            case r.SameObject(left, right):
                return f"{self.place(left, places)} = {self.place(right, places)}"
            case r.HasType(term, types):
                return self.has_type(term, types, places)
            case r.Compares(operator, left, right):
                return ComparisonWriter(self, places).text(operator, left, right)
            case r.Lacks(inner):
                text = self.truth(inner, places)
                # For NOT IN, SQLite looks for NULL in all rows of the list, for each row that asks.
                is_listed = _LISTED.match(text) is not None
                return f"({text}) IS NOT TRUE" if is_listed else f"NOT ({text})"
            case r.AllOf(parts) | r.OneOf(parts):
                return self._junction(part, parts, places)
            case r.Witness(bound, inner):
                selection = self.selection([inner], bound, places)
                if not selection.tables:
                    own = balanced("AND", selection.where)
                    return f"({own})" if own else "TRUE"
                return f"EXISTS ({selection.text('1')})"

    def _junction(self, part: r.AllOf | r.OneOf, parts: Sequence[r.Part], places: Places) -> str:
        is_all = isinstance(part, r.AllOf)
        if not parts:
            return "TRUE" if is_all else "FALSE"
        found = self.operands(parts, places, is_all)
        return f"({balanced('AND' if is_all else 'OR', found)})"

    def operands(self, parts: Sequence[r.Part], places: Places, is_all: bool) -> list[str]:
        """Write the parts of a conjunction, or of a disjunction."""
        found, rest = self._ground_lists(parts, is_all)
        return found + [self.truth(part, places) for part in rest]

    def _ground_lists(
        self, parts: Sequence[r.Part], is_all: bool
    ) -> tuple[list[str], Sequence[r.Part]]:
        """Write many ground facts of one predicate with one list; return the other parts."""
        parts = _without_repeats(parts)
        if len(parts) < FEW_GROUND:
            return [], parts
        groups: dict[tuple[int, bool], dict[str, None]] = {}
        rest: list[r.Part] = []
        for part in parts:
            fact = part.part if isinstance(part, r.Lacks) else part
            is_ground = (
                isinstance(fact, r.HoldsFact)
                and bool(fact.terms)
                and not self.rules.of(fact.predicate)
                and all(isinstance(term, r.Known) for term in fact.terms)
            )
            if is_ground:
                assert isinstance(fact, r.HoldsFact)
                key = " ".join(str(term.id) for term in fact.terms)  # type: ignore[union-attr]
                groups.setdefault((fact.predicate, isinstance(part, r.Lacks)), {})[key] = None
            else:
                rest.append(part)
        found = []
        for (predicate, is_negative), keys in groups.items():
            atom = self.alias("p")
            among = self.words.in_list.format(f"{atom}.arguments", self.list_parameter(keys))
            where = " AND ".join([*self.atom(atom, predicate), among, self.atom_holds(atom)])
            held = f"(SELECT count(*) FROM proposition AS {atom} WHERE {where})"
            # All hold, none holds, one holds, one does not.
            compared = {
                (True, False): f"= {len(keys)}",
                (True, True): "= 0",
                (False, False): "> 0",
                (False, True): f"< {len(keys)}",
            }[is_all, is_negative]
            found.append(f"{held} {compared}")
        return found, rest

    def argument(self, alias: str, of: str, position: int, table: str = "proposition") -> list[str]:
        """Write that a row is the argument at a position of an identity, given by its id."""
        return [
            f"{alias}.kb_id = :kb",
            f"{alias}.{table}_id = {of}",
            f"{alias}.position = {position}",
        ]

    def atom(self, alias: str, predicate: int, column: str = "predicate_id") -> list[str]:
        """Write that an interned atom is a fact of a predicate."""
        return [
            f"{alias}.kb_id = :kb",
            self.words.is_fact.format(alias),
            f"{alias}.{column} = {self.parameter(predicate)}",
        ]

    def atom_holds(self, atom: str) -> str:
        """Write that an interned atom holds."""
        version = self.alias("v")
        key = f"{version}.kb_id = :kb AND {version}.proposition_id = {atom}.id"
        if self.words.is_one_state:
            return self._true_of(atom, version, key)
        if not self.is_past:
            where = [key, f"{version}.until IS NULL"]
            return self.exists(f"proposition_version AS {version}", where)
        # The last version that began by then: a fact may have come and gone a million times.
        return (
            f"COALESCE((SELECT COALESCE({version}.until, :at + 1) FROM proposition_version AS "
            f"{version} WHERE {key} AND {version}.since <= :at ORDER BY {version}.since DESC "
            "LIMIT 1), 0) > :at"
        )

    def _true_of(self, atom: str, version: str, key: str) -> str:
        """Write that an atom held in valid time: as was last said, or else as it was known then."""
        said = self._said("proposition", f"{atom}.id", "CASE WHEN s.holds THEN 2 ELSE 1 END")
        return (
            f"COALESCE({said}, (SELECT CASE WHEN {version}.until <= :valid_state THEN 1 ELSE 2 END "
            f"FROM {RAW}proposition_version AS {version} WHERE {key} AND {version}.since <= "
            f":valid_state ORDER BY {version}.since DESC LIMIT 1), 1) = 2"
        )

    def _said(self, table: str, id_: str, wanted: str) -> str:
        """Write a lookup of what was last said of one element that covers the time."""
        return (
            f"(SELECT {wanted} FROM {table}_saying AS s WHERE {COVERS.format('s')} AND "
            f"s.{table}_id = {id_} ORDER BY s.since + 0 DESC LIMIT 1)"
        )

    def is_derived(self, fact: r.HoldsFact) -> bool:
        """Return whether rules count for a fact."""
        if fact.is_stored:
            return False
        return fact.predicate in self.growing or bool(self.rules.of(fact.predicate))

    def _stored_holds(self, fact: r.HoldsFact, places: Places) -> str:
        terms = fact.terms
        if not self.is_past and len(terms) <= len(ARGUMENT_COLUMNS):
            version = self.alias("v")
            where = self.versions(version, fact.predicate)
            where += [
                f"{version}.{column} = {self.place(term, places)}"
                for column, term in zip(ARGUMENT_COLUMNS, terms, strict=False)
            ]
            return self.exists(f"proposition_version AS {version}", where)
        given = {
            n: self.place(term, places)
            for n, term in enumerate(terms[: len(ARGUMENT_COLUMNS)])
            if self.is_given(term, places)
        }
        if len(given) < len(terms) and self.is_read(fact.predicate, self.asked, given):
            others = {n: term for n, term in enumerate(terms) if n not in given}
            relation = self.past(fact.predicate, len(terms), given)
            return self.words.looked_up.format(self._listed_in(relation, others, places))
        atom = self.alias("p")
        where = self.atom(atom, fact.predicate)
        where += [f"{atom}.arguments = {self._key(terms, places)}", self.atom_holds(atom)]
        return self.exists(f"proposition AS {atom}", where)

    def versions(self, alias: str, predicate: int, unsought: str = "") -> list[str]:
        """Write that a version is that of a fact of a predicate that holds in the state."""
        return [
            f"{alias}.kb_id = :kb",
            f"{alias}.predicate_id = {self.parameter(predicate)}",
            self.words.is_fact.format(alias),
            self.held(alias, unsought),
        ]

    def _derived_holds(self, fact: r.HoldsFact, places: Places) -> str:
        body = self.inline(fact)
        if body is not None:
            return self.truth(body, places)
        given = {n: term for n, term in enumerate(fact.terms) if self.is_given(term, places)}
        # PostgreSQL before 16 refuses a subquery in FROM without an alias.
        relation = f"{self.relation(fact, given, places)} AS facts"
        if not fact.terms:
            return f"EXISTS (SELECT 1 FROM {relation})"
        return self._listed_in(relation, dict(enumerate(fact.terms)), places)

    def _listed_in(self, relation: str, terms: Mapping[int, r.Place], places: Places) -> str:
        """Write that a relation has some terms at some positions."""
        # Uncorrelated, so that SQLite builds one index for all rows that ask.
        values = ", ".join(self.place(term, places) for term in terms.values())
        columns = ", ".join(f"c{n}" for n in terms)
        return f"({values}) IN (SELECT {columns} FROM {relation})"

    def has_type(self, term: r.Place, types: r.TypeSet, places: Places) -> str:
        """Write that an object has one of some types."""
        if types is None:
            return "TRUE"
        if isinstance(term, r.Known):
            return "TRUE" if r.fits(self.definitions, term.id, types) else "FALSE"
        version = self.alias("o")
        where = [f"{version}.object_id = {places[term]}", *self.objects(version, (types,))]
        return self.exists(f"object_version AS {version}", where)

    def objects(self, alias: str, types: Iterable[r.TypeSet]) -> list[str]:
        """Write that a version is that of an object of each of some type sets."""
        where = [f"{alias}.kb_id = :kb", self.held(alias)]
        for each in types:
            if each is not None:
                ids = self.list_parameter(sorted(each))
                first = self.words.in_list.format(f"{alias}.type_id", ids)
                # Those that are declared with `either` have further types.
                other = self.words.in_list.format("e.type_id", ids)
                where.append(
                    f"({first} OR ({alias}.object_id, {alias}.since) IN (SELECT e.object_id, "
                    f"e.since FROM object_type AS e WHERE e.kb_id = :kb AND {other}))"
                )
        return where

    # Numbers.

    def value_of(self, fluent: r.NumberOf, places: Places, column: str) -> str:
        """Write a column of the version of a fluent; NULL without a value."""
        versions, where = self.value_version(fluent.function, fluent.terms, places)
        alias = versions.split()[-1]
        return f"(SELECT {alias}.{column} FROM {versions} WHERE {' AND '.join(where)})"

    def value_version(
        self, function: int, terms: Sequence[r.Place], places: Places, is_joined: bool = False
    ) -> tuple[str, list[str]]:
        """Write the version of a fluent whose arguments are bound, as a table and conditions.

        As `is_joined`, other tables of the same FROM may bind the arguments.
        """
        fluent, version = self.alias("f"), self.alias("w")
        # No join: without statistics PostgreSQL would read all values for each one that it needs.
        id_ = (
            f"SELECT {fluent}.id FROM function_value AS {fluent} WHERE {fluent}.kb_id = :kb "
            f"AND {fluent}.function_id = {self.parameter(function)} "
            f"AND {fluent}.arguments = {self._key(terms, places)}"
        )
        where = [
            f"{version}.kb_id = :kb",
            f"{version}.function_value_id = ({id_})",
            self.held(version),
        ]
        if not self.is_past:
            return f"function_value_version AS {version}", where
        # The last that began by then; a fluent may have had a million values.
        last, is_one = self.alias("w"), self.words.is_one_state
        table, at = (RAW, ":valid_state") if is_one else ("", ":at")
        newest = (
            f"FROM {table}function_value_version AS {last} WHERE {last}.kb_id = :kb "
            f"AND {last}.function_value_id = ({id_}) AND {last}.since <= {at} "
            f"ORDER BY {last}.since DESC LIMIT 1"
        )
        if not is_one and not is_joined:
            held = f"({version}.until IS NULL OR {version}.until > :at)"
            return f"(SELECT {last}.* {newest}) AS {version}", [held]
        since = f"(SELECT {last}.since {newest})"
        if not is_one:
            where.append(f"{version}.since = {since}")
            return f"function_value_version AS {version}", where
        since = f"COALESCE({self._said('function_value', f'({id_})', 's.since')}, {since})"
        key, given = f"{version}.function_value_id, {version}.since", f"({id_}), {since}"
        # With a bound of revisions, without statistics, their index is as good as that of the key.
        where = [f"{version}.kb_id = :kb", self.words.is_row.format(key, given)]
        return f"function_value_found AS {version}", where

    # Joins.

    @abstractmethod
    def selection(
        self, parts: Iterable[r.Part], bound: Iterable[r.Bound], places: Places
    ) -> JoinedTables:
        """Join what gives variables their objects, and filter by all else."""

    @abstractmethod
    def relation(self, fact: r.HoldsFact, given: Mapping[int, r.Place], places: Places) -> str:
        """Return the table of a recursive predicate, with columns `c0` ...

        The facts with the given terms are complete in it; it may lack others.
        """

    # Tables of the WITH clause.

    def _table(self, name: str, columns: int, sql: str, kind: str = "") -> None:
        """Add a table of the WITH clause."""
        listed = ", ".join(f"c{n}" for n in range(columns)) or "present"
        self._tables.append(f"{name} ({listed}) AS {kind}({sql})")

    def forks(self) -> str:
        """Return the table of the forks of the past state, with the column `value`."""
        # Written out each time, with their number: what is read twice SQLite takes for a million
        # rows, and with statistics reads a whole table to filter what they are joined to.
        listed = f"{self.words.each.format(':forks')} AS f WHERE f.value <= {HEAD}"
        return f"(SELECT f.value FROM {listed} LIMIT {MOST_FORKS})"

    def past(self, predicate: int, arity: int, given: Mapping[int, str]) -> str:
        """Return the relation of the facts of a predicate that held, with columns `c0` ...

        `given` has the parameters for some terms.
        """
        key = ("past", predicate, *sorted(given.items()))
        name = self._relations.get(key)
        if name is not None:
            return name
        name = f"{PAST}{predicate}" + (f"_{len(self._tables)}" if given else "")
        self._relations[key] = name
        # The forks as a table: for `fork IN` a planner without statistics expects few rows, and
        # then compares all of them with each row that they are joined to.
        selection = JoinedTables(self.words, {})
        found = any(n < len(ARGUMENT_COLUMNS) for n in given)
        if not self.words.is_one_state:
            selection.tables = [f"{self.forks()} AS f0"]
            selection.where = ["v0.fork = f0.value"]
            if found:
                selection.sorted["v0"] = "since"
        selection.tables.append(f"{self.facts(found)} AS v0")
        selection.where += self.versions(
            "v0", predicate, "" if found else self.words.loops.unsought
        )
        columns = [f"v0.{column}" for column in ARGUMENT_COLUMNS[:arity]]
        for n in range(len(columns), arity):
            selection.tables.append(f"proposition_argument AS a{n}")
            selection.where += self.argument(f"a{n}", "v0.proposition_id", n)
            columns.append(f"a{n}.object_id")
        selection.where += [f"{columns[n]} = {place}" for n, place in given.items()]
        sql = selection.text(", ".join(columns) or "1")
        self._table(name, arity, sql, "MATERIALIZED ")
        return name

    def types_of(self, slot: r.Slot) -> tuple[r.TypeSet, ...]:
        """Return the type sets that the objects of a variable fit."""
        return self._types.get(slot, ())

    def declare(self, bound: Iterable[r.Bound]) -> None:
        """Note the types of variables."""
        for each in bound:
            self._types[each.slot] = each.types

    # DerivationRules.

    def inline(self, fact: r.HoldsFact) -> r.Part | None:
        """Return what implies a derived fact; None if its rules are recursive or too many."""
        if fact.predicate in self.growing:
            return None
        if self.rules.is_recursive(fact.predicate) or self._inlined >= MAX_INLINED:
            return None
        rules = self.rules.evaluated(fact.predicate)
        self._inlined += len(rules)
        stored = r.HoldsFact(fact.predicate, fact.terms, is_stored=True)
        return r.OneOf((*(self.instance(rule, fact.terms) for rule in rules), stored))

    def instance(self, rule: DerivationRule, terms: Sequence[r.Place]) -> r.Part:
        """Return the body of a rule for some terms, with the types of its parameters."""
        places = {
            parameter.slot: term for parameter, term in zip(rule.parameters, terms, strict=True)
        }
        body = r.replaced(rule.body, places, self.rules.numbers)
        typed = [
            r.HasType(term, types)
            for parameter, term in zip(rule.parameters, terms, strict=True)
            for types in parameter.types
            if types is not None
        ]
        return r.AllOf((*typed, body)) if typed else body

    def is_given(self, term: r.Place, places: Places) -> bool:
        """Return whether a term is a parameter of the statement."""
        return isinstance(term, r.Known) or places.get(term, "").startswith(":")
