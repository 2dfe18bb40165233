"""Walks through the pages: follows every link, and checks that markup comes from templates."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple, Protocol
from urllib.parse import parse_qsl, urlencode, urljoin, urlsplit

from starlette.routing import Route

import kant_sql
from kant_sql.web.pages import TOPICS

WEB = Path(kant_sql.__file__).parent / "web"
# Each page of the application.
PATHS = sorted(
    {"/api"}
    | {
        route.path
        for pages in TOPICS
        for route in pages.html.routes
        if isinstance(route, Route)
        and "GET" in (route.methods or ())
        and not route.path.startswith("/csv")
    }
)
_BOOLEAN = {
    *("async", "autofocus", "checked", "data-live", "data-revision", "defer", "disabled"),
    *("download", "hidden", "multiple", "open", "readonly", "required", "selected"),
}
_EMPTY = {"input", "meta", "link", "br", "hr", "img", "col", "wbr", "source"}
# The characters that the guards of direction and of line ends write as text.
_HIDING = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


class Answer(Protocol):
    """An answer of the server."""

    @property
    def status_code(self) -> int: ...
    @property
    def text(self) -> str: ...
    @property
    def headers(self) -> object: ...


class Client(Protocol):
    """A client that sends requests."""

    def get(self, url: str) -> Answer: ...


class Visited(NamedTuple):
    """A visited page."""

    address: str
    answer: Answer
    markup: Markup | None


class Markup(HTMLParser):
    """The markup of a page.

    Attributes:
        elements: the names of its elements.
        attributes: element, name and value of each attribute.
        links: its links, including forms with their initial values.
        texts: its texts, except those in input boxes.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: set[str] = set()
        self.attributes: list[tuple[str, str, str]] = []
        self.links: list[str] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self._form: tuple[str, list[tuple[str, str]]] | None = None
        self.unbalanced: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.add(tag)
        values = {name: value or "" for name, value in attrs}
        self.attributes += [(tag, name, value) for name, value in values.items()]
        if tag not in _EMPTY:
            self._open.append(tag)
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "form" and values.get("method", "get").lower() == "get":
            self._form = values.get("action", ""), []
        if tag == "input" and self._form and "name" in values:
            is_off = values.get("type") in ("checkbox", "radio") and "checked" not in values
            if not is_off:
                self._form[1].append((values["name"], values.get("value", "")))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in _EMPTY:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag == "form" and self._form:
            self.links.append(f"{self._form[0]}?{urlencode(self._form[1])}")
            self._form = None
        if self._open and self._open[-1] == tag:
            self._open.pop()
        elif tag in self._open:
            # An element whose end tag is optional, such as a paragraph.
            while self._open.pop() != tag:
                pass
        else:
            self.unbalanced.append(tag)

    def handle_data(self, data: str) -> None:
        # The text in an input box is returned as the reader wrote it.
        if self._open[-1:] != ["textarea"]:
            self.texts.append(data)

    def faults(self) -> Iterator[str]:
        """List markup that no template contains, and links out of the application."""
        elements, names = _written()
        yield from (f"element {tag}" for tag in self.elements - elements)
        yield from (f"end of {tag}" for tag in self.unbalanced)
        for tag, name, value in self.attributes:
            if name.startswith("on") or name == "style" or name not in names:
                yield f"attribute {name} of {tag}"
            # A value that a reader may change or send back stays as written.
            if name != "value" and _HIDING.search(value):
                yield f"{name} {value[:100]!r}"
            is_own = value.startswith(("/", "#", "?")) and value[:2] not in ("//", "/\\")
            if name in ("href", "src", "action", "formaction") and value and not is_own:
                yield f"{name} {value[:100]}"
        yield from (f"text {text[:100]!r}" for text in self.texts if _HIDING.search(text))


@cache
def _written() -> tuple[set[str], set[str]]:
    """Return the elements and attributes of all templates, and of the drawings."""
    texts = [path.read_text(encoding="utf-8") for path in (WEB / "templates").iterdir()]
    texts += [path.read_text(encoding="utf-8") for path in (WEB / "pages").glob("*.py")]
    drawings = WEB.parent / "history" / "drawing.py", WEB / "cause_graph.py"
    texts += [path.read_text(encoding="utf-8") for path in drawings]
    text = "\n".join(texts)
    elements = set(re.findall(r"<([a-z][a-z0-9]*)\b", text))
    named = {
        *(name.lower() for name in re.findall(r"[\s{}]([A-Za-z][A-Za-z0-9-]*)=[\"']", text)),
        *re.findall(r"data-[a-z-]+", text),
    }
    return elements, named | _BOOLEAN


def walk(client: Client, starts: Iterable[str] = ("/",), most: int = 400) -> Iterator[Visited]:
    """Visit every page that links lead to.

    Args:
        client: sends the requests.
        starts: the first pages.
        most: the maximum number of pages; each path with the same parameters gets an equal share.
    """
    waiting, known, shares = deque(starts), set(starts), Counter[tuple[str, ...]]()
    visited = 0
    while waiting and visited < most:
        address = waiting.popleft()
        answer = client.get(address)
        visited += 1
        # Check this first: a page that is cut off has no links either.
        is_page = "<html" in answer.text[:200]
        markup = Markup(answer.text) if is_page else None
        yield Visited(address, answer, markup)
        for link in markup.links if markup else ():
            parts = urlsplit(urljoin(address, link))
            if parts.netloc or parts.path.startswith(("/static/", "/csv")):
                continue
            following = parts.path + (f"?{parts.query}" if parts.query else "")
            sort = (parts.path, *sorted({name for name, _ in parse_qsl(parts.query)}))
            if following not in known and shares[sort] < most // 10:
                known.add(following)
                shares[sort] += 1
                waiting.append(following)
