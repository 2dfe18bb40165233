"""In a browser, nothing of a hostile store runs, or is an element."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from urllib.parse import parse_qsl, urlsplit

import pytest
from fastapi.testclient import TestClient

from kant_sql.web.application import create_app
from tests.browser.conftest import Visit
from tests.support.browsing import NARROW, WIDE, Serving
from tests.support.crawling import walk
from tests.support.worlds.hostile import record_hostile

ATTACKED = """() => [
    typeof window.hacked,
    document.querySelectorAll('hostile-element, [hostile], [onmouseover], [onerror], base').length,
    document.querySelectorAll('iframe, main script, main style:not([id])').length,
    document.querySelectorAll('svg a:not([href^="/"])').length,
    [...document.scripts].filter(each => !each.src.startsWith(location.origin)).length,
]"""


@pytest.fixture(scope="session")
def hostile_url(tmp_path_factory: pytest.TempPathFactory) -> str:
    return record_hostile(f"sqlite:///{tmp_path_factory.mktemp('hostile') / 'store.db'}")


@pytest.fixture(scope="session")
def hostile(hostile_url: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server of a hostile store."""
    running = Serving(hostile_url, tmp_path_factory.mktemp("hostile"))
    yield running
    running.stop()


def addresses(url: str) -> list[str]:
    """List two addresses of each page and set of parameters, one with the longest name."""
    found = defaultdict[tuple[str, ...], list[str]](list)
    with TestClient(create_app(url), base_url="http://127.0.0.1") as client:
        for page in walk(client):
            if page.markup:
                parts = urlsplit(page.address)
                names = sorted({name for name, _ in parse_qsl(parts.query)})
                found[parts.path, *names].append(page.address)
    return [
        address
        for each in found.values()
        for address in dict.fromkeys((each[0], max(each, key=len)))
    ]


def test_nothing_of_a_hostile_store_runs(hostile: Serving, hostile_url: str, visit: Visit) -> None:
    narrow, wide = visit(hostile.address, width=NARROW), visit(hostile.address, width=WIDE)
    before = hostile.log()
    for address in addresses(hostile_url):
        for visitor in (narrow, wide):
            visitor.open(address)
            assert visitor.page.evaluate(ATTACKED) == ["undefined", 0, 0, 0, 0], address[:300]
            assert visitor.overflow() == [], address[:300]
            assert visitor.faults == [], address[:300]
    assert hostile.log() == before
