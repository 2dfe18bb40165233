"""`kant-sql watch`: the revisions, as they come."""

from __future__ import annotations

import math
import select
import sys
import time
from contextlib import suppress
from typing import Annotated

import typer

from ..errors import ConnectionLostError, StoreUnreachableError
from ..history import LogEntry
from ..knowledge_base import KnowledgeBase
from .entries import entry_document, write_entry
from .output import Printer, write_json
from .stores import Name, Url, open_to_read

# So often it is seen whether anybody still reads.
_SLICE = 1.0
_GONE = ConnectionLostError, StoreUnreachableError


def watch(
    url: Url,
    kb: Name = None,
    after: Annotated[
        int | None,
        typer.Option(
            metavar="REV",
            min=0,
            show_default=False,
            help="Begin with the revision after this one; when not given, with what comes now.",
        ),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", min=0, show_default=False, help="How long; else until Ctrl-C."
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each revision.")
    ] = False,
) -> None:
    """Write the revisions as they come: when, who, why and what."""
    deadline = math.inf if timeout is None else time.monotonic() + timeout
    with open_to_read(url, kb) as (_, knowledge_base):
        writer = _Writer(as_json)
        seen = knowledge_base.revision if after is None else after
        while True:
            seen = _write_new(knowledge_base, seen, writer)
            if _wait(knowledge_base, seen, deadline) is None:
                return


def _write_new(kb: KnowledgeBase, seen: int, writer: _Writer) -> int:
    """Write what is new, and tell how far that came; a server that is gone may come back."""
    with suppress(*_GONE):
        for entry in kb.changes(seen):
            writer.write(entry)
            seen = entry.revision.number
    return seen


def _wait(kb: KnowledgeBase, seen: int, deadline: float) -> int | None:
    """Wait for news, as long as there is time and somebody reads."""
    while _is_read():
        left = max(deadline - time.monotonic(), 0.0)
        is_last = left <= _SLICE
        try:
            news = kb.watch(seen, timeout=min(left, _SLICE))
        except _GONE:
            if is_last:
                raise
            continue
        if news is not None or is_last:
            return news
    return None


def _is_read() -> bool:
    """Tell whether there is somebody at the other end of standard output, if it is a pipe."""
    if not hasattr(select, "poll"):
        return True
    poll = select.poll()
    try:
        poll.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):
        return True
    return not any(event & select.POLLERR for _, event in poll.poll(0))


class _Writer:
    """Writes entries so that who reads a pipe has each of them at once."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._printer = Printer()
        self._is_first = True

    def write(self, entry: LogEntry) -> None:
        """Write an entry.

        Args:
            entry: the revision and its changes.
        """
        if self._as_json:
            write_json(entry_document(entry))
        else:
            if not self._is_first:
                self._printer.line()
            write_entry(self._printer, entry)
        self._is_first = False
        sys.stdout.flush()
