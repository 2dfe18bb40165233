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
from ..dto.node import Node, walk
from .conjuncts import flatten
from .cursor import Steps, finished, hint
from .formulas import TIMED, FormulaReader
from .signatures import Signature
from .symbols import Head

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
        found = self._begin(context)
        return flatten(found if isinstance(found, Node) else finished(found))

    def _begin(self, context: int) -> Formula | Steps[Formula]:
        """Read an effect, unless there are effects within: then give the steps that read it."""
        tokens, at = self.tokens, self.at
        if tokens[at] != "(":
            self.fail("an effect, which begins with '('")
        head = tokens[at + 1]
        kind = self.symbols.effect_heads.get(head)
        if kind is None:
            kind = self._effect_head(head)
        if not isinstance(kind, Signature):
            return kind(self, context)
        if context & TIMED:
            self.fail(_TIMED_EFFECT)
        if not kind.accepted:
            return self.atom(kind)
        return Atom(kind.name, self.arguments(kind))

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

    def _all(self, context: int) -> Steps[Formula]:
        self.at += 2 if self.tokens[self.at + 1] != ")" else 1
        effects = []
        tokens = self.tokens
        while tokens[self.at] != ")":
            found = self._begin(context)
            effects.append(found if isinstance(found, Node) else (yield found))
        self.at += 1
        return And(tuple(effects))

    def _delete(self, context: int) -> Formula:
        if context & TIMED:
            self.fail(_TIMED_EFFECT)
        self.at += 2
        at = self.at
        formula = self.formula(0)
        if not isinstance(formula, Atom):
            self.fail("an atom that is deleted", at=at)
        self.expect(")", "')' after the atom that is deleted")
        return Not(formula)

    def _for_all(self, context: int) -> Steps[Formula]:
        outside = self.mark()
        self.at += 2
        variables = self.variables()
        effect = yield self._begin(context)
        self.expect(")", "')' after the effect of forall")
        self.release(outside)
        return Forall(variables, effect)

    def _when(self, context: int) -> Steps[Formula]:
        self.at += 2
        condition = self._empty() if self.is_empty() else (yield self.begin(context))
        effect = yield self._begin(context)
        self.expect(")", "')' after the condition and the effect of when")
        return When(condition, effect)

    def _at(self, context: int) -> Formula | Steps[Formula]:
        time = self.time_here()
        if time is None:
            if context & TIMED:
                self.fail(_TIMED_EFFECT)
            return self.atom(self.known(self.symbols.predicates, self.tokens[self.at + 1]))
        if not context & TIMED or time == OVER_ALL:
            self.fail(_TIMED_EFFECT if context & TIMED else "an effect without a time")
        return self._happening(time)

    def _happening(self, time: str) -> Steps[Formula]:
        self.at += 3
        effect = yield self._begin(0)
        self.expect(")", f"')' after the effect that happens {time}")
        return Timed(time, effect)

    def _assign(self, context: int) -> Formula:
        start = self.at
        operator = self.tokens[start + 1]
        if self._is_predicate():
            return self.atom(self.known(self.symbols.predicates, operator))
        operator = operator.lower()
        self.at += 2
        signature, fluent = self._assigned_fluent(operator)
        value = self.assigned(signature)
        self.expect(")", f"')' after the value of {operator}")
        effect = Assign(operator, fluent, value)
        if context & TIMED and not any(isinstance(one, ContinuousTime) for one in walk(value)):
            self.fail(_TIMED_EFFECT, at=start)
        return effect

    def _assigned_fluent(self, operator: str) -> tuple[Signature, Fluent]:
        if self.tokens[self.at] == "(":
            fluent = self.fluent(numeric=None if operator == "assign" else True)
        else:
            fluent = self.bare_fluent(self.tokens[self.at])
        signature = self.symbols.functions.find(fluent.function)
        assert signature is not None
        return signature, fluent


_Reader = Callable[[EffectReader, int], Formula | Steps[Formula]]
_READERS: dict[str, _Reader] = {
    "and": EffectReader._all,
    "not": EffectReader._delete,
    "forall": EffectReader._for_all,
    "when": EffectReader._when,
    "at": EffectReader._at,
    "over": EffectReader._at,
    **dict.fromkeys(ASSIGNMENTS, EffectReader._assign),
}
