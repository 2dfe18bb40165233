"""What the web says instead of the folders of its server: in errors, and where data names files."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import KantSqlError, StoreError
from ..json_values import JsonValue

# A file's URL; a path in what the driver or the system said, where names of PDDL may have slashes.
_FILE = re.compile(r"sqlite(?:\+\w+)?:///(?!:memory:)([^?]+)")
_URL = re.compile(r"(sqlite:///)[^:;,?'\"()\n]*/")
_PATH = re.compile(r"(?<![\w:/.…])/(?:[^\s/:;,'\"()]+/)+")


class Folders:
    """Writes `…/` for the folders of a server: readers are told which file, never where it is."""

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
        """Return a document without folders, however deep they are."""
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
