"""The identities of a knowledge base, and the words that texts are made of.

A name with a space makes a text ambiguous: a fact about an object `rb1 wp1` reads like one about
`rb1` and `wp1`. The library never writes such a name.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from typing import Any, NamedTuple

from sqlalchemy import Select, Table, func, literal_column, select

from ...dto.lexical import decimal_text, fold
from ...errors import InvalidKnowledgeError
from ...knowledge.definitions import (
    DOMAIN,
    DOMAIN_SECTIONS,
    GOAL,
    KINDS,
    PROBLEM,
    PROBLEM_SECTIONS,
    Definitions,
    DocumentDefinition,
    Elements,
    FormulaDefinition,
)
from ...knowledge.trees import PREDICATE, ParameterDefinition
from ...sql.query import Query
from ...sql.rows import KB, KIND_TABLES, looked_up
from ...sql.tables import TABLES
from .sides import Check

# A word has none of the characters that separate words.
_WORD = r"[^\s()?]+"
_IS_WORD = re.compile(_WORD).fullmatch
_IS_ITEM = re.compile(rf"{_WORD}|\({_WORD}( {_WORD})*\)").fullmatch
_IS_REQUIREMENT = re.compile(r":[^\s()]+").fullmatch
_FORMULA_SECTIONS = frozenset((*DOMAIN_SECTIONS, *PROBLEM_SECTIONS))
_ELEMENTS = ("requirement", "type", "constant", "predicate", "function", "action", "object")
_DOCUMENT_SECTIONS = _FORMULA_SECTIONS.union(_ELEMENTS)


def is_word(text: str) -> bool:
    """Return whether a text is one word, as each name is."""
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


def formula_fault(formula: FormulaDefinition) -> str | None:
    """Find what makes the change line of a formula look like that of another element."""
    if formula.section not in _FORMULA_SECTIONS:
        return f"there is no section {formula.section!r}"
    root = formula.tree[0]
    is_atom = root.operator == PREDICATE and all(term.object_id is not None for term in root.terms)
    if formula.section == GOAL and is_atom:
        return "a goal that is a ground atom is a proposition"
    return None


def document_fault(document: DocumentDefinition) -> str | None:
    """Find what makes a document's text ambiguous."""
    return next(_document_faults(document), None)


def _document_faults(document: DocumentDefinition) -> Iterator[str]:
    for name in (document.title, document.domain):
        if name is not None and not is_word(name):
            yield f"no {document.name} can be called {name!r}"
    for section, name in document.items:
        if section not in _DOCUMENT_SECTIONS:
            yield f"there is no section {section!r}"
        # Older versions accepted a requirement with a question mark, which is one word, too.
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
        .having(func.count() > literal_column("1"))
    )


def _doubles(kind: str) -> Query:
    identity = KIND_TABLES[kind].identity
    key = identity.c.key
    return Query(doubles(identity, "key").add_columns(key).order_by(key))


_IDENTITIES = {kind: _identities(kind) for kind in KINDS}
_DOUBLES = {kind: _doubles(kind) for kind in KINDS}
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
    """A definition reduced to its name."""

    id: int
    name: str
    text: str = ""


class NamesById(dict[int, str]):
    """The names of one kind; an unknown id gives a text that is not a name."""

    def __missing__(self, id_: int) -> str:
        return f"?{id_}"


class IdentityNames(NamedTuple):
    """The names of ids, by kind."""

    known: dict[str, NamesById]
    held: Definitions  # of elements with a version, which alone can be referred to; names only


def check_names(check: Check) -> IdentityNames:
    """Check the identities of all kinds, and return their names."""
    report = check.report
    known: dict[str, NamesById] = {}
    made: list[Elements[Any]] = []
    for kind in KINDS:
        for first, second, key in check.rows(_DOUBLES[kind]):
            report.add(None, kind, f"{kind} {key!r} has two rows, {first} and {second}")
        names = NamesById()
        base: dict[int, Any] = {}
        for id_, name, key, is_held in check.stream(_IDENTITIES[kind]):
            if fold(name) != key:
                report.add(None, kind, f"{kind} {id_}, {name!r}, has the key {key!r}")
            if kind == "document" and name not in (DOMAIN, PROBLEM):
                report.add(None, kind, f"there is no document {name!r}")
            if not is_word(name):
                report.add(None, kind, f"no {kind} can be called {name!r}")
            names[id_] = name
            if is_held:
                base[id_] = _Named(id_, name)
        known[kind] = names
        made.append(Elements(base=base))
    return IdentityNames(known, Definitions(*made))


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
