"""Names, reasons and sources are data wherever they appear: a hostile store, page by page."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import make_url

from kant_sql.web.application import create_app
from tests.browser.addresses import FIRST
from tests.support.crawling import PATHS, Markup, walk
from tests.support.profile import PROFILE
from tests.support.servers import Server
from tests.support.worlds.hostile import (
    KNOWLEDGE_BASE,
    NAMES,
    TEXTS,
    overwrite,
    record_hostile,
    text_columns,
)
from tests.web.conftest import BASE

# Tables whose texts stand on pages as they are; what is derived of the others is read from these.
SHOWN = {
    *("knowledge_base", "revision", "plan", "plan_step", "plan_step_version", "proposition"),
    *("object", "object_version", "function_value_version", "action_version", "head"),
}
# Of each sort one.
REVISIONS = [f"/revision?kb=courier&number={number}" for number in (2, 7, 29)]
# Of a damaged store, each so many-th page is opened.
EACH = 1 if PROFILE.is_whole else 2
# A page, whatever is in the store: the longest text has 10,000 characters.
LARGEST = 2_000_000
# Of each sort of attack one.
ASKED = (NAMES[1], NAMES[2], NAMES[7], *TEXTS[-9:-6], *TEXTS[-3:])


@pytest.fixture(scope="session")
def sqlite_hostile(tmp_path_factory: pytest.TempPathFactory) -> str:
    return record_hostile(f"sqlite:///{tmp_path_factory.mktemp('hostile') / 'store.db'}")


@pytest.fixture(scope="session")
def postgresql_hostile(server: Server) -> str:
    return record_hostile(server.new_store())


@pytest.fixture(params=["sqlite", "postgresql"])
def hostile(request: pytest.FixtureRequest) -> Iterator[TestClient]:
    url = request.getfixturevalue(f"{request.param}_hostile")
    with TestClient(create_app(url), base_url=BASE) as client:
        yield client


@pytest.mark.more
def test_every_link_leads_somewhere(client: TestClient) -> None:
    visited = [(page.answer.status_code, page.address) for page in walk(client)]
    assert len(visited) > 50
    assert [each for each in visited if each[0] != 200] == []


@pytest.mark.more
def test_every_page_of_a_hostile_store_is_made_by_its_template(hostile: TestClient) -> None:
    seen: set[str] = set()
    for page in walk(hostile):
        assert page.answer.status_code == 200, (page.address[:300], page.answer.text[:500])
        assert len(page.answer.text) < LARGEST, page.address[:300]
        assert "Traceback" not in page.answer.text
        if page.markup is None:
            assert page.answer.headers["content-type"] == "application/json"  # type: ignore[index]
            continue
        assert list(page.markup.faults()) == [], page.address[:300]
        text = "".join(page.markup.texts)
        assert "819026281" not in text, "a template has evaluated a name"
        seen.update(each for each in NAMES if each in text)
    # They are not left out either.
    assert seen == set(NAMES)


@pytest.mark.more
def test_what_is_asked_for_is_text_in_the_answer(hostile: TestClient) -> None:
    described = hostile.get("/api/openapi.json").json()["paths"]
    for api, methods in described.items():
        path = api.removeprefix("/api")
        if "text/event-stream" in methods["get"]["responses"]["200"]["content"]:
            # It never ends.
            continue
        names = [each["name"] for each in methods["get"].get("parameters", ())]
        for name, text in itertools.product((*names, "unknown"), ASKED):
            for asked in (api, path) if path in PATHS else (api,):
                answer = hostile.get(asked, params={"kb": KNOWLEDGE_BASE, name: text})
                assert answer.status_code in (200, 400, 404, 422), (asked, name, text[:100])
                if asked == path:
                    assert list(Markup(answer.text).faults()) == [], (asked, name, text[:100])


@pytest.fixture(scope="module")
def columns(sqlite_hostile: str) -> list[tuple[str, str]]:
    return text_columns(str(make_url(sqlite_hostile).database))


@pytest.mark.more
def test_a_file_that_somebody_has_written_into_is_data_too(
    sqlite_story: str, columns: list[tuple[str, str]], tmp_path: Path
) -> None:
    written = 0
    tried = [each for each in columns if PROFILE.is_whole or each[0] in SHOWN]
    for table, column in tried:
        path = tmp_path / "store.db"
        shutil.copy(str(make_url(sqlite_story).database), path)
        if not overwrite(str(path), table, column):
            continue
        written += 1
        app = create_app(f"sqlite:///{path}")
        with TestClient(app, base_url=BASE, raise_server_exceptions=False) as client:
            for address in (*FIRST, *REVISIONS)[written % EACH :: EACH]:
                text = client.get(address).text
                assert "Traceback" not in text, (table, column, address)
                assert list(Markup(text).faults()) == [], (table, column, address)
    assert written > len(tried) // 2
