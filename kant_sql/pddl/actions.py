"""Actions, durative actions, processes, events, and rules for derived predicates."""

from __future__ import annotations

from ..dto.formula import (
    COMPARISONS,
    And,
    Comparison,
    Derived,
    Formula,
    Timed,
    TypedName,
    Variable,
)
from ..dto.node import Node
from .conjuncts import flatten
from .cursor import Steps, finished, hint
from .document import DURATIVE_ACTION, PROCESS, Action, Predicate
from .effects import EffectReader
from .formulas import PREFERENCES, TIMED
from .hierarchy import Fit, Types
from .section import Section
from .typed_lists import VARIABLES, Group

_CONDITION = {DURATIVE_ACTION: ":condition"}
_KEYS = (":parameters", ":vars", ":duration", ":condition", ":precondition", ":effect")
_DURATION = Variable("duration")


class ActionReader(EffectReader):
    """A reader of actions, one after another."""

    def action(self, section: Section) -> tuple[Action, int]:
        """Read an action.

        Args:
            section: its section.

        Returns:
            The action, and the index of its name.
        """
        self._kind = kind = section.keyword[1:]
        self.open(section, kind)
        self._parameters: tuple[TypedName, ...] = ()
        self._parts: dict[str, tuple[Formula, ...]] = {}
        self._keys: set[str] = set()
        durative = kind == DURATIVE_ACTION
        self._context = TIMED if durative else 0
        self.duration_allowed = durative
        self.time_allowed = durative or kind == PROCESS
        return self._action()

    def _action(self) -> tuple[Action, int]:
        self.at = 2
        name = self.declared_name(self._kind)
        whole = self.nesting = f"{self._kind} {name}"
        self._find_parameters()
        while self.tokens[self.at] != ")":
            self.nesting = whole
            self._part(self._key())
        self.nesting = whole
        self.at += 1
        if self._kind == DURATIVE_ACTION and ":duration" not in self._keys:
            self.deviate("a :duration", "read as any duration", f"{whole} without one", 2)
        parts = self._parts
        duration, condition = parts.get(":duration", ()), parts.get(":condition", ())
        effect = parts.get(":effect", ())
        return Action(self._kind, name, self._parameters, duration, condition, effect), 2

    def _find_parameters(self) -> None:
        """Read the parameters first, wherever they are: conditions and effects use them."""
        start = self.at
        if self.tokens[start].lower() == ":parameters":
            return
        while self.tokens[self.at] not in (")", ""):
            if self.tokens[self.at].lower() == ":parameters":
                self.at += 1
                self._parameters = self.variables()
                break
            self.skip()
        else:
            self.deviate(":parameters ()", "read so", f"{self.nesting} without parameters", 2)
        self.at = start

    def _key(self) -> str:
        """Pass the keyword of a part."""
        key = self.tokens[self.at].lower()
        if key not in _KEYS or (key == ":duration" and self._kind != DURATIVE_ACTION):
            self.fail(f"a part of an action, such as :effect{hint(key, list(_KEYS))}")
        if key in (":condition", ":precondition"):
            proper = _CONDITION.get(self._kind, ":precondition")
            if key != proper:
                self.deviate(proper, "read so")
            key = ":condition"
        if key in self._keys:
            self.fail(f"each part of an action once, but {key} is there already")
        self._keys.add(key)
        self.nesting = f"{self.nesting}, {self.tokens[self.at]}"
        self.at += 1
        return key

    def _part(self, key: str) -> None:
        if key == ":parameters":
            if self._parameters:
                self.skip()
            else:
                self._parameters = self.variables()
        elif key == ":vars":
            self.deviate("variables in :parameters", "read as further parameters", at=self.at - 1)
            self._parameters += self.variables()
        else:
            found = [*self._read_part(key)]
            while self.tokens[self.at] == "(":
                self.deviate("one formula: (and ...)", "read as a conjunction")
                found += self._read_part(key)
            self._parts[key] = tuple(found)

    def _read_part(self, key: str) -> tuple[Formula, ...]:
        if key == ":effect":
            return self.effects(self._context)
        if key == ":duration":
            if self._skip_empty():
                return ()
            found = self._duration()
            return flatten(found if isinstance(found, Node) else finished(found))
        return self.conjuncts(PREFERENCES | self._context)

    def _skip_empty(self) -> bool:
        """Pass `()`, if it is next."""
        empty = self.is_empty()
        self.at += 2 if empty else 0
        return empty

    def _duration(self) -> Formula | Steps[Formula]:
        self.expect("(", "a duration, such as (= ?duration 5)")
        self.at -= 1
        head = self.tokens[self.at + 1].lower()
        if head == "and":
            return self._all_durations()
        time = self.time_here()
        return self._duration_constraint(head) if time is None else self._timed_duration(time)

    def _all_durations(self) -> Steps[Formula]:
        self.at += 2
        parts = []
        while self.tokens[self.at] != ")":
            parts.append((yield self._duration()))
        self.at += 1
        return And(tuple(parts))

    def _timed_duration(self, time: str) -> Steps[Formula]:
        self.at += 3
        formula = yield self._duration()
        self.expect(")", f"')' after the duration {time}")
        return Timed(time, formula)

    def _duration_constraint(self, operator: str) -> Formula:
        start = self.at
        if operator not in COMPARISONS:
            self.fail("(= ?duration ...), (<= ?duration ...) or (>= ?duration ...)")
        found = self.comparison()
        if not isinstance(found, Comparison) or _DURATION not in (found.left, found.right):
            self.fail("a comparison with ?duration", at=start)
        if operator in "<>":
            self.deviate(f"({operator}= ?duration ...)", "kept", at=start)
        return found


class DerivedReader(EffectReader):
    """A reader of rules for derived predicates, one after another."""

    def head(self, section: Section) -> Predicate:
        """Read the head of a rule alone, as a predicate's declaration.

        Args:
            section: the rule's section.

        Returns:
            The predicate.
        """
        self.open(section, section.keyword)
        self.at = 3
        name = self.declared_name("predicate")
        return Predicate(name, self.bind(self.typed_list(VARIABLES)))

    def rule(self, section: Section) -> Derived:
        """Read a rule.

        Args:
            section: its section.

        Returns:
            The rule.
        """
        self.open(section, section.keyword)
        self.at = 2
        self.expect("(", "a predicate with its variables")
        name = self.tokens[3]
        self.nesting = f":derived {name}"
        self.at = 2
        signature = self.known(self.symbols.predicates, name)
        self.at = 4
        groups = self.typed_list(VARIABLES)
        variables = self.bind(groups)
        parameters = signature.parameters or ()
        if len(variables) != len(parameters):
            expected = f"{len(parameters)}, as {signature.name} is declared"
            self.fail(expected, f"{len(variables)} variables", 3)
        self._check_variables(groups, parameters)
        formula = self.formula(0)
        self.expect(")", "')' after the formula that it follows from")
        return Derived(signature.name, variables, formula)

    def _check_variables(self, groups: list[Group], parameters: tuple[Types, ...]) -> None:
        """Check the types against the predicate's; variables that say none have those."""
        wanted = iter(parameters)
        for group in groups:
            for number, word in enumerate(group.words):
                types = next(wanted)
                bound = self.symbols.bound(word, types)
                if not group.types:
                    self.scope[bound.key] = self.scope[word] = bound.entity
                elif self.symbols.fit(self.scope[word][1], types) is Fit.NO:
                    expected = f"{bound.declared.type_text}, as the predicate is declared"
                    given = TypedName("", self.scope[word][1]).type_text
                    self.fail(expected, f"{word} of type {given}", group.at + number)
