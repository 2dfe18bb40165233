"""The SDK's own client asks a real server over HTTP, which its token guards."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import anyio
import pytest
from fastapi.testclient import TestClient

from kant_sql.web.application import create_app
from kant_sql.web.tokens import TokenFile
from tests.plugins.mcp.test_reading import GIVEN, asked, url
from tests.support.serving import PATIENCE, running

pytest.importorskip("mcp", reason="needs the extra mcp")
import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

__all__ = ["url"]

TOKEN = "a-token-that-nobody-guesses"
BASE = "http://127.0.0.1"
ACCEPT = {"Accept": "application/json, text/event-stream"}
LIST = {"jsonrpc": "2.0", "id": 1, "method": "tools/list", "params": {}}


def test_the_tools_answer_over_http_as_the_pages_do(url: str) -> None:
    async def work(client: Client) -> tuple[Any, Any, int]:
        known = await client.call_tool("known", GIVEN["known"])
        domain = await client.read_resource("kant-sql://ward/domain")
        return known, domain, len((await client.list_tools()).tools)

    with running(url) as address:
        known, domain, count = asked(f"{address}/mcp", work)
        page = httpx2.get(f"{address}/api/state", timeout=PATIENCE).json()
    assert known.structured_content == page
    assert "(domain ward)" in domain.contents[0].text
    assert count > 20


def test_only_who_has_the_token_asks(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KANT_SQL_TOKEN", TOKEN)

    async def ask(address: str) -> Any:
        headers = {"Authorization": f"Bearer {TOKEN}"}
        async with (
            httpx2.AsyncClient(headers=headers, timeout=PATIENCE) as http,
            Client(streamable_http_client(address, http_client=http)) as client,
        ):
            return await client.call_tool("overview", {})

    with running(url) as address:
        for headers in ({}, {"Authorization": "Bearer another"}):
            refused = httpx2.post(
                f"{address}/mcp", json=LIST, headers={**ACCEPT, **headers}, timeout=PATIENCE
            )
            assert (refused.status_code, refused.headers["www-authenticate"]) == (401, "Bearer")
        assert not anyio.run(ask, f"{address}/mcp").is_error


def test_a_token_for_some_knowledge_bases_does_not_read_all(url: str, tmp_path: Path) -> None:
    tokens = TokenFile(tmp_path / "tokens.json")
    of_all, of_one, writer = (
        {**ACCEPT, "Authorization": f"Bearer {tokens.add('agent', names, scopes)}"}
        for names, scopes in ((["*"], ["read"]), (["other"], ["read"]), (["*"], ["write"]))
    )
    with TestClient(create_app(url, tokens=tokens), base_url=BASE) as client:
        assert client.post("/mcp", json=LIST, headers=of_all).status_code == 200
        for headers in (of_one, writer):
            assert client.post("/mcp", json=LIST, headers=headers).status_code == 403
        # Without a token, too, a server of which programs write has no tool that writes.
        assert "write_" not in client.post("/mcp", json=LIST, headers=ACCEPT).text


def test_what_is_not_a_request_of_the_protocol_is_refused(url: str) -> None:
    with TestClient(create_app(url), base_url=BASE) as client:
        assert client.get("/mcp", headers=ACCEPT).status_code == 405
        other = {**ACCEPT, "Origin": "https://elsewhere.example"}
        assert client.post("/mcp", json=LIST, headers=other).status_code == 403
        foreign = {**ACCEPT, "Host": "elsewhere.example"}
        assert client.post("/mcp", json=LIST, headers=foreign).status_code == 400
        broken = client.post(
            "/mcp", content=b"{", headers=ACCEPT | {"Content-Type": "application/json"}
        )
        assert broken.status_code == 400
        assert "event: message" in client.post("/mcp", json=LIST, headers=ACCEPT).text


def test_without_the_extra_the_server_names_it(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "kant_sql_plugins.mcp.server", raising=False)
    monkeypatch.setitem(sys.modules, "mcp.server.mcpserver", None)
    with TestClient(create_app(url), base_url=BASE) as client:
        assert client.get("/api/state").status_code == 200
        answer = client.post("/mcp", json=LIST, headers=ACCEPT)
    assert answer.status_code == 501
    assert "pip install 'kant-sql[mcp]'" in answer.json()["error"]
