"""Compares definitions and their identities with their texts.

A name with a space makes a text ambiguous: a fact about an object `rb1 wp1` reads like one about
`rb1` and `wp1`. The library never writes such a name.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from decimal import Decimal, InvalidOperation
from itertools import zip_longest
from operator import eq
from typing import Any, NamedTuple

from sqlalchemy import Select, Table, func, select

from ...dto.formulas import COMPARISONS
from ...dto.lexical import decimal_text, fold
from ...errors import UNREADABLE, InvalidKnowledgeError, KantSqlError
from ...knowledge import definitions as d
from ...knowledge import trees as kinds
from ...knowledge.canonical import canonical_text
from ...knowledge.formulas import TreeReader, TreeWriter
from ...knowledge.trees import PREDICATE, ParameterDefinition, Tree, TreeNode, mentioned
from ...sql.dialects.base import Row
from ...sql.query import Query, constant
from ...sql.rows import KB, KIND_TABLES, RowsByTable, looked_up
from ...sql.tables import TABLES
from .sides import Check, Touched, began, differing, interval_fault

# A word has no character that separates words.
_WORD = r"[^\s()?]+"
_IS_WORD = re.compile(_WORD).fullmatch
_IS_ITEM = re.compile(rf"{_WORD}|\({_WORD}( {_WORD})*\)").fullmatch
_IS_REQUIREMENT = re.compile(r":[^\s()]+").fullmatch
_FORMULA_SECTIONS = frozenset((*d.DOMAIN_SECTIONS, *d.PROBLEM_SECTIONS))
_ELEMENTS = ("requirement", "type", "constant", "predicate", "function", "action", "object")
_DOCUMENT_SECTIONS = _FORMULA_SECTIONS.union(_ELEMENTS)


def is_word(text: str) -> bool:
    """Return whether a text is one word, like every name."""
    return _IS_WORD(text) is not None


def is_decimal(text: str | None) -> bool:
    """Return whether a text is a number as the library writes numbers."""
    try:
        return text is not None and decimal_text(Decimal(text)) == text
    except (InvalidOperation, InvalidKnowledgeError):
        return False


def parameter_fault(parameters: tuple[ParameterDefinition, ...]) -> str | None:
    """Find a parameter whose name is not one word."""
    wrong = next((each.name for each in parameters if not is_word(each.name)), None)
    return None if wrong is None else f"no parameter can be called {wrong!r}"


def formula_fault(formula: d.FormulaDefinition) -> str | None:
    """Find a fault that makes the change line of a formula look like that of another element."""
    if formula.section not in _FORMULA_SECTIONS:
        return f"there is no section {formula.section!r}"
    root = formula.tree[0]
    is_atom = root.operator == PREDICATE and all(term.object_id is not None for term in root.terms)
    if formula.section == d.GOAL and is_atom:
        return "a goal that is a ground atom is a proposition"
    return None


def document_faults(document: d.DocumentDefinition) -> Iterator[str]:
    """Find faults that make a document's text ambiguous."""
    for name in (document.title, document.domain):
        if name is not None and not is_word(name):
            yield f"no {document.name} can be called {name!r}"
    for section, name in document.items:
        if section not in _DOCUMENT_SECTIONS:
            yield f"there is no section {section!r}"
        # Older versions accepted a requirement with a question mark, which is also one word.
        if (_IS_REQUIREMENT if section == "requirement" else _IS_ITEM)(name) is None:
            yield f"{name!r} is not an item of it"


def _identities(kind: str) -> Query:
    tables = KIND_TABLES[kind]
    identity, version = tables.identity.c, tables.version.table.c
    first = looked_up(version.since, tables.version.owner, identity.id)
    return Query(
        select(identity.id, identity.name, identity.key, first.is_not(None))
        .where(identity.kb_id == KB)
        .order_by(identity.id)
    )


def doubles(table: Table, *key: str) -> Select[Any]:
    """Select the first and last id of identities that are stored more than once."""
    return (
        select(func.min(table.c.id), func.max(table.c.id))
        .where(table.c.kb_id == KB)
        .group_by(*(table.c[name] for name in key))
        .having(func.count() > constant(1))
    )


def _doubles(kind: str) -> Query:
    identity = KIND_TABLES[kind].identity
    key = identity.c.key
    return Query(doubles(identity, "key").add_columns(key).order_by(key))


_IDENTITIES = {kind: _identities(kind) for kind in d.KINDS}
_DOUBLES = {kind: _doubles(kind) for kind in d.KINDS}
_FUNCTION, _VALUE_TYPE = TABLES["function_version"].c, TABLES["function_type"].c
_FUNCTIONS = Query(
    select(
        _FUNCTION.function_id,
        _FUNCTION.since,
        select(func.count())
        .where(
            _VALUE_TYPE.kb_id == KB,
            _VALUE_TYPE.function_id == _FUNCTION.function_id,
            _VALUE_TYPE.since == _FUNCTION.since,
        )
        .scalar_subquery(),
    )
    .where(_FUNCTION.kb_id == KB)
    .order_by(_FUNCTION.function_id, _FUNCTION.since)
)


class _Named(NamedTuple):
    """A definition reduced to its name, and to whether a function has objects as values."""

    id: int
    name: str
    type_ids: tuple[int, ...] = ()


def names_alone(names: Iterable[Mapping[int, str]]) -> d.Definitions:
    """Make definitions from the names of each kind, by their ids."""
    made: list[dict[int, Any]] = [{id_: _Named(id_, each[id_]) for id_ in each} for each in names]
    return d.Definitions(*(d.Elements(base=base) for base in made))


class NamesById(dict[int, str]):
    """The names of one kind; an unknown id gives a text that is not a valid name."""

    def __missing__(self, id_: int) -> str:
        return f"?{id_}"


class IdentityNames(NamedTuple):
    """The names of ids, by kind."""

    known: dict[str, NamesById]
    held: d.Definitions  # only names, of elements with a version: others cannot be referred to


def check_names(check: Check) -> IdentityNames:
    """Check the identities of all kinds, and return their names."""
    report = check.report
    known: dict[str, NamesById] = {}
    held: list[dict[int, str]] = []
    for kind in d.KINDS:
        for first, second, key in check.rows(_DOUBLES[kind]):
            report.add(None, kind, f"{kind} {key!r} has two rows, {first} and {second}")
        names = NamesById()
        held.append({})
        for id_, name, key, is_held in check.stream(_IDENTITIES[kind]):
            if fold(name) != key:
                report.add(None, kind, f"{kind} {id_}, {name!r}, has the key {key!r}")
            if kind == "document" and name not in (d.DOMAIN, d.PROBLEM):
                report.add(None, kind, f"there is no document {name!r}")
            if not is_word(name):
                report.add(None, kind, f"no {kind} can be called {name!r}")
            names[id_] = name
            if is_held:
                held[-1][id_] = name
        known[kind] = names
    return IdentityNames(known, names_alone(held))


class ObjectFunctions:
    """The functions whose values are objects, by revision."""

    def __init__(self, check: Check) -> None:
        self._versions: defaultdict[int, list[tuple[int, bool]]] = defaultdict(list)
        for id_, since, types in check.rows(_FUNCTIONS):
            self._versions[id_].append((since, bool(types)))
        self._sinces = sorted({since for id_ in self._versions for since, _ in self._versions[id_]})
        self._known: dict[int, frozenset[int]] = {}

    def at(self, revision: int) -> frozenset[int]:
        """Return these functions at a revision."""
        epoch = bisect_right(self._sinces, revision)
        if epoch not in self._known:
            self._known[epoch] = frozenset(self._at(revision))
        return self._known[epoch]

    def _at(self, revision: int) -> Iterator[int]:
        for id_, versions in self._versions.items():
            held = [has for since, has in versions if since <= revision]
            if held[-1] if held else versions[0][1]:
                yield id_


def _unlike(tree: Tree, read: Tree) -> str | None:
    """Find where a tree differs from the one that its text is read as."""
    if tree == read:
        return None
    for node, right in zip_longest(tree, read):
        if node is None:
            return f"there is no node {right.position}"
        if right is None:
            return f"node {node.position} does not stand below node {node.parent}"
        for column, its, that in zip(TreeNode._fields, node, right, strict=True):
            if column == "terms" and len(its) == len(that) and its != that:
                number = [*map(eq, its, that)].index(False)
                return f"node {node.position}: term {number} is not bound as its name is"
            if its != that:
                return (
                    f"node {node.position}: {node.operator} and {column} {its} do not go together"
                )
    return None


def _can_have_value(node: TreeNode) -> bool:
    if node.operator == kinds.VARIABLE:
        return fold(node.value or "") == "?duration"
    return node.value is None or is_word(node.value)


def _ambiguous(tree: Tree, object_functions: Collection[int]) -> str | None:
    """Find a fault that the text does not show, in a tree that matches it."""
    values = {term.child for node in tree for term in node.terms}
    for node in tree:
        above = None if node.parent is None else tree[node.parent].operator
        is_object = node.function_id in object_functions
        fault = parameter_fault(node.variables)
        if not _can_have_value(node):
            fault = f"{node.operator} cannot have the value {node.value!r}"
        elif node.position in values and not is_object:
            fault = "it is a number, and stands for an object"
        elif node.position not in values and is_object and above in COMPARISONS:
            fault = "it is an object, and is compared as a number"
        if fault is not None:
            return f"node {node.position}: {fault}"
    return None


def _version_query(kind: str, is_narrow: bool) -> Query:
    tables = KIND_TABLES[kind]
    version = tables.version.table
    _, *own = version.c
    rows = select(*own, tables.name.label("identity_name")).where(version.c.kb_id == KB)
    if is_narrow:
        rows = rows.where(Touched(version, tables.version.owner.name).versions(version))
    return Query(rows.order_by(tables.version.owner, version.c.since))


# The queries, by whether this continues an earlier verification.
_VERSIONS = {
    is_narrow: {kind: _version_query(kind, is_narrow) for kind in d.KINDS}
    for is_narrow in (False, True)
}
# The rows of each table for one version.
_Rows = dict[Table, list[Row]]


class DefinitionCheck:
    """Compares the text of every version of every definition with its rows."""

    def __init__(
        self, check: Check, names: d.Definitions, object_functions: ObjectFunctions
    ) -> None:
        self._check = check
        self._names = names
        self._object_functions = object_functions

    def run(self) -> None:
        """Check all kinds."""
        for kind in d.KINDS:
            self._check_kind(kind)

    def _check_kind(self, kind: str) -> None:
        version = KIND_TABLES[kind].version
        sides = {
            child: self._check.side(child, version.table, narrow=began, width=2)
            for child in version.children
        }
        position = list(version.table.c.keys()).index("text") - 1
        before: Row | None = None
        for row in self._versions(kind):
            *own, name = row
            owner, since, until, *_ = own
            rows = {version.table: [tuple(own)]}
            rows |= {child: [*side.take((owner, since))] for child, side in sides.items()}
            ended = before[2] if before is not None and before[0] == owner else 0
            faults = [interval_fault(ended, since, until)]
            if since > self._check.after:
                faults.append(self._fault(kind, rows, name))
            for fault in faults:
                if fault is not None:
                    text = " ".join(str(row[position]).split())
                    message = f"'{text:.200}' since revision {since}: {fault}"
                    self._check.report.add(since, version.table.name, message)
            before = row
        for side in sides.values():
            side.end()

    def _versions(self, kind: str) -> Iterator[Row]:
        check = self._check
        bounds = {"after": check.after} if check.after else {}
        return check.session.stream(_VERSIONS[bool(check.after)][kind], kb=check.kb_id, **bounds)

    def _fault(self, kind: str, rows: _Rows, name: str | None) -> str | None:
        if name is None:
            return f"there is no row of {kind} for it"
        version, *children = rows
        ((id_, since, _, *own),) = rows[version]
        # Definitions are made from rows without the revisions.
        plain: _Rows = {version: [(id_, name, *own)]}
        plain |= {child: [(row[0], *row[2:]) for row in rows[child]] for child in children}
        try:
            (definition,) = KIND_TABLES[kind].definitions(plain)
            fault = self._meaning(definition, name, since)
        except (*UNREADABLE, KantSqlError) as error:
            return f"its rows make no {kind}: {type(error).__name__}: {error}"
        return fault or self._layout(kind, definition, since, rows)

    def _meaning(self, definition: Any, name: str, since: int) -> str | None:
        """Compare the rows with the text."""
        fault = self._own_fault(definition, name, since)
        if fault is not None:
            return fault
        text = canonical_text(self._names, definition)
        return None if text == definition.text else f"its rows say '{' '.join(text.split()):.200}'"

    def _own_fault(self, definition: Any, name: str, since: int) -> str | None:
        """Find a fault that the text does not show."""
        match definition:
            case d.FormulaDefinition():
                if d.formula_name(definition.section, definition.text) != name:
                    return "its name is not the hash of its section and its text"
                return formula_fault(definition) or self._tree_fault(definition.tree, (), since)
            case d.RuleDefinition():
                return self._tree_fault(definition.constraint, (), since)
            case d.DocumentDefinition():
                expected = d.DOMAIN if definition.domain is None else d.PROBLEM
                if name != expected:
                    return f"a {expected} is called {name!r}"
                return next(document_faults(definition), None)
            case d.ActionDefinition():
                parameters = parameter_fault(definition.parameters)
                return parameters or self._action_fault(definition, since)
            case d.PredicateDefinition() | d.FunctionDefinition():
                return parameter_fault(definition.parameters)
        return None

    def _action_fault(self, action: d.ActionDefinition, since: int) -> str | None:
        if action.duration and action.kind != "durative-action":
            return f"a {action.kind} has no duration"
        for part, tree in (("condition", action.condition), ("effect", action.effect)):
            if not tree or tree[0].operator != "and":
                return f"its {part} is not a conjunction"
        faults = (self._tree_fault(tree, action.parameters, since) for tree in action.trees)
        return next((fault for fault in faults if fault is not None), None)

    def _tree_fault(self, tree: Tree, parameters: Any, since: int) -> str | None:
        """Compare a tree with the one that its text is read as."""
        if not tree:
            return None
        objects = self._object_functions.at(since)
        # Only the mentioned elements: another element may have the name of an operator.
        known: dict[tuple[str, str], Any] = {}
        for kind, ids in zip(d.KINDS, mentioned([tree]), strict=False):
            for id_ in ids:
                one = self._names.elements(kind).live(id_)
                if kind == "function" and id_ in objects:
                    one = one._replace(type_ids=(0,))
                known[kind, fold(one.name)] = one
        reader = TreeReader(self._names, tree, parameters)
        writer = TreeWriter(lambda kind, name: known.get((kind, fold(name))), parameters)
        return _unlike(tree, writer.tree(reader.formula())) or _ambiguous(tree, objects)

    def _layout(self, kind: str, definition: Any, since: int, rows: _Rows) -> str | None:
        """Compare the rows with those that saving the definition writes."""
        version = KIND_TABLES[kind].version.table
        ((id_, _, _, *own),) = rows[version]
        stored = {**rows, version: [(id_, since, None, *own)]}
        written: RowsByTable = defaultdict(list)
        KIND_TABLES[kind].add_rows(written, self._check.kb_id, since, definition)
        wrong = differing(
            ((table.name, *row) for table, of_table in stored.items() for row in of_table),
            ((table.name, *row[1:]) for table, of_table in written.items() for row in of_table),
        )
        return f"rows of {wrong[0]} differ from those of the definition" if wrong else None
