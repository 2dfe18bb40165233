"""The sections that declare names: types, constants and objects, predicates, functions."""

from __future__ import annotations

from collections.abc import Callable

from ..dto.formula import TypedName
from ..dto.name import fold, function_kind, is_name, is_requirement
from .cursor import Reading
from .document import Function, Predicate
from .section import Section
from .symbols import Symbols
from .typed_lists import OBJECTS, VARIABLES, Group, ListReader

NUMBER_TYPE = "number"


class DeclarationReader(ListReader):
    """A reader of one section of declarations.

    Attributes:
        symbols: the names that are declared; the reader adds to them.
    """

    def __init__(self, reading: Reading, section: Section, symbols: Symbols) -> None:
        super().__init__(reading, section, section.keyword)
        self.symbols = symbols
        self.at = 2

    def names(self) -> list[Group]:
        """Read the names of a section of types, constants or objects.

        Returns:
            The names, as written.
        """
        return self.typed_list(OBJECTS)

    def requirements(self) -> list[str]:
        """Read the requirements.

        Returns:
            Each, as written, with its colon.
        """
        found: dict[str, str] = {}
        while self.tokens[self.at] != ")":
            word = self.word("a requirement such as :typing")
            if word[0] != ":":
                self.deviate(f"':{word}'", "read so", at=self.at - 1)
                word = f":{word}"
            if not is_requirement(word):
                self.fail("a requirement such as :typing", at=self.at - 1)
            if fold(word) in found:
                self.deviate("each requirement once", "left out", at=self.at - 1)
            found.setdefault(fold(word), word)
        self.at += 1
        return list(found.values())

    def predicates(self, add: Callable[[Predicate, int], None]) -> None:
        """Read the predicates.

        Args:
            add: what is told each predicate, and the index of its name.
        """
        while self.tokens[self.at] != ")":
            if self.tokens[self.at : self.at + 2] == ["(", "="]:
                self.deviate("no declaration of =, which is built in", "left out")
                self.skip()
            else:
                add(*self.predicate())
        self.at += 1

    def predicate(self) -> tuple[Predicate, int]:
        """Read a predicate with its parameters.

        Returns:
            The predicate, and the index of its name.
        """
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

    def functions(self, add: Callable[[Function, int], None]) -> None:
        """Read the functions.

        Args:
            add: what is told each function, and the index of its name.
        """
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
                add(Function(name, parameters, types), at)
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
