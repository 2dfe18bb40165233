"""Loading a domain into a store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..dao.action import put_action
from ..dao.action_trees import action_trees
from ..dao.dependants import Scope, delete_scope
from ..dao.formula import make_formula
from ..dto.formula import Node
from ..dto.name import ROOT_TYPE, fold
from ..errors import ConflictError
from ..knowledge.document import DOMAIN, Item
from ..knowledge.formula import (
    DERIVED_PREDICATE,
    DOMAIN_CONSTRAINT,
    DOMAIN_SECTIONS,
    FormulaDefinition,
)
from ..pddl.document import Action, Domain
from ..transaction import Transaction
from ..verification.findings import Progress
from .declaring import Declaring, Steps
from .misfits import retract_misfits
from .ordering import check_title, find_document, put_document


def load_domain(
    transaction: Transaction, domain: Domain, replace: bool, progress: Progress | None = None
) -> None:
    """Store a domain.

    Args:
        transaction: the transaction.
        domain: the domain.
        replace: whether what it does not say is retracted; else it must not contradict what is
            stored, and that stays.
        progress: called with the number of elements that are stored, and to be stored.

    Raises:
        ConflictError: it contradicts what is stored.
    """
    stored = find_document(transaction.definitions, DOMAIN)
    if stored is not None and not replace:
        check_title(stored, domain.name)
    declaring = Declaring(transaction, replace)
    declared = domain.types, domain.constants, domain.predicates, domain.functions
    steps = Steps(progress, sum(map(len, (*declared, domain.actions))))
    declaring.types(domain.types)
    declaring.objects(domain.constants, is_constant=True)
    declaring.predicates(domain.predicates)
    declaring.functions(domain.functions)
    steps.add(sum(map(len, declared)))
    formulas = _put_formulas(transaction, domain)
    actions = _put_actions(transaction, domain.actions, declaring, replace, steps)
    if replace:
        _retract_unsaid(transaction, declaring, {each.id for each in formulas}, actions)
        retract_misfits(transaction)
    put_document(transaction, DOMAIN, domain.name, None, _items(domain, formulas), replace)


def _items(domain: Domain, formulas: Sequence[FormulaDefinition]) -> Iterator[Item]:
    yield from (Item("requirement", name) for name in domain.requirements)
    for section, named in (
        ("type", domain.types),
        ("constant", domain.constants),
        ("predicate", domain.predicates),
        ("function", domain.functions),
        ("action", domain.actions),
    ):
        yield from (Item(section, fold(each.name)) for each in named)
    yield from (Item(each.section, each.name) for each in formulas)


def _put_formulas(transaction: Transaction, domain: Domain) -> list[FormulaDefinition]:
    sections: tuple[tuple[str, Sequence[Node]], ...] = (
        (DERIVED_PREDICATE, domain.derived),
        (DOMAIN_CONSTRAINT, domain.constraints),
    )
    formulas = []
    for section, nodes in sections:
        for node in nodes:
            formula = make_formula(transaction, section, node)
            transaction.define("formula", formula)
            formulas.append(formula)
    return formulas


def _put_actions(
    transaction: Transaction,
    actions: Sequence[Action],
    declaring: Declaring,
    replace: bool,
    steps: Steps,
) -> set[int]:
    definitions = transaction.definitions
    names = [action.name for action in actions]
    transaction.look_up("action", names)
    for action in actions:
        stored = definitions.actions.named(action.name)
        parameters = declaring.parameters(action.parameters)
        if replace and stored is not None and stored.kind != action.kind:
            transaction.undefine("action", stored.id)
        said = (action.duration, action.condition, action.effect)
        trees = action_trees(transaction, action.kind, action.name, parameters, *said)
        put_action(transaction, action.kind, action.name, parameters, trees)
        now = definitions.actions.named(action.name)
        if stored is not None and not replace and now != stored:
            raise ConflictError(
                f"action {stored.name!r} is stored with another definition than the document has; "
                "load it with mode='replace', or make the two agree"
            )
        steps.add(1)
    found = (definitions.actions.named(name) for name in names)
    return {action.id for action in found if action is not None}


def _retract_unsaid(
    transaction: Transaction, declaring: Declaring, formulas: set[int], actions: set[int]
) -> None:
    definitions = transaction.definitions
    for action in list(definitions.actions):
        if action.id not in actions:
            transaction.undefine("action", action.id)
    for formula in list(definitions.formulas):
        if formula.section in DOMAIN_SECTIONS and formula.id not in formulas:
            transaction.undefine("formula", formula.id)
    said = declaring.said

    def unsaid(kind: str) -> set[int]:
        return {each.id for each in definitions.elements(kind)} - said.get(kind, set())

    types = {id_ for id_ in unsaid("type") if fold(definitions.types.live(id_).name) != ROOT_TYPE}
    constants = {id_ for id_ in unsaid("object") if definitions.objects.live(id_).is_constant}
    objects = {each.id for each in definitions.objects if not types.isdisjoint(each.type_ids)}
    delete_scope(
        transaction,
        Scope(types, constants | objects, unsaid("predicate"), unsaid("function")),
    )
