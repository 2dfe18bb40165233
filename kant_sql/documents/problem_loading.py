"""Loading a problem into a store."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from ..atoms import Atom as LiveAtom
from ..atoms import AtomKey
from ..dao.base import batches
from ..dao.dependants import Scope, delete_scope, propositions_on, retract
from ..dao.fluents_on import function_values_on, retract_function_values
from ..dao.formula import is_ground, make_formula, read_formulas
from ..dto.formula import Atom, Constant, Fluent, Node
from ..dto.name import fold
from ..dto.number import decimal_text
from ..errors import ConflictError
from ..fluents import FluentKey, FluentValue
from ..knowledge.document import PROBLEM, Item
from ..knowledge.formula import CONSTRAINT, GOAL, INITIAL, METRIC, PROBLEM_SECTIONS, TIMED
from ..knowledge.predicate import PredicateDefinition
from ..pddl.document import FunctionValue, Problem
from ..transaction import Transaction
from .declaring import Declaring
from .ordering import check_title, find_document, merged, put_document


def load_problem(transaction: Transaction, problem: Problem, replace: bool) -> None:
    """Store a problem, whose domain is stored.

    Args:
        transaction: the transaction.
        problem: the problem.
        replace: whether what it does not say is retracted; else it must not contradict what is
            stored, and that stays.

    Raises:
        ConflictError: it contradicts what is stored.
    """
    stored = find_document(transaction.definitions, PROBLEM)
    if stored is not None and not replace:
        check_title(stored, problem.name)
    before = _Before(transaction) if replace and transaction.head.revision else None
    declaring = Declaring(transaction, replace)
    declaring.objects(problem.objects, is_constant=False)
    names = _Names(transaction)
    goals = [goal for goal in problem.goal if isinstance(goal, Atom) and is_ground(goal)]
    for atoms, is_goal in ((problem.facts, False), (goals, True)):
        _hold(transaction, names, atoms, is_goal, {} if before is None else before.atoms)
    values = names.values(problem.values)
    transaction.values.set_many(values)
    formulas = _Formulas(transaction, names, problem)
    if before is not None:
        before.retract(transaction, {key for key, _, _ in values})
    if replace:
        _retract_unsaid(transaction, declaring, formulas.ids)
    _refuse_second_metric(transaction, formulas.ids)
    items = merged(stored, _items(problem, formulas), replace)
    put_document(transaction, PROBLEM, problem.name, problem.domain, items)


_NAME = attrgetter("name")


class _Names:
    """From names in a consistent document to ids; a document has each name in one spelling."""

    def __init__(self, transaction: Transaction) -> None:
        definitions = transaction.definitions
        self._definitions = definitions
        self._predicates: dict[str, PredicateDefinition] = {}
        self._ids = {object_.name: str(object_.id) for object_ in definitions.objects}

    def atom(self, atom: Atom, is_goal: bool) -> tuple[AtomKey, str]:
        """Find what makes a ground atom the one that it is, and its text."""
        predicate = self._predicates.get(atom.predicate)
        if predicate is None:
            predicate = self._definitions.predicates.named(atom.predicate)
            assert predicate is not None
            self._predicates[atom.predicate] = predicate
        ids, names = self._arguments(atom)
        text = f"({' '.join([predicate.name, *names])})"
        return AtomKey(is_goal, predicate.id, " ".join(ids)), text

    def values(self, values: Iterable[FunctionValue]) -> list[tuple[FluentKey, str, FluentValue]]:
        """Find what makes fluents the ones that they are, their texts and their values."""
        made = []
        for fluent, value in values:
            function = self._definitions.functions.named(fluent.function)
            assert function is not None
            ids, names = self._arguments(fluent)
            text = f"({' '.join([function.name, *names])})"
            if isinstance(value, Constant):
                object_ = self._object(value.name)
                held = FluentValue(object_[1], int(object_[0]))
            else:
                held = FluentValue(decimal_text(value.value))
            made.append((FluentKey(function.id, " ".join(ids)), text, held))
        return made

    def _arguments(self, atom: Atom | Fluent) -> tuple[list[str], list[str]]:
        names = [*map(_NAME, atom.terms)]
        try:
            return [self._ids[name] for name in names], names
        except KeyError:
            # The store had the object before, in another spelling.
            found = [self._object(name) for name in names]
            return [id_ for id_, _ in found], [name for _, name in found]

    def _object(self, name: str) -> tuple[str, str]:
        object_ = self._definitions.objects.named(name)
        assert object_ is not None
        return str(object_.id), object_.name


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
    names: _Names,
    atoms: Sequence[Atom],
    is_goal: bool,
    before: dict[AtomKey, LiveAtom],
) -> None:
    """Let atoms hold; those that held before are taken out of there."""
    propositions = transaction.propositions
    for batch in batches(atoms):
        texts = dict([names.atom(atom, is_goal) for atom in batch])
        for key in [key for key in texts if before.pop(key, None) is not None]:
            del texts[key]
        found = propositions.find(texts)
        propositions.look_at(found.values())
        for key, text in texts.items():
            atom = found.get(key)
            if atom is None:
                propositions.add(key, text)
            else:
                propositions.set(atom, True)
        propositions.spill()


class _Formulas:
    """The formulas of a problem, as they are stored.

    Attributes:
        ids: the ids of those that the problem says.
        items: their places in the document.
    """

    def __init__(self, transaction: Transaction, names: _Names, problem: Problem) -> None:
        self._transaction = transaction
        self.ids: set[int] = set()
        self.items: list[Item] = []
        for goal in problem.goal:
            if isinstance(goal, Atom) and is_ground(goal):
                self.items.append(Item(GOAL, names.atom(goal, True)[1]))
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
    said = declaring.said.get("object", set())
    objects = {
        object_.id
        for object_ in definitions.objects
        if not object_.is_constant and object_.id not in said
    }
    if objects:
        delete_scope(transaction, Scope(objects=objects))
