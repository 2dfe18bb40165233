"""Who may ask, under which name, and what a browser may do with the answer."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import urlencode

import pytest
from fastapi.testclient import TestClient

from kant_sql.dao_calls import is_loopback
from kant_sql.errors import InvalidArgumentError, StoreUnreachableError, UnknownNameError
from kant_sql.html import visible
from kant_sql.web.application import create_app, token_for
from kant_sql.web.rendering import Folders
from kant_sql.web.security import TOKEN_COOKIE
from tests.support.crawling import Markup
from tests.support.statements import fill
from tests.support.stores import Connect, new_file_store
from tests.web.conftest import BASE, archive_some

TOKEN = "a secret of the tests, long"


@pytest.fixture
def guarded(sqlite_story: str) -> Iterator[TestClient]:
    """A client of an application that other machines reach, and that has a token."""
    app = create_app(sqlite_story, bound="0.0.0.0", hosts=["robots.example"], token=TOKEN)
    with TestClient(app, base_url=BASE, follow_redirects=False) as made:
        yield made


@pytest.mark.parametrize(
    "path", ["/", "/api/", "/static/style.css", "/nothing", "/revision?number=x"]
)
def test_every_answer_has_a_policy_without_inline_scripts(client: TestClient, path: str) -> None:
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert "server" not in headers


@pytest.mark.parametrize(
    ("status", "host"),
    [
        *((400, host) for host in ("evil.example", "evil.example:80", "", "10.0.0.1", "0.0.0.0")),
        (400, "127.0.0.1.evil.example"),
        *((400, host) for host in ("127.0.0.1:x?/", "127.0.0.1:80#", "localhost:-1", "[::1")),
        *((200, host) for host in ("127.0.0.2:8765", "localhost:8765", "127.0.0.1", "LOCALHOST")),
        (200, "[::1]:8765"),
    ],
)
def test_only_names_of_this_machine_are_known(client: TestClient, host: str, status: int) -> None:
    answer = client.get("/", headers={"host": host})
    assert (answer.status_code, "courier" in answer.text) == (status, status == 200)


def test_a_server_for_others_knows_addresses_and_its_names(guarded: TestClient) -> None:
    bearer = {"authorization": f"Bearer {TOKEN}"}
    for host, status in {"10.1.2.3:80": 200, "Robots.example": 200, "evil.example": 400}.items():
        assert guarded.get("/", headers={**bearer, "host": host}).status_code == status


@pytest.mark.parametrize(
    "given", ["", "Bearer", "Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x"]
)
def test_without_the_token_nothing_is_read_and_each_refusal_is_logged(
    guarded: TestClient, given: str, caplog: pytest.LogCaptureFixture
) -> None:
    why = "the token is not" if given.startswith("Bearer ") else "give the token of this server"
    for path in ("/", "/api/", "/revision?kb=courier&number=1", "/api/openapi.json", "/nothing"):
        caplog.clear()
        answer = guarded.get(path, headers={"authorization": given})
        assert answer.status_code == 401
        assert "courier</" not in answer.text
        (said,) = [one.getMessage() for one in caplog.records if one.name == "kant_sql.web"]
        refused = f"refused GET {path.partition('?')[0]} to nobody at testclient: 401, {why}"
        assert said.startswith(refused)
        assert TOKEN not in said
        if path.startswith("/api/"):
            assert (answer.json()["type"], answer.headers["www-authenticate"]) == (
                "RefusedError",
                "Bearer",
            )


def test_a_wrong_token_of_the_page_is_logged_and_not_written(
    guarded: TestClient, caplog: pytest.LogCaptureFixture
) -> None:
    guarded.cookies.set(TOKEN_COOKIE, f"{TOKEN}x")
    assert guarded.get("/").status_code == 401
    assert guarded.post("/token", data={"token": f"{TOKEN}x", "next": "/"}).status_code == 401
    said = [one.getMessage() for one in caplog.records if one.name == "kant_sql.web"]
    assert [one.split(" to ")[0] for one in said] == ["refused GET /", "refused POST /token"]
    assert not any(TOKEN in one for one in said)


def test_foreign_names_and_sites_are_logged(
    client: TestClient, caplog: pytest.LogCaptureFixture
) -> None:
    answers = [
        client.get("/", headers={"host": "evil.example"}),
        client.post("/token", headers={"origin": "http://evil.example"}),
    ]
    name = "this server is not known as 'evil.example'; start it with --allow-host NAME"
    site = "the request comes from another site"
    assert [(one.status_code, one.json()["error"]) for one in answers] == [(400, name), (403, site)]
    assert [one.getMessage() for one in caplog.records if one.name == "kant_sql.web"] == [
        f"refused GET / to nobody at testclient: 400, {name}",
        f"refused POST /token to nobody at testclient: 403, {site}",
    ]


def test_the_token_is_taken_once_and_leads_back(guarded: TestClient) -> None:
    asked = guarded.get("/revision?kb=courier&number=5")
    target = re.search(r'name="next" value="([^"]+)"', asked.text)
    assert target is not None
    assert target[1] == "/revision?kb=courier&amp;number=5"
    refused = guarded.post("/token", data={"token": "wrong", "next": "/"})
    assert (refused.status_code, TOKEN_COOKIE in refused.cookies) == (401, False)
    taken = guarded.post("/token", data={"token": TOKEN, "next": "/revision?kb=courier&number=5"})
    assert (taken.status_code, taken.headers["location"]) == (303, "/revision?kb=courier&number=5")
    assert "httponly" in taken.headers["set-cookie"].lower()
    guarded.cookies.set(TOKEN_COOKIE, taken.cookies[TOKEN_COOKIE])
    assert guarded.get("/revision?kb=courier&number=5").status_code == 200


@pytest.mark.parametrize(
    "target", ["//evil.example", "/\\evil.example", "https://evil.example", ""]
)
def test_the_token_page_leads_to_no_other_server(guarded: TestClient, target: str) -> None:
    answer = guarded.post("/token", data={"token": TOKEN, "next": target})
    assert answer.headers["location"] == "/"


def test_a_page_of_another_site_can_post_nothing(client: TestClient) -> None:
    for headers in (
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"sec-fetch-site": "cross-site"},
    ):
        assert client.post("/token", headers=headers).status_code == 403
    assert client.post("/token", headers={"origin": "http://["}).status_code == 403
    assert client.post("/").status_code == 405


def test_a_page_of_another_site_may_link_here_and_cannot_ask_unseen(client: TestClient) -> None:
    for site, dest, status in (
        *(("cross-site", "document", 200), ("cross-site", "image", 403)),
        *(("cross-site", "iframe", 403), ("same-site", "empty", 403)),
        *(("same-origin", "empty", 200), ("none", "document", 200)),
    ):
        headers = {"sec-fetch-site": site, "sec-fetch-dest": dest}
        assert client.get("/api/", headers=headers).status_code == status, headers


PAGES = "log", "state", "revision", "timeline"


def test_no_page_shows_where_the_store_is(story_url: str, connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "very secret"
    folder.mkdir()
    path = folder / "store.db"
    url = new_file_store(path)
    kb = connect(url, knowledge_base="courier")
    archive_some(kb, folder)
    courier = "?kb=courier&element=(robot_at rb1 wp1)", "?kb=courier&number=3&at=2"
    addresses = ["/", "/log" + courier[0], *(f"/{page}{courier[1]}" for page in PAGES)]
    app = create_app(url)
    with TestClient(app, base_url=BASE, raise_server_exceptions=False) as client:

        def told() -> str:
            return "".join(
                client.get(f"{api}{at}").text for at in addresses for api in ("", "/api")
            )

        intact = told()
        kb.close()
        path.write_bytes(b"no database " * 1000)
        broken = told()
        path.unlink()
        gone = told()
    assert "old.db" in intact
    assert all("store.db" in text for text in (broken, gone))
    assert "secret" not in intact + broken + gone
    socket = StoreUnreachableError('socket "/var/run/postgresql/.s.PGSQL.5432" failed')
    assert Folders(story_url).said(socket) == 'socket "…/.s.PGSQL.5432" failed'
    assert Folders(story_url).said(UnknownNameError("no '/map/base/r1'")) == "no '/map/base/r1'"


@pytest.mark.parametrize(
    "hidden", ["\u202egpj.exe", "a\u200bb", "\x1b[31m", "\u2066x", "\x85", "a\n2 b"]
)
def test_names_and_actors_show_what_hides_in_them(
    connect: Connect, tmp_path: Path, hidden: str
) -> None:
    path = tmp_path / "store.db"
    url = new_file_store(path)
    kb = connect(url, knowledge_base="courier", actor=hidden)
    fill(kb, 2)
    fill(connect(url, knowledge_base="other"), 2)
    with closing(sqlite3.connect(path)) as file, file:
        # No call gives such a name.
        file.execute("UPDATE knowledge_base SET name = ? WHERE name = 'other'", (hidden,))
    with TestClient(create_app(url), base_url=BASE) as client:
        own = {"kb": "courier"}
        for page, asked in {
            "/": {},
            "/log": own | {"actor": hidden},
            "/state": own,
            "/revision": own | {"number": "1"},
            "/timeline": own,
            "/fact": own | {"text": "(robot_at rb1 wp1)"},
            "/search": own | {"q": hidden},
            "/ask": own | {"condition": f"(robot_at ?{hidden} ?w)"},
        }.items():
            query = urlencode(asked)
            text = client.get(f"{page}?{query}").text
            assert list(Markup(text).faults()) == [], page
            assert visible(hidden) in text or page == "/ask", page
            answer = client.get(f"/api{page}?{query}")
            assert visible(answer.text) == answer.text, page
            if page == "/log":
                assert answer.json()["revisions"][0]["actor"] == hidden


def test_cookies_of_other_servers_of_this_machine_do_no_harm(guarded: TestClient) -> None:
    for foreign in ("a,b=1", "(x)=1", "=", ";;", 'x="', "kant_sql_token", "kant_sql_token=\xff"):
        headers = {b"cookie": foreign.encode("latin-1")}
        assert guarded.get("/", headers=headers).status_code == 401
        cookie = f'{foreign}; {TOKEN_COOKIE}="{TOKEN}"'.encode("latin-1")
        assert guarded.get("/", headers={b"cookie": cookie}).status_code == 200


def test_only_a_file_that_is_there_is_kept_by_browsers(client: TestClient) -> None:
    def kept(path: str, **headers: str) -> str:
        return client.get(path, headers=headers).headers["cache-control"]

    assert "immutable" in kept("/static/style.css")
    assert kept("/static/nothing") == "no-cache"
    assert kept("/static/style.css", host="evil.example") == "no-cache"


def test_the_token_comes_from_the_environment_or_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KANT_SQL_TOKEN", raising=False)
    assert token_for("127.0.0.1") is None
    first, second = token_for("0.0.0.0"), token_for("0.0.0.0")
    assert first is not None
    assert first != second
    monkeypatch.setenv("KANT_SQL_TOKEN", TOKEN)
    assert token_for("0.0.0.0") == token_for("localhost") == TOKEN
    for guessed in ("short", ""):
        monkeypatch.setenv("KANT_SQL_TOKEN", guessed)
        with pytest.raises(InvalidArgumentError, match=r"^KANT_SQL_TOKEN has .*16 or more"):
            token_for("0.0.0.0")
    for unfit in ("ein Geheimnis, größer", "a secret of two\nlines", " a secret in spaces "):
        monkeypatch.setenv("KANT_SQL_TOKEN", unfit)
        with pytest.raises(InvalidArgumentError, match="ASCII"):
            token_for("0.0.0.0")


def test_loopback_addresses() -> None:
    assert all(map(is_loopback, ("localhost", "127.0.0.1", "127.1.2.3", "::1")))
    assert not any(map(is_loopback, ("0.0.0.0", "10.0.0.1", "::", "robot", "")))
