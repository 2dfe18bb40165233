"""What a redefinition leaves behind: facts, values and formulas that fit it no more."""

from __future__ import annotations

from ..dao.dependants import propositions_on, retract
from ..dao.fluents_on import function_values_on, retract_function_values
from ..dao.formula import make_formula, read_formula
from ..errors import InvalidKnowledgeError
from ..fluents import HeldValue
from ..knowledge.definitions import Definitions
from ..knowledge.formula import PROBLEM_SECTIONS
from ..knowledge.predicate import ParameterDefinition
from ..transaction import Transaction

_KINDS = ("type", "object", "predicate", "function")


def retract_misfits(transaction: Transaction) -> None:
    """Retract what does not fit the definitions as a transaction has changed them.

    Args:
        transaction: the transaction.
    """
    definitions = transaction.definitions
    if not any(_is_redefined(transaction, kind) for kind in _KINDS):
        return
    retract(
        transaction,
        [
            atom
            for atom in propositions_on(transaction, None)
            if not _fits(
                definitions,
                definitions.predicates.live(atom.key.predicate_id).parameters,
                atom.key.arguments,
            )
        ],
    )
    retract_function_values(
        transaction,
        [
            held
            for held in function_values_on(transaction, None)
            if not _value_fits(definitions, held)
        ],
    )
    for formula in list(definitions.formulas):
        if formula.section in PROBLEM_SECTIONS:
            try:
                node = read_formula(definitions, formula)
                transaction.define("formula", make_formula(transaction, formula.section, node))
            except InvalidKnowledgeError:
                transaction.undefine("formula", formula.id)


def _is_redefined(transaction: Transaction, kind: str) -> bool:
    """Tell whether anything that was there before is another by now."""
    elements = transaction.definitions.elements(kind)
    return any(
        (before := elements.origin.get(id_)) is not None and before != now
        for id_, now in elements.changes.items()
    )


def _value_fits(definitions: Definitions, held: HeldValue) -> bool:
    function = definitions.functions.live(held.fluent.key.function_id)
    value = held.value.object_id
    if value is None or not function.type_ids:
        same_kind = value is None and not function.type_ids
    else:
        object_ = definitions.objects.live(value)
        same_kind = definitions.any_fits(object_.type_ids, function.type_ids)
    return same_kind and _fits(definitions, function.parameters, held.fluent.key.arguments)


def _fits(
    definitions: Definitions, parameters: tuple[ParameterDefinition, ...], arguments: str
) -> bool:
    ids = arguments.split()
    if len(ids) != len(parameters):
        return False
    objects = [definitions.objects.live(int(id_)) for id_ in ids]
    return all(
        definitions.any_fits(object_.type_ids, parameter.type_ids)
        for object_, parameter in zip(objects, parameters, strict=True)
    )
