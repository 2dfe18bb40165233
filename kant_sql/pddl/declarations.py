"""Reading declarations of a domain or a problem: names, and actions and rules."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Generic, NamedTuple, TypeVar

from ..dto import formulas as f
from ..dto.formulas import TypedName
from ..dto.lexical import ROOT_TYPE, either_text, fold, function_kind, is_name, is_requirement
from .cursor import VARIABLES, Cursor, Diagnostics, Group, Section, hint
from .document import DURATIVE_ACTION, PROCESS, Action, Function, Predicate
from .formulas import DURATION_VARIABLE, EFFECT, PREFERENCES, TIMED, FormulaReader, flatten
from .requirements import KNOWN
from .symbols import Fit, SymbolTable, Types

NUMBER_TYPE = "number"


class DeclarationReader(Cursor):
    """A reader of one section of declarations."""

    def __init__(self, diagnostics: Diagnostics, section: Section, symbols: SymbolTable) -> None:
        super().__init__(diagnostics, section, section.keyword)
        self.symbols = symbols
        self.at = 2

    def requirements(self) -> list[str]:
        """Read the requirements."""
        found: dict[str, str] = {}
        while self.tokens[self.at] != ")":
            word = self.word("a requirement such as :typing")
            if word[0] != ":":
                self.deviate(f"':{word}'", "read so", at=self.at - 1)
                word = f":{word}"
            if not is_requirement(word):
                self.fail("a requirement such as :typing", at=self.at - 1)
            near = "" if fold(word) in KNOWN else self.diagnostics.hint(word, lambda: [*KNOWN])
            if near:
                self.deviate("a known requirement", f"kept{near}", f"'{word}'", self.at - 1)
            if fold(word) in found:
                self.deviate("each requirement once", "left out", at=self.at - 1)
            found.setdefault(fold(word), word)
        self.at += 1
        return list(found.values())

    def predicates(self) -> Iterator[tuple[Predicate, int]]:
        """Read the predicates, each with the index of its name."""
        while self.tokens[self.at] != ")":
            if self.tokens[self.at : self.at + 2] == ["(", "="]:
                self.deviate("no declaration of =, which is built in", "left out")
                self.skip()
            else:
                yield self.predicate()
        self.at += 1

    def predicate(self) -> tuple[Predicate, int]:
        """Read a predicate with its parameters."""
        at, name, parameters = self._skeleton("predicate")
        return Predicate(name, parameters), at

    def _skeleton(self, kind: str) -> tuple[int, str, tuple[TypedName, ...]]:
        self.expect("(", f"a {kind} such as (near ?a ?b)")
        at = self.at
        if self.tokens[at][:1] == ":":
            self.fail(f"a {kind}")
        name = self.declared_name(kind)
        nesting, self.nesting = self.nesting, f"{kind} {name}"
        parameters = self._parameters(self.typed_list(VARIABLES))
        self.nesting = nesting
        return at, name, parameters

    def _parameters(self, groups: list[Group]) -> tuple[TypedName, ...]:
        parameters = []
        seen: set[str] = set()
        for group in groups:
            types = self.resolve(self.symbols, group.types, group.types_at)
            for number, word in enumerate(group.words):
                bound = self.symbols.bound(word, types)
                if bound.key in seen:
                    found = f"the parameter '{word}' again"
                    self.deviate("each parameter once", "kept", found, group.at + number)
                seen.add(bound.key)
                parameters.append(bound.declared)
        return tuple(parameters)

    def functions(self) -> Iterator[tuple[Function, int]]:
        """Read the functions, each with the index of its name."""
        pending: list[tuple[int, str, tuple[TypedName, ...]]] = []
        while True:
            token = self.tokens[self.at]
            if token == "(":
                pending.append(self._skeleton("function"))
                continue
            types: tuple[str, ...] = ()
            if token[:1] == "-":
                types = self._value_types(token, len(pending))
            elif token != ")":
                self.fail("a function such as (distance ?a ?b)")
            for at, name, parameters in pending:
                if not is_name(name, function_kind(parameters, types)):
                    self.fail(f"the name of another function than ({name})", at=at)
                yield Function(name, parameters, types), at
            pending = []
            if token == ")":
                self.at += 1
                return

    def _value_types(self, token: str, count: int) -> tuple[str, ...]:
        at = self.at
        types = self.type_behind("function", token, count)
        if len(types) == 1 and fold(types[0]) == NUMBER_TYPE:
            return ()
        return self.resolve(self.symbols, types, at)


Element = TypeVar("Element")


class Declarations(Generic[Element]):
    """Elements by name, in the order of their first declaration."""

    def __init__(self, kind: str, meaning: Callable[[Element], Hashable]) -> None:
        self._kind = kind  # the kind of the elements, for messages
        self._meaning = meaning  # returns what two declarations of one name must have in common
        self._elements: dict[str, tuple[Element, object]] = {}

    def __contains__(self, name: str) -> bool:
        return fold(name) in self._elements

    def elements(self) -> tuple[Element, ...]:
        """Return the elements."""
        return tuple([element for element, _ in self._elements.values()])

    def add(self, cursor: Cursor, name: str, element: Element, at: int) -> bool:
        """Declare an element; return whether it is new."""
        source = cursor.section.text
        known, first = self._elements.setdefault(fold(name), (element, source))
        if known is element:
            return True
        if self._meaning(known) != self._meaning(element):
            found = f"another {self._kind} {name}, which differs from the first"
            cursor.fail(f"one {self._kind} of that name", found, at)
        if first is source:
            cursor.deviate(f"each {self._kind} once", "left out", f"'{name}' again", at)
        return False


class _Entry(NamedTuple):
    name: str
    types: Types
    cursor: Cursor
    types_at: int


class TypedNames:
    """Names with types, which `resolve` replaces by declared types; `kind` is for messages."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._entries: dict[str, _Entry] = {}

    def __contains__(self, name: str) -> bool:
        return fold(name) in self._entries

    def names(self) -> list[str]:
        """Return the names."""
        return [entry.name for entry in self._entries.values()]

    def add(self, cursor: Cursor, name: str, group: Group, at: int) -> bool:
        """Declare a name; return whether it is new."""
        key = fold(name)
        known = self._entries.get(key)
        if known is None:
            self._entries[key] = _Entry(name, group.types, cursor, group.types_at)
            return True
        same_source = known.cursor.section.text is cursor.section.text
        types = self._united(known, name, group.types, cursor, at)
        if same_source:
            together = either_text(types or (ROOT_TYPE,))
            repeated = f"the {self._kind} '{name}' again"
            cursor.deviate(f"each {self._kind} once", f"read as {together}", repeated, at)
        if types != known.types:
            self._entries[key] = _Entry(known.name, types, cursor, group.types_at)
        return False

    def _united(self, known: _Entry, name: str, types: Types, cursor: Cursor, at: int) -> Types:
        """Return the union of the types of a name that is declared twice."""
        first = {fold(one): one for one in known.types}
        second = {fold(one): one for one in types}
        if first.keys() == second.keys() or second.keys() <= {ROOT_TYPE}:
            return known.types
        if first.keys() <= {ROOT_TYPE}:
            return types
        other = known.cursor.section.text
        if other is not cursor.section.text:
            found = f"the {self._kind} '{name}' of another type"
            expected = f"{either_text(known.types)}, as in {other.name}"
            cursor.fail(expected, found, at)
        return tuple((first | second).values())

    def resolve(self, symbols: SymbolTable) -> list[TypedName]:
        """Return the names with their types resolved."""
        return [
            TypedName(entry.name, entry.cursor.resolve(symbols, entry.types, entry.types_at))
            for entry in self._entries.values()
        ]

    def refuse(self, name: str, expected: str, found: str) -> None:
        """Refuse a declared name."""
        entry = self._entries[fold(name)]
        entry.cursor.fail(expected, found, entry.types_at)


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
        """Read the parameters first, wherever they are: other parts refer to them."""
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
            self.fail("each part of an action once, but this one is there already")
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
        if time in (f.AT_START, f.AT_END):
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
