"""Formulas that stand on their own: derived predicates, goals, constraints, the metric ..."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Generic, TypeVar, get_args

from ..dto.formula import (
    Atom,
    Constant,
    Derived,
    Equal,
    Formula,
    Metric,
    Node,
    Not,
    TimedLiteral,
    variables_text,
)
from ..dto.node import shown
from ..errors import InvalidKnowledgeError, reading_rows
from ..knowledge.definitions import Definitions
from ..knowledge.formula import (
    CONSTRAINT,
    DERIVED_PREDICATE,
    DOMAIN_CONSTRAINT,
    GOAL,
    INITIAL,
    METRIC,
    TIMED,
    FormulaDefinition,
    formula_name,
)
from ..knowledge.tree_reader import TreeReader
from ..pddl.conjuncts import flatten
from ..pddl.node_text import node_text
from ..transaction import Transaction
from .base import SqlDao, batches
from .formula_interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    FormulaDao,
    InitialLiteralDao,
    TimedInitialLiteralDao,
)
from .term_writer import Place
from .tree_writer import TreeWriter

N = TypeVar("N", bound=Node)

_PLACES = {
    DERIVED_PREDICATE: Place.DERIVED,
    DOMAIN_CONSTRAINT: Place.CONSTRAINT,
    INITIAL: Place.INITIAL,
    TIMED: Place.TIMED,
    GOAL: Place.CONDITION,
    CONSTRAINT: Place.CONSTRAINT,
    METRIC: Place.METRIC,
}
# What the root of a tree may be, in the sections that do not take any formula.
_CLASSES: dict[str, tuple[type, ...]] = {
    DERIVED_PREDICATE: (Derived,),
    INITIAL: (Not, Equal),
    TIMED: (TimedLiteral,),
    METRIC: (Metric,),
}
_FORMULAS: tuple[type, ...] = get_args(Formula)


def read_formula(definitions: Definitions, formula: FormulaDefinition) -> Node:
    """Read a stored formula.

    Args:
        definitions: what is defined.
        formula: the formula.

    Returns:
        The node.
    """
    with reading_rows("formula_version", f"formula {formula.id!r}"):
        node: Node = TreeReader(definitions, formula.tree).formula()
        if not isinstance(node, _CLASSES.get(formula.section, _FORMULAS)):
            raise TypeError(f"a {type(node).__name__} stands as {formula.section}")
    return node


def read_formulas(definitions: Definitions, section: str) -> list[FormulaDefinition]:
    """Find the stored formulas of one section.

    Args:
        definitions: what is defined.
        section: the section.

    Returns:
        The formulas, in the order in which each was first known.
    """
    return [each for each in definitions.formulas if each.section == section]


def make_formula(transaction: Transaction, section: str, node: Node) -> FormulaDefinition:
    """Check a formula, and find or make its identity.

    Args:
        transaction: the transaction.
        section: the part of the domain or the problem that it stands in.
        node: the formula.

    Returns:
        What it would be defined as.

    Raises:
        InvalidKnowledgeError: it is not well formed, or names what is not known.
    """
    definitions = transaction.definitions
    writer = TreeWriter(transaction, f"the {section} {shown(node)}")
    tree = writer.tree(node, _PLACES[section])
    text = formula_text(TreeReader(definitions, tree).formula())
    name = formula_name(section, text)
    stored = definitions.formulas.named(name)
    id_ = stored.id if stored else transaction.intern("formula", name)[0]
    return FormulaDefinition(id_, name, section, tree, text)


def formula_text(node: Node) -> str:
    """Write a formula as `str()` does, but without recursion.

    Args:
        node: the formula.

    Returns:
        The canonical PDDL text.

    Raises:
        InvalidKnowledgeError: the text could not be read back.
    """
    if isinstance(node, TimedLiteral):
        return str(node)
    if isinstance(node, Metric):
        return f"(:metric {node.optimization} {node_text(node.expression)})"
    if isinstance(node, Derived):
        head = " ".join(part for part in (node.predicate, variables_text(node.variables)) if part)
        return f"(:derived ({head}) {node_text(node.formula)})"
    return node_text(node)


def put_formula(transaction: Transaction, section: str, node: Node) -> bool:
    """Let a formula stand.

    Args:
        transaction: the transaction.
        section: the part of the domain or the problem that it stands in.
        node: the formula.

    Returns:
        Whether that is a change.

    Raises:
        InvalidKnowledgeError: as `make_formula`.
    """
    return transaction.define("formula", make_formula(transaction, section, node))


class _NotStandingError(Exception):
    """Undoes what was made to look for a formula that does not stand."""


def remove_formula(transaction: Transaction, section: str, node: Node) -> bool:
    """Let a formula stand no more.

    Args:
        transaction: the transaction.
        section: the part of the domain or the problem that it stands in.
        node: the formula, in any spelling of what it mentions.

    Returns:
        False when it does not stand.
    """
    try:
        with transaction.scope():
            made = make_formula(transaction, section, node)
            if transaction.definitions.formulas.get(made.id) is None:
                raise _NotStandingError
    except (InvalidKnowledgeError, _NotStandingError):
        return False
    transaction.undefine("formula", made.id)
    return True


def is_ground(formula: Node) -> bool:
    """Tell whether a formula is an atom over objects, which is stored as a proposition.

    Args:
        formula: the formula.

    Returns:
        Whether it is.
    """
    return isinstance(formula, Atom) and all(isinstance(term, Constant) for term in formula.terms)


class SqlFormulaDao(SqlDao, FormulaDao[N], Generic[N]):
    """One section of formulas in an SQL store."""

    section: ClassVar[str]
    node_classes: tuple[type, ...] = (Node,)

    def get_all(self) -> list[N]:
        """Read all formulas of the section."""

        def work(definitions: Definitions) -> list[N]:
            stored = read_formulas(definitions, self.section)
            return [read_formula(definitions, each) for each in stored]  # type: ignore[misc]

        return self._store.read_definitions(work, self._at)

    def save(self, formula: N) -> bool:
        """Let a formula stand."""
        self.save_all([formula])
        return True

    def insert(self, formula: N) -> bool:
        """Let a formula stand that does not stand yet."""
        return self.save_all([formula]) > 0

    def save_all(self, formulas: Iterable[N]) -> int:
        """Let many formulas stand, in one revision."""
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(formulas):
                changed += sum(self._put(transaction, self._checked(each)) for each in batch)
        return changed

    def delete(self, formula: N) -> bool:
        """Let a formula stand no more."""
        self._check_writable()
        self._checked(formula)
        return self._store.write(lambda transaction: self._remove(transaction, formula))

    def delete_all(self) -> int:
        """Let no formula of the section stand."""
        self._check_writable()

        def work(transaction: Transaction) -> int:
            stored = read_formulas(transaction.definitions, self.section)
            for each in stored:
                transaction.undefine("formula", each.id)
            return len(stored)

        return self._store.write(work)

    def _checked(self, formula: N) -> N:
        if not isinstance(formula, self.node_classes):
            names = " or ".join(each.__name__ for each in self.node_classes)
            raise InvalidKnowledgeError(
                f"what stands as a {self.section} is a node {names} of kant_sql.pddl, not "
                f"{type(formula).__name__}: {shown(formula)}"
            )
        return formula

    def _put(self, transaction: Transaction, formula: N) -> bool:
        return put_formula(transaction, self.section, formula)

    def _remove(self, transaction: Transaction, formula: N) -> bool:
        return remove_formula(transaction, self.section, formula)


class SqlDerivedPredicateDao(SqlFormulaDao[Derived], DerivedPredicateDao):
    """Rules for derived predicates in an SQL store."""

    section = DERIVED_PREDICATE
    node_classes = (Derived,)


class SqlTimedInitialLiteralDao(SqlFormulaDao[TimedLiteral], TimedInitialLiteralDao):
    """Timed initial literals in an SQL store."""

    section = TIMED
    node_classes = (TimedLiteral,)


class SqlInitialLiteralDao(SqlFormulaDao[Not | Equal], InitialLiteralDao):
    """Negative literals and equalities of the initial state in an SQL store."""

    section = INITIAL
    node_classes = (Not, Equal)


class SqlConstraintDao(SqlFormulaDao[Formula], ConstraintDao):
    """The problem's constraints in an SQL store."""

    section = CONSTRAINT

    def _put(self, transaction: Transaction, formula: Formula) -> bool:
        made = [put_formula(transaction, self.section, part) for part in flatten(formula)]
        return any(made)

    def _remove(self, transaction: Transaction, formula: Formula) -> bool:
        gone = [remove_formula(transaction, self.section, part) for part in flatten(formula)]
        return any(gone)


class SqlDomainConstraintDao(SqlConstraintDao):
    """The domain's constraints in an SQL store."""

    section = DOMAIN_CONSTRAINT
