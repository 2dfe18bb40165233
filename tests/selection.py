"""Which tests `make test` runs, and which only `make test-all`; CONTRIBUTING.md states the rule."""

from __future__ import annotations

import re
import zlib
from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent
# Who judge, measure, kill or drive browsers for long: only a test marked `smoke` is in `make test`.
MORE_FOLDERS = {*("benchmarks", "browser", "corpus", "meaning", "operation", "plugins", "pooler")}
MAIN = re.compile(r"(sqlite(-file|-memory)?|postgresql)( .*)?")
OTHER = re.compile(r"aio-.*|http-.*|citus|extra-\d+")
# What takes longer than so many seconds, as `make slow` found: a ninth of the tests takes half of
# the time.
SLOW = ROOT / "slow.txt"
LONG = 0.3


def in_make_test(items: Sequence[pytest.Item], with_slow: bool = False) -> set[pytest.Item]:
    """Choose the tests of `make test`: one backend for each, none of `more`, and no slow ones."""
    slow = frozenset(() if with_slow else SLOW.read_text(encoding="utf-8").splitlines())
    alike: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if not _is_more(item, slow):
            alike[without_backend(item)].append(item)
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


class SlowTests:
    """Notes what takes long."""

    def __init__(self) -> None:
        self._seconds = defaultdict[str, float](float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add what a test took itself."""
        if report.when != "setup":
            self._seconds[str(dict(report.user_properties)["name"])] += report.duration

    def pytest_sessionfinish(self) -> None:
        slow = sorted(name for name, seconds in self._seconds.items() if seconds > LONG)
        SLOW.write_text("".join(f"{name}\n" for name in slow), encoding="utf-8")


def _is_more(item: pytest.Item, slow: Collection[str]) -> bool:
    if any(OTHER.fullmatch(value) for value in backends_of(item)):
        return True
    marks = [mark.name for mark in item.iter_markers() if mark.name in ("more", "smoke")]
    if marks:
        return marks[0] == "more"
    is_in_folder = item.path.relative_to(ROOT).parts[0] in MORE_FOLDERS
    return is_in_folder or without_backend(item) in slow


def without_backend(item: pytest.Item) -> str:
    """Give the same name for the same test on each backend."""
    test, _, parameters = item.nodeid.partition("[")
    # "sqlite" is in "sqlite-file".
    for backend in sorted(filter(MAIN.fullmatch, backends_of(item)), key=len, reverse=True):
        parameters = parameters.replace(backend, "")
    return f"{test}[{parameters}".removesuffix("[")


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
