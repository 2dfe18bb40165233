"""Numbers and what is computed of them; comparisons, which may be of objects as well."""

from __future__ import annotations

import re
from decimal import Decimal

from ..dto.formula import (
    ARITHMETIC,
    Arithmetic,
    Comparison,
    ContinuousTime,
    Equal,
    Expression,
    Fluent,
    IsViolated,
    Number,
    Term,
    Variable,
)
from ..dto.name import NUMBER, fold
from ..dto.node import Node
from ..dto.number import MAX_DIGITS
from .cursor import Steps, bounded_hint, finished, hint
from .hierarchy import Fit
from .signatures import Signature
from .terms import DURATION, TermReader

TOTAL_TIME, TOTAL_COST = "total-time", "total-cost"
_DURATION = Variable("duration")
_STANDARD_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


class ExpressionReader(TermReader):
    """A reader of numeric expressions and comparisons.

    Attributes:
        time_allowed: whether `#t` may be used.
        metric: whether it is a metric, which knows `total-time` and `is-violated`.
    """

    time_allowed = False
    metric = False

    def expression(self) -> Expression:
        """Read a number, or what is computed of numbers, nested to any depth.

        Returns:
            The expression.
        """
        found = self._begin_expression()
        return found if isinstance(found, Node) else finished(found)

    def _begin_expression(self) -> Expression | Steps[Expression]:
        """Read a number; of what is computed, give the steps that read it."""
        token = self.tokens[self.at]
        if token == "(":
            head = self.tokens[self.at + 1]
            if head in ARITHMETIC:
                return self._arithmetic(head)
            return self._number_fluent(head)
        if token[:1] == "?" or token in ("#t", "#T"):
            return self._special(token)
        number = self.number_here()
        if number is not None:
            self.at += 1
            return number
        return self.bare_fluent(token)

    def _arithmetic(self, operator: str) -> Steps[Expression]:
        start = self.at
        self.at += 2
        operands = []
        while self.tokens[self.at] != ")":
            found = self._begin_expression()
            operands.append(found if isinstance(found, Node) else (yield found))
        if not operands or (len(operands) == 1 and operator != "-"):
            self.fail(f"two operands of {operator}", f"{len(operands)}")
        if len(operands) > 2 and operator in "-/":
            self.deviate(f"two operands of {operator}", "read from the left", at=start)
            for operand in operands[2:]:
                operands[:2] = [Arithmetic(operator, tuple(operands[:2])), operand]
            del operands[2:]
        self.at += 1
        return Arithmetic(operator, tuple(operands))

    def _number_fluent(self, head: str) -> Expression:
        if self.metric and head.lower() == "is-violated":
            return self._is_violated()
        return self.fluent(numeric=True)

    def _is_violated(self) -> IsViolated:
        self.at += 2
        name = self.declared_name("preference")
        known = self.symbols.preference(name)
        if known is None and not self.symbols.unknown_domain:
            names = self.symbols.preferences
            close = bounded_hint(self.reading, name, lambda: list(names.values()))
            expected = f"a preference{close}"
            found = f"the preference '{name}'"
            self.deviate(expected, "never violated", found, self.at - 1)
        self.expect(")")
        return IsViolated(known or name)

    def fluent(self, numeric: bool | None = None) -> Fluent:
        """Read a function applied to terms.

        Args:
            numeric: whether its value must be a number, or must not; None for either.

        Returns:
            The fluent.
        """
        self.expect("(", "a function, such as (distance ?a ?b)")
        self.at -= 1
        signature = self._cost_or_time() or self.function_here()
        if (
            numeric is not None
            and signature.parameters is not None
            and numeric != (not signature.types)
        ):
            kinds = ("an object", "a number")
            found = f"({signature.name} ...), which is {kinds[not numeric]}"
            self.fail(kinds[numeric], found)
        return Fluent(signature.name, self.arguments(signature))

    def _cost_or_time(self) -> Signature | None:
        """The signature of `total-time` or `total-cost`, when it is here and not declared."""
        name = self.tokens[self.at + 1]
        if self.symbols.unknown_domain or self.symbols.functions.find(name) is not None:
            return None
        if self.metric and fold(name) == TOTAL_TIME:
            return Signature(TOTAL_TIME, ())
        if fold(name) == TOTAL_COST:
            return self._undeclared_cost(self.at + 1)
        return None

    def _undeclared_cost(self, at: int) -> Signature:
        declared = "the declaration of total-cost in :functions"
        self.deviate(declared, "taken for declared", "total-cost", at)
        signature = Signature(TOTAL_COST, ())
        self.symbols.functions.add(signature)
        return signature

    def _special(self, token: str) -> Expression:
        if token[0] == "#":
            if not self.time_allowed:
                self.fail("a number", f"'{token}' outside of a process or a durative action")
            self.at += 1
            return ContinuousTime()
        if not (self.duration_allowed and fold(token) == DURATION):
            self.fail("a number")
        self.at += 1
        return _DURATION

    def bare_fluent(self, token: str) -> Fluent:
        """Read a function without its parentheses.

        Args:
            token: the next token.

        Returns:
            The fluent.
        """
        if token == ")":
            self.fail("a number")
        if self.metric and fold(token) == TOTAL_TIME and self.symbols.functions.find(token) is None:
            self.at += 1
            return Fluent(TOTAL_TIME)
        signature = self.symbols.functions.find(token)
        if signature is None and fold(token) == TOTAL_COST:
            signature = self._undeclared_cost(self.at)
        if signature is None or signature.parameters or signature.types:
            self.fail(f"a number{hint(token, self.symbols.functions.names())}")
        self.deviate(f"'({token})'", "read so")
        self.at += 1
        return Fluent(signature.name)

    def is_number(self) -> bool:
        """Whether the next token is a number."""
        return NUMBER.fullmatch(self.tokens[self.at]) is not None

    def number_here(self) -> Number | None:
        """Read the next token as a number, without passing it.

        Returns:
            The number; None when it is none.
        """
        token = self.tokens[self.at]
        if _STANDARD_NUMBER.fullmatch(token) is None:
            if NUMBER.fullmatch(token) is None:
                return None
            value = self._sized(token)
            self.deviate(_plain_form(value), "read so")
            return Number(value)
        return Number(Decimal(token) if len(token) < 20 else self._sized(token))

    def _sized(self, token: str) -> Decimal:
        """Take a number whose digits, written out, are not too many."""
        value = Decimal(token) if len(token) <= MAX_DIGITS else Decimal(f"1e{MAX_DIGITS}")
        digits, exponent = value.as_tuple().digits, value.as_tuple().exponent
        assert isinstance(exponent, int)
        if max(len(digits) + exponent, -exponent) > MAX_DIGITS:
            self.fail(f"a number of at most {MAX_DIGITS} digits")
        return value

    def comparison(self) -> Comparison | Equal:
        """Read a comparison of numbers, or an equation of objects.

        Returns:
            It.
        """
        operator = self.tokens[self.at + 1]
        self.at += 2
        if operator == "=" and self._equates_objects():
            left, right = self.term()[0], self.term()[0]
            self.expect(")", "')' after two terms")
            return Equal(left, right)
        first, second = self.expression(), self.expression()
        self.expect(")", "')' after two numbers")
        return Comparison(operator, first, second)

    def _equates_objects(self) -> bool:
        """Whether the next token begins a term that denotes an object."""
        start = self.at
        numeric = self._is_numeric()
        if numeric is None:
            self.skip()
            numeric = self._is_numeric()
            self.at = start
        return not numeric if numeric is not None else False

    def _is_numeric(self) -> bool | None:
        """Whether a number is next, or an object; None when a function may be either."""
        token = self.tokens[self.at]
        if token == "(":
            head = self.tokens[self.at + 1]
            signature = self.symbols.functions.find(head)
            if signature is not None and signature.parameters is not None:
                return not signature.types
            return True if head in ARITHMETIC or not self.symbols.unknown_domain else None
        if token[:1] == "?":
            return self.duration_allowed and fold(token) == DURATION
        if token in ("#t", "#T") or NUMBER.fullmatch(token) is not None:
            return self.symbols.unknown_domain or not self.symbols.is_object(token)
        if self.symbols.is_object(token):
            return False
        return self.symbols.functions.find(token) is not None

    def assigned(self, signature: Signature) -> Expression | Term:
        """Read the value that a fluent gets.

        Args:
            signature: the fluent's function.

        Returns:
            A number's expression; for an object fluent a term.
        """
        at = self.at
        if signature.parameters is None:
            return self.expression() if self._is_numeric() else self.term()[0]
        if not signature.types:
            return self.expression()
        entity = self.term()
        if self.symbols.fit(entity[1], signature.types) is not Fit.YES:
            self.misfit(entity, signature.types, f"as the value of {signature.name}", at)
        return entity[0]


def _plain_form(value: Decimal) -> str:
    """A number as the standard has it, unless that is long."""
    text = f"{value:f}"
    return f"'{text}'" if len(text) <= 40 else "a number without an exponent"
