"""What depends on what: for deletes that cascade, and redefinitions that are refused."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

from sqlalchemy import Select, select

from ..atoms import Atom, AtomKey
from ..backends import Query, in_list, in_rows
from ..errors import DependantsError
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.formula import FormulaDefinition
from ..knowledge.loading import KB
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree import Mentioned, mentions
from ..tables import PropositionArgumentRow, PropositionRow, PropositionVersionRow
from ..transaction import Transaction
from .fluents_on import function_values_on, retract_function_values

SHOWN = 10


_LIVE = select(PropositionVersionRow.proposition_id).where(
    PropositionVersionRow.kb_id == KB, PropositionVersionRow.until.is_(None)
)
_MENTIONING = select(PropositionArgumentRow.proposition_id).where(
    PropositionArgumentRow.kb_id == KB, in_list(PropositionArgumentRow.object_id, "ids")
)


def _atoms(versions: Select[Any]) -> Query:
    return Query(
        select(
            PropositionRow.id,
            PropositionRow.is_goal,
            PropositionRow.predicate_id,
            PropositionRow.arguments,
            PropositionRow.text,
        ).where(PropositionRow.kb_id == KB, in_rows(PropositionRow.id, versions))
    )


_ALL = _atoms(_LIVE)
_OF_PREDICATES = _atoms(_LIVE.where(in_list(PropositionVersionRow.predicate_id, "ids")))
_OF_OBJECTS = _atoms(_LIVE.where(in_rows(PropositionVersionRow.proposition_id, _MENTIONING)))


Scope = Mentioned


def of_types(definitions: Definitions, type_ids: Collection[int]) -> Scope:
    """Find what is defined in terms of types.

    Args:
        definitions: the definitions.
        type_ids: the types.

    Returns:
        The types with their subtypes, the objects of these, and the predicates and functions with
        a parameter, or with values, of one.
    """
    types = definitions.subtypes(*type_ids)

    def has(parameters: Iterable[ParameterDefinition]) -> bool:
        return any(not types.isdisjoint(parameter.type_ids) for parameter in parameters)

    return Scope(
        types,
        {each.id for each in definitions.objects if not types.isdisjoint(each.type_ids)},
        {each.id for each in definitions.predicates if has(each.parameters)},
        {
            each.id
            for each in definitions.functions
            if has(each.parameters) or not types.isdisjoint(each.type_ids)
        },
    )


def actions_on(definitions: Definitions, scope: Scope) -> Iterator[ActionDefinition]:
    """Find the actions, processes and events that mention something.

    Args:
        definitions: the definitions.
        scope: what they may mention.

    Yields:
        The actions.
    """
    for action in definitions.actions:
        if mentions(action.trees, scope) or any(
            id_ in scope.types for part in action.parameters for id_ in part.type_ids
        ):
            yield action


def formulas_on(definitions: Definitions, scope: Scope) -> Iterator[FormulaDefinition]:
    """Find the formulas that mention something.

    Args:
        definitions: the definitions.
        scope: what they may mention.

    Yields:
        The formulas.
    """
    return (each for each in definitions.formulas if mentions([each.tree], scope))


def propositions_on(transaction: Transaction, scope: Scope | None) -> list[Atom]:
    """Find the live facts and goals that mention something.

    Args:
        transaction: the transaction.
        scope: the predicates and objects that they may mention; None for all facts and goals.

    Returns:
        The propositions, each once.
    """
    transaction.flush()
    session, kb = transaction.session, transaction.kb_id
    rows = session.rows(_ALL, kb=kb) if scope is None else []
    if scope is not None and scope.predicates:
        rows += session.rows(
            _OF_PREDICATES, kb=kb, ids=session.list_value(sorted(scope.predicates))
        )
    if scope is not None and scope.objects:
        rows += session.rows(_OF_OBJECTS, kb=kb, ids=session.list_value(sorted(scope.objects)))
    found = {
        id_: Atom(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)
        for id_, is_goal, predicate_id, arguments, text in rows
    }
    atoms = [found[id_] for id_ in sorted(found)]
    transaction.propositions.look_at(atoms)
    return atoms


def retract(transaction: Transaction, atoms: list[Atom]) -> None:
    """Retract propositions.

    Args:
        transaction: the transaction.
        atoms: the propositions.
    """
    transaction.propositions.look_at(atoms)
    for atom in atoms:
        transaction.propositions.set(transaction.propositions.know(atom), False)


def _undefine_users(transaction: Transaction, scope: Scope) -> None:
    retract(transaction, propositions_on(transaction, scope))
    retract_function_values(transaction, function_values_on(transaction, scope))
    for action in list(actions_on(transaction.definitions, scope)):
        transaction.undefine("action", action.id)
    for formula in list(formulas_on(transaction.definitions, scope)):
        transaction.undefine("formula", formula.id)


def delete_scope(transaction: Transaction, scope: Scope) -> None:
    """Delete definitions and all that depends on them.

    Args:
        transaction: the transaction.
        scope: the definitions; closed already, as `of_types` gives them.
    """
    _undefine_users(transaction, scope)
    for kind, ids in (
        ("predicate", scope.predicates),
        ("function", scope.functions),
        ("object", scope.objects),
        ("type", scope.types),
    ):
        for id_ in sorted(ids):
            transaction.undefine(kind, id_)


def _users(transaction: Transaction, scope: Scope) -> list[str]:
    """Name all that mentions something."""
    definitions = transaction.definitions
    atoms = propositions_on(transaction, scope)
    return [
        *(f"action {action.name}" for action in actions_on(definitions, scope)),
        *(f"formula {formula.text}" for formula in formulas_on(definitions, scope)),
        *(f"{'goal' if atom.key.is_goal else 'fact'} {atom.text}" for atom in atoms),
        *(f"value {value.text}" for value in function_values_on(transaction, scope)),
    ]


def clear_for_redefinition(
    transaction: Transaction, scope: Scope, before: str, after: str, cascade: bool
) -> None:
    """Let a redefinition go on only if nothing live depends on the present definition.

    Args:
        transaction: the transaction.
        scope: what is defined in terms of what is to be redefined, that itself included.
        before: the PDDL text of the present definition.
        after: the PDDL text of the new one.
        cascade: whether dependants are retracted instead.

    Raises:
        DependantsError: there are dependants, and `cascade` is False.
    """
    if cascade:
        _undefine_users(transaction, scope)
        return
    dependants = _users(transaction, scope)
    if dependants:
        shown = ", ".join(dependants[:SHOWN])
        more = f" and {len(dependants) - SHOWN} more" if len(dependants) > SHOWN else ""
        raise DependantsError(
            f"{before} cannot become {after}: {shown}{more} depend on it; delete those first, or "
            "save with cascade=True to retract them",
            dependants,
        )
