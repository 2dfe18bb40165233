"""From terms and expressions, which name what they mention, to the nodes of a tree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Any, NamedTuple, NoReturn

from ..dto import PddlTypeDto
from ..dto.formula import (
    ARITHMETIC,
    ASSIGNMENTS,
    Arithmetic,
    Assign,
    Atom,
    Constant,
    ContinuousTime,
    Fluent,
    IsViolated,
    Number,
    TypedName,
    Variable,
    variables_text,
)
from ..dto.name import ROOT_TYPE, check_name, fold
from ..dto.node import shown
from ..dto.number import decimal_text
from ..errors import ArityError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge import tree as kinds
from ..knowledge.function import FunctionDefinition
from ..knowledge.predicate import ParameterDefinition, PredicateDefinition
from ..knowledge.tree import Node, Term
from ..pddl.document import DURATIVE_ACTION, PROCESS
from ..transaction import Transaction
from .type import ensure_type

TOTAL_TIME = "total-time"
_DURATION = "duration"

Types = tuple[int, ...]
Bound = tuple[ParameterDefinition, ...]
# A node whose terms are to be added: its position, what it is, and its function.
_Below = tuple[int, Fluent, FunctionDefinition]


class Place(Enum):
    """Where a formula stands, which decides what it may be built of."""

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


class Context(NamedTuple):
    """What is around a node.

    Attributes:
        place: where it stands.
        soft: whether preferences may stand here.
    """

    place: Place
    soft: bool = False

    def hard(self) -> Context:
        """Give what is around the nodes below one here that no preference may stand in.

        Returns:
            The same, without preferences.
        """
        return self._replace(soft=False)


class TermWriter:
    """Makes nodes of terms and expressions."""

    def __init__(
        self,
        transaction: Transaction,
        role: str,
        parameters: Sequence[ParameterDefinition] = (),
        kind: str = "",
    ) -> None:
        """Make it.

        Args:
            transaction: the transaction, with what is defined.
            role: the element, for messages.
            parameters: the element's parameters.
            kind: of an action its kind, which decides whether there are `?duration` and `#t`.
        """
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._role = role
        self._parameters = parameters
        self._has_duration = kind == DURATIVE_ACTION
        self._has_time = kind in (DURATIVE_ACTION, PROCESS)
        self._nodes: list[Node] = []
        # The variables that quantifiers bind around the present node, innermost last.
        self._scope: dict[str, list[tuple[Term, Types]]] = {}
        self._check_duration(parameters)

    def _open(self, parent: int | None, operator: str, **fields: Any) -> int:
        position = len(self._nodes)
        self._nodes.append(Node(position, parent, operator, **fields))
        return position

    def _fail(self, fault: str) -> NoReturn:
        raise InvalidKnowledgeError(f"{self._role}: {fault}")

    # Expressions.

    def _expression(self, expression: object, parent: int, context: Context) -> None:
        """Add an expression, with a stack of its own: none is nested too deeply for it."""
        pending = [(expression, parent)]
        while pending:
            part, above = pending.pop()
            if isinstance(part, Arithmetic):
                position = self._arithmetic(part, above)
                pending += [(operand, position) for operand in reversed(part.operands)]
            else:
                self._number(part, above, context)

    def _number(self, expression: object, parent: int, context: Context) -> None:
        match expression:
            case Number():
                self._open(parent, kinds.NUMBER, value=self._decimal(expression))
            case Fluent():
                self._numeric_fluent(expression, parent, context)
            case Variable() if fold(expression.name) == _DURATION and self._has_duration:
                self._open(parent, kinds.VARIABLE, value=f"?{expression.name}")
            case ContinuousTime() if self._has_time:
                self._open(parent, kinds.TIME)
            case IsViolated() if context.place is Place.METRIC:
                check_name("preference", expression.preference)
                self._open(parent, kinds.IS_VIOLATED, value=expression.preference)
            case _:
                self._fail(f"{shown(expression)} is no number here")

    def _decimal(self, number: object) -> str:
        if not isinstance(number, Number):
            self._fail(f"{shown(number)} is no Number")
        return decimal_text(number.value)

    def _arithmetic(self, expression: Arithmetic, parent: int) -> int:
        operator, operands = expression.operator, expression.operands
        if operator not in ARITHMETIC:
            self._fail(f"{operator!r} is no operation; use one of {' '.join(ARITHMETIC)}")
        least, most = 1 if operator == "-" else 2, 2 if operator in "-/" else len(operands)
        if not least <= len(operands) <= most:
            self._fail(f"{shown(expression)} has {len(operands)} operands")
        return self._open(parent, operator)

    def _numeric_fluent(self, fluent: Fluent, parent: int, context: Context) -> None:
        named = self._definitions.functions.named(fluent.function)
        is_time = context.place is Place.METRIC and fold(fluent.function) == TOTAL_TIME
        if named is None and is_time and not fluent.terms:
            self._open(parent, TOTAL_TIME)
        elif self._fluent(fluent, parent, context).type_ids:
            self._fail(f"{shown(fluent)} is an object, not a number")

    def _fluent(self, fluent: Fluent, parent: int, context: Context) -> FunctionDefinition:
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

    def _bind(self, variables: Sequence[TypedName]) -> Bound:
        bound = tuple(self._variable(variable) for variable in variables)
        self._check_duration(bound)
        if len({fold(variable.name) for variable in bound}) < len(bound):
            self._fail(f"one quantifier binds a variable twice: {variables_text(variables)}")
        return bound

    def _check_duration(self, variables: Sequence[ParameterDefinition]) -> None:
        """Refuse a variable that the text would take for the duration of the action."""
        if self._has_duration:
            for each in variables:
                check_name("variable of a durative action", each.name)

    def _variable(self, variable: TypedName) -> ParameterDefinition:
        if not isinstance(variable, TypedName):
            self._fail(f"{shown(variable)} is no TypedName, as what a quantifier binds")
        check_name("variable", variable.name)
        ids = []
        for name in variable.types:
            type_ = self._definitions.types.named(name)
            if type_ is None and fold(name) != ROOT_TYPE:
                self._fail(
                    f"?{variable.name} is of type {name!r}, which is not known; save it first"
                )
            # That one needs no declaration.
            type_ = type_ or ensure_type(self._transaction, PddlTypeDto(ROOT_TYPE), self._role)
            ids.append(type_.id)
        return ParameterDefinition(variable.name, tuple(ids))

    def _give_terms(
        self,
        position: int,
        formula: Atom | Fluent,
        owner: PredicateDefinition | FunctionDefinition,
        context: Context,
    ) -> None:
        """Add the terms of a node, with a stack of its own: none is nested too deeply for it."""
        pending = [self._terms(position, formula, owner, context)]
        while pending:
            below = next(pending[-1], None)
            if below is None:
                pending.pop()
            else:
                pending.append(self._terms(*below, context))

    def _terms(
        self,
        position: int,
        formula: Atom | Fluent,
        owner: PredicateDefinition | FunctionDefinition,
        context: Context,
    ) -> Iterator[_Below]:
        """Add the terms of a node; what has terms of its own is yielded for these to be added."""
        terms = formula.terms
        if len(terms) != len(owner.parameters):
            raise ArityError(
                f"{self._role}: {shown(formula)} has {len(terms)} terms, expected "
                f"{len(owner.parameters)} as in {owner.text}"
            )
        made = []
        for number, (term, wanted) in enumerate(zip(terms, owner.parameters, strict=True), start=1):
            child = len(self._nodes)
            term_, types, function = self._begin_term(term, position, context)
            if not self._may_fit(term, types, wanted.type_ids):
                raise TypeMismatchError(
                    f"{self._role}: term {number} of {shown(formula)} does not fit {owner.text}"
                )
            if function is not None and isinstance(term, Fluent):
                yield child, term, function
            made.append(term_)
        self._set_terms(position, made)

    def _set_terms(self, position: int, terms: Sequence[Term]) -> None:
        self._nodes[position] = self._nodes[position]._replace(terms=tuple(terms))

    def _may_fit(self, term: object, given: Types, wanted: Types) -> bool:
        """Tell whether a term fits; of a supertype, a variable's object may, as in real domains."""
        fits = self._definitions.any_fits
        return fits(given, wanted) or (not isinstance(term, Constant) and fits(wanted, given))

    def _term(self, term: object, position: int, context: Context) -> tuple[Term, Types]:
        """Add a term with all that is within."""
        child = len(self._nodes)
        made, types, function = self._begin_term(term, position, context)
        if function is not None and isinstance(term, Fluent):
            self._give_terms(child, term, function, context)
        return made, types

    def _begin_term(
        self, term: object, position: int, context: Context
    ) -> tuple[Term, Types, FunctionDefinition | None]:
        """Add a term; of a fluent give its function as well, for its terms are not added yet."""
        if isinstance(term, Variable):
            return *self._bound(term), None
        if isinstance(term, Constant):
            object_ = self._definitions.objects.named(term.name)
            if object_ is None:
                self._fail(f"object {term.name!r} is not known; save it first")
            return Term(object_id=object_.id), object_.type_ids, None
        if isinstance(term, Fluent):
            if context.place is Place.INITIAL:
                self._fail(f"{shown(term)} is no object, as the initial state asks for")
            child = len(self._nodes)
            function = self._open_fluent(term, position)
            if not function.type_ids:
                self._fail(f"{shown(term)} is a number, not an object")
            return Term(child=child), function.type_ids, function
        return self._fail(f"{shown(term)} is no term; give a Variable, a Constant or a Fluent")

    def _assign_object(
        self, formula: Assign, position: int, types: tuple[int, ...], context: Context
    ) -> None:
        if formula.operator != ASSIGNMENTS[0]:
            self._fail(f"{shown(formula)} counts with a function whose values are objects")
        term, given = self._term(formula.value, position, context)
        if not self._may_fit(formula.value, given, types):
            raise TypeMismatchError(f"{self._role}: the value in {shown(formula)} does not fit")
        self._set_terms(position, [term])

    def _enter(self, position: int, bound: Bound) -> None:
        """Let the variables that a node binds be used, until `_leave`."""
        for index, one in enumerate(bound):
            term = Term(quantifier=position, variable=index)
            self._scope.setdefault(fold(one.name), []).append((term, one.type_ids))

    def _leave(self, bound: Bound) -> None:
        for one in bound:
            self._scope[fold(one.name)].pop()

    def _bound(self, variable: Variable) -> tuple[Term, Types]:
        key = fold(variable.name)
        if around := self._scope.get(key):
            return around[-1]
        for index, parameter in enumerate(self._parameters):
            if fold(parameter.name) == key:
                return Term(parameter=index), parameter.type_ids
        return self._fail(f"?{variable.name} is neither a parameter nor bound by a quantifier")
