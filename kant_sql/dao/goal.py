"""Goals of any form: the DAO."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..arguments import expect
from ..atoms import AtomKey
from ..dto.formula import Atom, Constant, Formula, Node
from ..knowledge.formula import GOAL
from ..knowledge.tree_reader import TreeReader
from ..pddl.conjuncts import flatten
from ..pddl.node_text import node_text
from ..transaction import Transaction
from ..view import View
from .base import SqlDao, batches
from .dependants import propositions_on, retract
from .formula import is_ground, put_formula, read_formula, read_formulas, remove_formula
from .formula_interfaces import GoalDao
from .proposition import GOALS
from .term_writer import Place
from .tree_writer import TreeWriter


class SqlGoalDao(SqlDao, GoalDao):
    """Goals of any form in an SQL store."""

    def get_all(self) -> list[Formula]:
        """Read all goals."""

        def work(view: View) -> list[Formula]:
            atoms: list[Any] = [
                Atom(goal.predicate.name, tuple(Constant(object_.name) for object_ in goal.objects))
                for goal in GOALS.answer(view)
            ]
            definitions = view.definitions
            stored = read_formulas(definitions, GOAL)
            return [*atoms, *(read_formula(definitions, each) for each in stored)]

        return self._store.read(work, self._at)

    def save(self, formula: Formula) -> bool:
        """Let a goal stand."""
        self.save_all([formula])
        return True

    def insert(self, formula: Formula) -> bool:
        """Let a goal stand that does not stand yet."""
        return self.save_all([formula]) > 0

    def save_all(self, formulas: Iterable[Formula]) -> int:
        """Let many goals stand, in one revision."""
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(formulas):
                for formula in batch:
                    expect(formula, Node, "a goal")
                    made = [self._put(transaction, part) for part in flatten(formula)]
                    changed += any(made)
        return changed

    def delete(self, formula: Formula) -> bool:
        """Let a goal stand no more."""
        self._check_writable()
        expect(formula, Node, "a goal")

        def work(transaction: Transaction) -> bool:
            gone = [self._remove(transaction, part) for part in flatten(formula)]
            return any(gone)

        return self._store.write(work)

    def delete_all(self) -> int:
        """Let no goal stand."""
        self._check_writable()

        def work(transaction: Transaction) -> int:
            atoms = [atom for atom in propositions_on(transaction, None) if atom.key.is_goal]
            retract(transaction, atoms)
            stored = read_formulas(transaction.definitions, GOAL)
            for each in stored:
                transaction.undefine("formula", each.id)
            return len(atoms) + len(stored)

        return self._store.write(work)

    def _put(self, transaction: Transaction, goal: Formula) -> bool:
        if not (isinstance(goal, Atom) and is_ground(goal)):
            return put_formula(transaction, GOAL, goal)
        tree = TreeWriter(transaction, "a goal").tree(goal, Place.CONDITION)
        text = node_text(TreeReader(transaction.definitions, tree).formula())
        key = self._key(transaction, goal)
        assert key is not None
        return transaction.propositions.hold_all({key: text}) > 0

    def _remove(self, transaction: Transaction, goal: Formula) -> bool:
        if not (isinstance(goal, Atom) and is_ground(goal)):
            return remove_formula(transaction, GOAL, goal)
        key = self._key(transaction, goal)
        found = None if key is None else transaction.propositions.find([key]).get(key)
        return found is not None and transaction.propositions.set(found, False)

    @staticmethod
    def _key(transaction: Transaction, goal: Atom) -> AtomKey | None:
        """Find what makes a ground goal the one that it is; None when a name is not known."""
        predicate = transaction.definitions.predicates.named(goal.predicate)
        ids = transaction.definitions.arguments(map(str, goal.terms))
        return None if predicate is None or ids is None else AtomKey(True, predicate.id, ids)
