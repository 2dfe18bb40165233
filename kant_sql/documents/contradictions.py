"""What a problem that is merged may not contradict: the values and literals that are stored."""

from __future__ import annotations

from collections.abc import Collection

from ..dto.formula import Atom, Not
from ..errors import ConflictError
from ..fluents import FluentKey, FluentValue
from ..knowledge.formula import INITIAL, formula_name
from ..pddl.document import Problem
from ..transaction import Transaction
from .naming import Names

_REMEDY = "load it with mode='replace', or make the two agree"


def refuse_contradictions(
    transaction: Transaction,
    names: Names,
    problem: Problem,
    values: Collection[tuple[FluentKey, str, FluentValue]],
) -> None:
    """Refuse a problem whose initial state contradicts what is stored.

    Args:
        transaction: the transaction, before the problem's state is stored.
        names: the names that the problem uses.
        problem: the problem.
        values: its values.

    Raises:
        ConflictError: it gives a fluent another value, denies a fact, or asserts what is denied.
    """
    _refuse_values(transaction, values)
    denied = [
        literal.formula
        for literal in problem.literals
        if isinstance(literal, Not) and isinstance(literal.formula, Atom)
    ]
    propositions = transaction.propositions
    found = propositions.find(names.atoms(denied, False).texts)
    propositions.look_at(found.values())
    for atom in found.values():
        if propositions.holds(atom):
            raise ConflictError(
                f"{atom.text} is stored, but the document has (not {atom.text}); {_REMEDY}"
            )
    formulas = transaction.definitions.formulas
    if any(formula.section == INITIAL for formula in formulas):
        for text in names.atoms(problem.facts, False).texts.values():
            if formulas.named(formula_name(INITIAL, f"(not {text})")) is not None:
                raise ConflictError(
                    f"(not {text}) is stored, but the document has {text}; {_REMEDY}"
                )


def _refuse_values(
    transaction: Transaction, values: Collection[tuple[FluentKey, str, FluentValue]]
) -> None:
    found = transaction.values.find({key for key, _, _ in values})
    transaction.values.look_at(found.values())
    for key, text, value in values:
        fluent = found.get(key)
        now = None if fluent is None else transaction.values.value(fluent)
        if now is not None and not value.is_same(now):
            raise ConflictError(
                f"(= {text} {now.text}) is stored, but the document has (= {text} {value.text}); "
                f"{_REMEDY}"
            )
