"""Reading actions, durative actions, processes, events and rules for derived predicates."""

from __future__ import annotations

from ..dto import formulas as f
from ..dto.lexical import either_text
from .cursor import VARIABLES, Group, Section, hint
from .document import DURATIVE_ACTION, PROCESS, Action, Predicate
from .formulas import (
    DURATION_VARIABLE,
    EFFECT,
    PREFERENCES,
    TIMED,
    FormulaReader,
    flatten,
)
from .hierarchy import Fit, Types

_KEYS = (":parameters", ":vars", ":duration", ":condition", ":precondition", ":effect")

_DURATION = "(= ?duration ...), (<= ?duration ...) or (>= ?duration ...)"


class ActionReader(FormulaReader):
    """A reader of actions, one after another."""

    def action(self, section: Section) -> tuple[Action, int]:
        """Read an action; return it with the index of its name."""
        self._kind = kind = section.keyword[1:]
        self.open(section, kind)
        self._parameters: tuple[f.TypedName, ...] = ()
        self._parts: dict[str, tuple[f.Formula, ...]] = {}
        self._keys: set[str] = set()
        durative = kind == DURATIVE_ACTION
        self._context = TIMED if durative else 0
        self.duration_allowed = durative
        self.time_allowed = durative or kind == PROCESS
        self.at = 2
        name = self.declared_name(kind)
        whole = self.nesting = f"{kind} {name}"
        self._find_parameters()
        while self.tokens[self.at] != ")":
            self.nesting = whole
            self._part(self._key())
        self.nesting = whole
        self.at += 1
        if durative and ":duration" not in self._keys:
            self.deviate("a :duration", "read as any duration", f"{whole} without one", 2)
        parts = [self._parts.get(key, ()) for key in (":duration", ":condition", ":effect")]
        return Action(kind, name, self._parameters, *parts), 2

    def _find_parameters(self) -> None:
        """Read the parameters first, wherever they stand: other parts refer to them."""
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
        """Consume the keyword of a part."""
        key = self.tokens[self.at].lower()
        if key not in _KEYS or (key == ":duration" and self._kind != DURATIVE_ACTION):
            self.fail(f"a part of an action, such as :effect{hint(key, list(_KEYS))}")
        if key in (":condition", ":precondition"):
            proper = ":condition" if self._kind == DURATIVE_ACTION else ":precondition"
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

    def _read_part(self, key: str) -> tuple[f.Formula, ...]:
        if key == ":condition":
            return self.conjuncts(PREFERENCES | self._context)
        if key == ":effect":
            return self.conjuncts(EFFECT | self._context)
        if self.is_empty():
            self.at += 2
            return ()
        return flatten(self._duration())

    def _duration(self) -> f.Formula:
        head = self.peek_head("a duration, such as (= ?duration 5)", _DURATION).lower()
        time = self.time_here()
        self.enter()
        found = self._inner_duration(head, time)
        self.level -= 1
        return found

    def _inner_duration(self, head: str, time: str | None) -> f.Formula:
        if head == "and":
            self.at += 2
            parts = []
            while self.tokens[self.at] != ")":
                parts.append(self._duration())
            self.at += 1
            return f.And(tuple(parts))
        if time is not None:
            self.at += 3
            formula = self._duration()
            self.expect(")", f"')' after the duration {time}")
            return f.Timed(time, formula)
        return self._duration_constraint(head)

    def _duration_constraint(self, operator: str) -> f.Formula:
        start = self.at
        if operator not in f.COMPARISONS:
            self.fail(_DURATION)
        found = self.comparison()
        if not isinstance(found, f.Comparison) or DURATION_VARIABLE not in f.children(found):
            self.fail("a comparison with ?duration", at=start)
        if operator in "<>":
            self.deviate(f"({operator}= ?duration ...)", "kept", at=start)
        return found


class RuleReader(FormulaReader):
    """A reader of rules for derived predicates, one after another."""

    def head(self, section: Section) -> Predicate:
        """Read the head of a rule, as the declaration of its predicate."""
        self.open(section, section.keyword)
        self.at = 3
        name = self.declared_name("predicate")
        return Predicate(name, self.bind(self.typed_list(VARIABLES)))

    def rule(self, section: Section) -> f.Derived:
        """Read a rule."""
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
        return f.Derived(signature.name, variables, formula)

    def _check_variables(self, groups: list[Group], parameters: tuple[Types, ...]) -> None:
        """Check the types of variables; untyped ones get those of the predicate."""
        wanted = iter(parameters)
        for group in groups:
            for number, word in enumerate(group.words):
                types = next(wanted)
                bound = self.symbols.bound(word, types)
                if not group.types:
                    self.scope[bound.key] = self.scope[word] = bound.entity
                elif self.symbols.fit(self.scope[word][1], types) is Fit.NO:
                    expected = f"{bound.declared.type_text}, as the predicate is declared"
                    given = either_text(self.scope[word][1])
                    self.fail(expected, f"{word} of type {given}", group.at + number)
