"""The display in notebooks: bounded tables in HTML, with all stored text escaped.

A notebook calls `_repr_html_` of a value, and shows the result without a check. So every text is
escaped, characters that reorder or hide text are written out, and a result of a million rows shows
a few.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from html import escape
from itertools import islice
from typing import Generic, TypeVar

from .errors import KantSqlError, printable

# Limits: rows of a table, lines of a cell, and characters of a text.
ROWS = 50
LINES = 10
LENGTH = 200

_CELL = 'style="text-align:left;vertical-align:top"'
_TIME = 'style="text-align:left;vertical-align:top;white-space:nowrap"'
# Characters without width, or that only turn the direction of text, and that `printable` does not
# escape. (Joiners, which some languages need, stay.)
_UNSEEN = re.compile(
    r"[\u00ad\u034f\u061c\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b\u200e\u200f\u2060-\u206f"
    r"\u3164\ufeff\uffa0\ufff9-\ufffb\U000e0000-\U000e0fff]"
)
_LAYOUT = re.compile(r"[\t\n]+")

Row = Mapping[str, object]
T_co = TypeVar("T_co", covariant=True)
T = TypeVar("T")


def row_of(item: object, noun: str) -> Row:
    """Return the row of an item: its own, or its text under its noun."""
    make: Callable[[], Row] | None = getattr(item, "_html_row_", None)
    return {noun: str(item)} if make is None else make()


def visible(text: str) -> str:
    """Escape the characters that control, reorder or hide text, as JSON does."""
    return _UNSEEN.sub(lambda match: json.dumps(match[0])[1:-1], printable(text))


def cut(text: str, length: int = LENGTH) -> str:
    """Return the beginning of a text; for a long one, with its length."""
    if len(text) <= length:
        return text
    return f"{text[:length]}... ({len(text):,} characters)"


def shown_text(value: object) -> str:
    """Return a value as HTML: escaped, visible and bounded."""
    text = str(value).replace("+00:00", "Z") if isinstance(value, datetime) else str(value)
    # An action's text has lines; in a cell it has none.
    return escape(visible(_LAYOUT.sub(" ", cut(text))))


def _cell(value: object) -> str:
    lines = value if isinstance(value, list | tuple) else () if value is None else (value,)
    style = _TIME if isinstance(value, datetime) else _CELL
    return f"<td {style}>{'<br>'.join(map(shown_text, lines))}</td>"


def heading(text: str) -> str:
    """Return a line above tables."""
    return f"<p><strong><bdi>{shown_text(text)}</bdi></strong></p>"


def table(rows: Sequence[Row], *, more: str = "") -> str:
    """Return rows as a table, without columns that are empty in all rows.

    Args:
        rows: the rows to show, all with the same columns.
        more: the text about omitted rows.
    """
    names = rows[0] if rows else ()
    columns = [name for name in names if any(_is_said(row[name]) for row in rows)]
    head = "".join(f"<th {_CELL}>{shown_text(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(_cell(row[name]) for name in columns)}</tr>" for row in rows)
    end = f"<p>{shown_text(more)}</p>" if more else ""
    return _scrolled(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>") + end


def _scrolled(made: str) -> str:
    """Let a table be wider than the notebook."""
    return f'<div style="overflow-x:auto">{made}</div>'


def _is_said(value: object) -> bool:
    return value is not None and value != ()


def more(left: int) -> tuple[str, ...]:
    """Write the number of omitted items, if any."""
    return (f"and {left:,} more",) if left else ()


def counted(count: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def listing(items: Sequence[object], noun: str) -> str:
    """Return items as a table under their number."""
    return titled([row_of(item, noun) for item in items[:ROWS]], len(items), noun)


def titled(rows: Sequence[Row], count: int, noun: str) -> str:
    """Return the first rows as a table under the number of all."""
    title = heading(counted(count, noun))
    return title + table(rows, more="".join(more(count - len(rows)))) if rows else title


def fields(row: Row) -> str:
    """Return one row as a table with a line for each column."""
    lines = "".join(
        f"<tr><th {_CELL}>{shown_text(name)}</th>{_cell(value)}</tr>"
        for name, value in row.items()
        if _is_said(value)
    )
    return _scrolled(f"<table><tbody>{lines}</tbody></table>")


def lines(text: str) -> str:
    """Return the first lines of a text unchanged."""
    every = text.split("\n")
    said = [shown_text(line) for line in every[:ROWS]]
    if len(every) > ROWS:
        said.append(f"and {len(every) - ROWS:,} more lines")
    together = "\n".join(said)
    return f"<pre>{together}</pre>"


def guarded(make: Callable[[], str]) -> str:
    """Return the result of a read, or why it failed: a notebook shows nothing for an error."""
    try:
        return make()
    except KantSqlError as error:
        return f"<p>{escape(visible(cut(str(error), 10 * LENGTH)))}</p>"


class OneRow:
    """A result that notebooks show as a table of its fields."""

    def _html_row_(self) -> Row:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return fields(self._html_row_())


class Listing(list[T]):
    """A list that notebooks show as a table."""

    def __init__(self, items: Iterable[T] = (), noun: str = "item") -> None:
        """Copy the items.

        Args:
            items: the items.
            noun: what one is called.
        """
        super().__init__(items)
        self._noun = noun

    def _repr_html_(self) -> str:
        return listing(self, self._noun)


class Feed(Iterator[T_co], Generic[T_co]):
    """An iterator whose first page notebooks show; they read it separately, and consume nothing."""

    def __init__(
        self, read: Callable[[int | None], Iterator[T_co]], limit: int | None, *, noun: str
    ) -> None:
        """Begin to read.

        Args:
            read: reads a number of the first items, or all.
            limit: the maximum number of items.
            noun: what one is called.
        """
        self._items = read(limit)
        self._peeked: list[T_co] = []  # the next item, once `bool` has read it
        self._read, self._limit, self._noun = read, limit, noun

    def __next__(self) -> T_co:
        return self._peeked.pop() if self._peeked else next(self._items)

    def __bool__(self) -> bool:
        """Return whether there is a next item, which it reads and keeps."""
        if not self._peeked:
            self._peeked += islice(self._items, 1)
        return bool(self._peeked)

    def _repr_html_(self) -> str:
        return guarded(self._first_page)

    def _first_page(self) -> str:
        most = ROWS + 1 if self._limit is None else min(ROWS + 1, self._limit)
        found = list(islice(self._read(most), most))
        if len(found) <= ROWS:
            return listing(found, self._noun)
        rows = [row_of(item, self._noun) for item in found[:ROWS]]
        title = heading(f"The first {ROWS} of more {self._noun}s")
        return title + table(rows, more="and more: iterate over it")
