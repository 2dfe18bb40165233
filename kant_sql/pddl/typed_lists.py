"""Typed lists: of types, of objects, of variables; and the names that are declared in them."""

from __future__ import annotations

import re
from typing import NamedTuple

from ..dto.name import fold, is_name
from .cursor import Cursor, bounded_hint
from .hierarchy import Types
from .symbols import ANY, Symbols

_STANDARD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,254}")
OBJECTS, VARIABLES = "name", "variable"


class Group(NamedTuple):
    """Names in a typed list that have one type, as written.

    Attributes:
        words: the names, in order; variables with their question marks.
        types: their types as written; none when they have no type.
        at: the index of the first name's token; those of the others follow.
        types_at: the index of the token behind the names.
    """

    words: list[str]
    types: Types
    at: int
    types_at: int


class ListReader(Cursor):
    """A reader of typed lists."""

    # Behind which token types were looked for last, and where one was found.
    _found = (-1, -1)

    def typed_list(self, kind: str) -> list[Group]:
        """Read a typed list and the parenthesis behind it.

        Args:
            kind: `variable` or `name`.

        Returns:
            The names, in order.
        """
        tokens, at = self.tokens, self.at
        reading = self.reading
        standard = reading.standard_variables if kind == VARIABLES else reading.standard_names
        groups: list[Group] = []
        start = at
        while True:
            token = tokens[at]
            if token in standard:
                at += 1
                continue
            self.at = at
            if token == ")":
                if at > start:
                    groups.append(Group(tokens[start:at], (), start, at))
                self.at = at + 1
                return groups
            if token[:1] == "-":
                types = self.type_behind(kind, token, at - start)
                groups.append(Group(tokens[start:at], types, start, at))
                at = start = self.at
            else:
                self._check_name(kind, token)

    def type_behind(self, kind: str, token: str, count: int) -> Types:
        """Read a dash and the type of the names before it.

        Args:
            kind: what has the type, for messages.
            token: the next token, which is a dash or begins with one.
            count: how many names have the type.

        Returns:
            The types, as written.
        """
        if not count and token != "-":
            # It is a name rather than a type that nothing has.
            self.fail(f"a {kind}, which does not begin with '-'")
        if not count:
            self.deviate(f"a {kind} before the type", "the type left out")
        return self.after_dash(token)

    def _check_name(self, kind: str, token: str) -> None:
        """Check a name of a typed list once, and remember it."""
        name, known = token, self.reading.standard_names
        if kind == VARIABLES:
            if token[:1] != "?":
                self.fail("a variable, which begins with '?'")
            name, known = token[1:], self.reading.standard_variables
        if _STANDARD_NAME.fullmatch(name) is None:
            self.odd_name(name, kind)
        known.add(token)

    def odd_name(self, name: str, kind: str) -> None:
        """Note a name that is none in the standard, or refuse what can be none at all.

        Args:
            name: the name, which is the next token, but for its question mark.
            kind: what it names, for messages.
        """
        article = "an" if kind[0] in "aeiou" else "a"
        if not is_name(name, kind if kind != OBJECTS else "object"):
            self.fail(f"the name of {article} {kind}" if kind != OBJECTS else "a name")
        expected = f"{article} {kind} of a letter and letters, digits, '-' and '_'"
        self.deviate(expected, "taken as it is")

    def declared_name(self, kind: str) -> str:
        """Pass a name that is declared here, and in no typed list.

        Args:
            kind: what it names.

        Returns:
            The name.
        """
        name = self.word(f"the name of the {kind}")
        self.at -= 1
        if not is_name(name, kind):
            self.fail(f"the name of the {kind}, which is no reserved word")
        # What may name a predicate, `5` for one, may not name an object.
        if _STANDARD_NAME.fullmatch(name) is None and name not in self.reading.odd_names:
            self.reading.odd_names.add(name)
            self.odd_name(name, kind)
        self.at += 1
        return name

    def after_dash(self, token: str) -> Types:
        """Read a type and the dash before it, which may have no space behind it.

        Args:
            token: the next token.

        Returns:
            The types, as written.
        """
        if token == "-":
            self.at += 1
            return self.type_expression()
        self.deviate(f"'- {token[1:]}'", "read so")
        self.at += 1
        return (token[1:],)

    def type_expression(self) -> Types:
        """Read a type, or `(either ...)`.

        Returns:
            The types, as written.
        """
        if self.tokens[self.at] != "(":
            return (self.word("a type"),)
        types: dict[str, str] = {}
        # How many lists are open, and whether the innermost has a type: the others get its types.
        opened, filled = 0, False
        while True:
            token = self.tokens[self.at]
            if token == "(":
                if opened:
                    self.deviate("a type", "its types read as alternatives")
                self._open_either()
                opened, filled = opened + 1, False
            elif token == ")":
                if not filled:
                    self.fail("a type")
                self.at += 1
                opened -= 1
                if not opened:
                    return tuple(types.values())
            else:
                name = self.word("a type")
                types.setdefault(fold(name), name)
                filled = True

    def _open_either(self) -> None:
        """Pass the parenthesis and the word that begin a list of types."""
        self.at += 1
        if self.tokens[self.at].lower() == "either":
            self.at += 1
        else:
            self.deviate("a type or (either ...)", "read as (either ...)", at=self.at - 1)

    def resolve(self, symbols: Symbols, types: Types, at: int) -> Types:
        """Find types among those that are declared.

        Args:
            symbols: the names that are declared.
            types: the types, as written.
            at: the index of the token that a message names.

        Returns:
            The types in their declared spelling; `object` when there are none.
        """
        known = symbols.resolved.get(types)
        if known is None:
            known = symbols.resolved[types] = tuple(
                [self._resolve(symbols, name, at) for name in types or ANY]
            )
        return known

    def _resolve(self, symbols: Symbols, name: str, at: int) -> str:
        known = symbols.types.get(fold(name))
        if known is None:
            if not is_name(name, "type"):
                self.fail("a type", f"'{name}'", self._token_of(name, at))
            if not symbols.unknown_domain:
                place = self._token_of(name, at)
                close = bounded_hint(self.reading, name, symbols.type_names)
                expected = f"a type that is declared{close}"
                if not symbols.grows:
                    self.fail(expected, f"the type '{name}'", place)
                self.deviate(expected, "added under object", f"the type '{name}'", place)
            known = symbols.types[fold(name)] = name
        return known

    def _token_of(self, name: str, at: int) -> int:
        """The index of a type's own token, when it is among those behind the dash."""
        # Types are looked up in their order: from the one before on, each token is met once.
        start = self._found[1] if self._found[0] == at else at
        for index in range(start, self.at):
            if self.tokens[index] in (name, f"-{name}"):
                self._found = at, index
                return index
        return at
