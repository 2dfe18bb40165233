"""What depends on what: for deletes that cascade, and redefinitions that are refused."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from sqlalchemy import Select, select

from ..atoms import Atom, AtomKey
from ..backends import Query, in_list, in_rows
from ..errors import DependantsError
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.loading import KB
from ..tables import PropositionArgumentRow, PropositionRow, PropositionVersionRow
from ..transaction import Transaction

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


class Scope(NamedTuple):
    """A set of definitions.

    Attributes:
        types: ids of types.
        objects: ids of objects.
        predicates: ids of predicates.
    """

    types: Collection[int] = ()
    objects: Collection[int] = ()
    predicates: Collection[int] = ()


def of_types(definitions: Definitions, type_ids: Collection[int]) -> Scope:
    """Find what is defined in terms of types.

    Args:
        definitions: the definitions.
        type_ids: the types.

    Returns:
        The types with their subtypes, the objects of these, and the predicates with a parameter
        of one.
    """
    types = {below for type_id in type_ids for below in definitions.subtypes(type_id)}
    return Scope(
        types,
        {object_.id for object_ in definitions.objects if object_.type_id in types},
        {
            predicate.id
            for predicate in definitions.predicates
            if any(not types.isdisjoint(parameter.type_ids) for parameter in predicate.parameters)
        },
    )


def actions_on(definitions: Definitions, scope: Scope) -> Iterator[ActionDefinition]:
    """Find the actions that mention something.

    Args:
        definitions: the definitions.
        scope: what they may mention.

    Yields:
        The actions.
    """
    for action in definitions.actions:
        literals = (*action.conditions, *action.effects)
        if (
            any(id_ in scope.types for part in action.parameters for id_ in part.type_ids)
            or any(literal.predicate_id in scope.predicates for literal in literals)
            or any(term.object_id in scope.objects for part in literals for term in part.terms)
        ):
            yield action


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
    for atom in atoms:
        transaction.propositions.set(transaction.propositions.know(atom), False)


def delete_scope(transaction: Transaction, scope: Scope) -> None:
    """Delete definitions and all that depends on them.

    Args:
        transaction: the transaction.
        scope: the definitions; closed already, as `of_types` gives them.
    """
    retract(transaction, propositions_on(transaction, scope))
    for action in list(actions_on(transaction.definitions, scope)):
        transaction.undefine("action", action.id)
    for kind, ids in (
        ("predicate", scope.predicates),
        ("object", scope.objects),
        ("type", scope.types),
    ):
        for id_ in sorted(ids):
            transaction.undefine(kind, id_)


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
    atoms = propositions_on(transaction, scope)
    actions = list(actions_on(transaction.definitions, scope))
    if not cascade and (atoms or actions):
        dependants = [*(f"action {action.name}" for action in actions)]
        dependants += [f"{'goal' if atom.key.is_goal else 'fact'} {atom.text}" for atom in atoms]
        shown = ", ".join(dependants[:SHOWN])
        more = f" and {len(dependants) - SHOWN} more" if len(dependants) > SHOWN else ""
        raise DependantsError(
            f"{before} cannot become {after}: {shown}{more} depend on it; delete those first, or "
            "save with cascade=True to retract them",
            dependants,
        )
    retract(transaction, atoms)
    for action in actions:
        transaction.undefine("action", action.id)
