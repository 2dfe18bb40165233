"""Where a reader is in the tokens of a section, and what it says when something is wrong there."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from difflib import get_close_matches
from operator import itemgetter
from typing import Any, NoReturn, TypeVar

from ..arguments import flag
from ..dto.name import fold
from ..dto.node import Node
from ..errors import InvalidArgumentError, PddlError
from .document import PddlWarning
from .section import Section
from .tokens import Text

END = "the end of the text"
_SHOWN = 60
# Each looks through all names, so only the first warnings of a reading suggest one.
MAX_SUGGESTIONS = 20

T = TypeVar("T")
# What reads something with the like of it within: it yields what is within, or the steps that read
# that, is sent what was read, and returns the whole.
Steps = Generator[Any, Any, T]


def finished(steps: Steps[T]) -> T:
    """Take steps, and those that they yield, on a stack that is not the interpreter's.

    Args:
        steps: what reads something, nested to any depth.

    Returns:
        What was read.
    """
    stack, given = [steps], None
    while True:
        try:
            found = stack[-1].send(given)
        except StopIteration as end:
            stack.pop()
            given = end.value
            if not stack:
                return end.value  # type: ignore[no-any-return]
            continue
        if isinstance(found, Node):
            given = found
        else:
            stack.append(found)
            given = None


class Reading:
    """What one call of a reader has come across.

    Attributes:
        strict: whether what violates the standard is refused.
        standard_names: names in typed lists that were found to be as in the standard, or noted.
        standard_variables: the same of variables, with their question marks.
        odd_names: other names that were noted.
    """

    def __init__(self, strict: bool) -> None:
        self.strict = flag(strict, "strict", InvalidArgumentError)
        self.standard_names: set[str] = set()
        self.standard_variables: set[str] = set()
        self.odd_names: set[str] = set()
        self._noted: dict[Section, dict[int, list[str]]] = {}
        self._whole: list[PddlWarning] = []
        self.suggestions = MAX_SUGGESTIONS

    def deviate(
        self, section: Section, index: int, found: str, expected: str, read_as: str, nesting: str
    ) -> None:
        """Note what violates the standard, or refuse it.

        Args:
            section: the section it is in.
            index: the token in the section.
            found: what is there.
            expected: what the standard asks for.
            read_as: what it is taken for.
            nesting: what it is in.

        Raises:
            PddlError: the reading is strict.
        """
        if self.strict:
            self.refuse(section, index, found, expected, nesting)
        within = f"in {nesting}: " if nesting else ""
        message = f"{within}found {found}, expected {expected}; {read_as}"
        self._noted.setdefault(section, {}).setdefault(index, []).append(message)

    def check_comments(self, text: Text) -> None:
        """Note a comment that is not UTF-8.

        Args:
            text: the text.
        """
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
        """Say what is wrong.

        Args:
            section: the section it is in.
            index: the token in the section.
            found: what is there.
            expected: what should be there.
            nesting: what it is in.

        Raises:
            PddlError: always.
        """
        text = section.text
        [place] = text.locate(text.offsets(section.start, [index]))
        raise PddlError(text.name, place.line, place.column, found, expected, nesting)

    def warnings(self) -> tuple[PddlWarning, ...]:
        """Give what was noted.

        Returns:
            The warnings, in the order of the sources and of the places in them.
        """
        found = list(self._whole)
        if not self._noted:
            return tuple(found)
        for noted in self._noted_by_source():
            # All at once: each call goes through the source from its beginning.
            places = noted[0][1].locate(offset for offset, _, _ in noted)
            for (_, text, messages), place in zip(noted, places, strict=True):
                found += [PddlWarning(text.name, *place, message) for message in messages]
        sources = dict.fromkeys(section.text.name for section in self._noted)
        order = {name: number for number, name in enumerate(sources)}
        return tuple(sorted(found, key=lambda one: (order.get(one.source, -1), one[1], one[2])))

    def _noted_by_source(self) -> Iterable[list[tuple[int, Text, list[str]]]]:
        """Give what was noted in each source: the offset in its code, the text, the messages."""
        sources: dict[int, list[tuple[int, Text, list[str]]]] = {}
        for section in sorted(self._noted, key=lambda section: section.start):
            noted, text = self._noted[section], section.text
            indexes = sorted(noted)
            sources.setdefault(text.source, []).extend(
                (offset, text, noted[index])
                for index, offset in zip(indexes, text.offsets(section.start, indexes), strict=True)
            )
        for of_source in sources.values():
            of_source.sort(key=itemgetter(0))
        return sources.values()


class Cursor:
    """A place in the tokens of a section, from where they are read.

    Attributes:
        reading: the call that reads.
        section: the section.
        tokens: its tokens, or some of them.
        at: the index of the next token.
        base: how many tokens of the section are before the first of `tokens`.
        nesting: what is being read, for messages.
    """

    def __init__(self, reading: Reading, section: Section, nesting: str) -> None:
        self.reading = reading
        self.open(section, nesting)

    def open(self, section: Section, nesting: str) -> None:
        """Go to the beginning of a section.

        Args:
            section: the section.
            nesting: what it is, for messages.
        """
        self.section = section
        self.tokens = self.first_tokens()
        self.at = 0
        self.base = 0
        self.nesting = nesting

    def first_tokens(self) -> list[str]:
        """Give the tokens to begin with.

        Returns:
            All of the section, with empty ones that stand for the end.
        """
        return self.section.tokens

    def fail(self, expected: str, found: str | None = None, at: int | None = None) -> NoReturn:
        """Refuse what is here.

        Args:
            expected: what should be here.
            found: what is here; the token unless given.
            at: the index of the token; the next one unless given.

        Raises:
            PddlError: always.
        """
        index = self.at if at is None else at
        found = self.shown(index) if found is None else found
        self.reading.refuse(self.section, self.base + index, found, expected, self.nesting)

    def deviate(
        self, expected: str, read_as: str, found: str | None = None, at: int | None = None
    ) -> None:
        """Note that what is here violates the standard.

        Args:
            expected: what the standard asks for.
            read_as: what it is taken for.
            found: what is here; the token unless given.
            at: the index of the token; the next one unless given.

        Raises:
            PddlError: the reading is strict.
        """
        index = self.at if at is None else at
        found = self.shown(index) if found is None else found
        self.reading.deviate(
            self.section, self.base + index, found, expected, read_as, self.nesting
        )

    def shown(self, index: int) -> str:
        """Show a token in a message.

        Args:
            index: which token.

        Returns:
            The token in quotes, with the one that follows a parenthesis.
        """
        token = self.tokens[index]
        if token == "(":
            following = self.tokens[index + 1]
            token += following if following not in ("(", ")") else ""
        if not token:
            return END
        return f"'{token}'" if len(token) <= _SHOWN else f"'{token[:_SHOWN]}...'"

    def expect(self, token: str, expected: str | None = None) -> None:
        """Pass a token.

        Args:
            token: the token that must be next.
            expected: how a message calls it.

        Raises:
            PddlError: it is not next.
        """
        if self.tokens[self.at] != token:
            self.fail(expected or f"'{token}'")
        self.at += 1

    def word(self, expected: str) -> str:
        """Pass a word.

        Args:
            expected: how a message calls it.

        Returns:
            The word.

        Raises:
            PddlError: a parenthesis is next.
        """
        token = self.tokens[self.at]
        if token in ("(", ")", ""):
            self.fail(expected)
        self.at += 1
        return token

    def skip(self) -> None:
        """Pass a word, or all from a parenthesis to the one that closes it."""
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


def bounded_hint(reading: Reading, name: str, known: Callable[[], list[str]]) -> str:
    """Suggest a name in a warning, of which a text may get many.

    Args:
        reading: the call that reads, which has a number of suggestions left.
        name: the name.
        known: gives the names that are known.

    Returns:
        As `hint`; nothing when no suggestions are left.
    """
    if not reading.suggestions:
        return ""
    reading.suggestions -= 1
    return hint(name, known())


def hint(name: str, known: list[str]) -> str:
    """Suggest a name that is like one that is not known.

    Args:
        name: the name.
        known: the names that are known.

    Returns:
        `; did you mean ...?`, or nothing.
    """
    if len(name) > _SHOWN:
        return ""
    spelled = {fold(one): one for one in known[:5000]}
    close = get_close_matches(fold(name), spelled, n=1)
    return f" (did you mean {spelled[close[0]]}?)" if close else ""
