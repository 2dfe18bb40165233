"""Formulas as trees, and the DAOs of derived predicates, goals, constraints and the metric.

The checks accept what the PDDL reader accepts, so the text of a stored formula can be read back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import Any, ClassVar, Generic, NamedTuple, NoReturn, TypeVar, get_args

from typing_extensions import override

from ..arguments import is_many, iterate, refuse_many, shown
from ..dto import PddlPropositionDto, PddlTypeDto
from ..dto.formulas import (
    ARITHMETIC,
    ASSIGNMENTS,
    AT_END,
    COMPARISONS,
    DURATION,
    MODALS,
    OVER_ALL,
    TIMES,
    TOTAL_TIME,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    IsViolated,
    Metric,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
    check_nesting,
    variables_text,
    walk,
)
from ..dto.lexical import ROOT_TYPE, check_name, decimal_text, fold
from ..errors import ArityError, InvalidKnowledgeError, TypeMismatchError, reading_rows
from ..knowledge import trees as kinds
from ..knowledge.canonical import canonical_text
from ..knowledge.definitions import (
    CONSTRAINT,
    DERIVED_PREDICATE,
    DOMAIN_CONSTRAINT,
    GOAL,
    INITIAL,
    METRIC,
    TIMED,
    Definitions,
    FormulaDefinition,
    FunctionDefinition,
    PredicateDefinition,
    formula_name,
)
from ..knowledge.formulas import TreeReader
from ..knowledge.rules import check_stratified
from ..knowledge.trees import ParameterDefinition, Tree, TreeNode, TreeTerm
from ..pddl.conditions import read_constraints, read_goal
from ..pddl.document import DURATIVE_ACTION, PROCESS
from ..pddl.formulas import flatten
from ..pddl.writer import node_text
from ..store.caches import AtomKey
from ..store.snapshot import View
from ..store.transaction import Transaction
from .base import SqlDao, batches, identify
from .dependants import propositions_on, retract
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
from .proposition import GOALS, References, check_dto, existing_key, key_of_atom
from .text import TextReader, expect_text
from .type import TYPES

TypeIds = tuple[int, ...]
BoundVariables = tuple[ParameterDefinition, ...]


class Symbol(Enum):
    """What a formula is in PDDL's grammar: it decides which nodes the formula may contain."""

    CONDITION = "a condition or a goal"
    EFFECT = "an effect"
    TIMED_CONDITION = "a condition of a durative action, where what holds is within a Timed"
    TIMED_EFFECT = "an effect of a durative action, where what happens is within a Timed"
    DURATION = "a duration"
    CONSTRAINT = "a constraint, where what holds is within a Modal"
    TRAJECTORY = "what a constraint is about"
    INITIAL = "an initial state"
    TIMED = "the timed initial literals"
    DERIVED = "the rules for derived predicates"
    METRIC = "a metric"


class FormulaContext(NamedTuple):
    """What a node is a part of, and whether a preference may stand there."""

    symbol: Symbol
    allows_preferences: bool = False

    def hard(self) -> FormulaContext:
        """Return the same symbol without preferences."""
        return self._replace(allows_preferences=False)


_HARD = (Symbol.CONDITION, Symbol.TIMED_CONDITION, Symbol.CONSTRAINT, Symbol.TRAJECTORY)
_HOLDS = (Symbol.CONDITION, Symbol.TRAJECTORY)
_WITHIN_TIMED = {
    Symbol.TIMED_CONDITION: Symbol.CONDITION,
    Symbol.TIMED_EFFECT: Symbol.EFFECT,
    Symbol.DURATION: Symbol.DURATION,
    Symbol.CONSTRAINT: Symbol.CONDITION,
    Symbol.TRAJECTORY: Symbol.CONDITION,
}
_Parts = Iterable[tuple[object, FormulaContext]]


class TreeWriter:
    """Checks formulas and makes the trees of one element.

    Args:
        transaction: where names are looked up.
        role: what the formulas are, for messages.
        parameters: the parameters of the action that they belong to.
        kind: the kind of that action.
    """

    def __init__(
        self,
        transaction: Transaction,
        role: str,
        parameters: Sequence[ParameterDefinition] = (),
        kind: str = "",
    ) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._role = role
        self._parameters = parameters
        self._has_duration = kind == DURATIVE_ACTION
        self._has_time = kind in (DURATIVE_ACTION, PROCESS)
        self._nodes: list[TreeNode] = []
        # The variables that quantifiers bind around the present node, innermost last.
        self._scope: dict[str, list[tuple[TreeTerm, TypeIds]]] = {}
        self._check_duration(parameters)

    def conjunction(self, formulas: Iterable[Node], symbol: Symbol) -> Tree:
        """Make the tree of a conjunction."""
        formulas = tuple(formulas)
        check_nesting(*formulas)
        self._nodes = []
        root = self._open(None, kinds.AND)
        for formula in formulas:
            self._add(formula, root, FormulaContext(symbol, allows_preferences=symbol in _HARD))
        return tuple(self._nodes)

    def tree(self, formula: Node, symbol: Symbol) -> Tree:
        """Make the tree of a formula."""
        check_nesting(formula)
        self._nodes = []
        self._add(formula, None, FormulaContext(symbol, allows_preferences=symbol in _HARD))
        return tuple(self._nodes)

    def _add(self, part: object, parent: int | None, context: FormulaContext) -> None:
        """Add a formula with its parts."""
        if type(part) not in _HANDLERS:
            self._fail(f"{shown(part)} is no formula but {type(part).__name__}")
        handler, symbols = _HANDLERS[type(part)]
        if symbols:
            self._expect(part, context, *symbols)
        position = len(self._nodes)
        below = handler(self, part, parent, context)
        bound = self._nodes[position].variables
        if bound:
            self._enter(position, bound)
        for child, inner in below:
            self._add(child, position, inner)
        if bound:
            self._leave(bound)

    def _expect(self, formula: object, context: FormulaContext, *symbols: Symbol) -> None:
        if context.symbol not in symbols:
            self._fail(f"{shown(formula)} has no place in {context.symbol.value}")

    def _open(self, parent: int | None, operator: str, **fields: Any) -> int:
        position = len(self._nodes)
        self._nodes.append(TreeNode(position, parent, operator, **fields))
        return position

    def _fail(self, fault: str) -> NoReturn:
        raise InvalidKnowledgeError(f"{self._role}: {fault}")

    # Formulas: each handler adds a node and returns the parts to add below it.

    def _atom(self, formula: Atom, parent: int | None, context: FormulaContext) -> _Parts:
        predicate = self._definitions.predicates.named(formula.predicate)
        if predicate is None:
            self._fail(
                f"{shown(formula)} is of predicate {formula.predicate!r}, which is not known; "
                "save the predicate first"
            )
        position = self._open(parent, kinds.PREDICATE, predicate_id=predicate.id)
        self._give_terms(position, formula, predicate, context)
        return ()

    def _equal(self, formula: Equal, parent: int | None, context: FormulaContext) -> _Parts:
        position = self._open(parent, kinds.EQUAL)
        terms = [self._term(term, position, context)[0] for term in (formula.left, formula.right)]
        self._set_terms(position, terms)
        return ()

    def _comparison(
        self, formula: Comparison, parent: int | None, context: FormulaContext
    ) -> _Parts:
        sides = (formula.left, formula.right)
        if formula.operator not in COMPARISONS:
            self._fail(f"{formula.operator!r} is no comparison; use one of {' '.join(COMPARISONS)}")
        if context.symbol is Symbol.DURATION and Variable(DURATION) not in sides:
            self._fail(f"{shown(formula)} is no constraint on ?duration")
        position = self._open(parent, formula.operator)
        for side in sides:
            self._expression(side, position, context)
        return ()

    def _not(self, formula: Not, parent: int | None, context: FormulaContext) -> _Parts:
        part, symbol = formula.formula, context.symbol
        if symbol is Symbol.EFFECT and not isinstance(part, Atom):
            self._fail(f"{shown(formula)} deletes what is not an atom")
        if symbol is Symbol.INITIAL and not isinstance(part, Atom | Equal):
            self._fail(f"{shown(formula)} is no literal, as the initial state asks for")
        self._open(parent, kinds.NOT)
        return [(part, context.hard())]

    def _and(self, formula: And, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.AND)
        return [(part, context) for part in formula.formulas]

    def _or(self, formula: Or, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.OR)
        return [(part, context.hard()) for part in formula.formulas]

    def _imply(self, formula: Imply, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.IMPLY)
        return [(part, context.hard()) for part in (formula.condition, formula.formula)]

    def _forall(self, formula: Forall, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.FORALL, variables=self._bind(formula.variables))
        return [(formula.formula, context)]

    def _exists(self, formula: Exists, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.EXISTS, variables=self._bind(formula.variables))
        return [(formula.formula, context.hard())]

    def _timed(self, formula: Timed, parent: int | None, context: FormulaContext) -> _Parts:
        time, symbol = formula.time, context.symbol
        if time not in TIMES:
            self._fail(f"{shown(formula)} has the time {time!r}, expected one of {TIMES}")
        inner = _WITHIN_TIMED.get(symbol)
        # The paper allows effects `over all`.
        wrong = symbol is Symbol.DURATION and time == OVER_ALL
        wrong = wrong or (symbol in (Symbol.CONSTRAINT, Symbol.TRAJECTORY) and time != AT_END)
        if inner is None or wrong:
            self._fail(f"{shown(formula)} has a time that has no place in {symbol.value}")
        self._open(parent, time)
        return [(formula.formula, context.hard()._replace(symbol=inner))]

    def _preference(
        self, formula: Preference, parent: int | None, context: FormulaContext
    ) -> _Parts:
        if not context.allows_preferences:
            self._fail(
                f"{shown(formula)} has no place here: a preference stands at the top of a goal, a "
                "precondition or a constraint, or within forall there"
            )
        if formula.name is not None:
            check_name("preference", formula.name)
        self._open(parent, kinds.PREFERENCE, value=formula.name)
        return [(formula.formula, context.hard())]

    def _modal(self, formula: Modal, parent: int | None, context: FormulaContext) -> _Parts:
        wanted = MODALS.get(formula.operator)
        if wanted != (len(formula.numbers), len(formula.formulas)):
            self._fail(f"{shown(formula)} is no constraint of PDDL 3.0")
        position = self._open(parent, formula.operator)
        for number in formula.numbers:
            self._open(position, kinds.NUMBER, value=decimal_text(number.value))
        inner = context.hard()._replace(symbol=Symbol.TRAJECTORY)
        return [(part, inner) for part in formula.formulas]

    def _when(self, formula: When, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.WHEN)
        is_timed = context.symbol is Symbol.TIMED_EFFECT
        symbol = Symbol.TIMED_CONDITION if is_timed else Symbol.CONDITION
        return [(formula.condition, context._replace(symbol=symbol)), (formula.effect, context)]

    def _assign(self, formula: Assign, parent: int | None, context: FormulaContext) -> _Parts:
        if formula.operator not in ASSIGNMENTS:
            known = " ".join(ASSIGNMENTS)
            self._fail(f"{formula.operator!r} is no assignment; use one of {known}")
        position = self._open(parent, formula.operator)
        types = self._fluent(formula.fluent, position, context).type_ids
        if types:
            self._assign_object(formula, position, types, context)
        else:
            self._expression(formula.value, position, context)
        if context.symbol is Symbol.TIMED_EFFECT and not any(
            isinstance(part, ContinuousTime) for part in walk(formula.value)
        ):
            self._expect(formula, context, Symbol.EFFECT)
        return ()

    # Formulas that stand on their own.

    def _derived(self, formula: Derived, parent: int | None, context: FormulaContext) -> _Parts:
        self._open(parent, kinds.DERIVED, variables=self._bind(formula.variables))
        head = Atom(formula.predicate, tuple(Variable(part.name) for part in formula.variables))
        inner = FormulaContext(Symbol.CONDITION)
        return [(head, inner), (formula.formula, inner)]

    def _timed_literal(
        self, formula: TimedLiteral, parent: int | None, context: FormulaContext
    ) -> _Parts:
        effect = formula.effect
        self._open(parent, kinds.AT, value=decimal_text(formula.time.value))
        if isinstance(effect, Assign):
            terms = (*effect.fluent.terms, effect.value)
            is_ground = all(isinstance(term, Constant | Number) for term in terms)
            if effect.operator != ASSIGNMENTS[0] or not is_ground:
                self._fail(f"{shown(formula)} assigns no number and no object to a ground fluent")
            return [(effect, context._replace(symbol=Symbol.EFFECT))]
        atom = effect.formula if isinstance(effect, Not) else effect
        if not isinstance(atom, Atom):
            self._fail(f"{shown(formula)} is no timed literal; give an Atom, a Not or an Assign")
        return [(effect, context._replace(symbol=Symbol.INITIAL))]

    def _metric(self, formula: Metric, parent: int | None, context: FormulaContext) -> _Parts:
        if formula.optimization not in kinds.OPTIMIZATIONS:
            self._fail(f"{formula.optimization!r} is neither minimize nor maximize")
        position = self._open(parent, formula.optimization)
        self._expression(formula.expression, position, context)
        return ()

    # Expressions.

    def _expression(self, part: object, parent: int, context: FormulaContext) -> None:
        if isinstance(part, Arithmetic):
            position = self._arithmetic(part, parent)
            for operand in part.operands:
                self._expression(operand, position, context)
        else:
            self._number(part, parent, context)

    def _number(self, expression: object, parent: int, context: FormulaContext) -> None:
        match expression:
            case Number():
                self._open(parent, kinds.NUMBER, value=decimal_text(expression.value))
            case Fluent():
                self._numeric_fluent(expression, parent, context)
            case Variable() if fold(expression.name) == DURATION and self._has_duration:
                self._open(parent, kinds.VARIABLE, value=f"?{expression.name}")
            case ContinuousTime() if self._has_time:
                self._open(parent, kinds.TIME)
            case IsViolated() if context.symbol is Symbol.METRIC:
                check_name("preference", expression.preference)
                self._open(parent, kinds.IS_VIOLATED, value=expression.preference)
            case _:
                self._fail(f"{shown(expression)} is no number here")

    def _arithmetic(self, expression: Arithmetic, parent: int) -> int:
        operator, operands = expression.operator, expression.operands
        if operator not in ARITHMETIC:
            self._fail(f"{operator!r} is no operation; use one of {' '.join(ARITHMETIC)}")
        least, most = 1 if operator == "-" else 2, 2 if operator in "-/" else len(operands)
        if not least <= len(operands) <= most:
            self._fail(f"{shown(expression)} has {len(operands)} operands")
        return self._open(parent, operator)

    def _numeric_fluent(self, fluent: Fluent, parent: int, context: FormulaContext) -> None:
        named = self._definitions.functions.named(fluent.function)
        is_time = context.symbol is Symbol.METRIC and fold(fluent.function) == TOTAL_TIME
        if named is None and is_time and not fluent.terms:
            self._open(parent, TOTAL_TIME)
        elif self._fluent(fluent, parent, context).type_ids:
            self._fail(f"{shown(fluent)} is an object, not a number")

    def _fluent(self, fluent: Fluent, parent: int, context: FormulaContext) -> FunctionDefinition:
        position = len(self._nodes)
        function = self._open_fluent(fluent, parent)
        self._give_terms(position, fluent, function, context)
        return function

    def _open_fluent(self, fluent: Fluent, parent: int) -> FunctionDefinition:
        """Add a function's node, without its terms."""
        function = self._definitions.functions.named(fluent.function)
        if function is None:
            self._fail(
                f"{shown(fluent)} is of function {fluent.function!r}, which is not known; save "
                "the function first"
            )
        self._open(parent, kinds.FUNCTION, function_id=function.id)
        return function

    # Terms and variables.

    def _bind(self, variables: Sequence[TypedName]) -> BoundVariables:
        bound = tuple(self._variable(variable) for variable in variables)
        self._check_duration(bound)
        if len({fold(variable.name) for variable in bound}) < len(bound):
            self._fail(f"one quantifier binds a variable twice: {variables_text(variables)}")
        return bound

    def _check_duration(self, variables: Sequence[ParameterDefinition]) -> None:
        """Refuse a variable named `?duration` in a durative action."""
        if self._has_duration:
            for each in variables:
                check_name("variable of a durative action", each.name)

    def _variable(self, variable: TypedName) -> ParameterDefinition:
        check_name("variable", variable.name)
        ids = []
        for name in variable.types:
            type_ = self._definitions.types.named(name)
            if type_ is None and fold(name) != ROOT_TYPE:
                self._fail(
                    f"?{variable.name} is of type {name!r}, which is not known; save it first"
                )
            # `object` needs no declaration.
            type_ = type_ or TYPES.ensure(self._transaction, PddlTypeDto(ROOT_TYPE), self._role)
            ids.append(type_.id)
        return ParameterDefinition(variable.name, tuple(ids))

    def _give_terms(
        self,
        position: int,
        formula: Atom | Fluent,
        owner: PredicateDefinition | FunctionDefinition,
        context: FormulaContext,
    ) -> None:
        """Add the terms of a node."""
        terms = formula.terms
        if len(terms) != len(owner.parameters):
            raise ArityError(
                f"{self._role}: {shown(formula)} has {len(terms)} terms, expected "
                f"{len(owner.parameters)} as in {owner.text}"
            )
        made = []
        for number, (term, wanted) in enumerate(zip(terms, owner.parameters, strict=True), start=1):
            term_, types = self._term(term, position, context)
            if not self._may_fit(term, types, wanted.type_ids):
                raise TypeMismatchError(
                    f"{self._role}: term {number} of {shown(formula)} does not fit {owner.text}"
                )
            made.append(term_)
        self._set_terms(position, made)

    def _set_terms(self, position: int, terms: Sequence[TreeTerm]) -> None:
        self._nodes[position] = self._nodes[position]._replace(terms=tuple(terms))

    def _may_fit(self, term: object, given: TypeIds, wanted: TypeIds) -> bool:
        """Return whether a term may fit: real domains pass variables of a supertype."""
        fits = self._definitions.any_fits
        return fits(given, wanted) or (not isinstance(term, Constant) and fits(wanted, given))

    def _term(
        self, term: object, position: int, context: FormulaContext
    ) -> tuple[TreeTerm, TypeIds]:
        """Add a term with all its subterms."""
        if isinstance(term, Variable):
            return self._bound(term)
        if isinstance(term, Constant):
            object_ = self._definitions.objects.named(term.name)
            if object_ is None:
                self._fail(f"object {term.name!r} is not known; save it first")
            return TreeTerm(object_id=object_.id), object_.type_ids
        if isinstance(term, Fluent):
            if context.symbol is Symbol.INITIAL:
                self._fail(f"{shown(term)} is no object, as the initial state asks for")
            child = len(self._nodes)
            function = self._open_fluent(term, position)
            if not function.type_ids:
                self._fail(f"{shown(term)} is a number, not an object")
            self._give_terms(child, term, function, context)
            return TreeTerm(child=child), function.type_ids
        return self._fail(f"{shown(term)} is no term; give a Variable, a Constant or a Fluent")

    def _assign_object(
        self, formula: Assign, position: int, types: TypeIds, context: FormulaContext
    ) -> None:
        if formula.operator != ASSIGNMENTS[0]:
            self._fail(f"{shown(formula)} counts with a function whose values are objects")
        term, given = self._term(formula.value, position, context)
        if not self._may_fit(formula.value, given, types):
            raise TypeMismatchError(f"{self._role}: the value in {shown(formula)} does not fit")
        self._set_terms(position, [term])

    def _enter(self, position: int, bound: BoundVariables) -> None:
        """Bind the variables of a quantifier until `_leave`."""
        for index, one in enumerate(bound):
            term = TreeTerm(quantifier=position, variable=index)
            self._scope.setdefault(fold(one.name), []).append((term, one.type_ids))

    def _leave(self, bound: BoundVariables) -> None:
        for one in bound:
            self._scope[fold(one.name)].pop()

    def _bound(self, variable: Variable) -> tuple[TreeTerm, TypeIds]:
        key = fold(variable.name)
        if around := self._scope.get(key):
            return around[-1]
        for index, parameter in enumerate(self._parameters):
            if fold(parameter.name) == key:
                return TreeTerm(parameter=index), parameter.type_ids
        return self._fail(f"?{variable.name} is neither a parameter nor bound by a quantifier")


# By node: what adds it, and the symbols that may have it; without any, the handler checks that.
_HANDLERS: dict[
    type, tuple[Callable[[TreeWriter, Any, int | None, FormulaContext], _Parts], tuple[Symbol, ...]]
] = {
    Atom: (TreeWriter._atom, (*_HOLDS, Symbol.EFFECT, Symbol.INITIAL)),
    Equal: (TreeWriter._equal, (*_HOLDS, Symbol.INITIAL)),
    Comparison: (TreeWriter._comparison, (*_HOLDS, Symbol.DURATION)),
    Not: (TreeWriter._not, (*_HARD, Symbol.EFFECT, Symbol.INITIAL)),
    And: (TreeWriter._and, (*_HARD, *_WITHIN_TIMED, Symbol.EFFECT)),
    Or: (TreeWriter._or, _HARD),
    Imply: (TreeWriter._imply, _HARD),
    Forall: (TreeWriter._forall, (*_HARD, Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    Exists: (TreeWriter._exists, _HARD),
    Timed: (TreeWriter._timed, ()),
    Preference: (TreeWriter._preference, ()),
    Modal: (TreeWriter._modal, (Symbol.CONSTRAINT, Symbol.TRAJECTORY)),
    When: (TreeWriter._when, (Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    Assign: (TreeWriter._assign, (Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    Derived: (TreeWriter._derived, (Symbol.DERIVED,)),
    TimedLiteral: (TreeWriter._timed_literal, (Symbol.TIMED,)),
    Metric: (TreeWriter._metric, (Symbol.METRIC,)),
}


N = TypeVar("N", bound=Node)

_SYMBOLS = {
    DERIVED_PREDICATE: Symbol.DERIVED,
    DOMAIN_CONSTRAINT: Symbol.CONSTRAINT,
    INITIAL: Symbol.INITIAL,
    TIMED: Symbol.TIMED,
    GOAL: Symbol.CONDITION,
    CONSTRAINT: Symbol.CONSTRAINT,
    METRIC: Symbol.METRIC,
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
    """Read a stored formula."""
    with reading_rows("formula_version", f"formula {formula.id!r}"):
        node: Node = TreeReader(definitions, formula.tree).formula()
        if not isinstance(node, _CLASSES.get(formula.section, _FORMULAS)):
            raise TypeError(f"a {type(node).__name__} stands as {formula.section}")
    return node


def read_formulas(definitions: Definitions, section: str) -> list[FormulaDefinition]:
    """Find the stored formulas of one section."""
    return [each for each in definitions.formulas if each.section == section]


def make_formula(transaction: Transaction, section: str, node: Node) -> FormulaDefinition:
    """Check a formula and find or create its identity."""
    definitions = transaction.definitions
    writer = TreeWriter(transaction, f"the {section} {shown(node)}")
    tree = writer.tree(node, _SYMBOLS[section])
    text = canonical_text(definitions, FormulaDefinition(0, "", section, tree))
    id_, name = identify(transaction, "formula", formula_name(section, text))
    return FormulaDefinition(id_, name, section, tree, text)


def is_ground(formula: Node) -> bool:
    """Return whether a formula is a ground atom, which is stored as a proposition."""
    return isinstance(formula, Atom) and all(isinstance(term, Constant) for term in formula.terms)


def put_formula(transaction: Transaction, section: str, node: Node) -> bool:
    """Save a formula; return whether it is new."""
    return transaction.define("formula", make_formula(transaction, section, node))


class _AbsentError(Exception):
    """Rolls back the identities that were made to look up an absent formula."""


def remove_formula(transaction: Transaction, section: str, node: Node) -> bool:
    """Delete a formula; return whether there was one."""
    try:
        with transaction.scope():
            made = make_formula(transaction, section, node)
            if transaction.definitions.formulas.get(made.id) is None:
                raise _AbsentError
    except (InvalidKnowledgeError, _AbsentError):
        return False
    transaction.undefine("formula", made.id)
    return True


def remove_formulas(transaction: Transaction, section: str) -> int:
    """Delete all formulas of a section; return their number."""
    stored = read_formulas(transaction.definitions, section)
    for each in stored:
        transaction.undefine("formula", each.id)
    return len(stored)


class SqlFormulaDao(SqlDao, FormulaDao[N], Generic[N]):
    """One section of formulas in an SQL store."""

    section: ClassVar[str]
    node_classes: tuple[type, ...] = (Node,)
    # Reads such a formula from text, where it can be told from others of its form.
    _reads: ClassVar[Callable[..., Any] | None] = None
    example: ClassVar[str] = ""

    @override
    def get_all(self) -> list[N]:
        return self._store.read_definitions(self._stored, self._at)

    @override
    def save(self, formula: N | str | Sequence[N | str]) -> bool:
        given: Any = formula
        self.save_all(given if is_many(given) else [given])
        return True

    @override
    def insert(self, formula: N | str) -> bool:
        return self.save_all([formula]) > 0

    @override
    def save_all(self, formulas: Iterable[N | str]) -> int:
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(formulas):
                for formula in batch:
                    self._check(formula)
                    changed += self._put_given(transaction, formula)
        return changed

    @override
    def delete(self, formula: N | str) -> bool:
        self._check_writable()
        self._check(formula)
        return self._store.write(lambda transaction: self._remove_given(transaction, formula))

    def _check(self, formula: object) -> None:
        """Refuse what is no formula of the section."""
        refuse_many(formula)
        if isinstance(formula, self.node_classes):
            return
        if self._reads is not None:
            expect_text(formula, f"the {self.section} DAO", f"a {self.section}", self.example)
            return
        names = " or ".join(each.__name__ for each in self.node_classes)
        raise InvalidKnowledgeError(
            f"what is saved as a {self.section} is a node {names} of kant_sql.pddl, not "
            f"{type(formula).__name__}: {shown(formula)}"
        )

    def _put_given(self, transaction: Transaction, formula: Any) -> bool:
        """Save a node or a text; return whether that is a change."""
        node: N = formula
        if isinstance(formula, str):
            node = TextReader(transaction).read(self._reader(), formula)
        made = [self._put(transaction, part) for part in self._parts(node)]
        return any(made)

    def _remove_given(self, transaction: Transaction, formula: Any) -> bool:
        """Delete a node or a text; return whether it was stored."""
        node: N | None = formula
        if isinstance(formula, str):
            node = TextReader(transaction).read_stored(self._reader(), formula)
        if node is None:
            return False
        gone = [self._remove(transaction, part) for part in self._parts(node)]
        return any(gone)

    def _reader(self) -> Callable[..., Any]:
        assert self._reads is not None
        return self._reads

    @override
    def delete_all(self, formulas: Iterable[N | str] | None = None) -> int:
        self._check_writable()
        if formulas is None:
            return self._store.write(self._remove_all)
        removed = 0
        with self._store.transaction() as transaction:
            for formula in iterate(formulas, "what delete_all takes", "an iterable of formulas"):
                self._check(formula)
                removed += self._remove_given(transaction, formula)
        return removed

    def _stored(self, definitions: Definitions) -> list[N]:
        stored = read_formulas(definitions, self.section)
        return [read_formula(definitions, each) for each in stored]  # type: ignore[misc]

    def _parts(self, formula: N) -> Sequence[N]:
        """Return the formulas that are stored in its place."""
        return (formula,)

    def _put(self, transaction: Transaction, formula: N) -> bool:
        return put_formula(transaction, self.section, formula)

    def _remove(self, transaction: Transaction, formula: N) -> bool:
        return remove_formula(transaction, self.section, formula)

    def _remove_all(self, transaction: Transaction) -> int:
        return remove_formulas(transaction, self.section)


class SqlDerivedPredicateDao(SqlFormulaDao[Derived], DerivedPredicateDao):
    """Rules for derived predicates in an SQL store."""

    section = DERIVED_PREDICATE
    node_classes = (Derived,)

    @override
    def save_all(self, formulas: Iterable[Derived | str]) -> int:
        with self._store.transaction() as transaction:
            changed = super().save_all(formulas)
            if changed:
                check_stratified(transaction.definitions)
        return changed


class SqlTimedInitialLiteralDao(SqlFormulaDao[TimedLiteral], TimedInitialLiteralDao):
    """Timed initial literals in an SQL store."""

    section = TIMED
    node_classes = (TimedLiteral,)


class SqlInitialLiteralDao(SqlFormulaDao[Not | Equal], InitialLiteralDao):
    """Negative literals and equalities of the initial state in an SQL store."""

    section = INITIAL
    node_classes = (Not, Equal)


class _SqlConjunctionDao(SqlFormulaDao[Formula]):
    """A section in which a conjunction is stored as its conjuncts."""

    def _parts(self, formula: Formula) -> Sequence[Formula]:
        return flatten(*super()._parts(formula))


class SqlConstraintDao(_SqlConjunctionDao, ConstraintDao):
    """The problem's constraints in an SQL store."""

    section = CONSTRAINT
    _reads = staticmethod(read_constraints)
    example = "(always (not (open door1)))"


class SqlDomainConstraintDao(SqlConstraintDao):
    """The domain's constraints in an SQL store."""

    section = DOMAIN_CONSTRAINT


class SqlGoalDao(_SqlConjunctionDao, GoalDao):
    """Goals of any form in an SQL store; ground atoms among them are propositions."""

    section = GOAL
    _reads = staticmethod(read_goal)
    example = "(robot_at rb1 wp1)"

    @override
    def get_all(self) -> list[Formula]:
        def work(view: View) -> list[Formula]:
            atoms: list[Formula] = [
                Atom(goal.predicate.name, tuple(Constant(object_.name) for object_ in goal.objects))
                for goal in GOALS.answer(view)
            ]
            return atoms + self._stored(view.definitions)

        return self._store.read(work, self._at)

    @override
    def save(self, formula: GoalLike | Sequence[GoalLike]) -> bool:
        return super().save(formula)  # type: ignore[arg-type]

    @override
    def insert(self, formula: GoalLike) -> bool:
        return super().insert(formula)  # type: ignore[arg-type]

    @override
    def save_all(self, formulas: Iterable[GoalLike]) -> int:
        return super().save_all(formulas)  # type: ignore[arg-type]

    @override
    def delete(self, formula: GoalLike) -> bool:
        return super().delete(formula)  # type: ignore[arg-type]

    @override
    def delete_all(self, formulas: Iterable[GoalLike] | None = None) -> int:
        return super().delete_all(formulas)  # type: ignore[arg-type]

    def _check(self, formula: object) -> None:
        if isinstance(formula, PddlPropositionDto):
            check_dto(formula)
        else:
            super()._check(formula)

    def _put_given(self, transaction: Transaction, formula: Any) -> bool:
        if not isinstance(formula, PddlPropositionDto):
            return super()._put_given(transaction, formula)
        key, text = References(transaction).resolve(formula)
        return transaction.propositions.hold_all({key._replace(is_goal=True): text}) > 0

    def _remove_given(self, transaction: Transaction, formula: Any) -> bool:
        if not isinstance(formula, PddlPropositionDto):
            return super()._remove_given(transaction, formula)
        key = existing_key(transaction, formula)
        return self._retract(transaction, None if key is None else key._replace(is_goal=True))

    def _put(self, transaction: Transaction, formula: Formula) -> bool:
        if not (isinstance(formula, Atom) and is_ground(formula)):
            return super()._put(transaction, formula)
        tree = TreeWriter(transaction, "a goal").tree(formula, Symbol.CONDITION)
        text = node_text(TreeReader(transaction.definitions, tree).formula())
        key = key_of_atom(transaction, formula, True)
        assert key is not None
        return transaction.propositions.hold_all({key: text}) > 0

    def _remove(self, transaction: Transaction, formula: Formula) -> bool:
        if not (isinstance(formula, Atom) and is_ground(formula)):
            return super()._remove(transaction, formula)
        return self._retract(transaction, key_of_atom(transaction, formula, True))

    @staticmethod
    def _retract(transaction: Transaction, key: AtomKey | None) -> bool:
        found = None if key is None else transaction.propositions.find([key]).get(key)
        return found is not None and transaction.propositions.set(found, False)

    def _remove_all(self, transaction: Transaction) -> int:
        atoms = [atom for atom in propositions_on(transaction, None) if atom.key.is_goal]
        retract(transaction, atoms)
        return len(atoms) + super()._remove_all(transaction)


class SqlMetricDao(SqlDao, MetricDao):
    """The metric in an SQL store."""

    @override
    def get(self) -> Metric | None:
        def work(definitions: Definitions) -> Metric | None:
            stored = read_formulas(definitions, METRIC)
            return read_formula(definitions, stored[0]) if stored else None  # type: ignore[return-value]

        return self._store.read_definitions(work, self._at)

    @override
    def set(self, metric: Metric | None) -> bool:
        self._check_writable()
        if metric is not None and not isinstance(metric, Metric):
            raise InvalidKnowledgeError(
                f"the metric is a node Metric of kant_sql.pddl, or None, not "
                f"{type(metric).__name__}: {shown(metric)}"
            )
        return self._store.write(lambda transaction: put_metric(transaction, metric))


def put_metric(transaction: Transaction, metric: Metric | None) -> bool:
    """Replace the metric; return whether it changed."""
    made = None if metric is None else make_formula(transaction, METRIC, metric)
    changed = False
    for stored in read_formulas(transaction.definitions, METRIC):
        if made is None or stored.id != made.id:
            transaction.undefine("formula", stored.id)
            changed = True
    return (made is not None and transaction.define("formula", made)) or changed
