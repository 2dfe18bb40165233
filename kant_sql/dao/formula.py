"""Formulas as trees, and the DAOs of derived predicates, goals, constraints and the metric.

The PDDL reader checks every formula, a node by its text. So the text of a stored formula can be
read back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Generic, TypeVar, get_args

from typing_extensions import override

from ..arguments import is_many, shown
from ..dto import PddlPropositionDto, PddlTypeDto
from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidKnowledgeError, reading_rows
from ..html import Listing
from ..knowledge.atoms import AtomKey
from ..knowledge.canonical import canonical_text
from ..knowledge.definitions import (
    CONSTRAINT,
    DERIVED_PREDICATE,
    DOMAIN_CONSTRAINT,
    GOAL,
    INITIAL,
    METRIC,
    TIMED,
    Definition,
    Definitions,
    FormulaDefinition,
    formula_name,
)
from ..knowledge.formulas import TreeReader, TreeWriter
from ..knowledge.rules import check_stratified
from ..knowledge.trees import ParameterDefinition
from ..pddl.formulas import flatten
from ..pddl.given import (
    read_constraints,
    read_derived,
    read_goal,
    read_initial_literal,
    read_metric,
    read_timed_literal,
)
from ..pddl.writer import node_text
from ..store.snapshot import View
from ..store.transaction import Transaction
from .base import SqlDao, SqlSavingDao, identify, saving
from .interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    FormulaDao,
    GoalDao,
    GoalLike,
    InitialLiteralDao,
    MetricDao,
    TimedInitialLiteralDao,
)
from .proposition import GOALS, References, check_dto, existing_key, key_of_atom, retract_all
from .text import expect_text, read_stored, read_text
from .type import TYPES


def tree_writer(
    transaction: Transaction, parameters: Sequence[ParameterDefinition] = ()
) -> TreeWriter:
    """Prepare to make the trees of one element; the type `object` needs no declaration."""
    definitions = transaction.definitions

    def find(kind: str, name: str) -> Definition | None:
        known: Definition | None = definitions.elements(kind).named(name)
        if known is None and kind == "type":
            return TYPES.ensure(transaction, PddlTypeDto(ROOT_TYPE), "a variable")
        return known

    return TreeWriter(find, parameters)


N = TypeVar("N", bound=f.Node)
Given = TypeVar("Given")

# The reader of each section.
_READS: dict[str, Callable[..., Any]] = {
    DERIVED_PREDICATE: read_derived,
    DOMAIN_CONSTRAINT: read_constraints,
    INITIAL: read_initial_literal,
    TIMED: read_timed_literal,
    GOAL: read_goal,
    CONSTRAINT: read_constraints,
    METRIC: read_metric,
}
# The allowed roots of trees, in sections that do not take every formula.
_CLASSES: dict[str, tuple[type, ...]] = {
    DERIVED_PREDICATE: (f.Derived,),
    INITIAL: (f.Not, f.Equal),
    TIMED: (f.TimedLiteral,),
    METRIC: (f.Metric,),
}
_FORMULAS: tuple[type, ...] = get_args(f.Formula)


def read_formula(definitions: Definitions, formula: FormulaDefinition) -> f.Node:
    """Read a stored formula."""
    with reading_rows("formula_version", f"formula {formula.id!r}"):
        node: f.Node = TreeReader(definitions, formula.tree).formula()
        if not isinstance(node, _CLASSES.get(formula.section, _FORMULAS)):
            raise TypeError(f"a {type(node).__name__} stands as {formula.section}")
    return node


def read_formulas(definitions: Definitions, section: str) -> list[FormulaDefinition]:
    """Read the stored formulas of one section."""
    return [each for each in definitions.formulas if each.section == section]


def read_given(transaction: Transaction, section: str, given: f.Node | str) -> Any:
    """Read a formula from a text or a node."""
    read = read_text(transaction, _READS[section], given)
    if isinstance(given, f.Node):
        refuse_others(given, read)
    return read


def refuse_others(given: f.Node, read: f.Node) -> None:
    """Refuse a node whose text has another meaning: a name may have blanks and parentheses."""
    if _content(given) != _content(read):
        # Nodes of other classes can have the same text.
        found = repr(read) if str(read) == str(given) else shown(read)
        raise InvalidKnowledgeError(
            f"the text of {shown(given)} is read as another formula, {found}; give each "
            "name, operator and operand as PDDL has it"
        )


def _content(node: f.Node) -> list[object]:
    """Return a key that is equal for formulas that differ only in spelling."""
    bound = [
        (fold(one.name), [*map(fold, one.types)])
        for part in f.walk(node)
        for one in getattr(part, "variables", ())
    ]
    return [[*map(type, f.walk(node))], fold(str(node)), bound]


def make_formula(transaction: Transaction, section: str, node: f.Node) -> FormulaDefinition:
    """Find or create the identity of a checked formula."""
    definitions = transaction.definitions
    tree = tree_writer(transaction).tree(node)
    text = canonical_text(definitions, FormulaDefinition(0, "", section, tree))
    id_, name = identify(transaction, "formula", formula_name(section, text))
    return FormulaDefinition(id_, name, section, tree, text)


def is_ground(formula: f.Node) -> bool:
    """Return whether a formula is a ground atom, which is stored as a proposition."""
    return isinstance(formula, f.Atom) and all(
        isinstance(term, f.Constant) for term in formula.terms
    )


class _AbsentError(Exception):
    """Rolls back the identities made to look up an absent formula."""


def remove_formula(transaction: Transaction, section: str, node: f.Node) -> bool:
    """Delete a formula; return whether there was one."""
    try:
        with transaction.scope():
            made = make_formula(transaction, section, read_given(transaction, section, node))
            if transaction.definitions.formulas.get(made.id) is None:
                raise _AbsentError
    except (InvalidKnowledgeError, _AbsentError):
        return False
    transaction.undefine("formula", made.id)
    return True


class SqlFormulaDao(SqlSavingDao[Given], FormulaDao[N, Given], Generic[N, Given]):
    """One section of formulas in an SQL store."""

    section: ClassVar[str]
    _items = "an iterable of formulas"
    example: ClassVar[str]

    @override
    def get_all(self) -> list[N]:
        return Listing(self._store.read_definitions(self._stored, self._at), "element")

    @override
    def save(self, formula: Given | Sequence[Given]) -> bool:
        given: Any = formula
        self.save_all(given if is_many(given) else [given])
        return True

    @override
    def insert(self, dto: Given) -> bool:
        self._check_writable()
        self._check(dto)

        def insert(transaction: Transaction) -> bool:
            return not self._holds(transaction, dto) and self._save_batch(transaction, [dto]) > 0

        return self._store.write(insert)

    def _check(self, formula: object) -> None:
        """Refuse an argument that is not a formula of the section."""
        classes = _CLASSES.get(self.section, (f.Node,))
        if isinstance(formula, f.Node) and not isinstance(formula, classes):
            names = " or ".join(each.__name__ for each in classes)
            raise InvalidKnowledgeError(
                f"a {self.section} is a node {names} of kant_sql.pddl, not "
                f"{type(formula).__name__}: {shown(formula)}"
            )
        expect_text(formula, f"the {self.section} DAO", f"a {self.section}", self.example)

    def _holds(self, transaction: Transaction, formula: Given) -> bool:
        """Return whether it is stored, where saving it does not show that."""
        return False

    def _save_batch(self, transaction: Transaction, dtos: Iterable[Given]) -> int:
        return sum(self._put_given(transaction, dto) for dto in dtos)

    def _put_given(self, transaction: Transaction, formula: Any) -> bool:
        """Save a node or a text; return whether it changed the store."""
        # A conjunction may be nested deeper than its parts may be.
        given: Sequence[Any] = (formula,) if isinstance(formula, str) else self._parts(formula)
        read = [read_given(transaction, self.section, part) for part in given]
        made = [self._put(transaction, part) for each in read for part in self._parts(each)]
        return any(made)

    def _remove(self, transaction: Transaction, dto: Any) -> bool:
        node: N | None = dto
        if isinstance(dto, str):
            node = read_stored(transaction, _READS[self.section], dto)
        if node is None:
            return False
        gone = [self._remove_part(transaction, part) for part in self._parts(node)]
        return any(gone)

    def _stored(self, definitions: Definitions) -> list[N]:
        stored = read_formulas(definitions, self.section)
        return [read_formula(definitions, each) for each in stored]  # type: ignore[misc]

    def _parts(self, formula: N) -> Sequence[N]:
        """Return the formulas to store in its place."""
        return (formula,)

    def _put(self, transaction: Transaction, formula: N) -> bool:
        return transaction.define("formula", make_formula(transaction, self.section, formula))

    def _remove_part(self, transaction: Transaction, formula: N) -> bool:
        return remove_formula(transaction, self.section, formula)

    def _remove_all(self, transaction: Transaction) -> int:
        stored = read_formulas(transaction.definitions, self.section)
        for each in stored:
            transaction.undefine("formula", each.id)
        return len(stored)


class SqlDerivedPredicateDao(SqlFormulaDao[f.Derived, f.Derived | str], DerivedPredicateDao):
    """Rules for derived predicates in an SQL store."""

    section = DERIVED_PREDICATE
    example = "(:derived (reachable ?p - place) (connected dock ?p))"

    def _save_batch(self, transaction: Transaction, dtos: Iterable[f.Derived | str]) -> int:
        changed = super()._save_batch(transaction, dtos)
        if changed:
            check_stratified(transaction.definitions)
        return changed


class SqlTimedInitialLiteralDao(
    SqlFormulaDao[f.TimedLiteral, f.TimedLiteral | str], TimedInitialLiteralDao
):
    """Timed initial literals in an SQL store."""

    section = TIMED
    example = "(at 10 (open door1))"


class SqlInitialLiteralDao(
    SqlFormulaDao[f.Not | f.Equal, f.Not | f.Equal | str], InitialLiteralDao
):
    """Negative literals and equalities of the initial state in an SQL store."""

    section = INITIAL
    example = "(not (open door1))"


class _SqlConjunctionDao(SqlFormulaDao[f.Formula, Given]):
    """A section in which a conjunction is stored as its conjuncts."""

    def _parts(self, formula: f.Formula) -> Sequence[f.Formula]:
        return flatten(*super()._parts(formula))


class SqlConstraintDao(_SqlConjunctionDao[f.Formula | str], ConstraintDao):
    """The problem's constraints in an SQL store."""

    section = CONSTRAINT
    example = "(always (not (open door1)))"


class SqlDomainConstraintDao(SqlConstraintDao):
    """The domain's constraints in an SQL store."""

    section = DOMAIN_CONSTRAINT


def read_goals(view: View) -> list[f.Formula]:
    """Read the goals of a state, including preferences; propositions come first."""
    found: list[Any] = [
        f.Atom(goal.predicate.name, tuple([f.Constant(one.name) for one in goal.objects]))
        for goal in GOALS.answer(view)
    ]
    stored = read_formulas(view.definitions, GOAL)
    return found + [read_formula(view.definitions, each) for each in stored]


class SqlGoalDao(_SqlConjunctionDao[GoalLike], GoalDao):
    """Goals of any form in an SQL store; ground atoms among them are propositions."""

    section = GOAL
    example = "(robot_at rb1 wp1)"

    @override
    def get_all(self) -> list[f.Formula]:
        return Listing(self._store.read(read_goals, self._at), "element")

    @override
    def get_propositions(self) -> list[PddlPropositionDto]:
        return Listing(self._store.read(GOALS.answer, self._at), "goal")

    def _check(self, formula: object) -> None:
        if isinstance(formula, PddlPropositionDto):
            check_dto(formula)
        else:
            super()._check(formula)

    def _holds(self, transaction: Transaction, formula: GoalLike) -> bool:
        if not isinstance(formula, PddlPropositionDto):
            return False
        found = transaction.propositions.find_one(existing_key(transaction, formula, is_goal=True))
        return found is not None and transaction.propositions.holds(found)

    def _save_batch(self, transaction: Transaction, dtos: Iterable[GoalLike]) -> int:
        given = [*dtos]
        atoms = [each for each in given if isinstance(each, PddlPropositionDto)]
        with saving(transaction, atoms):
            resolve = References(transaction, are_goals=True).resolve
            changed = transaction.propositions.hold_all(dict(map(resolve, atoms)))
        others = (each for each in given if not isinstance(each, PddlPropositionDto))
        return changed + super()._save_batch(transaction, others)

    def _remove(self, transaction: Transaction, dto: Any) -> bool:
        if not isinstance(dto, PddlPropositionDto):
            return super()._remove(transaction, dto)
        return self._retract(transaction, existing_key(transaction, dto, is_goal=True))

    def _put(self, transaction: Transaction, formula: f.Formula) -> bool:
        if not (isinstance(formula, f.Atom) and is_ground(formula)):
            return super()._put(transaction, formula)
        tree = tree_writer(transaction).tree(formula)
        text = node_text(TreeReader(transaction.definitions, tree).formula())
        key = key_of_atom(transaction, formula, True)
        assert key is not None
        return transaction.propositions.hold_all({key: text}) > 0

    def _remove_part(self, transaction: Transaction, formula: f.Formula) -> bool:
        if not (isinstance(formula, f.Atom) and is_ground(formula)):
            return super()._remove_part(transaction, formula)
        return self._retract(transaction, key_of_atom(transaction, formula, True))

    @staticmethod
    def _retract(transaction: Transaction, key: AtomKey | None) -> bool:
        found = transaction.propositions.find_one(key)
        return found is not None and transaction.propositions.set(found, False)

    def _remove_all(self, transaction: Transaction) -> int:
        return retract_all(transaction, are_goals=True) + super()._remove_all(transaction)


class SqlMetricDao(SqlDao, MetricDao):
    """The metric in an SQL store."""

    @override
    def get(self) -> f.Metric | None:
        def read(definitions: Definitions) -> f.Metric | None:
            stored = read_formulas(definitions, METRIC)
            return read_formula(definitions, stored[0]) if stored else None  # type: ignore[return-value]

        return self._store.read_definitions(read, self._at)

    @override
    def set(self, metric: f.Metric | str | None) -> bool:
        self._check_writable()
        if metric is not None and not isinstance(metric, f.Metric | str):
            raise InvalidKnowledgeError(
                f"the metric is PDDL text, a node Metric of kant_sql.pddl, or None, not "
                f"{type(metric).__name__}: {shown(metric)}"
            )

        return self._store.write(lambda transaction: put_metric(transaction, metric))


def put_metric(transaction: Transaction, metric: f.Metric | str | None) -> bool:
    """Replace the metric; return whether it changed."""
    made = None
    if metric is not None:
        made = make_formula(transaction, METRIC, read_given(transaction, METRIC, metric))
    changed = False
    for stored in read_formulas(transaction.definitions, METRIC):
        if made is None or stored.id != made.id:
            transaction.undefine("formula", stored.id)
            changed = True
    return (made is not None and transaction.define("formula", made)) or changed
