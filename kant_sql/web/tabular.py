"""The rows of a page's data as CSV, for spreadsheets."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Sequence
from io import StringIO
from typing import Any

# What a spreadsheet takes for a formula; neither a sign nor a number is one.
_FORMULA = re.compile(r"(?![+-]?[0-9.]*$)[=+\-@\t\r]")

Row = dict[str, object]


def csv_text(data: Any, places: Sequence[str]) -> str:
    """Return the first rows that a document has at some places, such as `parts.elements`, as CSV.

    A column is the path of a value in its row; lists are in one cell, as JSON where they have
    documents. A text that would be a formula begins with an apostrophe.
    """
    rows = next(filter(None, (list(_rows(data, place.split("."))) for place in places)), [])
    columns = dict.fromkeys(name for row in rows for name in row)
    made = StringIO()
    writer = csv.writer(made)
    writer.writerow([_cell(name) for name in columns])
    writer.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return made.getvalue()


def _rows(data: Any, path: Sequence[str]) -> Iterator[Row]:
    """Yield the rows at a path; one within a row has the texts of that."""
    found = data.get(path[0])
    if isinstance(found, dict):
        yield from _rows(found, path[1:])
        return
    for one in found or ():
        if isinstance(one, list):
            yield dict(zip(data["columns"], one, strict=True))
        elif len(path) == 1:
            yield dict(_flat(one))
        else:
            texts = {name: value for name, value in one.items() if isinstance(value, str)}
            yield from ({**texts, **row} for row in _rows(one, path[1:]))


def _flat(row: Row, above: str = "") -> Iterator[tuple[str, object]]:
    for name, value in row.items():
        if isinstance(value, dict) and name != "source":
            yield from _flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def _cell(value: object) -> object:
    if isinstance(value, list) and all(isinstance(one, str | int) for one in value):
        value = "; ".join(map(str, value))
    elif isinstance(value, list | dict):
        value = json.dumps(value, ensure_ascii=False)
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value
