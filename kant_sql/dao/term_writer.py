"""The leaves of trees: terms, variables and numbers, checked on the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

from ..dto.formula import (
    ARITHMETIC,
    Arithmetic,
    Atom,
    Constant,
    ContinuousTime,
    Fluent,
    IsViolated,
    Number,
    TypedName,
    Variable,
)
from ..dto.formula import Term as FormulaTerm
from ..dto.name import check_name, fold
from ..dto.number import decimal_text
from ..errors import ArityError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge import tree as kinds
from ..knowledge.definitions import Definitions
from ..knowledge.function import FunctionDefinition
from ..knowledge.predicate import ParameterDefinition, PredicateDefinition
from ..knowledge.tree import Node, Term

MAX_DEPTH = 250
TOTAL_TIME = "total-time"
_DURATION = "duration"
_Types = tuple[int, ...]


def shown(node: object) -> str:
    """Give the beginning of a node's text, for a message.

    Args:
        node: the node, however deep.

    Returns:
        The text.
    """
    try:
        return f"{node!s:.80}"
    except RecursionError:
        return f"{type(node).__name__} of many levels"


class TermWriter:
    """Makes the leaves of one element's trees."""

    def __init__(
        self,
        definitions: Definitions,
        role: str,
        parameters: Sequence[ParameterDefinition] = (),
        durative: bool = False,
    ) -> None:
        """Make it.

        Args:
            definitions: what is defined.
            role: the element, for messages.
            parameters: the element's parameters.
            durative: whether it is a durative action, whose formulas may have times.
        """
        self._definitions = definitions
        self._role = role
        self._parameters = parameters
        self._durative = durative
        self._nodes: list[Node] = []
        self._scopes: list[tuple[int, tuple[ParameterDefinition, ...]]] = []
        self._depth = 0

    def _open(self, parent: int | None, operator: str, **fields: Any) -> int:
        position = len(self._nodes)
        self._nodes.append(Node(position, parent, operator, **fields))
        return position

    def _fail(self, fault: str) -> NoReturn:
        raise InvalidKnowledgeError(f"{self._role}: {fault}")

    # Expressions.

    def _expression(self, expression: object, parent: int) -> None:
        if self._depth >= MAX_DEPTH:
            self._fail(f"an expression is nested more than {MAX_DEPTH} deep; split it")
        self._depth += 1
        match expression:
            case Number():
                self._open(parent, kinds.NUMBER, value=decimal_text(expression.value))
            case Fluent():
                self._numeric_fluent(expression, parent)
            case Arithmetic() if expression.operator in ARITHMETIC and expression.operands:
                position = self._open(parent, expression.operator)
                for operand in expression.operands:
                    self._expression(operand, position)
            case Variable() if fold(expression.name) == _DURATION:
                self._open(parent, kinds.VARIABLE, value=f"?{expression.name}")
            case ContinuousTime():
                self._open(parent, kinds.TIME)
            case IsViolated():
                self._open(parent, kinds.IS_VIOLATED, value=expression.preference)
            case _:
                self._fail(f"{shown(expression)} is no number")
        self._depth -= 1

    def _numeric_fluent(self, fluent: Fluent, parent: int) -> None:
        named = self._definitions.functions.named(fluent.function)
        if named is None and fold(fluent.function) == TOTAL_TIME and not fluent.terms:
            self._open(parent, TOTAL_TIME)
        elif self._fluent(fluent, parent).type_ids:
            self._fail(f"{shown(fluent)} is an object, not a number")

    def _fluent(self, fluent: Fluent, parent: int) -> FunctionDefinition:
        function = self._definitions.functions.named(fluent.function)
        if function is None:
            self._fail(
                f"{shown(fluent)} is of function {fluent.function!r}, which is not known; save the "
                "function first"
            )
        position = self._open(parent, kinds.FUNCTION, function_id=function.id)
        self._give_terms(position, fluent, fluent.terms, function)
        return function

    # Terms and variables.

    def _variable(self, variable: TypedName) -> ParameterDefinition:
        check_name("variable", variable.name)
        ids = []
        for name in variable.types:
            type_ = self._definitions.types.named(name)
            if type_ is None:
                self._fail(
                    f"?{variable.name} is of type {name!r}, which is not known; save it first"
                )
            ids.append(type_.id)
        return ParameterDefinition(variable.name, tuple(ids))

    def _give_terms(
        self,
        position: int,
        formula: Atom | Fluent,
        terms: Sequence[FormulaTerm],
        owner: PredicateDefinition | FunctionDefinition,
    ) -> None:
        if len(terms) != len(owner.parameters):
            raise ArityError(
                f"{self._role}: {shown(formula)} has {len(terms)} terms, expected "
                f"{len(owner.parameters)} as in {owner.text}"
            )
        made = []
        for number, (term, wanted) in enumerate(zip(terms, owner.parameters, strict=True), start=1):
            term_, types = self._term(term, position)
            if not self._may_fit(types, wanted.type_ids):
                raise TypeMismatchError(
                    f"{self._role}: term {number} of {shown(formula)} does not fit {owner.text}"
                )
            made.append(term_)
        self._nodes[position] = self._nodes[position]._replace(terms=tuple(made))

    def _may_fit(self, given: _Types, wanted: _Types) -> bool:
        """Tell whether what is of a type can be of another: real domains pass supertypes, too."""
        fits = self._definitions.any_fits
        return fits(given, wanted) or fits(wanted, given)

    def _term(self, term: object, position: int) -> tuple[Term, _Types]:
        if isinstance(term, Variable):
            return self._bound(term)
        if isinstance(term, Constant):
            object_ = self._definitions.objects.named(term.name)
            if object_ is None:
                self._fail(f"object {term.name!r} is not known; save it first")
            return Term(object_id=object_.id), object_.type_ids
        if isinstance(term, Fluent):
            child = len(self._nodes)
            types = self._fluent(term, position).type_ids
            if not types:
                self._fail(f"{shown(term)} is a number, not an object")
            return Term(child=child), types
        self._fail(f"{shown(term)} is no term; give a Variable, a Constant or a Fluent")

    def _bound(self, variable: Variable) -> tuple[Term, _Types]:
        key = fold(variable.name)
        for quantifier, bound in reversed(self._scopes):
            for index in range(len(bound) - 1, -1, -1):
                if fold(bound[index].name) == key:
                    return Term(quantifier=quantifier, variable=index), bound[index].type_ids
        for index, parameter in enumerate(self._parameters):
            if fold(parameter.name) == key:
                return Term(parameter=index), parameter.type_ids
        self._fail(f"?{variable.name} is neither a parameter nor bound by a quantifier")
