"""The tables and rows of each kind of element, and its version table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter, itemgetter
from types import MappingProxyType
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    Boolean,
    ColumnElement,
    FromClause,
    ScalarSelect,
    Select,
    Table,
    and_,
    bindparam,
    case,
    delete,
    null,
    or_,
    select,
    update,
)

from ..knowledge.definitions import (
    CONDITION,
    DURATION,
    EFFECT,
    ActionDefinition,
    DocumentDefinition,
    FormulaDefinition,
    FunctionDefinition,
    Item,
    ObjectDefinition,
    PredicateDefinition,
    RuleDefinition,
    TypeDefinition,
)
from ..knowledge.trees import ParameterDefinition, TreeNode, TreeTerm
from . import tables as t
from .dialects.base import Row
from .query import AtKey, IdsQuery, Insert, Query, constant, first_rows, in_rows

KB: ColumnElement[int] = bindparam("kb", type_=BigInteger)
THEN: ColumnElement[int] = bindparam("at", type_=BigInteger)


def held_at(table: Any, at: ColumnElement[int] = THEN) -> ColumnElement[bool]:
    """Return whether a version held at a revision."""
    return and_(table.since <= at, or_(table.until.is_(None), table.until > at))


def table_of(mapped: type[t.Base]) -> Table:
    """Return the table of a class."""
    return mapped.__table__


def columns_of(table: Table, names: Iterable[str], *order: str) -> Query:
    """Read columns of the rows of one knowledge base, sorted by some of them."""
    rows = select(*(table.c[name] for name in names)).where(table.c.kb_id == KB)
    return Query(rows.order_by(*(table.c[name] for name in order)))


def looked_up(
    wanted: Any, column: ColumnElement[int], value: Any, *conditions: ColumnElement[bool]
) -> ScalarSelect[Any]:
    """Look up one row for each row of the query around it, by the last column of a key.

    The parameter names the knowledge base: comparing the columns of the two rows would have the
    same result, but a cluster would search all shards. Sorted by the key: PostgreSQL without
    statistics rates any index that begins with `kb_id` as good as that of the key.
    """
    found = select(wanted).where(column.table.c.kb_id == KB, *conditions)
    found = found.where(AtKey(column, value)).order_by(column)
    return first_rows(found, 1).correlate_except(column.table).scalar_subquery()


def made_here(table: FromClause) -> tuple[ColumnElement[bool], ...]:
    """Return the conditions that a row belongs to the uncommitted revision."""
    return table.c.kb_id == KB, table.c.since == THEN


_NOTHING: Mapping[str, Any] = MappingProxyType({})


class VersionTable:
    """A version table, and the statements that change its rows.

    All of them take the parameters `kb` and `id`; `at` is the number of the uncommitted revision.

    Attributes:
        owner: the column that names the element, or the last part of its key.
        children: the tables of the lists of each version.
        close: ends open versions.
        reopen: opens versions that this revision ended.
        unmake: deletes versions of this revision, after the rows below them.
    """

    def __init__(
        self,
        owner: str,
        table: Table,
        *children: Table,
        closed: Mapping[str, Any] = _NOTHING,
        opened: Mapping[str, Any] = _NOTHING,
        within: Callable[[FromClause], tuple[ColumnElement[bool], ...]] = lambda _: (),
    ) -> None:
        """Build the statements.

        Args:
            owner: the name of the column.
            children: the tables of the lists of each version, parents first.
            closed: the further values of a version that ends.
            opened: the further values of an open version.
            within: the conditions on the rest of the key.
        """
        self.table = table
        self.owner: ColumnElement[int] = table.c[owner]
        self.children = children

        def is_open(version: FromClause) -> tuple[ColumnElement[bool], ...]:
            return version.c.kb_id == KB, *within(version), version.c.until.is_(None)

        def ends_here(version: FromClause) -> tuple[ColumnElement[bool], ...]:
            return version.c.kb_id == KB, *within(version), version.c.until == THEN

        change = update(table)
        self.close = IdsQuery(change.values(until=THEN, **closed), self.owner, is_open)
        self.reopen = IdsQuery(change.values(until=null(), **opened), self.owner, ends_here)
        # Only rows of the uncommitted revision, which no other session has seen. An open version
        # that this transaction deletes belongs to that revision: without children, the index of
        # open versions finds it.
        self.unmake: tuple[IdsQuery, ...] = (IdsQuery(delete(table), self.owner, is_open),)
        if children:
            self.unmake = tuple(
                IdsQuery(delete(each), each.c[owner], made_here)
                for each in (*reversed(children), table)
            )


def is_of_version(
    child: Table, version: Table, owner: str, which: ColumnElement[bool]
) -> tuple[ColumnElement[bool], ...]:
    """Return the condition that a row belongs to a version that fulfils a condition."""
    of_one = version.c.since == child.c.since
    exactly = looked_up(version.c.since, version.c[owner], child.c[owner], of_one, which)
    owners = select(version.c[owner]).where(which)
    return in_rows(child.c[owner], owners), exactly.is_not(None)


RowsByTable = dict[Table, list[Row]]


def _values(names: Sequence[str]) -> Callable[[Any], Row]:
    """Return a function that reads some attributes, as a tuple."""
    if len(names) == 1:
        return lambda entry: (getattr(entry, names[0]),)
    return attrgetter(*names)


class ListTable:
    """The table of a list in a definition, or in an entry of another list.

    Its key is that of the version, the section if there are several such lists, and the position
    of the entry within the list, after those of the entries around it. An entry is a record, of
    which each field is a column of that name or a list, or it is the value of the only column that
    is no part of the key.
    """

    def __init__(
        self, table: Table, record: Any = None, /, *, first: int = 0, **lists: ListTable
    ) -> None:
        """Describe it.

        Args:
            record: the class of entries; None for single values.
            first: the position of the first entry.
            lists: the field of an entry -> the table of its list.
        """
        self.table = table
        _, owner, _, *columns = self.table.c.keys()
        self.columns = (owner, *columns)
        self.has_sections = "section" in columns
        self.entries_have_sections = "section" in getattr(record, "_fields", ())
        self._first = first
        self._record = record
        self._lists = lists
        # Rows are read without the knowledge base and the revision.
        self._width = len(self.table.primary_key) - 2
        self._row: Callable[[Any], Row] = lambda entry: (entry,)
        if record is not None:
            self._row = _values(columns[self._width - 1 :])
            places = (*self.columns, *lists)
            self._fields = itemgetter(*(places.index(field) for field in record._fields))

    @property
    def tables(self) -> tuple[Table, ...]:
        """The table, and those of the lists within, parents first."""
        return self.table, *(table for each in self._lists.values() for table in each.tables)

    def lists(self) -> Iterator[ListTable]:
        """Yield it, and the lists within."""
        yield self
        for each in self._lists.values():
            yield from each.lists()

    def add_rows(self, rows: RowsByTable, key: Row, entries: Iterable[Any]) -> None:
        """Add the rows of a list."""
        own, row = rows[self.table], self._row
        for position, entry in enumerate(entries, start=self._first):
            place = (*key, position)
            own.append((*place, *row(entry)))
            for field, list_ in self._lists.items():
                within = getattr(entry, field)
                if within:
                    list_.add_rows(rows, place, within)

    def read(self, rows: Mapping[Table, Iterable[Row]]) -> dict[Row, tuple[Any, ...]]:
        """Make lists from their rows, by their keys; lists of entries with sections are one."""
        below = [each.read(rows) for each in self._lists.values()]
        width = self._width
        around = 1 if self.entries_have_sections else width - 1
        lists: defaultdict[Row, list[Any]] = defaultdict(list)
        # By the key alone: what comes after it may be NULL.
        for row in sorted(rows.get(self.table, ()), key=itemgetter(slice(width))):
            if self._record is None:
                entry = row[width]
            else:
                own = (each.get(row[:width], ()) for each in below)
                entry = self._record._make(self._fields((*row, *own)))
            lists[row[:around]].append(entry)
        return {key: tuple(entries) for key, entries in lists.items()}


class Kind:
    """One kind of named element: converts definitions to rows and back.

    Each field of a definition is the identity's id or name, a column of that name in the version
    table, or a list in a table of its own.
    """

    def __init__(
        self, definition: Any, identity: Table, version: Table, **lists: ListTable
    ) -> None:
        """Describe it.

        Args:
            definition: the class of definitions.
            identity: the identity table.
            version: the version table.
            lists: the field of a definition -> the table of its list.
        """
        self.identity = identity
        self.new_identity = Insert(self.identity, "kb_id", "id", "name", "key")
        # Several fields may be lists of one table.
        tops = list(dict.fromkeys(lists.values()))
        tables = (table for each in tops for table in each.tables)
        self.version = VersionTable(f"{self.identity.name}_id", version, *tables)
        _, _, _, _, *self.columns = self.version.table.c.keys()
        self.lists = [below for each in tops for below in each.lists()]
        self._definition = definition
        self._fields = lists
        self._row = _values(self.columns)
        kinds = self.version.table.c
        booleans = [name for name in self.columns if isinstance(kinds[name].type, Boolean)]
        self._booleans = [2 + self.columns.index(name) for name in booleans]
        # What comes last is found first: a column's own value is that of the driver.
        places = ("id", "name", *self.columns, *lists, *booleans)
        last = {field: place for place, field in enumerate(places)}
        self._order = itemgetter(*(last[field] for field in definition._fields))
        self._section = 2 + self.columns.index("section") if "section" in self.columns else None

    @property
    def name(self) -> ScalarSelect[str]:
        """The name of the element of a row in the version table, as a subquery."""
        identity = self.identity.c
        return looked_up(identity.name, identity.id, self.version.owner)

    def add_rows(self, rows: RowsByTable, kb: int, since: int, definition: Any) -> None:
        """Add the rows of one version."""
        key = (kb, definition.id, since)
        rows[self.version.table].append((*key, None, *self._row(definition)))
        for field, list_ in self._fields.items():
            entries = getattr(definition, field)
            if not list_.has_sections:
                list_.add_rows(rows, key, entries)
            elif not list_.entries_have_sections:
                section = field if self._section is None else definition.section
                list_.add_rows(rows, (*key, section), entries)
            else:
                for section in dict.fromkeys(entry.section for entry in entries):
                    own = [entry for entry in entries if entry.section == section]
                    list_.add_rows(rows, (*key, section), own)

    def definitions(self, rows: Mapping[Table, Iterable[Row]]) -> Iterator[Any]:
        """Make the definitions of rows.

        Args:
            rows: the rows of each table, without the knowledge base and the revisions; those of
                the version table have the name after the id.
        """
        known = {list_: list_.read(rows) for list_ in dict.fromkeys(self._fields.values())}
        fields = [
            (self._key_of(field, list_), known[list_]) for field, list_ in self._fields.items()
        ]
        make, order, booleans = self._definition._make, self._order, self._booleans
        for row in rows.get(self.version.table, ()):
            lists = [found.get(key(row), ()) if found else () for key, found in fields]
            flags = [bool(row[place]) for place in booleans] if booleans else ()
            yield make(order((*row, *lists, *flags)))

    def _key_of(self, field: str, list_: ListTable) -> Callable[[Row], Row]:
        """Return a function from a row of the version table to the key of a list."""
        section = self._section
        if not list_.has_sections or list_.entries_have_sections:
            return lambda row: (row[0],)
        if section is None:
            return lambda row: (row[0], field)
        return lambda row: (row[0], row[section])


def _list(table: str, record: Any = None, first: int = 0, **lists: ListTable) -> ListTable:
    return ListTable(t.TABLES[table], record, first=first, **lists)


def _typed_names(table: str) -> ListTable:
    return _list(table, ParameterDefinition, type_ids=_list(f"{table}_type"))


def _tree(element: str) -> ListTable:
    variables, terms = _typed_names(f"{element}_variable"), _list(f"{element}_term", TreeTerm)
    return _list(f"{element}_node", TreeNode, variables=variables, terms=terms)


# In the order of writing: each refers only to earlier ones.
_KINDS: dict[str, tuple[Any, dict[str, ListTable]]] = {
    "type": (TypeDefinition, {"other_parent_ids": _list("type_parent", first=1)}),
    "object": (ObjectDefinition, {"other_type_ids": _list("object_type", first=1)}),
    "predicate": (PredicateDefinition, {"parameters": _typed_names("predicate_parameter")}),
    "function": (
        FunctionDefinition,
        {"parameters": _typed_names("function_parameter"), "type_ids": _list("function_type")},
    ),
    "action": (
        ActionDefinition,
        {
            "parameters": _typed_names("action_parameter"),
            **dict.fromkeys((DURATION, CONDITION, EFFECT), _tree("action")),
        },
    ),
    "formula": (FormulaDefinition, {"tree": _tree("formula")}),
    "rule": (RuleDefinition, {"constraint": _tree("rule")}),
    "document": (DocumentDefinition, {"items": _list("document_item", Item)}),
}
KIND_TABLES = {
    kind: Kind(definition, t.TABLES[kind], t.TABLES[f"{kind}_version"], **lists)
    for kind, (definition, lists) in _KINDS.items()
}


FACT, GOAL, VALUE = "fact", "goal", "value"
PROPOSITION = "proposition"


class VersionColumns(NamedTuple):
    """The columns that describe the versions of one kind of knowledge.

    `owner` names the identity; `kind` and `text` are those of change lines.
    """

    identity: Any
    version: Any
    owner: ColumnElement[int]
    kind: ColumnElement[str]
    text: ColumnElement[str]


def _definition(kind: str, tables: Kind) -> VersionColumns:
    version = tables.version.table.c
    # The kind of a formula is its section.
    name: Any = version.section if kind == "formula" else constant(kind)
    return VersionColumns(tables.identity.c, version, tables.version.owner, name, version.text)


def _value() -> VersionColumns:
    version = table_of(t.FunctionValueVersionRow).c
    identity, owner = table_of(t.FunctionValueRow).c, version.function_value_id
    return VersionColumns(identity, version, owner, constant(VALUE), version.text)


def _proposition() -> VersionColumns:
    version, atom = table_of(t.PropositionVersionRow).c, table_of(t.PropositionRow).c
    # The version's own copy: a lookup of the text in the identity table costs more.
    kind: Any = case((version.is_goal, constant(GOAL)), else_=constant(FACT))
    text = looked_up(atom.text, atom.id, version.proposition_id)
    return VersionColumns(atom, version, version.proposition_id, kind, text)


VERSION_COLUMNS: dict[str, VersionColumns] = {
    **{kind: _definition(kind, tables) for kind, tables in KIND_TABLES.items()},
    VALUE: _value(),
    PROPOSITION: _proposition(),
}


class AtomTables(NamedTuple):
    """The tables of ground atoms, or of fluents, which are interned with their arguments."""

    identity: Table
    arguments: Table
    version: Table
    sayings: Table
    owner: str  # the column of the identity in the other tables
    key: tuple[str, ...]  # the columns that intern one: its head, and last its arguments

    @property
    def head(self) -> str:
        """The column of the predicate or the function."""
        return self.key[-2]

    def identities(self, *more: Any) -> Select[Any]:
        """Select what `GroundAtom.of` or `GroundFluent.of` reads, and further columns."""
        identity = self.identity.c
        own = (identity[name] for name in ("id", *self.key, "text"))
        return select(*own, *more).where(identity.kb_id == KB)

    def live(self) -> Select[Any]:
        """Select the ids of present elements."""
        version = self.version.c
        return select(version[self.owner]).where(version.kb_id == KB, version.until.is_(None))


def _atoms(key: tuple[str, ...], *mapped: type[t.Base]) -> AtomTables:
    identity, arguments, version, sayings = map(table_of, mapped)
    return AtomTables(identity, arguments, version, sayings, f"{identity.name}_id", key)


ATOM_TABLES = {
    PROPOSITION: _atoms(
        ("is_goal", "predicate_id", "arguments"),
        *(
            t.PropositionRow,
            t.PropositionArgumentRow,
            t.PropositionVersionRow,
            t.PropositionSayingRow,
        ),
    ),
    VALUE: _atoms(
        ("function_id", "arguments"),
        *(t.FunctionValueRow, t.FunctionValueArgumentRow),
        *(t.FunctionValueVersionRow, t.FunctionValueSayingRow),
    ),
}
