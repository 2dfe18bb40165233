"""The lexer: PDDL text without its comments, its tokens, and their positions.

Reading must be fast and errors must be exact. So tokens are plain strings; the position of one is
computed from the text only for an error or a warning.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterable, Iterator
from copy import copy
from itertools import islice
from typing import NamedTuple

from ..arguments import expect, refusal
from ..errors import InvalidArgumentError, PddlError, SourceError, SourceMissingError

STRING = "<string>"
# A text with more unmatched parentheses is refused at once.
MAX_UNMATCHED = 150

_COMMENT = re.compile(r";[^\n]*")
_TOKEN = re.compile(r"[()]|[^\s()]+")
_UNDECODABLE = re.compile(r"[\udc80-\udcff]")
_BLOCK = 1 << 15
# Beginnings or contents of strings that are text, not paths.
_TEXT = re.compile(r"\ufeff?\s*(?:[(;]|\Z)|[^\r\n\0]*[\r\n\0]")
_DEFINE = re.compile(r"\(\s*define\b|\A\s*define\s*\(", re.IGNORECASE)


class Position(NamedTuple):
    """A place in a source: line and column, in characters, both from 1."""

    line: int
    column: int


class Text:
    """The text of one source.

    Attributes:
        name: the source's name: a path, or `<string>`.
        code: the text without its comments.
        undecodable: the place of the first comment that is not UTF-8, if any.
    """

    def __init__(self, name: str, *, whole: str) -> None:
        self.name = expect(name, str, "the name of a source", InvalidArgumentError)
        expect(whole, str, "the text of a source", InvalidArgumentError)
        if "\r" in whole:
            whole = whole.replace("\r\n", "\n").replace("\r", "\n")
        self._whole = whole.removeprefix("\ufeff")
        self.code = _COMMENT.sub("", self._whole) if ";" in self._whole else self._whole
        self.undecodable: Position | None = None
        self._check_characters()

    def _check_characters(self) -> None:
        nul = self._whole.find("\0")
        if nul >= 0:
            raise self._refusal(self._at(nul), "a NUL character", "PDDL text in UTF-8")
        if self._whole.isascii():
            return
        found = _UNDECODABLE.search(self.code)
        if found is not None:
            [position] = self.locate([found.start()])
            byte = f"the byte 0x{ord(found[0]) - 0xDC00:02X}"
            raise self._refusal(position, byte, "PDDL text in UTF-8")
        found = _UNDECODABLE.search(self._whole)
        if found is not None:
            self.undecodable = self._at(found.start())

    def _refusal(self, position: Position, found: str, expected: str) -> PddlError:
        return PddlError(self.name, position.line, position.column, found, expected)

    @property
    def source(self) -> int:
        """The identity of its source, which `without` keeps."""
        return id(self._whole)

    def _at(self, offset: int) -> Position:
        line_start = self._whole.rfind("\n", 0, offset) + 1
        return Position(self._whole.count("\n", 0, offset) + 1, offset - line_start + 1)

    def without(self, parts: Iterable[tuple[int, int]]) -> Text:
        """Blank out parts; the rest keeps its position."""
        pieces, seen = [], 0
        for start, end in parts:
            pieces += [self.code[seen:start], " " * (end - start)]
            seen = end
        rest = copy(self)
        rest.code = "".join([*pieces, self.code[seen:]])
        return rest

    def locate(self, offsets: Iterable[int]) -> list[Position]:
        """Return the positions in the text of ascending offsets in the code."""
        comments = _COMMENT.finditer(self._whole)
        comment = next(comments, None)
        removed, line, line_start, seen = 0, 1, 0, 0
        positions = []
        for offset in offsets:
            while comment is not None and comment.start() - removed <= offset:
                removed += len(comment[0])
                comment = next(comments, None)
            place = offset + removed
            line += self._whole.count("\n", seen, place)
            line_start = max(line_start, self._whole.rfind("\n", seen, place) + 1)
            seen = place
            positions.append(Position(line, place - line_start + 1))
        return positions

    def offsets(self, start: int, *, indexes: Iterable[int]) -> Iterator[int]:
        """Yield the offsets in the code of tokens."""
        tokens = enumerate(_TOKEN.finditer(self.code, start))
        place = (-1, start)
        for index in indexes:
            if index > place[0]:
                found = next(islice(tokens, index - place[0] - 1, None), None)
                place = (index, len(self.code)) if found is None else (found[0], found[1].start())
            yield place[1]


# A path, a text that begins with `(`, or a text with the name of its source.
Source = str | os.PathLike[str] | Text


def tokenize(text: str) -> list[str]:
    """Split text into parentheses and words."""
    return text.replace("(", " ( ").replace(")", " ) ").split()


class Blocks:
    """The tokens of a list in blocks of whole elements, small enough for a processor's cache."""

    def __init__(self, code: str, start: int, end: int) -> None:
        self._code = code
        self._next = start  # at first the offset of the parenthesis that opens the list
        self._end = end  # at or after the parenthesis that closes it
        self._depth = 0

    def next(self) -> list[str]:
        """Return the next block."""
        start = counted = self._next
        cut = start + _BLOCK
        while cut < self._end:
            cut = self._code.find(")", cut, self._end) + 1 or self._end
            self._depth += self._code.count("(", counted, cut) - self._code.count(")", counted, cut)
            counted = cut
            # Between two elements, only the list itself is open.
            if self._depth == 1:
                break
        self._next = min(cut, self._end)
        return tokenize(self._code[start : self._next])

    def rest(self) -> list[str]:
        """Return the tokens after the last block."""
        start, self._next = self._next, self._end
        return tokenize(self._code[start : self._end])


def end_of_tokens(text: str, count: int) -> int:
    """Return the offset of the end of the first tokens, without splitting the whole text."""
    return max((found.end() for found in islice(_TOKEN.finditer(text), count)), default=0)


def unmatched(code: str) -> tuple[int, int] | None:
    """Return place and number of unmatched parentheses, if more than `MAX_UNMATCHED`."""
    missing = code.count("(") - code.count(")")
    if missing > MAX_UNMATCHED:
        return len(code.rstrip()), missing
    if missing >= -MAX_UNMATCHED:
        return None
    depth = start = 0
    for start in range(0, len(code), _BLOCK):
        gain = code.count("(", start, start + _BLOCK) - code.count(")", start, start + _BLOCK)
        if depth + gain < 0:
            break
        depth += gain
    for found in re.finditer("[()]", code[start : start + _BLOCK]):
        depth += 1 if found[0] == "(" else -1
        if depth < 0:
            return start + found.start(), 0
    return len(code), 0


def is_text(source: str) -> bool:
    """Return whether a string is PDDL text: by its beginning, its lines, or `(define`."""
    return _TEXT.match(source) is not None or _DEFINE.search(source) is not None


def read_file(path: str | os.PathLike[str]) -> bytes:
    """Read a regular file."""
    name = os.fsdecode(path)
    try:
        # Opening a pipe without a writer would block.
        with open(path, "rb", opener=_open_at_once) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError(errno.EINVAL, "it is not a regular file; copy its content to one")
            return file.read()
    except (FileNotFoundError, ValueError) as error:
        # ValueError: the name has a NUL character or a lone surrogate.
        reason = os.strerror(errno.ENOENT)
        raise SourceMissingError(errno.ENOENT, reason, name) from error
    except OSError as error:
        number = error.errno or errno.EIO
        raise SourceError(number, error.strerror or os.strerror(number), name) from error


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def load(source: Source) -> Text:
    """Return the text of a source."""
    if isinstance(source, Text):
        return source
    # A number would be opened as a file descriptor.
    expected = "a path, or a string that begins with '('"
    expect(source, (str, os.PathLike), "a source", InvalidArgumentError, expected)
    if isinstance(source, str) and is_text(source):
        return Text(STRING, whole=source)
    try:
        path = os.fsdecode(source)
    except Exception as error:
        raise refusal("a source", expected, source, InvalidArgumentError) from error
    return decode(path, read_file(path))


def decode(name: str, data: bytes) -> Text:
    """Return the text of a file's content."""
    return Text(name, whole=data.decode("utf-8", "surrogateescape"))
