"""Which tests `make test` runs, and which only `make test-all`; CONTRIBUTING.md states the rule."""

from __future__ import annotations

import re
import zlib
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent
# Who judge, measure, kill or drive browsers for long: only a test marked `smoke` is in `make test`.
MORE_FOLDERS = {
    *("benchmarks", "browser", "corpus", "meaning", "operation", "plugins", "pooler"),
}
MAIN = re.compile(r"(sqlite(-file|-memory)?|postgresql)( .*)?")
OTHER = re.compile(r"aio-.*|http-.*|citus|extra-\d+")


def in_make_test(items: Sequence[pytest.Item]) -> set[pytest.Item]:
    """Choose the tests of `make test`: one backend for each, and none of `more`."""
    alike: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if not _is_more(item):
            alike[_without_backend(item)].append(item)
    return {
        item
        for name, group in alike.items()
        for item in (
            group if group[0].get_closest_marker("every_backend") else [_chosen(name, group)]
        )
    }


def _chosen(name: str, group: Sequence[pytest.Item]) -> pytest.Item:
    """Choose a backend by a hash: PostgreSQL, which takes longest, for a quarter of the tests."""
    turn = zlib.crc32(name.encode()) % 4
    fast = [item for item in group if not is_on_server(item)] or group
    slow = [item for item in group if is_on_server(item)] or group
    return slow[0] if turn == 0 else fast[turn % len(fast)]


def has_none(path: Path) -> bool:
    """Whether `make test` runs nothing of a file of tests, which it need not import."""
    is_more = path.relative_to(ROOT).parts[0] in MORE_FOLDERS and path.name.startswith("test_")
    return is_more and "mark.smoke" not in path.read_text()


def _is_more(item: pytest.Item) -> bool:
    if any(OTHER.fullmatch(value) for value in backends_of(item)):
        return True
    marks = [mark.name for mark in item.iter_markers() if mark.name in ("more", "smoke")]
    if marks:
        return marks[0] == "more"
    return item.path.relative_to(ROOT).parts[0] in MORE_FOLDERS


def _without_backend(item: pytest.Item) -> str:
    """Give the same name for the same test on each backend."""
    test, _, parameters = item.nodeid.partition("[")
    # "sqlite" is in "sqlite-file".
    for backend in sorted(filter(MAIN.fullmatch, backends_of(item)), key=len, reverse=True):
        parameters = parameters.replace(backend, "")
    return f"{test}[{parameters}"


def backends_of(item: pytest.Item) -> set[str]:
    """Give the parameters of a test that may name backends."""
    call: Any = getattr(item, "callspec", None)
    parameters = {} if call is None else call.params
    return {value for value in parameters.values() if isinstance(value, str)}


def is_on_server(item: pytest.Item) -> bool:
    """Whether a test uses a PostgreSQL server."""
    return not {"server", "mortal_server"}.isdisjoint(item.fixturenames) or any(  # type: ignore[attr-defined]
        backend.removeprefix("aio-").startswith("postgresql") for backend in backends_of(item)
    )
