"""Writing over HTTP: who may, what comes of it, and what is refused."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql import InvalidArgumentError
from kant_sql.dao_calls import LONGEST_BODY
from kant_sql.web import writing
from kant_sql.web.application import create_app
from kant_sql.web.tokens import TokenFile
from kant_sql.web.writing import PATH_SCOPES
from tests.support.processes.commands import run
from tests.web.conftest import BASE

DOMAIN = """(define (domain tour) (:requirements :typing :fluents :durative-actions)
  (:types robot wp)
  (:predicates (robot_at ?r - robot ?w - wp))
  (:functions (battery ?r - robot))
  (:action move :parameters (?r - robot ?from ?to - wp)
    :precondition (robot_at ?r ?from)
    :effect (and (not (robot_at ?r ?from)) (robot_at ?r ?to)))
  (:durative-action charge :parameters (?r - robot) :duration (= ?duration 5)
    :condition (at start (< (battery ?r) 50)) :effect (at end (assign (battery ?r) 100))))"""
PROBLEM = """(define (problem p) (:domain tour) (:objects rb1 - robot wp1 wp2 - wp)
  (:init (robot_at rb1 wp1) (= (battery rb1) 20)) (:goal (robot_at rb1 wp2)))"""
OTHER = """(define (domain tour) (:requirements :typing) (:types robot wp)
  (:predicates (robot_at ?r - robot)))"""
PLAIN: dict[str, Any] = {"warnings": [], "is_repeated": False}
Post = Callable[..., Any]


@pytest.fixture
def tokens(tmp_path: Path) -> TokenFile:
    return TokenFile(tmp_path / "tokens.json")


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A store without a knowledge base, on each dialect."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'store.db'}"
    made: str = request.getfixturevalue("server").new_store()
    return made


@pytest.fixture
def client(url: str, tokens: TokenFile) -> Iterator[TestClient]:
    with TestClient(create_app(url, tokens=tokens), base_url=BASE) as made:
        yield made


@pytest.fixture
def post(client: TestClient, tokens: TokenFile) -> Post:
    """Write as the actor `executive`, who may do everything in `tiago`."""
    secret = tokens.add("executive", ["tiago"], ["read", "write", "apply"])

    def send(
        path: str, status: int = 200, headers: dict[str, str] | None = None, **body: Any
    ) -> Any:
        own = {"authorization": f"Bearer {secret}", **(headers or {})}
        answer = client.post(f"/api/{path}", params={"kb": "tiago"}, json=body, headers=own)
        assert answer.status_code == status, answer.text
        return answer.json()

    return send


@pytest.fixture
def loaded(post: Post) -> Post:
    """The same, with a domain and a problem as revision 1."""
    assert post("load", domain=DOMAIN, problem=PROBLEM)["revision"] == 1
    return post


def test_each_write_is_a_revision_of_the_actor_of_the_token(loaded: Post, url: str) -> None:
    said = {"reason": "arrived", "source": {"sensor": "amcl"}}
    moved = loaded("facts", delete=["(robot_at rb1 wp1)"], save=["(robot_at rb1 wp2)"], **said)
    assert moved == {"revision": 2, "results": [1, 1], **PLAIN}
    assert loaded("values", set={"(battery rb1)": "12.5"})["results"] == [True]
    assert loaded("apply", step="(move rb1  wp2 wp1)")["revision"] == 4
    (execution,) = loaded("start", step="(charge rb1)")["results"]
    ended = loaded("end", step="(charge rb1)")
    assert ended == {"revision": 6, "results": [execution], **PLAIN}
    assert loaded("facts", delete=["(robot_at rb1 wp2)"])["revision"] is None
    with kant_sql.connect(url, knowledge_base="tiago", read_only=True) as kb:
        revisions = kb.store.revisions()
        assert {one.actor for one in revisions} == {"executive"}
        assert (revisions[1].reason, revisions[1].source) == ("arrived", {"sensor": "amcl"})
        assert revisions[3].reason == "applied (move rb1 wp2 wp1)"
        assert kb.function_values.get("(battery rb1)") == 100
        (charged,) = kb.executions.get_all(action="charge")
        assert (charged.id, charged.outcome) == (execution, "succeeded")
        assert kb.store.verify().is_intact


def test_a_step_is_aborted_or_fails(loaded: Post, url: str) -> None:
    loaded("start", step="(charge rb1)")
    (aborted,) = loaded("abort", step="(charge  rb1)", undo=True)["results"]
    (failed,) = loaded("start", step="(charge rb1)")["results"]
    answer = loaded("fail", execution=failed, code="E4", text="no charger")
    assert answer == {"revision": 5, "results": [failed], **PLAIN}
    assert loaded("fail", 409, execution=aborted)["type"] == "PlanError"
    assert "9.9" in loaded("fail", 404, execution="9.9")["error"]
    assert loaded("abort", 409, step="(charge rb1)")["type"] == "PlanError"
    with kant_sql.connect(url, knowledge_base="tiago", read_only=True) as kb:
        found = {one.id: (one.outcome, one.code, one.text) for one in kb.executions.get_all()}
        assert found == {aborted: ("aborted", None, None), failed: ("failed", "E4", "no charger")}
        reasons = [one.reason for one in kb.store.revisions()][2:]
        said = ["aborted (charge rb1)", "started (charge rb1)", f"failed {failed}"]
        assert reasons == said


def test_a_transaction_is_whole_or_not_at_all(loaded: Post, url: str) -> None:
    changes = [
        {"kind": "objects", "do": "save", "element": "wp3 - wp"},
        {"kind": "propositions", "do": "save_all", "element": ["(robot_at rb1 wp3)"]},
        {"kind": "function_values", "do": "increase", "element": "(battery rb1)", "by": 0.5},
        {"kind": "goals", "do": "delete_all"},
        {"kind": "metric", "do": "set", "element": "(:metric minimize (battery rb1))"},
    ]
    wrong = [*changes, {"kind": "propositions", "do": "save", "element": "(robot_at rb1 wp9)"}]
    assert "wp9" in loaded("transaction", 400, changes=wrong)["error"]
    assert loaded("transaction", changes=changes)["revision"] == 2
    with kant_sql.connect(url, knowledge_base="tiago", read_only=True) as kb:
        assert kb.revision == 2
        assert kb.function_values.get("(battery rb1)") == Decimal("20.5")
        assert kb.goals.get_all() == []


def test_what_happened_since_is_the_answer_to_a_stale_writer(loaded: Post) -> None:
    loaded("facts", save=["(robot_at rb1 wp2)"], reason="seen")
    stale = loaded("apply", 412, {"if-match": '"1"'}, step="(move rb1 wp1 wp2)")
    assert (stale["type"], stale["revision"]) == ("StaleRevisionError", 2)
    assert [(one["number"], one["reason"]) for one in stale["since"]] == [(2, "seen")]
    assert loaded("apply", 200, {"if-match": '"2"'}, step="(move rb1 wp1 wp2)")["revision"] == 3
    assert loaded("facts", 412, {"if-match": "99"}, save=[])["since"] == []


@pytest.mark.parametrize(
    ("path", "status", "body", "says"),
    [
        ("facts", 400, {"save": ["(nonsense"]}, "expected"),
        ("facts", 422, {"save": [7]}, "save.0: Input should be a valid string"),
        ("facts", 422, {"actor": "somebody"}, "actor"),
        ("values", 400, {"set": {"(battery rb1)": "much"}}, "much"),
        ("values", 422, {"set": {"(battery rb1)": True}}, "a valid integer"),
        ("transaction", 400, {"changes": [{"kind": "actions", "do": "increase"}]}, "increase"),
        ("transaction", 400, {"changes": [{"kind": "objects", "do": "save"}]}, "element"),
        ("transaction", 422, {"changes": [{"kind": "secrets", "do": "save"}]}, "kind"),
        ("apply", 409, {"step": "(move rb1 wp2 wp1)"}, "robot_at"),
        ("apply", 400, {"step": "(fly rb1)"}, "fly"),
        ("end", 409, {"step": "(charge rb1)"}, "running"),
        ("load", 400, {}, "nothing to load"),
        ("load", 400, {"domain": "/etc/passwd"}, "PDDL text"),
        ("load", 409, {"domain": OTHER, "mode": "merge"}, "robot_at"),
    ],
)
def test_what_cannot_be_written_is_refused_by_name(
    loaded: Post, path: str, status: int, body: dict[str, Any], says: str
) -> None:
    assert says in loaded(path, status, **body)["error"]
    assert loaded("facts", save=["(robot_at rb1 wp2)"])["revision"] == 2


@pytest.mark.parametrize(
    ("kind", "body", "says"),
    [
        (
            "application/x-www-form-urlencoded",
            '{"save": []}',
            "only with Content-Type: application/",
        ),
        ("application/json", '{"save": [}', "the body is not JSON: Expecting value"),
    ],
)
def test_what_is_no_json_is_refused_by_name(
    client: TestClient, tokens: TokenFile, kind: str, body: str, says: str
) -> None:
    bearer = f"Bearer {tokens.add('driver', ['tiago'], ['write'])}"
    headers = {"authorization": bearer, "content-type": kind}
    answer = client.post("/api/facts", content=body, headers=headers)
    assert (answer.status_code, says in answer.json()["error"]) == (422, True)


def test_a_name_that_is_no_text_begins_no_knowledge_base(
    client: TestClient, tokens: TokenFile
) -> None:
    headers = {"authorization": f"Bearer {tokens.add('driver', ['*'], ['read', 'write'])}"}
    for name in ("%ff", "caf%E9", "\xff"):
        answer = client.post(f"/api/load?kb={name}", json={"domain": DOMAIN}, headers=headers)
        assert answer.status_code == (200 if name == "\xff" else 400), name
    listed = client.get("/api/", headers=headers).json()["knowledge_bases"]
    assert [one["name"] for one in listed] == ["\xff"]


def test_a_rule_that_refuses_is_a_conflict(loaded: Post, url: str) -> None:
    with kant_sql.connect(url, knowledge_base="tiago", actor="safety") as kb:
        kb.rules.save("away", "(always (not (robot_at rb1 wp2)))", on_violation="refuse")
    refused = loaded("facts", 409, save=["(robot_at rb1 wp2)"])
    assert (refused["type"], "away" in refused["error"]) == ("RuleViolatedError", True)


def test_a_token_is_for_its_knowledge_bases_and_scopes(
    client: TestClient, tokens: TokenFile, loaded: Post, caplog: pytest.LogCaptureFixture
) -> None:
    reader = tokens.add("auditor", ["tiago", "pepper"], ["read"])
    writer = tokens.add("driver", ["pepper"], ["write"])
    asked = [
        (reader, "POST", "/api/facts?kb=tiago", 403),
        (reader, "POST", "/api/verify?kb=tiago", 403),
        (reader, "GET", "/api/log?kb=tiago", 200),
        (reader, "GET", "/api/log?kb=tiago&kb=other", 403),
        (reader, "GET", "/api/log", 403),
        (reader, "GET", "/api/log?kb=tiago&kb=", 403),
        (reader, "GET", "/api/log?kb=&kb=tiago", 200),
        (reader, "GET", "/api/?kb=tiago", 403),
        (reader, "GET", "/api/anchor?kb=tiago", 403),
        (writer, "GET", "/api/log?kb=pepper", 403),
        (writer, "POST", "/api/apply?kb=pepper", 403),
        (writer, "POST", "/api/facts?kb=tiago", 403),
        # A token for one knowledge base means that one, and begins it.
        (writer, "POST", "/api/facts", 200),
        (f"{writer}x", "POST", "/api/facts?kb=pepper", 401),
        (writer.partition(".")[0], "POST", "/api/facts?kb=pepper", 401),
        ("", "POST", "/api/facts?kb=pepper", 401),
        (writer.swapcase(), "POST", "/api/facts?kb=pepper", 401),
    ]
    for secret, method, path, status in asked:
        caplog.clear()
        headers = {"authorization": f"Bearer {secret}"}
        with caplog.at_level(logging.WARNING, "kant_sql.web"):
            answer = client.request(
                method, path, headers=headers, json={} if method == "POST" else None
            )
        assert answer.status_code == status, (path, answer.text)
        said = [one.getMessage() for one in caplog.records if one.name == "kant_sql.web"]
        assert (len(said), any("refused" in one for one in said)) == (
            (0, False) if status == 200 else (1, True)
        )
        assert not any(secret.partition(".")[2] in one for one in said if "." in secret)
    assert client.post("/api/facts?kb=pepper", json={}).headers["www-authenticate"] == "Bearer"


def test_a_token_for_an_empty_name_opens_nothing(client: TestClient, tokens: TokenFile) -> None:
    secret = tokens.add("auditor", ["tiago"], ["read"])
    tokens._path.write_text(tokens._path.read_text().replace('"tiago"', '""'))
    headers = {"authorization": f"Bearer {secret}"}
    for path in ("/api/", "/api/log", "/api/log?kb=tiago"):
        assert client.get(path, headers=headers).status_code == 401


def test_a_token_is_revoked_while_the_server_runs(
    client: TestClient, tokens: TokenFile, caplog: pytest.LogCaptureFixture
) -> None:
    secret = tokens.add("driver", ["*"], ["write"])
    headers = {"authorization": f"Bearer {secret}"}
    assert client.post("/api/facts?kb=tiago", json={}, headers=headers).status_code == 200
    link = tokens._path.with_name("link.json")
    link.symlink_to(tokens._path.name)
    TokenFile(link).revoke(secret.partition(".")[0])
    assert link.is_symlink()
    assert client.post("/api/facts?kb=tiago", json={}, headers=headers).status_code == 401
    # Whoever shows a token is judged by it, where others of this machine read without one.
    reads = "/api/"
    assert client.get(reads, headers=headers).status_code == 401
    id_ = secret.partition(".")[0]
    refused = [one.getMessage() for one in caplog.records if "refused" in one.getMessage()]
    assert len(refused) == 2
    assert all(f" to token {id_} of driver at " in one for one in refused)
    assert client.get(reads, headers={"authorization": "Bearer nobodys"}).status_code == 401
    assert client.get(reads).status_code == 200
    tokens._path.write_text("not a file of tokens")
    assert client.post("/api/facts?kb=tiago", json={}, headers=headers).status_code == 401


def test_a_token_is_revoked_while_its_request_is_being_sent(
    client: TestClient, tokens: TokenFile
) -> None:
    secret = tokens.add("driver", ["*"], ["read", "write"])
    headers = {"authorization": f"Bearer {secret}", "content-type": "application/json"}

    def parts() -> Iterator[bytes]:
        yield b"{"
        tokens.revoke(secret.partition(".")[0])
        yield b"}"

    path = "/api/facts?kb=tiago"
    assert client.post(path, content=b"{}", headers=headers).status_code == 200
    answer = client.post(path, content=parts(), headers=headers)
    assert (answer.status_code, "was revoked" in answer.json()["error"]) == (401, True)


def test_a_long_request_is_refused_unread(client: TestClient, tokens: TokenFile) -> None:
    headers = {"authorization": f"Bearer {tokens.add('driver', ['*'], ['write'])}"}
    path = "/api/facts?kb=tiago"
    sent = 0

    def parts() -> Iterator[bytes]:
        nonlocal sent
        for _ in range(4 * LONGEST_BODY >> 20):
            sent += 1
            yield b" " * (1 << 20)

    assert client.post(path, content=parts(), headers=headers).status_code == 413
    length = {**headers, "content-length": str(LONGEST_BODY + 1)}
    assert client.post(path, content=b"{}", headers=length).status_code == 413


def test_without_tokens_there_is_nothing_to_write_with(url: str) -> None:
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.types.save("robot")
    with TestClient(create_app(url), base_url=BASE) as client:
        assert {client.post(path, json={}).status_code for path in PATH_SCOPES} == {404, 405}
        assert not any(
            "writing" in str(path)
            for path in client.get("/api/openapi.json").json()["paths"].values()
        )


def test_writers_beyond_those_that_wait_are_refused_at_once(
    loaded: Post, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writing, "MOST_WAITING", 0)
    assert "try again" in loaded("facts", 429, save=[])["error"]


def test_the_prompt_makes_and_revokes_tokens(tmp_path: Path) -> None:
    file = str(tmp_path / "tokens.json")
    made = run("tokens", "add", file, "--actor", "robot", "--kb", "*", "--scope", "read")
    secret = made.stdout.strip()
    assert secret not in Path(file).read_text()
    assert Path(file).stat().st_mode & 0o777 == 0o600
    assert TokenFile(file).find(secret) is not None
    id_ = secret.partition(".")[0]
    assert f"{id_}: robot, read, of *" in run("tokens", "list", file).stdout
    assert run("tokens", "revoke", file, id_).exit_code == 0
    (listed,) = json.loads(run("tokens", "list", file, "--json").stdout)["tokens"]
    assert listed["revoked_at"] is not None
    assert "sha256" not in listed
    assert TokenFile(file).find(secret) is None
    for words, says in (
        (["revoke", file, "nobody"], "no token"),
        (["add", file, "--actor", "a", "--kb", "*", "--scope", "all"], "scope"),
        (["add", file, "--actor", "a", "--kb", "", "--scope", "read"], "a knowledge base"),
    ):
        refused = run("tokens", *words)
        assert (refused.exit_code, says in refused.stderr) == (1, True)


def test_whoever_could_read_the_file_of_tokens_can_read_it_after_a_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tokens.json"
    first = TokenFile(path).add("robot", ["*"], ["read"])
    path.chmod(0o640)
    if os.geteuid() == 0:
        # As `sudo kant-sql tokens` changes the file of a service.
        os.chown(path, 4321, 1234)
    before = path.stat()
    TokenFile(path).add("other", ["*"], ["read"])
    TokenFile(path).revoke(first.partition(".")[0])
    now = path.stat()
    assert (now.st_mode, now.st_uid, now.st_gid) == (before.st_mode, before.st_uid, before.st_gid)
    assert now.st_ino != before.st_ino

    def refuse(*given: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "fchmod", refuse)
    with pytest.raises(InvalidArgumentError, match="belongs to another user"):
        TokenFile(path).add("third", ["*"], ["read"])
    assert [one.actor for one in TokenFile(path).tokens()] == ["robot", "other"]
    assert [each.name for each in tmp_path.iterdir()] == ["tokens.json"]
