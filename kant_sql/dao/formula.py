"""Formulas as trees, and the DAOs of derived predicates, goals, constraints and the metric.

A formula that is given as text is checked by the PDDL reader, with line and column; one that is
given as a node is checked here. Both accept the same, so the text of a stored formula can be read
back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import Any, ClassVar, Generic, NamedTuple, NoReturn, TypeVar, get_args

from typing_extensions import override

from ..arguments import is_many, shown
from ..dto import PddlPropositionDto, PddlTypeDto
from ..dto import formulas as f
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
    Definition,
    Definitions,
    FormulaDefinition,
    FunctionDefinition,
    PredicateDefinition,
    formula_name,
)
from ..knowledge.formulas import TreeReader
from ..knowledge.rules import check_stratified
from ..knowledge.trees import ParameterDefinition, Tree, TreeNode, TreeTerm
from ..pddl.document import DURATIVE_ACTION, PROCESS
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
from ..store.caches import AtomKey
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
from .text import TextReader, expect_text
from .type import TYPES

TypeIds = tuple[int, ...]


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


def _bound_variables(
    transaction: Transaction, variables: Iterable[f.TypedName], role: str
) -> tuple[ParameterDefinition, ...]:
    """Find the types of variables; `object` needs no declaration."""
    found = []
    for variable in variables:
        ids = []
        for name in variable.types:
            type_ = transaction.definitions.types.named(name)
            if type_ is None and fold(name) != ROOT_TYPE:
                raise InvalidKnowledgeError(
                    f"{role}: ?{variable.name} is of type {name!r}, which is not known; save it "
                    "first"
                )
            ids.append((type_ or TYPES.ensure(transaction, PddlTypeDto(ROOT_TYPE), role)).id)
        found.append(ParameterDefinition(variable.name, tuple(ids)))
    return tuple(found)


class TreeWriter:
    """Makes the trees of one element, of formulas that were checked when they were read.

    Args:
        transaction: where names are looked up.
        parameters: the parameters of the action that they belong to.
    """

    def __init__(
        self, transaction: Transaction, parameters: Sequence[ParameterDefinition] = ()
    ) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._nodes: list[TreeNode] = []
        # What variables denote, innermost last.
        self._scope: dict[str, list[TreeTerm]] = {
            fold(one.name): [TreeTerm(parameter=number)] for number, one in enumerate(parameters)
        }

    def conjunction(self, formulas: Iterable[f.Node]) -> Tree:
        """Make the tree of a conjunction."""
        self._nodes = []
        root = self._open(None, kinds.AND)
        for formula in formulas:
            self._add(formula, root)
        return tuple(self._nodes)

    def tree(self, formula: f.Node) -> Tree:
        """Make the tree of a formula."""
        self._nodes = []
        self._add(formula, None)
        return tuple(self._nodes)

    def _open(self, parent: int | None, operator: str, **fields: Any) -> int:
        position = len(self._nodes)
        self._nodes.append(TreeNode(position, parent, operator, **fields))
        return position

    def _add(self, node: Any, parent: int | None) -> None:
        """Add a formula or a number, with its parts."""
        match node:
            case f.Atom(name, terms):
                id_ = self._id(self._definitions.predicates.named(name))
                self._apply(parent, terms, kinds.PREDICATE, predicate_id=id_)
            case f.Fluent(name, terms) if function := self._definitions.functions.named(name):
                self._apply(parent, terms, kinds.FUNCTION, function_id=function.id)
            case f.Equal(left, right):
                self._apply(parent, (left, right), kinds.EQUAL)
            case f.Assign(operator, fluent, value):
                position = self._open(parent, operator)
                self._add(fluent, position)
                declared = self._definitions.functions.named(fluent.function)
                if declared is not None and declared.type_ids:
                    self._set_terms(position, (value,))
                else:
                    self._add(value, position)
            case f.Forall() | f.Exists() | f.Count() | f.Derived():
                self._quantify(node, parent)
            case _:
                operator, fields, parts = _plain(node)
                position = self._open(parent, operator, **fields)
                for part in parts:
                    self._add(part, position)

    def _quantify(
        self, node: f.Forall | f.Exists | f.Count | f.Derived, parent: int | None
    ) -> None:
        operator = node.operator if isinstance(node, f.Count) else _QUANTIFIERS[type(node)]
        bound = _bound_variables(self._transaction, node.variables, operator)
        position = self._open(parent, operator, variables=bound)
        for index, one in enumerate(bound):
            term = TreeTerm(quantifier=position, variable=index)
            self._scope.setdefault(fold(one.name), []).append(term)
        if isinstance(node, f.Derived):
            self._add(_derived_atom(node), position)
        self._add(node.formula, position)
        for one in bound:
            self._scope[fold(one.name)].pop()

    def _apply(
        self, parent: int | None, terms: Sequence[object], operator: str, **fields: int
    ) -> int:
        """Add a node with terms."""
        position = self._open(parent, operator, **fields)
        self._set_terms(position, terms)
        return position

    def _set_terms(self, position: int, terms: Sequence[object]) -> None:
        made = tuple([self._term(term, position) for term in terms])
        self._nodes[position] = self._nodes[position]._replace(terms=made)

    def _term(self, term: Any, position: int) -> TreeTerm:
        """Return a term; the nodes of its fluents are added."""
        if isinstance(term, f.Variable):
            return self._scope[fold(term.name)][-1]
        if isinstance(term, f.Constant):
            return TreeTerm(object_id=self._id(self._definitions.objects.named(term.name)))
        id_ = self._id(self._definitions.functions.named(term.function))
        child = self._apply(position, term.terms, kinds.FUNCTION, function_id=id_)
        return TreeTerm(child=child)

    @staticmethod
    def _id(definition: Definition | None) -> int:
        assert definition is not None
        return definition.id


_QUANTIFIERS: dict[type, str] = {
    f.Forall: kinds.FORALL,
    f.Exists: kinds.EXISTS,
    f.Derived: kinds.DERIVED,
}


def _derived_atom(rule: f.Derived) -> f.Atom:
    return f.Atom(rule.predicate, tuple(f.Variable(part.name) for part in rule.variables))


def _plain(node: Any) -> tuple[str, dict[str, str | None], Sequence[f.Node]]:
    """Return the operator, the value and the parts of a node that has neither terms nor scope."""
    match node:
        case f.Number(value):
            return kinds.NUMBER, {"value": decimal_text(value)}, ()
        case f.Variable(name):
            return kinds.VARIABLE, {"value": f"?{name}"}, ()
        case f.ContinuousTime():
            return kinds.TIME, {}, ()
        case f.IsViolated(name):
            return kinds.IS_VIOLATED, {"value": name}, ()
        case f.Preference(name, formula):
            return kinds.PREFERENCE, {"value": name}, (formula,)
        case f.TimedLiteral(time, effect):
            return kinds.AT, {"value": decimal_text(time.value)}, (effect,)
        case f.Fluent():
            return f.TOTAL_TIME, {}, ()
    return f.head(node), {}, f.children(node)


class FormulaChecker:
    """Checks formulas that are given as nodes; those of texts are checked where they are read.

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
        self._has_duration = kind == DURATIVE_ACTION
        self._has_time = kind in (DURATIVE_ACTION, PROCESS)
        # The types of variables, innermost last.
        self._scope: dict[str, list[TypeIds]] = {
            fold(one.name): [one.type_ids] for one in parameters
        }
        self._check_duration(parameters)

    def check(self, formulas: Iterable[f.Node], symbol: Symbol) -> None:
        """Refuse formulas that have no place, or that name what is not known."""
        formulas = tuple(formulas)
        f.check_nesting(*formulas)
        for formula in formulas:
            self._check(formula, FormulaContext(symbol, allows_preferences=symbol in _HARD))

    def _check(self, part: object, context: FormulaContext) -> None:
        """Check a formula with its parts."""
        if type(part) not in _HANDLERS:
            self._fail(f"{shown(part)} is not a formula but {type(part).__name__}")
        handler, symbols = _HANDLERS[type(part)]
        if symbols:
            self._expect(part, context, *symbols)
        variables: Sequence[f.TypedName] = getattr(part, "variables", ())
        bound = self._bind(variables)
        for one in bound:
            self._scope.setdefault(fold(one.name), []).append(one.type_ids)
        for child, inner in handler(self, part, context):
            self._check(child, inner)
        for one in bound:
            self._scope[fold(one.name)].pop()

    def _expect(self, formula: object, context: FormulaContext, *symbols: Symbol) -> None:
        if context.symbol not in symbols:
            self._fail(f"{shown(formula)} has no place in {context.symbol.value}")

    def _fail(self, fault: str) -> NoReturn:
        raise InvalidKnowledgeError(f"{self._role}: {fault}")

    # Formulas: each handler returns the parts to check.

    def _atom(self, formula: f.Atom, context: FormulaContext) -> _Parts:
        predicate = self._definitions.predicates.named(formula.predicate)
        if predicate is None:
            self._fail(
                f"{shown(formula)} is of predicate {formula.predicate!r}, which is not known; "
                "save the predicate first"
            )
        self._check_terms(formula, predicate, context)
        return ()

    def _equal(self, formula: f.Equal, context: FormulaContext) -> _Parts:
        for term in (formula.left, formula.right):
            self._term(term, context)
        return ()

    def _comparison(self, formula: f.Comparison, context: FormulaContext) -> _Parts:
        sides = (formula.left, formula.right)
        if formula.operator not in f.COMPARISONS:
            self._fail(
                f"{formula.operator!r} is not a comparison; use one of {' '.join(f.COMPARISONS)}"
            )
        if context.symbol is Symbol.DURATION and f.Variable(f.DURATION) not in sides:
            self._fail(f"{shown(formula)} is not a constraint on ?duration")
        for side in sides:
            self._expression(side, context)
        return ()

    def _not(self, formula: f.Not, context: FormulaContext) -> _Parts:
        part, symbol = formula.formula, context.symbol
        if symbol is Symbol.EFFECT and not isinstance(part, f.Atom):
            self._fail(f"{shown(formula)} deletes what is not an atom")
        if symbol is Symbol.INITIAL and not isinstance(part, f.Atom | f.Equal):
            self._fail(f"{shown(formula)} is not a literal, as the initial state asks for")
        return [(part, context.hard())]

    def _soft(self, formula: f.And | f.Forall, context: FormulaContext) -> _Parts:
        return [(part, context) for part in f.children(formula)]

    def _hard(self, formula: f.Or | f.Imply | f.Exists, context: FormulaContext) -> _Parts:
        return [(part, context.hard()) for part in f.children(formula)]

    def _timed(self, formula: f.Timed, context: FormulaContext) -> _Parts:
        time, symbol = formula.time, context.symbol
        if time not in f.TIMES:
            self._fail(f"{shown(formula)} has the time {time!r}, expected one of {f.TIMES}")
        inner = _WITHIN_TIMED.get(symbol)
        # The paper allows effects `over all`.
        wrong = symbol is Symbol.DURATION and time == f.OVER_ALL
        wrong = wrong or (symbol in (Symbol.CONSTRAINT, Symbol.TRAJECTORY) and time != f.AT_END)
        if inner is None or wrong:
            self._fail(f"{shown(formula)} has a time that has no place in {symbol.value}")
        return [(formula.formula, context.hard()._replace(symbol=inner))]

    def _preference(self, formula: f.Preference, context: FormulaContext) -> _Parts:
        if not context.allows_preferences:
            self._fail(
                f"{shown(formula)} has no place here: a preference stands at the top of a goal, a "
                "precondition or a constraint, or within forall there"
            )
        if formula.name is not None:
            check_name("preference", formula.name)
        return [(formula.formula, context.hard())]

    def _modal(self, formula: f.Modal, context: FormulaContext) -> _Parts:
        wanted = f.MODALS.get(formula.operator)
        if wanted != (len(formula.numbers), len(formula.formulas)):
            self._fail(f"{shown(formula)} is not a constraint of PDDL 3.0")
        inner = context.hard()._replace(symbol=Symbol.TRAJECTORY)
        return [(part, inner) for part in formula.formulas]

    def _when(self, formula: f.When, context: FormulaContext) -> _Parts:
        is_timed = context.symbol is Symbol.TIMED_EFFECT
        symbol = Symbol.TIMED_CONDITION if is_timed else Symbol.CONDITION
        return [(formula.condition, context._replace(symbol=symbol)), (formula.effect, context)]

    def _assign(self, formula: f.Assign, context: FormulaContext) -> _Parts:
        if formula.operator not in f.ASSIGNMENTS:
            known = " ".join(f.ASSIGNMENTS)
            self._fail(f"{formula.operator!r} is not an assignment; use one of {known}")
        types = self._fluent(formula.fluent, context).type_ids
        if types:
            self._assign_object(formula, types, context)
        else:
            self._expression(formula.value, context)
        if context.symbol is Symbol.TIMED_EFFECT and not f.mentions(
            f.ContinuousTime, formula.value
        ):
            self._expect(formula, context, Symbol.EFFECT)
        return ()

    # Formulas that stand on their own.

    def _derived(self, formula: f.Derived, context: FormulaContext) -> _Parts:
        del context
        inner = FormulaContext(Symbol.CONDITION)
        return [(_derived_atom(formula), inner), (formula.formula, inner)]

    def _timed_literal(self, formula: f.TimedLiteral, context: FormulaContext) -> _Parts:
        effect = formula.effect
        if isinstance(effect, f.Assign):
            terms = (*effect.fluent.terms, effect.value)
            is_ground = all(isinstance(term, f.Constant | f.Number) for term in terms)
            if effect.operator != f.ASSIGNMENTS[0] or not is_ground:
                self._fail(f"{shown(formula)} assigns no number and no object to a ground fluent")
            return [(effect, context._replace(symbol=Symbol.EFFECT))]
        atom = effect.formula if isinstance(effect, f.Not) else effect
        if not isinstance(atom, f.Atom):
            self._fail(f"{shown(formula)} is not a timed literal; give an Atom, a Not or an Assign")
        return [(effect, context._replace(symbol=Symbol.INITIAL))]

    def _metric(self, formula: f.Metric, context: FormulaContext) -> _Parts:
        if formula.optimization not in kinds.OPTIMIZATIONS:
            self._fail(f"{formula.optimization!r} is neither minimize nor maximize")
        self._expression(formula.expression, context)
        return ()

    # Expressions.

    def _expression(self, part: object, context: FormulaContext) -> None:
        match part:
            case f.Arithmetic():
                self._arithmetic(part)
                for operand in part.operands:
                    self._expression(operand, context)
            case f.Fluent():
                self._numeric_fluent(part, context)
            case f.IsViolated() if context.symbol is Symbol.METRIC:
                check_name("preference", part.preference)
            case f.Variable() if fold(part.name) == f.DURATION and self._has_duration:
                pass
            case f.ContinuousTime() if self._has_time:
                pass
            case f.Number():
                pass
            case _:
                self._fail(f"{shown(part)} is not a number here")

    def _arithmetic(self, expression: f.Arithmetic) -> None:
        operator, operands = expression.operator, expression.operands
        if operator not in f.ARITHMETIC:
            self._fail(f"{operator!r} is not an operation; use one of {' '.join(f.ARITHMETIC)}")
        least, most = 1 if operator == "-" else 2, 2 if operator in "-/" else len(operands)
        if not least <= len(operands) <= most:
            self._fail(f"{shown(expression)} has {len(operands)} operands")

    def _numeric_fluent(self, fluent: f.Fluent, context: FormulaContext) -> None:
        named = self._definitions.functions.named(fluent.function)
        is_time = context.symbol is Symbol.METRIC and fold(fluent.function) == f.TOTAL_TIME
        if named is None and is_time and not fluent.terms:
            return
        if self._fluent(fluent, context).type_ids:
            self._fail(f"{shown(fluent)} is an object, not a number")

    def _fluent(self, fluent: f.Fluent, context: FormulaContext) -> FunctionDefinition:
        function = self._definitions.functions.named(fluent.function)
        if function is None:
            self._fail(
                f"{shown(fluent)} is of function {fluent.function!r}, which is not known; save "
                "the function first"
            )
        self._check_terms(fluent, function, context)
        return function

    # Terms and variables.

    def _bind(self, variables: Sequence[f.TypedName]) -> tuple[ParameterDefinition, ...]:
        for variable in variables:
            check_name("variable", variable.name)
        bound = _bound_variables(self._transaction, variables, self._role)
        self._check_duration(bound)
        if len({fold(variable.name) for variable in bound}) < len(bound):
            self._fail(f"one quantifier binds a variable twice: {f.variables_text(variables)}")
        return bound

    def _check_duration(self, variables: Sequence[ParameterDefinition]) -> None:
        """Refuse a variable named `?duration` in a durative action."""
        if self._has_duration:
            for each in variables:
                check_name("variable of a durative action", each.name)

    def _check_terms(
        self,
        formula: f.Atom | f.Fluent,
        owner: PredicateDefinition | FunctionDefinition,
        context: FormulaContext,
    ) -> None:
        """Check the terms of an atom or a fluent."""
        terms = formula.terms
        if len(terms) != len(owner.parameters):
            raise ArityError(
                f"{self._role}: {shown(formula)} has {len(terms)} terms, expected "
                f"{len(owner.parameters)} as in {owner.text}"
            )
        for number, (term, wanted) in enumerate(zip(terms, owner.parameters, strict=True), start=1):
            if not self._may_fit(term, self._term(term, context), wanted.type_ids):
                raise TypeMismatchError(
                    f"{self._role}: term {number} of {shown(formula)} does not fit {owner.text}"
                )

    def _may_fit(self, term: object, given: TypeIds, wanted: TypeIds) -> bool:
        """Return whether a term may fit: real domains pass variables of a supertype."""
        fits = self._definitions.any_fits
        return fits(given, wanted) or (not isinstance(term, f.Constant) and fits(wanted, given))

    def _term(self, term: object, context: FormulaContext) -> TypeIds:
        """Check a term with all its subterms; return its types."""
        if isinstance(term, f.Variable):
            around = self._scope.get(fold(term.name))
            if not around:
                self._fail(f"?{term.name} is neither a parameter nor bound by a quantifier")
            return around[-1]
        if isinstance(term, f.Constant):
            object_ = self._definitions.objects.named(term.name)
            if object_ is None:
                self._fail(f"object {term.name!r} is not known; save it first")
            return object_.type_ids
        if not isinstance(term, f.Fluent):
            self._fail(f"{shown(term)} is not a term; give a Variable, a Constant or a Fluent")
        if context.symbol is Symbol.INITIAL:
            self._fail(f"{shown(term)} is not an object, as the initial state asks for")
        function = self._fluent(term, context)
        if not function.type_ids:
            self._fail(f"{shown(term)} is a number, not an object")
        return function.type_ids

    def _assign_object(self, formula: f.Assign, types: TypeIds, context: FormulaContext) -> None:
        if formula.operator != f.ASSIGNMENTS[0]:
            self._fail(f"{shown(formula)} counts with a function whose values are objects")
        if not self._may_fit(formula.value, self._term(formula.value, context), types):
            raise TypeMismatchError(f"{self._role}: the value in {shown(formula)} does not fit")


# By node: what checks it, and the symbols that may have it; without any, the handler checks that.
_HANDLERS: dict[
    type, tuple[Callable[[FormulaChecker, Any, FormulaContext], _Parts], tuple[Symbol, ...]]
] = {
    f.Atom: (FormulaChecker._atom, (*_HOLDS, Symbol.EFFECT, Symbol.INITIAL)),
    f.Equal: (FormulaChecker._equal, (*_HOLDS, Symbol.INITIAL)),
    f.Comparison: (FormulaChecker._comparison, (*_HOLDS, Symbol.DURATION)),
    f.Not: (FormulaChecker._not, (*_HARD, Symbol.EFFECT, Symbol.INITIAL)),
    f.And: (FormulaChecker._soft, (*_HARD, *_WITHIN_TIMED, Symbol.EFFECT)),
    f.Or: (FormulaChecker._hard, _HARD),
    f.Imply: (FormulaChecker._hard, _HARD),
    f.Forall: (FormulaChecker._soft, (*_HARD, Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    f.Exists: (FormulaChecker._hard, _HARD),
    f.Timed: (FormulaChecker._timed, ()),
    f.Preference: (FormulaChecker._preference, ()),
    f.Modal: (FormulaChecker._modal, (Symbol.CONSTRAINT, Symbol.TRAJECTORY)),
    f.When: (FormulaChecker._when, (Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    f.Assign: (FormulaChecker._assign, (Symbol.EFFECT, Symbol.TIMED_EFFECT)),
    f.Derived: (FormulaChecker._derived, (Symbol.DERIVED,)),
    f.TimedLiteral: (FormulaChecker._timed_literal, (Symbol.TIMED,)),
    f.Metric: (FormulaChecker._metric, (Symbol.METRIC,)),
}


N = TypeVar("N", bound=f.Node)
Given = TypeVar("Given")

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
    """Find the stored formulas of one section."""
    return [each for each in definitions.formulas if each.section == section]


def check_formula(transaction: Transaction, section: str, node: f.Node) -> None:
    """Check a formula that is given as a node."""
    FormulaChecker(transaction, f"the {section} {shown(node)}").check((node,), _SYMBOLS[section])


def make_formula(transaction: Transaction, section: str, node: f.Node) -> FormulaDefinition:
    """Find or create the identity of a formula that was checked."""
    definitions = transaction.definitions
    tree = TreeWriter(transaction).tree(node)
    text = canonical_text(definitions, FormulaDefinition(0, "", section, tree))
    id_, name = identify(transaction, "formula", formula_name(section, text))
    return FormulaDefinition(id_, name, section, tree, text)


def is_ground(formula: f.Node) -> bool:
    """Return whether a formula is a ground atom, which is stored as a proposition."""
    return isinstance(formula, f.Atom) and all(
        isinstance(term, f.Constant) for term in formula.terms
    )


class _AbsentError(Exception):
    """Rolls back the identities that were made to look up an absent formula."""


def remove_formula(transaction: Transaction, section: str, node: f.Node) -> bool:
    """Delete a formula; return whether there was one."""
    try:
        with transaction.scope():
            check_formula(transaction, section, node)
            made = make_formula(transaction, section, node)
            if transaction.definitions.formulas.get(made.id) is None:
                raise _AbsentError
    except (InvalidKnowledgeError, _AbsentError):
        return False
    transaction.undefine("formula", made.id)
    return True


class SqlFormulaDao(SqlSavingDao[Given], FormulaDao[N, Given], Generic[N, Given]):
    """One section of formulas in an SQL store."""

    section: ClassVar[str]
    node_classes: tuple[type, ...] = (f.Node,)
    # Reads such a formula from text.
    _reads: ClassVar[Callable[..., Any]]
    _items = "an iterable of formulas"
    example: ClassVar[str]

    @override
    def get_all(self) -> list[N]:
        return self._open_store.read_definitions(self._stored, self._at)

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

        return self._open_store.write(insert)

    def _check(self, formula: object) -> None:
        """Refuse what is not a formula of the section."""
        if isinstance(formula, f.Node) and not isinstance(formula, self.node_classes):
            names = " or ".join(each.__name__ for each in self.node_classes)
            raise InvalidKnowledgeError(
                f"a {self.section} is a node {names} of kant_sql.pddl, not "
                f"{type(formula).__name__}: {shown(formula)}"
            )
        expect_text(formula, f"the {self.section} DAO", f"a {self.section}", self.example)

    def _holds(self, transaction: Transaction, formula: Given) -> bool:
        """Return whether it is stored, where that cannot be seen by saving it."""
        return False

    def _save_batch(self, transaction: Transaction, dtos: Iterable[Given]) -> int:
        return sum(self._put_given(transaction, dto) for dto in dtos)

    def _put_given(self, transaction: Transaction, formula: Any) -> bool:
        """Save a node or a text; return whether that is a change."""
        node: N = formula
        if isinstance(formula, str):
            node = TextReader(transaction).read(self._reads, formula)
        made = []
        for part in self._parts(node):
            if node is formula:
                check_formula(transaction, self.section, part)
            made.append(self._put(transaction, part))
        return any(made)

    def _remove(self, transaction: Transaction, dto: Any) -> bool:
        node: N | None = dto
        if isinstance(dto, str):
            node = TextReader(transaction).read_stored(self._reads, dto)
        if node is None:
            return False
        gone = [self._remove_part(transaction, part) for part in self._parts(node)]
        return any(gone)

    def _stored(self, definitions: Definitions) -> list[N]:
        stored = read_formulas(definitions, self.section)
        return [read_formula(definitions, each) for each in stored]  # type: ignore[misc]

    def _parts(self, formula: N) -> Sequence[N]:
        """Return the formulas that are stored in its place."""
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
    node_classes = (f.Derived,)
    _reads = staticmethod(read_derived)
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
    node_classes = (f.TimedLiteral,)
    _reads = staticmethod(read_timed_literal)
    example = "(at 10 (open door1))"


class SqlInitialLiteralDao(
    SqlFormulaDao[f.Not | f.Equal, f.Not | f.Equal | str], InitialLiteralDao
):
    """Negative literals and equalities of the initial state in an SQL store."""

    section = INITIAL
    node_classes = (f.Not, f.Equal)
    _reads = staticmethod(read_initial_literal)
    example = "(not (open door1))"


class _SqlConjunctionDao(SqlFormulaDao[f.Formula, Given]):
    """A section in which a conjunction is stored as its conjuncts."""

    def _parts(self, formula: f.Formula) -> Sequence[f.Formula]:
        return flatten(*super()._parts(formula))


class SqlConstraintDao(_SqlConjunctionDao[f.Formula | str], ConstraintDao):
    """The problem's constraints in an SQL store."""

    section = CONSTRAINT
    _reads = staticmethod(read_constraints)
    example = "(always (not (open door1)))"


class SqlDomainConstraintDao(SqlConstraintDao):
    """The domain's constraints in an SQL store."""

    section = DOMAIN_CONSTRAINT


def read_goals(view: View) -> list[f.Formula]:
    """Read the goals of a state, preferences included; those that are propositions come first."""
    found: list[Any] = [
        f.Atom(goal.predicate.name, tuple([f.Constant(one.name) for one in goal.objects]))
        for goal in GOALS.answer(view)
    ]
    stored = read_formulas(view.definitions, GOAL)
    return found + [read_formula(view.definitions, each) for each in stored]


class SqlGoalDao(_SqlConjunctionDao[GoalLike], GoalDao):
    """Goals of any form in an SQL store; ground atoms among them are propositions."""

    section = GOAL
    _reads = staticmethod(read_goal)
    example = "(robot_at rb1 wp1)"

    @override
    def get_all(self) -> list[f.Formula]:
        return self._open_store.read(read_goals, self._at)

    @override
    def get_propositions(self) -> list[PddlPropositionDto]:
        return self._open_store.read(GOALS.answer, self._at)

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
        tree = TreeWriter(transaction).tree(formula)
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

        return self._open_store.read_definitions(read, self._at)

    @override
    def set(self, metric: f.Metric | str | None) -> bool:
        self._check_writable()
        if metric is not None and not isinstance(metric, f.Metric | str):
            raise InvalidKnowledgeError(
                f"the metric is PDDL text, a node Metric of kant_sql.pddl, or None, not "
                f"{type(metric).__name__}: {shown(metric)}"
            )

        def set_(transaction: Transaction) -> bool:
            if isinstance(metric, str):
                return put_metric(transaction, TextReader(transaction).read(read_metric, metric))
            return put_metric(transaction, metric)

        return self._open_store.write(set_)


def put_metric(transaction: Transaction, metric: f.Metric | None) -> bool:
    """Replace the metric; return whether it changed."""
    made = None
    if metric is not None:
        check_formula(transaction, METRIC, metric)
        made = make_formula(transaction, METRIC, metric)
    changed = False
    for stored in read_formulas(transaction.definitions, METRIC):
        if made is None or stored.id != made.id:
            transaction.undefine("formula", stored.id)
            changed = True
    return (made is not None and transaction.define("formula", made)) or changed
