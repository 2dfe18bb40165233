"""The position of a reader in the tokens of a section: errors, words, names and typed lists."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from operator import itemgetter
from typing import Final, NamedTuple, NoReturn

from ..arguments import flag
from ..dto.lexical import fold, is_name, name_fault, with_article
from ..errors import InvalidArgumentError, PddlError
from .document import PddlWarning
from .lexer import Text, tokenize
from .symbols import ANY, SymbolTable, Types

END: Final = "the end of the text"
OBJECTS, VARIABLES = "name", "variable"
# A suggestion compares with all names, so only the first warnings of a reading get one.
MAX_SUGGESTIONS = 20

_STANDARD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,254}")
_MAX_QUOTED = 60
# Readers look this far ahead without a check.
_ENDS = ["", "", ""]


@dataclass(eq=False, slots=True)
class Section:
    """A section of a definition: from its parenthesis to the next section."""

    text: Text
    # Its keyword in lower case, such as `:action`; `define` for a head, and empty outside of
    # definitions.
    keyword: str
    start: int  # the offset of its beginning in the code
    end: int  # the offset of the next section, or of the end of the code
    last: bool = True  # whether it is the last section of its definition
    _tokens: list[str] | None = None

    @property
    def tokens(self) -> list[str]:
        """The tokens, with empty ones after the end."""
        if self._tokens is None:
            self._tokens = tokenize(self.text.code[self.start : self.end])
            self._tokens += _ENDS
        return self._tokens

    def forget(self) -> None:
        """Free the tokens: they take ten times the memory of the text."""
        self._tokens = None


class Diagnostics:
    """The warnings of one reading, or its refusal of them."""

    def __init__(self, strict: bool) -> None:
        # Whether violations of the standard are errors.
        self.strict = flag(strict, "strict", InvalidArgumentError)
        # The checked names of typed lists, and variables with their question marks.
        self.checked: dict[str, set[str]] = {OBJECTS: set(), VARIABLES: set()}
        self.odd_names: set[str] = set()  # other names that already have a warning
        # The messages of each section, by the indexes of their tokens.
        self._noted: dict[Section, list[tuple[int, str]]] = {}
        self._whole: list[PddlWarning] = []
        self.suggestions = MAX_SUGGESTIONS  # how many more warnings may suggest a name

    def deviate(
        self, section: Section, index: int, found: str, expected: str, read_as: str, nesting: str
    ) -> None:
        """Warn about a violation of the standard; refuse it if strict."""
        if self.strict:
            self.refuse(section, index, found, expected, nesting)
        within = f"in {nesting}: " if nesting else ""
        message = f"{within}found {found}, expected {expected}; {read_as}"
        self._noted.setdefault(section, []).append((index, message))

    def check_comments(self, text: Text) -> None:
        """Warn about a comment that is not UTF-8."""
        place = text.undecodable
        if place is None:
            return
        found, expected = "a comment that is not UTF-8", "UTF-8"
        if self.strict:
            raise PddlError(text.name, place.line, place.column, found, expected)
        message = f"found {found}, expected {expected}; skipped like any comment"
        self._whole.append(PddlWarning(text.name, place.line, place.column, message))

    def refuse(
        self, section: Section, index: int, found: str, expected: str, nesting: str
    ) -> NoReturn:
        """Raise the error for a token."""
        text = section.text
        [place] = text.locate(text.offsets(section.start, indexes=[index]))
        raise PddlError(text.name, place.line, place.column, found, expected, nesting)

    def warnings(self) -> tuple[PddlWarning, ...]:
        """Return the warnings, in the order of the text."""
        found = list(self._whole)
        if not self._noted:
            return tuple(found)
        sources: dict[int, list[tuple[int, Text, str]]] = {}
        for section, noted in self._noted.items():
            noted.sort(key=itemgetter(0))
            text, indexes = section.text, [index for index, _ in noted]
            offsets = text.offsets(section.start, indexes=indexes)
            of_source = sources.setdefault(text.source, [])
            of_source += [(at, text, said) for (_, said), at in zip(noted, offsets, strict=True)]
        for of_source in sources.values():
            of_source.sort(key=itemgetter(0))
            # One call for all: each starts at the beginning of the source.
            places = of_source[0][1].locate(offset for offset, _, _ in of_source)
            for (_, text, message), place in zip(of_source, places, strict=True):
                found.append(PddlWarning(text.name, *place, message))
        names = dict.fromkeys(section.text.name for section in self._noted)
        order = {name: number for number, name in enumerate(names)}
        return tuple(sorted(found, key=lambda one: (order.get(one.source, -1), one[1], one[2])))

    def hint(self, name: str, known: Callable[[], list[str]]) -> str:
        """Suggest a similar name in a warning, for the first warnings only."""
        if not self.suggestions:
            return ""
        self.suggestions -= 1
        return hint(name, known())


def hint(name: str, known: list[str]) -> str:
    """Suggest a known name similar to an unknown one."""
    if len(name) > _MAX_QUOTED:
        return ""
    spelled = {fold(one): one for one in known[:5000]}
    close = get_close_matches(fold(name), spelled, n=1)
    return f" (did you mean {spelled[close[0]]}?)" if close else ""


class Group(NamedTuple):
    """Names of one type in a typed list, as written; variables have their question marks."""

    words: list[str]
    types: Types  # their types; empty without any
    at: int  # the index of the first name's token
    types_at: int  # the index of the token after the names


class Cursor:
    """A position in the tokens of a section, with the methods that all readers share."""

    # The token after which a type was last searched, and the token of that type.
    _found = (-1, -1)

    def __init__(self, diagnostics: Diagnostics, section: Section, nesting: str = "") -> None:
        self.diagnostics = diagnostics
        self.open(section, nesting)

    def open(self, section: Section, nesting: str, tokens: list[str] | None = None) -> None:
        """Go to the beginning of a section, or of a block of its tokens."""
        self.section = section
        # The tokens of the section, or a block of them.
        self.tokens = section.tokens if tokens is None else tokens
        self.at = 0  # the index of the next token
        self.base = 0  # the number of tokens of the section before `tokens`
        self.nesting = nesting  # the enclosing construct, for messages

    def fail(self, expected: str, found: str | None = None, at: int | None = None) -> NoReturn:
        """Refuse the token here."""
        index = self.at if at is None else at
        found = self.quoted(index) if found is None else found
        self.diagnostics.refuse(self.section, self.base + index, found, expected, self.nesting)

    def deviate(
        self, expected: str, read_as: str, found: str | None = None, at: int | None = None
    ) -> None:
        """Warn that the token here violates the standard."""
        index = self.at if at is None else at
        found = self.quoted(index) if found is None else found
        self.diagnostics.deviate(
            self.section, self.base + index, found, expected, read_as, self.nesting
        )

    def quoted(self, index: int) -> str:
        """Quote a token for a message, shortened."""
        token = self.tokens[index]
        if token == "(":
            following = self.tokens[index + 1]
            token += following if following not in ("(", ")") else ""
        if not token:
            return END
        return f"'{token}'" if len(token) <= _MAX_QUOTED else f"'{token[:_MAX_QUOTED]}...'"

    def expect(self, token: str, expected: str | None = None) -> None:
        """Consume the given token."""
        if self.tokens[self.at] != token:
            self.fail(expected or f"'{token}'")
        self.at += 1

    def word(self, expected: str) -> str:
        """Consume a word."""
        token = self.tokens[self.at]
        if token in ("(", ")", ""):
            self.fail(expected)
        self.at += 1
        return token

    def peek_head(self, list_: str, word: str) -> str:
        """Return the word after the next parenthesis, without consuming them."""
        self.expect("(", list_)
        found = self.word(word)
        self.at -= 2
        return found

    def skip(self) -> None:
        """Consume a word, or a whole list."""
        depth, at, tokens = 0, self.at, self.tokens
        while True:
            token = tokens[at]
            at += 1
            if token == "(":
                depth += 1
            elif token == ")":
                depth -= 1
            elif token == "":
                self.fail("')'", at=at - 1)
            if depth <= 0:
                self.at = at
                return

    def typed_list(self, kind: str) -> list[Group]:
        """Read a typed list and the parenthesis after it."""
        tokens, at = self.tokens, self.at
        checked = self.diagnostics.checked[kind]
        groups: list[Group] = []
        start = at
        while True:
            token = tokens[at]
            if token in checked:
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
        """Read a dash and the type of the names before it."""
        if not count and token != "-":
            # It is more likely a name than a type without names.
            self.fail(f"a {kind}, which does not begin with '-'")
        if not count:
            self.deviate(f"a {kind} before the type", "the type left out")
        # With or without a space between them.
        if token != "-":
            self.deviate(f"'- {token[1:]}'", "read so")
        self.at += 1
        return self.type_expression() if token == "-" else (token[1:],)

    def _check_name(self, kind: str, token: str) -> None:
        """Check a name of a typed list, once for each spelling."""
        if kind == VARIABLES and token[:1] != "?":
            self.fail("a variable, which begins with '?'")
        name = token[1:] if kind == VARIABLES else token
        if _STANDARD_NAME.fullmatch(name) is None:
            self.odd_name(name, kind)
        self.diagnostics.checked[kind].add(token)

    def odd_name(self, name: str, kind: str) -> None:
        """Warn about a name that is not standard; refuse one that cannot be a name."""
        declared = kind if kind != OBJECTS else "object"
        if not is_name(name, declared):
            self.refuse_name(name, declared)
        expected = f"{with_article(kind)} of a letter and letters, digits, '-' and '_'"
        self.deviate(expected, "taken as it is")

    def refuse_name(self, name: str, kind: str, at: int | None = None) -> NoReturn:
        """Refuse a name, with the reason."""
        self.fail(f"another name for {with_article(kind)}: {name_fault(kind, name)}", at=at)

    def declared_name(self, kind: str) -> str:
        """Consume the name of a declaration outside of typed lists."""
        name = self.word(f"the name of the {kind}")
        self.at -= 1
        if not is_name(name, kind):
            self.refuse_name(name, kind)
        # Rules differ by kind: `5` may name a predicate, but not an object.
        if _STANDARD_NAME.fullmatch(name) is None and name not in self.diagnostics.odd_names:
            self.diagnostics.odd_names.add(name)
            self.odd_name(name, kind)
        self.at += 1
        return name

    def type_expression(self) -> Types:
        """Read a type, or `(either ...)`."""
        if self.tokens[self.at] != "(":
            return (self.word("a type"),)
        types: dict[str, str] = {}
        # The number of open lists, and whether the innermost has a type; all count.
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
        """Consume the beginning of a list of types."""
        self.at += 1
        if self.tokens[self.at].lower() == "either":
            self.at += 1
        else:
            self.deviate("a type or (either ...)", "read as (either ...)", at=self.at - 1)

    def resolve(self, symbols: SymbolTable, types: Types, at: int) -> Types:
        """Return types in their declared spelling."""
        known = symbols.resolved.get(types)
        if known is None:
            known = symbols.resolved[types] = tuple(
                [self._resolve(symbols, name, at) for name in types or ANY]
            )
        return known

    def _resolve(self, symbols: SymbolTable, name: str, at: int) -> str:
        known = symbols.types.get(fold(name))
        if known is None:
            if not is_name(name, "type"):
                self.fail("a type", f"'{name}'", self._token_of(name, at))
            if not symbols.unknown_domain:
                place = self._token_of(name, at)
                close = self.diagnostics.hint(name, lambda: list(symbols.types.values()))
                expected = f"a type that is declared{close}"
                if not symbols.grows:
                    self.fail(expected, f"the type '{name}'", place)
                self.deviate(expected, "added under object", f"the type '{name}'", place)
            known = symbols.types[fold(name)] = name
        return known

    def _token_of(self, name: str, at: int) -> int:
        """Return the index of a type's own token, if it is one of those after the dash."""
        # Types are resolved in order, so the search continues where the last one ended.
        start = self._found[1] if self._found[0] == at else at
        for index in range(start, self.at):
            if self.tokens[index] in (name, f"-{name}"):
                self._found = at, index
                return index
        return at
