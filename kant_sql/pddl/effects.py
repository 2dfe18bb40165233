"""Effects of actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ..dto.formula import (
    ASSIGNMENTS,
    OVER_ALL,
    And,
    Assign,
    Atom,
    ContinuousTime,
    Fluent,
    Forall,
    Formula,
    Not,
    Timed,
    When,
)
from .conjuncts import flatten
from .cursor import hint
from .formulas import TIMED, FormulaReader
from .signatures import Signature
from .symbols import Head
from .walk import walk

_TIMED_EFFECT = "(at start ...), (at end ...) or a continuous effect with #t"
# What formulas know and effects do not.
_CONDITIONS: Final = frozenset(
    {"or", "imply", "exists", "preference", "=", "<", "<=", ">=", ">", "oneof", "probabilistic"}
)


class EffectReader(FormulaReader):
    """A reader of effects, and of what else an action is made of."""

    def effects(self, context: int) -> tuple[Formula, ...]:
        """Read an effect that may be `()` or a conjunction, at the top of an action.

        Args:
            context: whether it must be timed.

        Returns:
            Its conjuncts.
        """
        if self.is_empty():
            self.at += 2
            return ()
        return flatten(self.effect(self.top(), context))

    def effect(self, depth: int, context: int) -> Formula:
        """Read an effect.

        Args:
            depth: how deeply it is nested.
            context: whether it must be timed.

        Returns:
            The effect.
        """
        tokens, at = self.tokens, self.at
        if tokens[at] != "(":
            self.fail("an effect, which begins with '('")
        head = tokens[at + 1]
        kind = self.symbols.effect_heads.get(head)
        if kind is None:
            kind = self._effect_head(head)
        if not isinstance(kind, Signature):
            return kind(self, depth + 1, context)
        if context & TIMED:
            self.fail(_TIMED_EFFECT)
        if not kind.accepted:
            return self.atom(kind, depth)
        return Atom(kind.name, self.arguments(kind, depth))

    def _effect_head(self, head: str) -> Head:
        """Find what a word behind a parenthesis begins, and remember it."""
        if head in ("(", ")", ""):
            if head != ")":
                self.fail("a predicate or an operator", at=self.at + 1)
            self.deviate("an effect", "read as (and)", "'()'")
            return EffectReader._all
        kind: Head | None = _READERS.get(head.lower())
        if kind is None:
            kind = self.symbols.predicates.find(head)
        if kind is None:
            if head.lower() in _CONDITIONS:
                self.fail("an effect", f"'({head}', which is none")
            expected = "a predicate that is declared"
            expected += hint(head, [*self.symbols.predicates.names(), *_READERS])
            self.fail(expected, f"the predicate '{head}'", self.at + 1)
        self.symbols.effect_heads[head] = kind
        return kind

    def _all(self, depth: int, context: int) -> Formula:
        self.check_depth(depth)
        self.at += 2 if self.tokens[self.at + 1] != ")" else 1
        effects = []
        tokens = self.tokens
        while tokens[self.at] != ")":
            effects.append(self.effect(depth, context))
        self.at += 1
        return And(tuple(effects))

    def _delete(self, depth: int, context: int) -> Formula:
        if context & TIMED:
            self.fail(_TIMED_EFFECT)
        self.at += 2
        at = self.at
        formula = self.formula(depth, 0)
        if not isinstance(formula, Atom):
            self.fail("an atom that is deleted", at=at)
        self.expect(")", "')' after the atom that is deleted")
        return Not(formula)

    def _for_all(self, depth: int, context: int) -> Formula:
        self.check_depth(depth)
        outside = self.scope
        self.at += 2
        variables = self.variables()
        effect = self.effect(depth, context)
        self.expect(")", "')' after the effect of forall")
        self.scope = outside
        return Forall(variables, effect)

    def _when(self, depth: int, context: int) -> Formula:
        self.check_depth(depth)
        self.at += 2
        condition = self._empty() if self.is_empty() else self.formula(depth, context)
        effect = self.effect(depth, context)
        self.expect(")", "')' after the condition and the effect of when")
        return When(condition, effect)

    def _at(self, depth: int, context: int) -> Formula:
        time = self.time_here()
        if time is None:
            if context & TIMED:
                self.fail(_TIMED_EFFECT)
            return self.atom(self.known(self.symbols.predicates, self.tokens[self.at + 1]), depth)
        if not context & TIMED or time == OVER_ALL:
            self.fail(_TIMED_EFFECT if context & TIMED else "an effect without a time")
        self.check_depth(depth)
        self.at += 3
        effect = self.effect(depth, 0)
        self.expect(")", f"')' after the effect that happens {time}")
        return Timed(time, effect)

    def _assign(self, depth: int, context: int) -> Formula:
        start = self.at
        operator = self.tokens[start + 1]
        if self._is_predicate():
            return self.atom(self.known(self.symbols.predicates, operator), depth)
        operator = operator.lower()
        self.at += 2
        signature, fluent = self._assigned_fluent(operator, depth)
        value = self.assigned(signature, depth)
        self.expect(")", f"')' after the value of {operator}")
        effect = Assign(operator, fluent, value)
        if context & TIMED and not any(isinstance(one, ContinuousTime) for one in walk(value)):
            self.fail(_TIMED_EFFECT, at=start)
        return effect

    def _assigned_fluent(self, operator: str, depth: int) -> tuple[Signature, Fluent]:
        if self.tokens[self.at] == "(":
            fluent = self.fluent(depth, numeric=None if operator == "assign" else True)
        else:
            fluent = self.bare_fluent(self.tokens[self.at])
        signature = self.symbols.functions.find(fluent.function)
        assert signature is not None
        return signature, fluent


_Reader = Callable[[EffectReader, int, int], Formula]
_READERS: dict[str, _Reader] = {
    "and": EffectReader._all,
    "not": EffectReader._delete,
    "forall": EffectReader._for_all,
    "when": EffectReader._when,
    "at": EffectReader._at,
    "over": EffectReader._at,
    **dict.fromkeys(ASSIGNMENTS, EffectReader._assign),
}
