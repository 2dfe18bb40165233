"""Verifications that readers start, and anchors."""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from kant_sql.errors import AnchorError
from kant_sql.knowledge_base import Operations
from kant_sql.operations import parse_anchor
from kant_sql.web import verifying
from kant_sql.web.application import create_app
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.stores import Connect, new_file_store
from tests.support.worlds.robots import WP2, robot_at
from tests.web.conftest import BASE


def result_of(client: TestClient, kb: str = "courier") -> dict[str, Any]:
    """Wait for the end of a verification, and give its outcome."""
    wait_for(lambda: client.get(f"/api/verify?kb={kb}").json()["running"] is None)
    last: dict[str, Any] = client.get(f"/api/verify?kb={kb}").json()["last"]
    return last


def test_a_reader_starts_a_verification_and_sees_its_result(client: TestClient) -> None:
    assert "Nothing was verified" in client.get("/verify?kb=courier").text
    home = client.get("/").text
    assert "not yet" in home
    answer = client.post("/verify?kb=courier", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/verify?kb=courier")
    last = result_of(client)
    assert last["error"] is None
    assert (last["result"]["is_intact"], last["result"]["revisions"]) == (True, 36)
    page = client.get("/verify?kb=courier").text
    assert "Intact." in page
    assert "36 revisions" in page
    assert "intact</span> at 36" in client.get("/").text
    states = client.get("/api/").json()["knowledge_bases"]
    assert [one["verification"]["last"] is None for one in states] == [True, False]


def test_programs_start_one_too(client: TestClient) -> None:
    answer = client.post("/api/verify?kb=courier")
    assert answer.status_code == 200
    assert answer.json()["knowledge_base"] == "courier"
    assert result_of(client)["result"]["is_intact"]


@pytest.mark.parametrize("path", ["/verify", "/api/verify"])
def test_a_page_of_another_site_starts_none(client: TestClient, path: str) -> None:
    answer = client.post(f"{path}?kb=courier", headers={"origin": "http://evil.example"})
    assert answer.status_code == 403
    state = client.get("/api/verify?kb=courier").json()
    assert (state["running"], state["last"]) == (None, None)


def test_an_anchor_is_a_file_to_keep_and_to_check(client: TestClient) -> None:
    answer = client.get("/api/anchor")
    assert answer.headers["content-disposition"].startswith('attachment; filename="anchor-20')
    anchor = parse_anchor(answer.content)
    head = anchor.head("courier")
    assert head is not None
    assert head.revision == 36
    assert parse_anchor(client.get("/api/anchor?kb=courier").content).heads == anchor.heads
    for moment in ("9999-99-99", "9999-12-31T24:00:00.000000Z", "2026-01-31"):
        wrong = answer.text.replace(anchor.heads[0].committed_at, moment)
        with pytest.raises(AnchorError, match=r"lacks .*committed_at, or one of them is damaged"):
            parse_anchor(wrong)
    assert client.post("/verify?kb=courier", data={"anchor": answer.text}).status_code == 200
    last = result_of(client)
    assert last["result"]["anchored"] == 36
    assert last["anchor_made_at"] == anchor.made_at
    assert "Compared with the anchor" in client.get("/verify?kb=courier").text
    document = json.loads(answer.text)
    document["heads"][1]["hash"] = "0" * 64
    assert client.post("/api/verify?kb=courier", json=document).status_code == 200
    last = result_of(client)
    assert not last["result"]["is_intact"]
    assert "Not intact: 1 finding." in client.get("/verify?kb=courier").text


@pytest.mark.parametrize("text", ["no anchor", "{}", '{"format": 99, "heads": []}', "[" * 100_000])
def test_what_is_no_anchor_is_refused(client: TestClient, text: str) -> None:
    for path, given in (
        ("/verify", {"data": {"anchor": text}}),
        ("/api/verify", {"content": text}),
    ):
        answer = client.post(f"{path}?kb=courier", **given)
        assert answer.status_code == 400
        assert "Traceback" not in answer.text
    assert client.get("/api/verify?kb=courier").json()["running"] is None


def test_too_long_a_body_is_refused(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kant_sql.web.pages.verify.LONGEST_ANCHOR", 1_000)
    assert client.post("/api/verify?kb=courier", content="x" * 1_001).status_code == 413


def test_a_knowledge_base_that_does_not_exist_is_not_verified(client: TestClient) -> None:
    for path in ("/verify", "/api/verify", "/api/anchor"):
        assert client.get(f"{path}?kb=nobody").status_code == 404
    assert client.post("/verify?kb=nobody").status_code == 404
    assert client.post("/verify").status_code == 404


@pytest.fixture
def held_back(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Let verifications wait at their first report of progress."""
    go_on = threading.Event()
    verify = Operations.verify

    def slow(self: Operations, *given: Any, progress: Any, **more: Any) -> Any:
        def tell(done: int, total: int) -> None:
            progress(done, total)
            assert go_on.wait(PATIENCE)
            progress(done, total)

        return verify(self, *given, progress=tell, **more)

    monkeypatch.setattr(Operations, "verify", slow)
    yield go_on
    go_on.set()


def test_one_runs_at_a_time_and_shows_its_progress(
    client: TestClient, held_back: threading.Event
) -> None:
    client.post("/api/verify?kb=courier")
    wait_for(lambda: client.get("/api/verify?kb=courier").json()["running"]["total"])
    first = client.get("/api/verify?kb=courier").json()["running"]
    client.post("/api/verify?kb=courier")
    assert client.get("/api/verify?kb=courier").json()["running"] == first
    page = client.get("/verify?kb=courier").text
    assert "<progress" in page
    assert "data-progress" in page
    assert "running" in client.get("/").text
    refused = client.post("/api/verify?kb=courier", content=client.get("/api/anchor").content)
    assert refused.status_code == 503
    assert "without this anchor" in refused.json()["error"]
    held_back.set()
    assert result_of(client)["result"]["is_intact"]


@pytest.mark.more
def test_one_that_is_cancelled_says_so(client: TestClient, held_back: threading.Event) -> None:
    client.post("/verify?kb=courier")
    wait_for(lambda: client.get("/api/verify?kb=courier").json()["running"]["total"])
    client.post("/verify?kb=courier&cancel=true")
    held_back.set()
    last = result_of(client)
    assert last["result"] is None
    assert "cancelled" in last["error"]
    assert "cancelled" in client.get("/verify?kb=courier").text


def test_findings_are_shown(tmp_path: Path, connect: Connect) -> None:
    url = new_file_store(tmp_path / "store.db")
    kb = connect(url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(place=WP2))
    with closing(sqlite3.connect(tmp_path / "store.db")) as connection:
        connection.execute("UPDATE revision SET actor = '<b>nobody</b>' WHERE number = 2")
        connection.commit()
    with TestClient(create_app(url), base_url=BASE) as client:
        client.post("/verify?kb=tiago")
        last = result_of(client, "tiago")
        assert not last["result"]["is_intact"]
        page = client.get("/verify?kb=tiago").text
        assert 'href="/revision?kb=tiago&amp;number=2"' in page
        assert "<b>" not in page
        assert "not intact" in client.get("/").text


def test_failed_verifications_say_why(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Operations, *given: object, **more: object) -> None:
        raise RuntimeError("secret")

    monkeypatch.setattr(Operations, "verify", fail)
    client.post("/verify?kb=courier")
    last = result_of(client)
    assert "log says more" in last["error"]
    assert "secret" not in client.get("/verify?kb=courier").text


def test_so_many_verifications_wait_at_most(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verifying, "MOST_STARTED", 0)
    assert client.post("/api/verify?kb=courier").status_code == 503


@pytest.mark.more
def test_a_form_with_many_fields_is_refused_before_it_is_read(client: TestClient) -> None:
    assert client.post("/verify?kb=courier", content="a=b&" * 100_000).status_code == 400
