"""What all pages have in common: errors, links, JSON with a description."""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.testclient import TestClient

from kant_sql.errors import StoreBusyError


def test_the_home_page_lists_the_knowledge_bases(client: TestClient) -> None:
    listed = client.get("/api/").json()["knowledge_bases"]
    assert {one["name"]: one["revision"] for one in listed} == {"other": 2, "courier": 36}
    assert 'href="/log?kb=courier"' in client.get("/").text


def test_a_revision_is_the_same_as_a_page_and_as_json(client: TestClient) -> None:
    data = client.get("/api/revision?kb=courier&number=5").json()["revision"]
    assert (data["actor"], data["reason"]) == ("perception", "guest sat down")
    assert data["changes"] == [{"sign": "+", "kind": "fact", "text": "(waiting t2)"}]
    page = client.get("/revision?kb=courier&number=5").text
    assert data["hash"] in page
    assert "(waiting t2)" in page


def test_errors_are_one_sentence_with_a_status(client: TestClient) -> None:
    for query, status in {
        "kb=nobody&number=1": 404,
        "kb=courier&number=99999": 404,
        "number=1": 404,
        "kb=courier&number=none": 422,
        "kb=courier": 422,
    }.items():
        page, data = client.get(f"/revision?{query}"), client.get(f"/api/revision?{query}")
        assert (page.status_code, data.status_code) == (status, status)
        assert "Traceback" not in page.text
        assert set(data.json()) == {"error", "type"}


def test_the_description_documents_every_answer(client: TestClient) -> None:
    described = client.get("/api/openapi.json").json()
    for path, methods in described["paths"].items():
        for method in methods.values():
            content = method["responses"]["200"]["content"]
            assert all(each["schema"] for each in content.values()), path
            assert content, path
            assert method["description"], path


def test_a_character_that_no_text_of_a_store_has_is_the_readers_error(client: TestClient) -> None:
    required = {"number": "1", "name": "rb1", "text": "rb1", "id": "1", "part": "domain"}
    for path, methods in client.get("/api/openapi.json").json()["paths"].items():
        for one in methods.get("get", {}).get("parameters", ()):
            if path == "/api/live" and one["name"] != "kb":
                # It never ends.
                continue
            given = {"kb": "courier", **required, "condition": "(robot_at ?r ?w)"}
            answer = client.get(path, params={**given, one["name"]: "a\0b"})
            assert answer.status_code < 500, (path, one["name"], answer.text)


def test_the_id_of_an_event_that_is_no_number_to_python_is_no_error(client: TestClient) -> None:
    # Without a place for a reader, the stream does not begin, and the test ends.
    assert isinstance(client.app, FastAPI)
    client.app.state.live.admit = refuse
    answer = client.get("/api/live?kb=courier", headers={"last-event-id": "9" * 5000})
    assert answer.status_code == 503


def refuse(_: str | None) -> None:
    """Have no place for a reader."""
    raise StoreBusyError("full")
