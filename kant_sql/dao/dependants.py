"""Dependencies between elements: for cascading deletes and refused redefinitions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

from sqlalchemy import Select, select, union_all

from ..errors import DependantsError, few_of
from ..knowledge.atoms import GroundAtom, GroundFluent, HeldValue
from ..knowledge.definitions import Definitions
from ..knowledge.trees import Mentioned, ParameterDefinition, mentions
from ..sql.dialects.base import Row
from ..sql.intervals import open_value
from ..sql.query import Query, in_list, in_rows
from ..sql.rows import ATOM_TABLES, KB, PROPOSITION, VALUE, AtomTables
from ..store.transaction import Transaction

_FACT, _VALUE = ATOM_TABLES[PROPOSITION], ATOM_TABLES[VALUE]


def _mentioning(atoms: AtomTables) -> Select[Any]:
    """Select the ids of facts or fluents with one of some objects as an argument."""
    arguments = atoms.arguments.c
    return select(arguments[atoms.owner]).where(
        arguments.kb_id == KB, in_list(arguments.object_id, "ids")
    )


def _atoms(versions: Select[Any]) -> Query:
    identities = _FACT.identities()
    return Query(identities.where(in_rows(_FACT.identity.c.id, versions)))


def _values(versions: Select[Any]) -> Select[Any]:
    id_ = _VALUE.identity.c.id
    return _VALUE.identities(*open_value(id_)).where(in_rows(id_, versions))


_FACTS_NOW, _VALUES_NOW = _FACT.live(), _VALUE.live()
_ALL_ATOMS = _atoms(_FACTS_NOW)
_OF_PREDICATES = _atoms(_FACTS_NOW.where(in_list(_FACT.version.c.predicate_id, "ids")))
_ATOMS_OF_OBJECTS = _atoms(
    _FACTS_NOW.where(in_rows(_FACT.version.c.proposition_id, _mentioning(_FACT)))
)
_ALL_VALUES = Query(_values(_VALUES_NOW))
_OF_FUNCTIONS = Query(_values(_VALUES_NOW.where(in_list(_VALUE.version.c.function_id, "ids"))))
_VALUES_OF_OBJECTS = Query(
    union_all(
        # Including those without a value now, which are few: SQLite would read all live ones.
        _values(_mentioning(_VALUE)),
        _values(_VALUES_NOW.where(in_list(_VALUE.version.c.object_id, "ids"))),
    )
)


def _rows(
    transaction: Transaction,
    scope: Mentioned | None,
    everything: Query,
    parts: Sequence[tuple[Query, str]],
) -> list[Row]:
    """Read all rows, or for each field of a scope the rows that mention one of its ids."""
    session, kb = transaction.session, transaction.kb_id
    if scope is None:
        return session.rows(everything, kb=kb)
    rows: list[Row] = []
    for query, field in parts:
        if ids := getattr(scope, field):
            rows += session.rows(query, kb=kb, ids=session.list_value(sorted(ids)))
    return rows


def function_values_on(transaction: Transaction, scope: Mentioned | None) -> list[HeldValue]:
    """Find the live values that mention an element of a scope."""
    if next(iter(transaction.definitions.functions), None) is None:
        return []
    transaction.flush()
    parts = ((_OF_FUNCTIONS, "functions"), (_VALUES_OF_OBJECTS, "objects"))
    found = {
        row[0]: HeldValue.of(GroundFluent.of(row), held, object_id)
        for *row, held, object_id in _rows(transaction, scope, _ALL_VALUES, parts)
        if held is not None
    }
    return [found[id_] for id_ in sorted(found)]


SHOWN = 10


def of_types(definitions: Definitions, type_ids: Collection[int]) -> Mentioned:
    """Find the elements that are defined in terms of types."""
    types = definitions.subtypes(*type_ids)

    def has(parameters: Iterable[ParameterDefinition]) -> bool:
        return any(not types.isdisjoint(parameter.type_ids) for parameter in parameters)

    return Mentioned(
        types,
        {each.id for each in definitions.objects if not types.isdisjoint(each.type_ids)},
        {each.id for each in definitions.predicates if has(each.parameters)},
        {
            each.id
            for each in definitions.functions
            if has(each.parameters) or not types.isdisjoint(each.type_ids)
        },
    )


def _definitions_on(definitions: Definitions, scope: Mentioned) -> Iterator[tuple[str, int, str]]:
    """Find the definitions with trees that mention an element of a scope."""
    # For actions, processes, events and rules, the name is enough.
    for action in definitions.actions:
        if mentions(action.trees, scope) or any(
            id_ in scope.types for part in action.parameters for id_ in part.type_ids
        ):
            yield "action", action.id, action.name
    for formula in definitions.formulas:
        if mentions([formula.tree], scope):
            yield "formula", formula.id, formula.text
    for rule in definitions.rules:
        if mentions([rule.constraint], scope):
            yield "rule", rule.id, rule.name


def propositions_on(transaction: Transaction, scope: Mentioned | None) -> list[GroundAtom]:
    """Find the live facts and goals that mention an element of a scope."""
    transaction.flush()
    parts = ((_OF_PREDICATES, "predicates"), (_ATOMS_OF_OBJECTS, "objects"))
    found = {row[0]: GroundAtom.of(row) for row in _rows(transaction, scope, _ALL_ATOMS, parts)}
    atoms = [found[id_] for id_ in sorted(found)]
    transaction.propositions.load(atoms)
    return atoms


def retract(transaction: Transaction, atoms: list[GroundAtom]) -> None:
    """Retract propositions."""
    transaction.propositions.load(atoms)
    for atom in atoms:
        transaction.propositions.set(transaction.propositions.know(atom), False)


def _undefine_users(transaction: Transaction, scope: Mentioned) -> None:
    # Definitions have only known time, and so has everything deleted with them.
    with transaction.of_now():
        retract(transaction, propositions_on(transaction, scope))
        transaction.values.unset(function_values_on(transaction, scope))
    for kind, id_, _ in list(_definitions_on(transaction.definitions, scope)):
        transaction.undefine(kind, id_)


def delete_mentioned(transaction: Transaction, scope: Mentioned) -> None:
    """Delete definitions and their dependants."""
    _undefine_users(transaction, scope)
    for kind, ids in (
        ("predicate", scope.predicates),
        ("function", scope.functions),
        ("object", scope.objects),
        ("type", scope.types),
    ):
        for id_ in sorted(ids):
            transaction.undefine(kind, id_)


def _users(transaction: Transaction, scope: Mentioned) -> list[str]:
    """Return the texts of all dependants."""
    atoms = propositions_on(transaction, scope)
    return [
        *(f"{kind} {said}" for kind, _, said in _definitions_on(transaction.definitions, scope)),
        *(f"{'goal' if atom.key.is_goal else 'fact'} {atom.text}" for atom in atoms),
        *(f"value {value.text}" for value in function_values_on(transaction, scope)),
    ]


def clear_for_redefinition(
    transaction: Transaction, scope: Mentioned, before: str, after: str, cascade: bool
) -> None:
    """Refuse a redefinition while live elements depend on the present definition."""
    if cascade:
        _undefine_users(transaction, scope)
        return
    dependants = _users(transaction, scope)
    if dependants:
        raise DependantsError(
            f"{before} cannot become {after}: {few_of(dependants, SHOWN, ', ')} depend on it; "
            "delete those first, or save with cascade=True to retract them",
            dependants,
        )
