"""Formulas: conditions, goals, constraints and preferences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ..dto.formula import (
    AT_END,
    AT_START,
    COMPARISONS,
    MODALS,
    OVER_ALL,
    And,
    Atom,
    Comparison,
    Equal,
    Exists,
    Forall,
    Formula,
    Imply,
    Modal,
    Not,
    Number,
    Or,
    Preference,
    Timed,
)
from ..dto.name import fold
from ..dto.node import Node
from .conjuncts import flatten
from .cursor import Steps, finished, hint
from .expressions import ExpressionReader
from .signatures import Signature
from .symbols import Head

# What a formula may or must be, where it is: bits of a context.
PREFERENCES: Final = 1  # preferences may be
TIMED: Final = 2  # atoms must be within (at start ...), (over all ...) or (at end ...)
CONSTRAINTS: Final = 4  # atoms must be within modal operators
MODAL: Final = 8  # modal operators may be
_MUST: Final = TIMED | CONSTRAINTS

_TIMES = {("at", "start"): AT_START, ("at", "end"): AT_END, ("over", "all"): OVER_ALL}
_TIMED_FORM = "(at start ...), (over all ...) or (at end ...)"
_CONSTRAINT_FORM = "a constraint such as (always ...)"


class FormulaReader(ExpressionReader):
    """A reader of formulas."""

    def conjuncts(self, context: int) -> tuple[Formula, ...]:
        """Read a formula that may be `()` or a conjunction, at the top of something.

        Args:
            context: what it may or must be.

        Returns:
            Its conjuncts.
        """
        return flatten(self._empty() if self.is_empty() else self.formula(context))

    def is_empty(self) -> bool:
        """Whether `()` is next."""
        return self.tokens[self.at] == "(" and self.tokens[self.at + 1] == ")"

    def _empty(self) -> And:
        self.at += 2
        return And()

    def formula(self, context: int) -> Formula:
        """Read a formula.

        Args:
            context: what it may or must be.

        Returns:
            The formula.
        """
        found = self.begin(context)
        return found if isinstance(found, Node) else finished(found)

    def begin(self, context: int) -> Formula | Steps[Formula]:
        """Read a formula, unless there are formulas within.

        Args:
            context: what it may or must be.

        Returns:
            The formula; or the steps that read it.
        """
        tokens, at = self.tokens, self.at
        if tokens[at] != "(":
            self.fail("a formula, which begins with '('")
        head = tokens[at + 1]
        kind = self.symbols.heads.get(head)
        if kind is None:
            kind = self._head(head)
        if not isinstance(kind, Signature):
            return kind(self, context)
        if context & _MUST:
            self._misplaced(context)
        if not kind.accepted:
            return self.atom(kind)
        return Atom(kind.name, self.arguments(kind))

    def _head(self, head: str) -> Head:
        """Find what a word behind a parenthesis begins, and remember it."""
        if head in ("(", ")", ""):
            return self._no_head()
        kind: Head | None = _READERS.get(head.lower())
        if kind is None:
            kind = self.symbols.predicates.find(head)
        if kind is None:
            if not self.symbols.unknown_domain:
                self._unknown_predicate(head)
            kind = self.known(self.symbols.predicates, head)
        self.symbols.heads[head] = kind
        return kind

    def _unknown_predicate(self, head: str) -> None:
        names = self.symbols.predicates.names()
        expected = f"a predicate that is declared{hint(head, [*names, *_READERS])}"
        function = self.symbols.functions.find(head)
        if function is not None:
            expected = f"a formula, but {function.name} is a function"
        self.fail(expected, f"the predicate '{head}'", self.at + 1)

    def _no_head(self) -> Head:
        if self.tokens[self.at + 1] != ")":
            self.fail("a predicate or an operator", at=self.at + 1)
        self.deviate("a formula", "read as (and)", "'()'")
        return FormulaReader._none

    def _misplaced(self, context: int) -> None:
        self.fail(_TIMED_FORM if context & TIMED else _CONSTRAINT_FORM)

    def _none(self, context: int) -> Formula:
        del context
        return self._empty()

    def _junction(self, context: int) -> Steps[Formula]:
        tokens = self.tokens
        kind = And if tokens[self.at + 1].lower() == "and" else Or
        if kind is Or:
            context = self._plain("or", context)
        self.at += 2
        formulas = []
        while tokens[self.at] != ")":
            found = self.begin(context)
            formulas.append(found if isinstance(found, Node) else (yield found))
        self.at += 1
        return kind(tuple(formulas))

    def _plain(self, operator: str, context: int) -> int:
        """The context within an operator that timed formulas and constraints should not be in."""
        if context & _MUST:
            expected = _TIMED_FORM if context & TIMED else _CONSTRAINT_FORM
            self.deviate(f"{expected} instead of ({operator} ...)", "read as it is")
        return context & ~PREFERENCES

    def _not(self, context: int) -> Steps[Formula]:
        context = self._plain("not", context)
        self.at += 2
        formula = yield self.begin(context)
        self.expect(")", "')' after the formula that is negated")
        return Not(formula)

    def _imply(self, context: int) -> Steps[Formula]:
        context = self._plain("imply", context)
        self.at += 2
        condition = yield self.begin(context)
        formula = yield self.begin(context)
        self.expect(")", "')' after the two formulas of imply")
        return Imply(condition, formula)

    def _forall(self, context: int) -> Steps[Formula]:
        outside = self.mark()
        self.at += 2
        variables = self.variables()
        formula = yield self.begin(context)
        self.expect(")", "')' after the formula of forall")
        self.release(outside)
        return Forall(variables, formula)

    def _exists(self, context: int) -> Steps[Formula]:
        context = self._plain("exists", context)
        outside = self.mark()
        self.at += 2
        variables = self.variables()
        formula = yield self.begin(context)
        self.expect(")", "')' after the formula of exists")
        self.release(outside)
        return Exists(variables, formula)

    def _comparison(self, context: int) -> Comparison | Equal:
        if context & _MUST:
            self._misplaced(context)
        return self.comparison()

    def time_here(self) -> str | None:
        """Tell at which time what is next is said to hold or happen.

        Returns:
            `at start`, `over all` or `at end`; None when it is not said.
        """
        words = self.tokens[self.at + 1].lower(), self.tokens[self.at + 2].lower()
        return _TIMES.get(words) if self.tokens[self.at + 3] == "(" else None

    def _at_time(self, context: int) -> Formula | Steps[Formula]:
        time = self.time_here()
        if time is None:
            return self._named_like_operator(context)
        if not (context & TIMED or (time == AT_END and context & (CONSTRAINTS | MODAL))):
            self.fail("a formula without a time", f"({time} ...)")
        return self._timed_formula(time)

    def _timed_formula(self, time: str) -> Steps[Formula]:
        self.at += 3
        formula = yield self.begin(0)
        self.expect(")", f"')' after the formula that holds {time}")
        return Timed(time, formula)

    def _named_like_operator(self, context: int) -> Formula:
        """Read an atom whose predicate is named like an operator."""
        signature = self.known(self.symbols.predicates, self.tokens[self.at + 1])
        if context & _MUST:
            self._misplaced(context)
        return self.atom(signature)

    def _may_be_predicate(self) -> bool:
        """Whether the word behind the next parenthesis names a predicate, as far as is known."""
        unknown = self.symbols.unknown_domain
        return unknown or self.symbols.predicates.find(self.tokens[self.at + 1]) is not None

    def _is_predicate(self) -> bool:
        """Whether the word that is next, an operator, is used as a predicate's name."""
        declared = self.symbols.predicates.find(self.tokens[self.at + 1]) is not None
        return declared and self.tokens[self.at + 2] != "("

    def _preference(self, context: int) -> Formula | Steps[Formula]:
        # What is preferred is a formula, alone or behind a name; terms are no formulas.
        behind = self.tokens[self.at + 2 : self.at + (4 if context & PREFERENCES else 3)]
        if (behind[0] == ")" or "(" not in behind) and self._may_be_predicate():
            return self._named_like_operator(context)
        if not context & PREFERENCES:
            self.fail("a formula; a preference belongs to the top of a goal or precondition")
        return self._preferred(context)

    def _preferred(self, context: int) -> Steps[Formula]:
        self.at += 2
        name = None if self.tokens[self.at] == "(" else self.declared_name("preference")
        if name is not None:
            self.symbols.preferences.setdefault(fold(name), name)
        formula = yield self.begin(context & ~PREFERENCES)
        self.expect(")", "')' after the formula that is preferred")
        return Preference(name, formula)

    def _takes_operands(self, numbers: int) -> bool:
        """Whether what is behind the word that is next are the operands of a modal operator.

        A predicate of that name takes neither a formula, nor a number: no object's name is one.
        """
        self.at += 2
        found = self.is_number() if numbers else self.tokens[self.at] == "("
        self.at -= 2
        return found or not self._may_be_predicate()

    def _modal(self, context: int) -> Formula | Steps[Formula]:
        operator = self.tokens[self.at + 1].lower()
        wanted, formulas = MODALS[operator]
        if not self._takes_operands(wanted):
            return self._named_like_operator(context)
        if not context & (CONSTRAINTS | MODAL):
            self.fail("a formula; constraints belong to (:constraints ...)")
        return self._constraint(operator, wanted, formulas)

    def _constraint(self, operator: str, wanted: int, formulas: int) -> Steps[Formula]:
        self.at += 2
        numbers = tuple([self._time_span(operator) for _ in range(wanted)])
        parts = []
        for _ in range(formulas):
            parts.append((yield self.begin(MODAL)))
        self.expect(")", f"')' after the {formulas} formula{'s' * (formulas - 1)} of {operator}")
        return Modal(operator, numbers, tuple(parts))

    def _time_span(self, operator: str) -> Number:
        number = self.number_here()
        if number is None:
            self.fail(f"a number, the time of {operator}")
        self.at += 1
        return number


_Reader = Callable[[FormulaReader, int], Formula | Steps[Formula]]
_READERS: dict[str, _Reader] = {
    "and": FormulaReader._junction,
    "or": FormulaReader._junction,
    "not": FormulaReader._not,
    "imply": FormulaReader._imply,
    "forall": FormulaReader._forall,
    "exists": FormulaReader._exists,
    "at": FormulaReader._at_time,
    "over": FormulaReader._at_time,
    "preference": FormulaReader._preference,
    **dict.fromkeys(COMPARISONS, FormulaReader._comparison),
    **dict.fromkeys(MODALS, FormulaReader._modal),
}
