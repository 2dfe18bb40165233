"""Loading a problem into a store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..atoms import Atom as LiveAtom
from ..atoms import AtomKey
from ..dao.base import batches
from ..dao.dependants import Scope, delete_scope, propositions_on, retract
from ..dao.fluents_on import function_values_on, retract_function_values
from ..dao.formula import is_ground, make_formula, read_formulas
from ..dto.formula import Atom, Node
from ..dto.name import fold
from ..errors import ConflictError
from ..fluents import FluentKey
from ..knowledge.document import PROBLEM, Item
from ..knowledge.formula import CONSTRAINT, GOAL, INITIAL, METRIC, PROBLEM_SECTIONS, TIMED
from ..pddl.document import Problem
from ..transaction import Transaction
from ..verification.findings import Progress
from .constants import constant_ids
from .contradictions import refuse_contradictions
from .declaring import Declaring, Steps
from .naming import Names
from .ordering import check_title, find_document, put_document


def load_problem(
    transaction: Transaction, problem: Problem, replace: bool, progress: Progress | None = None
) -> None:
    """Store a problem, whose domain is stored.

    Args:
        transaction: the transaction.
        problem: the problem.
        replace: whether what it does not say is retracted; else it must not contradict what is
            stored, and that stays.
        progress: called with the number of elements that are stored, and to be stored.

    Raises:
        ConflictError: it contradicts what is stored.
    """
    stored = find_document(transaction.definitions, PROBLEM)
    if stored is not None and not replace:
        check_title(stored, problem.name)
    is_first = transaction.is_stateless and not transaction.head.revision
    before = _Before(transaction) if replace and not is_first else None
    declaring = Declaring(transaction, replace)
    steps = Steps(progress, len(problem.objects) + len(problem.facts) + len(problem.values))
    declaring.objects(problem.objects, is_constant=False)
    steps.add(len(problem.objects))
    names = Names(transaction)
    values, old = names.values(problem.values)
    if not replace:
        refuse_contradictions(transaction, names, problem, values)
    goals = [goal for goal in problem.goal if isinstance(goal, Atom) and is_ground(goal)]
    for atoms, is_goal in ((problem.facts, False), (goals, True)):
        told = Steps() if is_goal else steps
        _hold(transaction, names, atoms, is_goal, {} if before is None else before.atoms, told)
    transaction.values.set_many(values, old)
    steps.add(len(problem.values))
    formulas = _Formulas(transaction, names, problem)
    if before is not None:
        before.retract(transaction, {key for key, _, _ in values})
    if replace:
        _retract_unsaid(transaction, declaring, formulas.ids)
    _refuse_second_metric(transaction, formulas.ids)
    put_document(
        transaction, PROBLEM, problem.name, problem.domain, _items(problem, formulas), replace
    )


class _Before:
    """What held before a problem was loaded, as far as the problem has not said it again.

    Attributes:
        atoms: the facts and the goals.
        values: the values of functions.
    """

    def __init__(self, transaction: Transaction) -> None:
        # Read before anything is added, for that need not be read back.
        self.atoms = {atom.key: atom for atom in propositions_on(transaction, None)}
        self.values = function_values_on(transaction, None)

    def retract(self, transaction: Transaction, said: set[FluentKey]) -> None:
        """Retract what was not said again; the atoms that were said are gone from here."""
        retract(transaction, list(self.atoms.values()))
        unsaid = [value for value in self.values if value.fluent.key not in said]
        retract_function_values(transaction, unsaid)


def _hold(
    transaction: Transaction,
    names: Names,
    atoms: Sequence[Atom],
    is_goal: bool,
    before: dict[AtomKey, LiveAtom],
    steps: Steps,
) -> None:
    """Let atoms hold; those that held before are taken out of there."""
    propositions = transaction.propositions
    for batch in batches(atoms):
        texts, old = names.atoms(batch, is_goal)
        if before:
            for key in [key for key in old if before.pop(key, None) is not None]:
                del texts[key]
            old = [key for key in old if key in texts]
        propositions.hold_all(texts, old)
        propositions.spill()
        steps.add(len(batch))


class _Formulas:
    """The formulas of a problem, as they are stored.

    Attributes:
        ids: the ids of those that the problem says.
        items: their places in the document.
    """

    def __init__(self, transaction: Transaction, names: Names, problem: Problem) -> None:
        self._transaction = transaction
        self.ids: set[int] = set()
        self.items: list[Item] = []
        for goal in problem.goal:
            if isinstance(goal, Atom) and is_ground(goal):
                (text,) = names.atoms((goal,), True).texts.values()
                self.items.append(Item(GOAL, text))
            else:
                self._put(GOAL, goal)
        sections: tuple[tuple[str, Sequence[Node]], ...] = (
            (INITIAL, problem.literals),
            (TIMED, problem.timed),
            (CONSTRAINT, problem.constraints),
        )
        for section, nodes in sections:
            for node in nodes:
                self._put(section, node)
        if problem.metric is not None:
            self._put(METRIC, problem.metric)

    def _put(self, section: str, node: Node) -> None:
        formula = make_formula(self._transaction, section, node)
        self._transaction.define("formula", formula)
        self.ids.add(formula.id)
        self.items.append(Item(section, formula.name))


def _refuse_second_metric(transaction: Transaction, ids: set[int]) -> None:
    metrics = read_formulas(transaction.definitions, METRIC)
    if len(metrics) > 1:
        before, now = sorted(metrics, key=lambda each: each.id in ids)
        raise ConflictError(
            f"{before.text} is stored, but the document has {now.text}; load it with "
            "mode='replace', or make the two agree"
        )


def _items(problem: Problem, formulas: _Formulas) -> Iterator[Item]:
    yield from (Item("requirement", name) for name in problem.requirements)
    yield from (Item("object", fold(object_.name)) for object_ in problem.objects)
    yield from formulas.items


def _retract_unsaid(transaction: Transaction, declaring: Declaring, formulas: set[int]) -> None:
    definitions = transaction.definitions
    for formula in list(definitions.formulas):
        if formula.section in PROBLEM_SECTIONS and formula.id not in formulas:
            transaction.undefine("formula", formula.id)
    kept = declaring.said.get("object", set()) | constant_ids(definitions)
    objects = {object_.id for object_ in definitions.objects} - kept
    if objects:
        delete_scope(transaction, Scope(objects=objects))
