"""Templates and CSV: links, escaped text, and no folders of the server."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from .. import __version__
from ..errors import KantSqlError, StoreError
from ..history.window import TIMELINE_KINDS
from ..html import visible
from ..json_values import JsonValue
from ..sql.executions import OUTCOMES, read_outcome

STATIC = Path(__file__).parent / "static"
# Links and titles cut longer texts; their own page has the whole text.
SHORT = 200
# The characters of a long word in one line of a column.
_PIECE = re.compile(r"(?:\S{0,32}\s)+\S{0,32}|\S{1,32}|\s+")
_LINE = re.compile(r"[^\t\n]+")


def link(path: str, /, **query: object) -> str:
    """Return the address of a page; parameters that are None are left out."""
    given = {name: value for name, value in query.items() if value not in (None, "", False)}
    return f"{path}?{urlencode(given)}" if given else path


class Address(NamedTuple):
    """A page, and the parameters that name what it shows."""

    path: str
    query: dict[str, str]  # the parameters, without the knowledge base


def address_of(kind: str, text: str) -> Address | None:
    """Return the page of an element, of its kind and its text in a change; None without one."""
    if kind == "actor":
        return Address("/log", {"actor": text})
    if kind == "saying":
        # `(:held (= (battery rb1) 80) :from ...)` is about the lane `(battery rb1)`.
        said = text.partition(" :from ")[0].partition(" ")[2]
        lane = said.removeprefix("(= ").partition(")")[0] + ")"
        return Address("/timeline", {"text": lane, "clock": "valid"})
    words = text.replace("(", " ").replace(")", " ").split()
    if kind == "object" and words[:1] == [":constants"]:
        words.pop(0)
    if kind in ("object", "type", "predicate", "function") and words:
        return Address(f"/{kind}", {"name": words[0]})
    if kind == "action" and len(words) > 1:
        return Address("/action", {"name": words[1]})
    if kind in ("plan", "plan step") and len(words) > 1:
        return Address("/plan", {"id": words[1]})
    if kind == "execution" and len(words) > 1:
        return Address("/act", {"id": words[1]})
    return None if kind in ("archive", "promotion", "erasure") else Address("/fact", {"text": text})


def shown_text(value: object) -> str:
    """Make controls and bidirectional overrides visible; line feeds and tabs stay."""
    return _LINE.sub(lambda match: visible(match[0]), str(value))


def _written(value: object) -> object:
    """Make hidden characters in a template's output visible; `exact` and `lines` do not."""
    return visible(value) if isinstance(value, str) and not hasattr(value, "__html__") else value


def lines(value: object) -> Markup:
    """Return a text that may have several lines, such as PDDL or a reason."""
    return escape(shown_text(value))


def breaking(value: object) -> Markup:
    """Return a text whose words break only after a number of characters."""
    return Markup("<wbr>").join(map(escape, _PIECE.findall(shown_text(value))))


def shorten(value: object, length: int = SHORT) -> str:
    """Return the beginning of a long text."""
    return cut(shown_text(value), length)


def cut(text: str, length: int) -> str:
    """Return the beginning of a text, before it is made visible."""
    return text if len(text) <= length else f"{text[:length]}…"


def one_line(text: str, length: int = SHORT) -> str:
    """Return the beginning of a text of PDDL, which may be laid out in lines."""
    return cut(" ".join(text.split()), length)


def second(value: str | None) -> str:
    """Return a time as people read it: 2026-03-02 14:03:00; fractions only if there are any."""
    if value is None:
        return ""
    moment = value.replace("T", " ").removesuffix("Z")
    return moment.rstrip("0").rstrip(".") if "." in moment else moment


def position(value: str, begin: str, end: str) -> float:
    """Return where a time is between two others, from 0 to 1000."""
    first, moment, last = map(datetime.fromisoformat, (begin, value, end))
    share = (moment - first) / (last - first) if last > first else 0.0
    return round(1000 * min(max(share, 0.0), 1.0), 2)


def shifted(value: str, minutes: int) -> str | None:
    """Return a time some minutes later or earlier; None if it is in the future."""
    try:
        moment = datetime.fromisoformat(value) + timedelta(minutes=minutes)
    except OverflowError:
        return None
    return None if moment > datetime.now(UTC) else moment.isoformat()


def left(value: str) -> int:
    """Return the seconds until a time; negative if it has passed."""
    return round((datetime.fromisoformat(value) - datetime.now(UTC)).total_seconds())


def as_json(value: object) -> str:
    """Return a value as JSON text."""
    return json.dumps(value, ensure_ascii=False, default=str)


@cache
def static_address(name: str) -> str:
    """Return the address of a static file, which changes with the file."""
    digest = sha256((STATIC / name).read_bytes()).hexdigest()[:12]
    return f"/static/{name}?v={digest}"


@cache
def environment() -> Environment:
    """Return the templates' environment."""
    made = Environment(
        loader=PackageLoader("kant_sql.web"),
        autoescape=select_autoescape(default=True),
        finalize=_written,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals.update(
        link=link,
        address_of=address_of,
        static=static_address,
        version=__version__,
        timeline_kinds=TIMELINE_KINDS,
        outcomes=OUTCOMES,
    )
    made.filters.update(
        exact=escape,
        lines=lines,
        name=lambda value: visible(str(value)),
        breaking=breaking,
        short=shorten,
        cut=cut,
        line=one_line,
        second=second,
        as_json=as_json,
        position=position,
        shifted=shifted,
        left=left,
        outcome=lambda text: read_outcome(text).outcome,
    )
    return made


def render_text(template: str, data: Mapping[str, Any]) -> str:
    """Return a template with its data."""
    return environment().get_template(template).render(data)


def render(
    request: Request,
    template: str,
    data: Mapping[str, Any] | None,
    kb: str | None,
    *,
    status: int = 200,
    error: str | None = None,
    head: int | None = None,
    has_rows: bool = False,
    drawn: object = None,
) -> HTMLResponse:
    """Return a page; without data, with the error. After `head`, it follows changes."""
    path, query = request.url.path, request.url.query
    asked = f"?{query}" if query else ""
    context = {
        "page": data,
        "drawn": drawn,
        "error": error,
        "kb": kb,
        "head": head,
        "added": request.app.state.added,
        "path": path,
        "api": f"/api{path}{asked}",
        "csv": f"/csv{path}{asked}" if has_rows else None,
        "query": dict(request.query_params),
    }
    return HTMLResponse(render_text(template, context), status_code=status)


# Texts that a spreadsheet reads as formulas; a sign or a number is none.
_FORMULA = re.compile(r"(?![+-]?[0-9.]*$)[=+\-@\t\r]")

Row = dict[str, object]


def csv_text(data: Any, places: Sequence[str]) -> str:
    """Return the rows at the first non-empty path, such as `parts.elements`, as CSV."""
    # A column is the path of a value in its row; lists are in one cell, as JSON where they have
    # documents. A text that would be a formula begins with an apostrophe.
    rows = next(filter(None, (list(_rows(data, place.split("."))) for place in places)), [])
    columns = dict.fromkeys(name for row in rows for name in row)
    made = StringIO()
    writer = csv.writer(made)
    writer.writerow([_cell(name) for name in columns])
    writer.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return made.getvalue()


def _rows(data: Any, path: Sequence[str]) -> Iterator[Row]:
    """Yield the rows at a path; a row within another one has its texts."""
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
        if name == "cells" and isinstance(value, dict):
            yield from value.items()
        elif isinstance(value, dict) and name != "source":
            yield from _flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def _cell(value: object) -> object:
    if isinstance(value, list) and all(isinstance(one, str | int) for one in value):
        value = "; ".join(map(str, value))
    elif isinstance(value, list | dict):
        value = json.dumps(value, ensure_ascii=False)
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value


# A file's URL; a path in what the driver or the system said, where names of PDDL may have slashes.
_FILE = re.compile(r"sqlite(?:\+\w+)?:///(?!:memory:)([^?]+)")
_URL = re.compile(r"(sqlite:///)[^:;,?'\"()\n]*/")
_PATH = re.compile(r"(?<![\w:/.…])/(?:[^\s/:;,'\"()]+/)+")


class Folders:
    """Writes `…/` for the folders of a server: readers see the file, never its folder."""

    def __init__(self, url: str) -> None:
        file = _FILE.match(url)
        folder = Path("/") if file is None else Path(file[1]).resolve().parent
        self._own = None if folder == Path("/") else f"{folder}/"

    def hide(self, text: str) -> str:
        """Return a text without folders of URLs, and without the one of the store."""
        if self._own is not None:
            text = text.replace(self._own, "…/")
        return _URL.sub(r"\1…/", text) if "sqlite:///" in text else text

    def hide_in(self, data: JsonValue) -> JsonValue:
        """Return a document without folders, at any depth."""
        if isinstance(data, str):
            return self.hide(data)
        if isinstance(data, dict):
            return {name: self.hide_in(value) for name, value in data.items()}
        if isinstance(data, list):
            return [self.hide_in(value) for value in data]
        return data

    def said(self, error: KantSqlError) -> str:
        """Return the message of an error without folders."""
        text = self.hide(str(error))
        return _PATH.sub("…/", text) if isinstance(error, StoreError) else text
