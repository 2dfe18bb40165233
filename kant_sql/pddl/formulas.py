"""Reading formulas: terms, numeric expressions, conditions, effects, constraints and preferences.

A formula nested deeper than `MAX_NESTING` levels is refused, so methods recurse.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from decimal import Decimal
from typing import Final, NoReturn

from ..arguments import shown
from ..dto import formulas as f
from ..dto.lexical import MAX_DIGITS, NUMBER, either_text, fold, is_name, is_writable
from .cursor import VARIABLES, Cursor, Diagnostics, Group, Section, hint
from .symbols import BoundVariable, Entity, Fit, Head, Signature, Signatures, SymbolTable, Types

DURATION_VARIABLE = f.Variable(f.DURATION)
_DURATION_WORD = f"?{f.DURATION}"

# Bits of a context: what a formula is, and what it may or must contain.
PREFERENCES: Final = 1  # may contain preferences
TIMED: Final = 2  # atoms must be inside (at start ...), (over all ...) or (at end ...)
CONSTRAINTS: Final = 4  # atoms must be inside modal operators
MODAL: Final = 8  # may contain modal operators
EFFECT: Final = 16  # is an effect
INSIDE_TIME: Final = 32  # is inside (at start ...) or (at end ...) of an effect
RULES: Final = 64  # may contain (at-most-one ...) and (exactly-one ...), which no document has
_WRAPPED: Final = TIMED | CONSTRAINTS

_TIMES = {("at", "start"): f.AT_START, ("at", "end"): f.AT_END, ("over", "all"): f.OVER_ALL}
_TIMED_EFFECT = "(at start ...), (at end ...) or a continuous effect with #t"
_TIMED_FORM = "(at start ...), (over all ...) or (at end ...)"
_CONSTRAINT_FORM = "a constraint such as (always ...)"
# Operators only of conditions, and of other languages.
NO_EFFECTS: Final = frozenset(
    {"or", "imply", "exists", "preference", "=", "<", "<=", ">=", ">", "oneof", "probabilistic"}
)
_STANDARD_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


def flatten(formula: f.Formula) -> tuple[f.Formula, ...]:
    """Return the conjuncts of a formula, including those of nested conjunctions."""
    if not isinstance(formula, f.And):
        return (formula,)
    if f.And not in map(type, formula.formulas):
        return formula.formulas
    found: list[f.Formula] = []
    stack: list[f.Formula] = [formula]
    while stack:
        part = stack.pop()
        if isinstance(part, f.And):
            stack.extend(reversed(part.formulas))
        else:
            found.append(part)
    return tuple(found)


class Scope(dict[str, Entity]):
    """The variables in scope, each with its `?`, by folded name and by bound spelling.

    Bindings are journaled and rolled back: copies would be quadratic in the depth.
    """

    def __init__(self) -> None:
        super().__init__()
        self._journal: list[tuple[str, Entity | None]] = []

    def mark(self) -> int:
        """Return a mark of the present state, for `release`."""
        return len(self._journal)

    def release(self, mark: int) -> None:
        """Remove the bindings since a mark."""
        while len(self._journal) > mark:
            spelling, entity = self._journal.pop()
            if entity is None:
                del self[spelling]
            else:
                self[spelling] = entity

    def bind(self, word: str, bound: BoundVariable) -> None:
        """Bind a variable."""
        key, entity, journal = bound.key, bound.entity, self._journal
        outside = self.get(key)
        if outside is not None and str(outside[0]) != key:
            # The outer variable in another spelling is hidden as well.
            journal.append((str(outside[0]), outside))
            self[str(outside[0])] = entity
        journal.append((key, outside))
        self[key] = entity
        if word != key:
            journal.append((word, self.get(word)))
            self[word] = entity

    def find(self, word: str) -> Entity | None:
        """Look up a variable."""
        return self.get(word) or self.get(fold(word))


class FormulaReader(Cursor):
    """A reader of formulas."""

    duration_allowed = False  # whether `?duration` is the duration of the action
    time_allowed = False  # whether `#t` may be used
    metric = False  # whether it reads a metric, where `total-time` and `is-violated` are allowed

    def __init__(
        self, diagnostics: Diagnostics, section: Section, symbols: SymbolTable, nesting: str = ""
    ) -> None:
        super().__init__(diagnostics, section, nesting)
        self.symbols = symbols

    def open(self, section: Section, nesting: str, tokens: list[str] | None = None) -> None:
        """Go to the beginning of a section, with no variables in scope."""
        super().open(section, nesting, tokens)
        self.scope = Scope()
        self.level = 0  # the number of levels of formulas around the next token

    def enter(self) -> None:
        """Count a level of nesting; the caller subtracts it at its end."""
        self.level += 1
        if self.level > f.MAX_NESTING:
            self.fail(f.NESTING_REMEDY, f"a formula {self.level} levels deep")

    # Conditions and effects.

    def conjuncts(self, context: int) -> tuple[f.Formula, ...]:
        """Read a top-level formula, which may be `()` or a conjunction, as its conjuncts."""
        if self.is_empty():
            return flatten(self._empty())
        # A list of formulas is written as one conjunction, which does not count as a level.
        self.level = -(self.tokens[self.at + 1].lower() == "and")
        found = flatten(self.formula(context))
        self.level = 0
        return found

    def is_empty(self) -> bool:
        """Return whether `()` is next."""
        return self.tokens[self.at] == "(" and self.tokens[self.at + 1] == ")"

    def _empty(self, context: int = 0) -> f.And:
        del context
        self.at += 2
        return f.And()

    def formula(self, context: int) -> f.Formula:
        """Read a formula."""
        tokens, at = self.tokens, self.at
        if tokens[at] != "(":
            self.fail(f"{_called(context)}, which begins with '('")
        head = tokens[at + 1]
        heads = self.symbols.effect_heads if context & EFFECT else self.symbols.heads
        kind = heads.get(head)
        if kind is None:
            kind = self._head(head, context)
        if not isinstance(kind, Signature):
            self.enter()
            found = kind(self, context)
            self.level -= 1
            return found
        if self.level == f.MAX_NESTING:
            self.enter()
        if context & _WRAPPED:
            self._misplaced(context)
        if not kind.accepted:
            return self.atom(kind)
        return f.Atom(kind.name, self.arguments(kind))

    def _head(self, head: str, context: int) -> Head:
        """Look up the word after a parenthesis, and cache its meaning."""
        if head in ("(", ")", ""):
            if head != ")":
                self.fail("a predicate or an operator", at=self.at + 1)
            self.deviate(_called(context), "read as (and)", "'()'")
            return FormulaReader._empty
        is_effect = context & EFFECT
        operators = _EFFECTS if is_effect else _CONDITIONS
        kind: Head | None = operators.get(head.lower()) or self.symbols.predicates.find(head)
        if kind is None:
            if not self.symbols.unknown_domain:
                self._unknown_predicate(head, context)
            kind = self.known(self.symbols.predicates, head)
        (self.symbols.effect_heads if is_effect else self.symbols.heads)[head] = kind
        return kind

    def _unknown_predicate(self, head: str, context: int) -> NoReturn:
        operators = _EFFECTS if context & EFFECT else _CONDITIONS
        if context & EFFECT and head.lower() in NO_EFFECTS:
            self.fail("an effect", f"'({head}'")
        names = self.symbols.predicates.names()
        # A misspelt name of a knowledge base makes an empty one.
        close = hint(head, [*names, *operators]) or ("" if names else " (none is declared here)")
        expected = f"a predicate that is declared{close}"
        function = self.symbols.functions.find(head)
        if function is not None:
            expected = f"{_called(context)}, but {function.name} is a function"
        self.fail(expected, f"the predicate '{head}'", self.at + 1)

    def _misplaced(self, context: int) -> NoReturn:
        if context & EFFECT:
            self.fail(_TIMED_EFFECT)
        self.fail(_TIMED_FORM if context & TIMED else _CONSTRAINT_FORM)

    def _plain(self, operator: str, context: int) -> int:
        """Return the context inside an operator that should contain no times or constraints."""
        if context & _WRAPPED:
            expected = _TIMED_FORM if context & TIMED else _CONSTRAINT_FORM
            self.deviate(f"{expected} instead of ({operator} ...)", "read as it is")
        return context & ~PREFERENCES

    def _junction(self, context: int) -> f.Formula:
        tokens = self.tokens
        kind = f.And if tokens[self.at + 1].lower() == "and" else f.Or
        if kind is f.Or:
            context = self._plain("or", context)
        self.at += 2
        formulas = []
        while tokens[self.at] != ")":
            formulas.append(self.formula(context))
        self.at += 1
        return kind(tuple(formulas))

    def _not(self, context: int) -> f.Formula:
        context = self._plain("not", context)
        self.at += 2
        formula = self.formula(context)
        self.expect(")", "')' after the formula that is negated")
        return f.Not(formula)

    def _delete(self, context: int) -> f.Formula:
        if context & TIMED:
            self.fail(_TIMED_EFFECT)
        self.at += 2
        at = self.at
        formula = self.formula(0)
        if not isinstance(formula, f.Atom):
            self.fail("an atom that is deleted", at=at)
        self.expect(")", "')' after the atom that is deleted")
        return f.Not(formula)

    def _imply(self, context: int) -> f.Formula:
        context = self._plain("imply", context)
        self.at += 2
        condition = self.formula(context)
        formula = self.formula(context)
        self.expect(")", "')' after the two formulas of imply")
        return f.Imply(condition, formula)

    def _when(self, context: int) -> f.Formula:
        if context & INSIDE_TIME:
            expected = "(when ...) around (at start ...) or (at end ...), with times inside"
            self.deviate(expected, "read as a condition at the time of the effect")
        self.at += 2
        condition = self._empty() if self.is_empty() else self.formula(context & ~EFFECT)
        effect = self.formula(context)
        self.expect(")", "')' after the condition and the effect of when")
        return f.When(condition, effect)

    def _quantified(self, context: int) -> f.Formula:
        operator = self.tokens[self.at + 1].lower()
        if operator == "exists":
            context = self._plain("exists", context)
        variables, formula = self._within(context)
        return (f.Forall if operator == "forall" else f.Exists)(variables, formula)

    def _within(self, context: int) -> tuple[tuple[f.TypedName, ...], f.Formula]:
        """Read variables, and the formula that binds them."""
        operator, outside = self.tokens[self.at + 1].lower(), self.scope.mark()
        self.at += 2
        variables = self.variables()
        formula = self.formula(context)
        self.expect(")", f"')' after the {_noun(context)} of {operator}")
        self.scope.release(outside)
        return variables, formula

    def _counted(self, context: int) -> f.Formula:
        operator = self.tokens[self.at + 1].lower()
        # A predicate of that name applies to terms, and its first term is not a list of variables.
        if not context & RULES or self.tokens[self.at + 3][:1] != "?":
            return self._named_like_operator(context)
        return f.Count(*self._within(RULES), operator)

    def _comparison(self, context: int) -> f.Comparison | f.Equal:
        if context & _WRAPPED:
            self._misplaced(context)
        return self.comparison()

    def time_here(self) -> str | None:
        """Return the time of the next formula, if it has one."""
        words = self.tokens[self.at + 1].lower(), self.tokens[self.at + 2].lower()
        return _TIMES.get(words) if self.tokens[self.at + 3] == "(" else None

    def _at_time(self, context: int) -> f.Formula:
        time = self.time_here()
        if time is None:
            if context & EFFECT and context & TIMED:
                self._misplaced(context)
            return self._named_like_operator(context)
        if context & EFFECT:
            if not context & TIMED or time == f.OVER_ALL:
                self.fail(_TIMED_EFFECT if context & TIMED else "an effect without a time")
        elif not (context & TIMED or (time == f.AT_END and context & (CONSTRAINTS | MODAL))):
            self.fail("a formula without a time", f"({time} ...)")
        context = context & EFFECT and EFFECT | INSIDE_TIME
        self.at += 3
        formula = self.formula(context)
        self.expect(")", f"')' after the {_noun(context)} {time}")
        return f.Timed(time, formula)

    def _named_like_operator(self, context: int) -> f.Formula:
        """Read an atom whose predicate is named like an operator."""
        signature = self.known(self.symbols.predicates, self.tokens[self.at + 1])
        if context & _WRAPPED:
            self._misplaced(context)
        return self.atom(signature)

    def _may_be_predicate(self) -> bool:
        """Return whether the word after the next parenthesis may be a predicate."""
        unknown = self.symbols.unknown_domain
        return unknown or self.symbols.predicates.find(self.tokens[self.at + 1]) is not None

    def _preference(self, context: int) -> f.Formula:
        # A preference holds a formula, alone or after a name; terms are not formulas.
        following = self.tokens[self.at + 2 : self.at + (4 if context & PREFERENCES else 3)]
        if (following[0] == ")" or "(" not in following) and self._may_be_predicate():
            return self._named_like_operator(context)
        if not context & PREFERENCES:
            self.fail("a formula; a preference belongs to the top of a goal or precondition")
        return self._preferred(context)

    def _preferred(self, context: int) -> f.Formula:
        self.at += 2
        name = None if self.tokens[self.at] == "(" else self.declared_name("preference")
        if name is not None:
            self.symbols.preferences.setdefault(fold(name), name)
        formula = self.formula(context & ~PREFERENCES)
        self.expect(")", "')' after the formula that is preferred")
        return f.Preference(name, formula)

    def _modal(self, context: int) -> f.Formula:
        operator = self.tokens[self.at + 1].lower()
        wanted, formulas = f.MODALS[operator]
        # A predicate of that name takes neither a formula nor a number, which names no object.
        takes_operands = self.is_number(2) if wanted else self.tokens[self.at + 2] == "("
        if not takes_operands and self._may_be_predicate():
            return self._named_like_operator(context)
        if not context & (CONSTRAINTS | MODAL):
            self.fail("a formula; constraints belong to (:constraints ...)")
        return self._constraint(operator, wanted, formulas, MODAL | context & RULES)

    def _constraint(self, operator: str, wanted: int, formulas: int, inside: int) -> f.Formula:
        self.at += 2
        numbers = tuple([self.time_span(operator) for _ in range(wanted)])
        if wanted == 2 and numbers[0].value > numbers[1].value:
            self.fail(f"the end of {operator}, not before its begin", at=self.at - 1)
        parts = []
        for _ in range(formulas):
            parts.append(self.formula(inside))
        self.expect(")", f"')' after the {formulas} formula{'s' * (formulas - 1)} of {operator}")
        return f.Modal(operator, numbers, tuple(parts))

    def time_span(self, operator: str) -> f.Number:
        """Consume the time of an operator, which must not be negative."""
        number = self.number_here()
        if number is None or number.value < 0:
            self.fail(f"a number from 0 on, the time of {operator}")
        self.at += 1
        return number

    def _assign(self, context: int) -> f.Formula:
        start = self.at
        operator = self.tokens[start + 1]
        declared = self.symbols.predicates.find(operator)
        if declared is not None and self.tokens[start + 2] != "(":
            return self.atom(declared)
        operator = operator.lower()
        self.at += 2
        signature, fluent = self.assigned_fluent(None if operator == "assign" else True)
        value = self.assigned(signature)
        self.expect(")", f"')' after the value of {operator}")
        if context & TIMED and not f.mentions(f.ContinuousTime, value):
            self.fail(_TIMED_EFFECT, at=start)
        return f.Assign(operator, fluent, value)

    def assigned_fluent(self, numeric: bool | None = None) -> tuple[Signature, f.Fluent]:
        """Read the fluent of an assignment."""
        if self.tokens[self.at] == "(":
            fluent = self._fluent(numeric)
        else:
            fluent = self._bare_fluent(self.tokens[self.at])
        signature = self.symbols.functions.find(fluent.function)
        assert signature is not None
        return signature, fluent

    def assigned(self, signature: Signature) -> f.Expression | f.Term:
        """Read the value of an assignment."""
        at = self.at
        if signature.parameters is None:
            return self.expression() if self._is_numeric() else self.term()[0]
        if not signature.types:
            return self.expression()
        if self.is_number():
            types = either_text(signature.types)
            self.fail(f"an object: values of {signature.name} are of type {types}")
        entity = self.term()
        if self.symbols.fit(entity[1], signature.types) is not Fit.YES:
            self._misfit(entity, signature.types, f"as the value of {signature.name}", at)
        return entity[0]

    def comparison(self) -> f.Comparison | f.Equal:
        """Read a comparison of numbers, or an equality of objects."""
        operator = self.tokens[self.at + 1]
        self.at += 2
        if operator == "=" and self._equates_objects():
            left, right = self.term()[0], self.term()[0]
            self.expect(")", "')' after two terms")
            return f.Equal(left, right)
        first, second = self.expression(), self.expression()
        self.expect(")", "')' after two numbers")
        return f.Comparison(operator, first, second)

    def _equates_objects(self) -> bool:
        """Return whether the operands of `=` denote objects."""
        start = self.at
        numeric = self._is_numeric()
        if numeric is None:
            self.skip()
            numeric = self._is_numeric()
            self.at = start
        return numeric is False

    def _is_numeric(self) -> bool | None:
        """Return whether a number is next; None if it could be a number or an object."""
        token = self.tokens[self.at]
        if token == "(":
            head = self.tokens[self.at + 1]
            signature = self.symbols.functions.find(head)
            if signature is not None and signature.parameters is not None:
                return not signature.types
            return True if head in f.ARITHMETIC or not self.symbols.unknown_domain else None
        if token[:1] == "?":
            return self.duration_allowed and fold(token) == _DURATION_WORD
        if token in ("#t", "#T") or NUMBER.fullmatch(token) is not None:
            return self.symbols.unknown_domain or not self.symbols.is_object(token)
        if self.symbols.is_object(token):
            return False
        return self.symbols.functions.find(token) is not None

    # Numeric expressions.

    def expression(self) -> f.Expression:
        """Read a numeric expression."""
        token = self.tokens[self.at]
        if token == "(":
            head = self.tokens[self.at + 1]
            if head in f.ARITHMETIC:
                self.enter()
                found = self._arithmetic(head)
                self.level -= 1
                return found
            if self.level == f.MAX_NESTING:
                self.enter()
            if self.metric and head.lower() == "is-violated":
                return self._is_violated()
            return self._fluent(numeric=True)
        if token[:1] == "?" or token in ("#t", "#T"):
            return self._special(token)
        number = self.number_here()
        if number is not None:
            self.at += 1
            return number
        return self._bare_fluent(token)

    def _arithmetic(self, operator: str) -> f.Expression:
        start = self.at
        self.at += 2
        operands = []
        while self.tokens[self.at] != ")":
            operands.append(self.expression())
        if not operands or (len(operands) == 1 and operator != "-"):
            self.fail(f"two operands of {operator}", f"{len(operands)}")
        if len(operands) > 2 and operator in "-/":
            self.deviate(f"two operands of {operator}", "read from the left", at=start)
            self.level += len(operands) - 3
            self.enter()
            self.level -= len(operands) - 2
            for operand in operands[2:]:
                operands[:2] = [f.Arithmetic(operator, tuple(operands[:2])), operand]
            del operands[2:]
        self.at += 1
        return f.Arithmetic(operator, tuple(operands))

    def _is_violated(self) -> f.IsViolated:
        self.at += 2
        name = self.declared_name("preference")
        known = self.symbols.preference(name)
        if known is None and not self.symbols.unknown_domain:
            names = self.symbols.preferences
            expected = f"a preference{self.diagnostics.hint(name, lambda: list(names.values()))}"
            found = f"the preference '{name}'"
            self.deviate(expected, "never violated", found, self.at - 1)
        self.expect(")")
        return f.IsViolated(known or name)

    def _fluent(self, numeric: bool | None = None) -> f.Fluent:
        """Read a function applied to terms."""
        self.peek_head("a function, such as (distance ?a ?b)", "a function")
        signature = self._cost_or_time() or self._function_here()
        is_declared = signature.parameters is not None
        if numeric is not None and is_declared and numeric == bool(signature.types):
            kinds = ("an object", "a number")
            self.fail(kinds[numeric], f"({signature.name} ...), which is {kinds[not numeric]}")
        return f.Fluent(signature.name, self.arguments(signature))

    def _cost_or_time(self) -> Signature | None:
        """Return the signature of an undeclared `total-time` or `total-cost` that is next."""
        name = self.tokens[self.at + 1]
        if self.symbols.unknown_domain or self.symbols.functions.find(name) is not None:
            return None
        if self.metric and fold(name) == f.TOTAL_TIME:
            return Signature(f.TOTAL_TIME, ())
        if fold(name) == f.TOTAL_COST:
            return self._undeclared_cost(self.at + 1)
        return None

    def _undeclared_cost(self, at: int) -> Signature:
        declared = "the declaration of total-cost in :functions"
        self.deviate(declared, "taken for declared", "total-cost", at)
        signature = Signature(f.TOTAL_COST, ())
        self.symbols.functions.add(signature)
        return signature

    def _special(self, token: str) -> f.Expression:
        if token[0] == "#":
            if not self.time_allowed:
                self.fail("a number", f"'{token}' outside of a process or a durative action")
            self.at += 1
            return f.ContinuousTime()
        if not (self.duration_allowed and fold(token) == _DURATION_WORD):
            self.fail("a number")
        self.at += 1
        return DURATION_VARIABLE

    def _bare_fluent(self, token: str) -> f.Fluent:
        """Read a function without its parentheses."""
        if token == ")":
            self.fail("a number")
        signature = self.symbols.functions.find(token)
        if signature is None and self.metric and fold(token) == f.TOTAL_TIME:
            self.at += 1
            return f.Fluent(f.TOTAL_TIME)
        if signature is None and fold(token) == f.TOTAL_COST:
            signature = self._undeclared_cost(self.at)
        if signature is None or signature.parameters or signature.types:
            self.fail(f"a number{hint(token, self.symbols.functions.names())}")
        self.deviate(f"'({token})'", "read so")
        self.at += 1
        return f.Fluent(signature.name)

    def is_number(self, ahead: int = 0) -> bool:
        """Return whether the next token, or one further ahead, is a number."""
        return NUMBER.fullmatch(self.tokens[self.at + ahead]) is not None

    def number_here(self) -> f.Number | None:
        """Return the next token as a number, without consuming it."""
        token = self.tokens[self.at]
        if _STANDARD_NUMBER.fullmatch(token) is None:
            if NUMBER.fullmatch(token) is None:
                return None
            value = self._bounded(token)
            text = f"{value:f}"
            plain = f"'{text}'" if len(text) <= 40 else "a number without an exponent"
            self.deviate(plain, "read so")
            return f.Number(value)
        return f.Number(Decimal(token) if len(token) < 20 else self._bounded(token))

    def _bounded(self, token: str) -> Decimal:
        """Convert a number; refuse one with too many digits."""
        # The longest number has a sign, and all its digits before and after a point.
        if len(token) > 2 * MAX_DIGITS + 2 or not is_writable(value := Decimal(token)):
            self.fail(f"a number of at most {MAX_DIGITS} digits")
        return value

    # Atoms, terms and variables.

    def atom(self, signature: Signature) -> f.Atom:
        """Read an atom."""
        if not signature.accepted and self.tokens[self.at + 2] == ")":
            self.at += 3
            return signature.bare
        return f.Atom(signature.name, self.arguments(signature))

    def arguments(self, signature: Signature) -> tuple[f.Term, ...]:
        """Read the arguments of a predicate or function, and the closing parenthesis."""
        if signature.parameters is None:
            return self._any_arguments()
        tokens, scope, objects = self.tokens, self.scope, self.symbols.objects
        start = self.at
        at = start + 2
        terms: list[f.Term] = []
        for wanted, accepted in signature.accepted:
            word = tokens[at]
            entity = scope.get(word) or objects.get(word)
            if entity is None or (entity[1] is not wanted and entity[1] not in accepted):
                self.at = at
                terms.append(self._argument(signature, len(terms), start))
                at = self.at
            else:
                terms.append(entity[0])
                at += 1
        self.at = at + 1
        if tokens[at] != ")":
            self._wrong_number(signature, start, at)
        return tuple(terms)

    def _any_arguments(self) -> tuple[f.Term, ...]:
        self.at += 2
        terms = []
        while self.tokens[self.at] != ")":
            terms.append(self.term()[0])
        self.at += 1
        return tuple(terms)

    def _argument(self, signature: Signature, position: int, start: int) -> f.Term:
        """Read one argument with all checks."""
        at, (wanted, accepted) = self.at, signature.accepted[position]
        if self.tokens[at] == ")":
            self._wrong_number(signature, start, at)
        entity = self.term()
        if self.symbols.fit(entity[1], wanted) is Fit.YES:
            accepted.add(entity[1])
        else:
            self._misfit(entity, wanted, f"as argument {position + 1} of {signature.name}", at)
        return entity[0]

    def _wrong_number(self, signature: Signature, start: int, at: int) -> NoReturn:
        wanted = len(signature.accepted)
        arguments = f"{wanted} argument{'' if wanted == 1 else 's'} of {signature.name}"
        if self.tokens[at] == ")":
            given = sum(1 for token in self.tokens[start + 2 : at] if token not in ("(", ")"))
            self.fail(arguments, f"{given}", at)
        self.fail(f"')' after the {arguments}", at=at)

    def _misfit(self, entity: Entity, wanted: Types, role: str, at: int) -> None:
        """Warn about a term that may fit; refuse one that cannot."""
        term, types = entity
        found = f"{shown(term)} of type {either_text(types)}"
        expected = f"{either_text(wanted)} {role}"
        if isinstance(term, f.Constant) or self.symbols.fit(types, wanted) is Fit.NO:
            self.fail(expected, found, at)
        self.deviate(expected, "it may be one", found, at)

    def term(self) -> Entity:
        """Read a term."""
        if self.tokens[self.at] == "(":
            return self._object_fluent()
        return self._named_term()

    def _named_term(self) -> Entity:
        """Read a variable or an object."""
        token = self.tokens[self.at]
        if token == ")":
            self.fail("a term")
        found = self.scope.find(token) if token[0] == "?" else self.symbols.object(token)
        if found is None:
            self._unknown_term(token)
        self.at += 1
        return found

    def _unknown_term(self, token: str) -> NoReturn:
        if token[0] != "?":
            names = self.symbols.object_names()
            expected = f"an object that is declared{hint(token, names)}"
            if self.scope.find(f"?{token}") is not None:
                expected = f"an object, or the variable ?{token}"
            self.fail(expected, f"the object '{token}'")
        names = [f"{entity[0]}" for entity in self.scope.values()]
        expected = f"a variable that is bound here{hint(token, names)}"
        self.fail(expected, f"the variable '{token}'")

    def _object_fluent(self) -> Entity:
        signature = self._function_here()
        if signature.parameters is not None and not signature.types:
            self.fail("a term", f"the number ({signature.name} ...)")
        self.enter()
        found = f.Fluent(signature.name, self.arguments(signature))
        self.level -= 1
        return found, signature.types

    def _function_here(self) -> Signature:
        """Look up the function after the next parenthesis."""
        name = self.peek_head("a function, such as (distance ?a ?b)", "a function")
        return self.known(self.symbols.functions, name)

    def known(self, signatures: Signatures, name: str) -> Signature:
        """Look up a predicate or a function."""
        found = signatures.find(name)
        if found is not None:
            return found
        if self.symbols.unknown_domain and is_name(name, signatures.kind):
            found = Signature(name, None, ())
            signatures.add(found)
        else:
            expected = f"a {signatures.kind} that is declared{hint(name, signatures.names())}"
            self.fail(expected, f"the {signatures.kind} '{name}'", self.at + 1)
        return found

    def variables(self) -> tuple[f.TypedName, ...]:
        """Read a parenthesised list of typed variables, and bind them."""
        self.expect("(", "'(' before the variables")
        return self.bind(self.typed_list(VARIABLES))

    def bind(self, groups: list[Group]) -> tuple[f.TypedName, ...]:
        """Bind variables, in addition to those in scope."""
        symbols, scope = self.symbols, self.scope
        found: dict[str, BoundVariable] = {}
        for group in groups:
            types = self.resolve(symbols, group.types, group.types_at)
            for word in group.words:
                bound = symbols.bound(word, types)
                key = bound.key
                if self.duration_allowed and key == _DURATION_WORD:
                    at = group.at + group.words.index(word)
                    self.fail("a variable that is not the duration of the action", at=at)
                if key in found:
                    at = group.at + group.words.index(word)
                    self.fail("each variable once", f"the variable '{word}' again", at)
                found[key] = bound
                scope.bind(word, bound)
        return tuple([bound.declared for bound in found.values()])


def _noun(context: int) -> str:
    return "effect" if context & EFFECT else "formula"


def _called(context: int) -> str:
    return "an effect" if context & EFFECT else "a formula"


_Operators = dict[str, Callable[[FormulaReader, int], f.Formula]]
_CONDITIONS: _Operators = {
    "and": FormulaReader._junction,
    "or": FormulaReader._junction,
    "not": FormulaReader._not,
    "imply": FormulaReader._imply,
    "forall": FormulaReader._quantified,
    "exists": FormulaReader._quantified,
    "at": FormulaReader._at_time,
    "over": FormulaReader._at_time,
    "preference": FormulaReader._preference,
    **dict.fromkeys(f.COMPARISONS, FormulaReader._comparison),
    **dict.fromkeys(f.MODALS, FormulaReader._modal),
    **dict.fromkeys(f.COUNTS, FormulaReader._counted),
}
_EFFECTS: _Operators = {
    "and": FormulaReader._junction,
    "not": FormulaReader._delete,
    "forall": FormulaReader._quantified,
    "when": FormulaReader._when,
    "at": FormulaReader._at_time,
    "over": FormulaReader._at_time,
    **dict.fromkeys(f.ASSIGNMENTS, FormulaReader._assign),
}
