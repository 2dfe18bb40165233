"""The application on a store with a story in it, on each dialect, without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql import KnowledgeBase, NotApplicableError
from kant_sql.web.application import create_app
from tests.support.statements import count, fill

DOMAIN = """
(define (domain ward) (:requirements :typing :durative-actions) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (docking ?r - robot))
  (:action move :parameters (?r - robot ?a ?b - place) :precondition (at ?r ?a)
    :effect (and (not (at ?r ?a)) (at ?r ?b)))
  (:durative-action dock :parameters (?r - robot) :duration (= ?duration 500)
    :effect (and (at start (docking ?r)) (at end (not (docking ?r))))))
"""
BASE = "http://127.0.0.1"
# A knowledge base to fill, and a reader of it.
Filled = tuple[KnowledgeBase, TestClient]


def archive_some(kb: KnowledgeBase, folder: Path) -> None:
    """Give a knowledge base seven revisions or more, and move the first five to old.db."""
    fill(kb, 5)
    for _ in range(3):
        kb.propositions.delete("(robot_at rb1 wp1)")
        kb.propositions.save("(robot_at rb1 wp1)")
    kb.store.archive(6, to=f"sqlite:///{folder / 'old.db'}")


def do_some(kb: KnowledgeBase) -> None:
    """Do one thing of each outcome, the last of which runs."""
    kb.load_domain(DOMAIN)
    kb.objects.save_all(["rb1 - robot", "hall - place", "room - place"])
    kb.propositions.save("(at rb1 hall)")
    kb.apply("(move rb1 hall room)", reason="the nurse called")
    with pytest.raises(NotApplicableError):
        kb.apply("(move rb1 hall room)", record_refusal=True)
    reported = ["rb1", "bay <b>4</b>"]
    dock = kb.executions.report("Dock", arguments=reported, outcome="running")
    kb.executions.report(dock, outcome="failed", code="E7", text="bay 4 is taken")
    kb.start("(dock rb1)")


def statements_of(client: TestClient, path: str) -> int:
    """How many statements a page takes that was shown before."""
    client.get(path)
    return count(lambda: client.get(path))


def get(client: TestClient, path: str, **query: Any) -> Any:
    """The data of a page; the page itself is there, too."""
    query = {"kb": "courier", **query}
    assert client.get(path, params=query).status_code == 200
    return client.get(f"/api{path}", params=query).json()


def walk(client: TestClient, path: str, place: str = "next", **query: Any) -> Iterator[Any]:
    """The data of a page and of those that follow: each begins where `place` of the last says."""
    data = get(client, path, **query)
    yield data
    while data[place] is not None:
        begin = {"after" if place == "next" else place: data[place]}
        data = get(client, path, **query, **begin)
        yield data


@pytest.fixture(params=["sqlite", "postgresql"])
def story_url(request: pytest.FixtureRequest) -> str:
    """The URL of the store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_story")
    return url


@pytest.fixture
def client(story_url: str) -> Iterator[TestClient]:
    with TestClient(create_app(story_url), base_url=BASE) as made:
        yield made


@pytest.fixture(params=["sqlite", "postgresql"])
def filled(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Filled]:
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path / 'store.db'}"
    else:
        url = request.getfixturevalue("server").new_store()
    with (
        kant_sql.connect(url, knowledge_base="courier", actor="filler") as kb,
        TestClient(create_app(url), base_url=BASE) as client,
    ):
        yield kb, client


@pytest.fixture
def busy(filled: Filled) -> Filled:
    """The same, where one thing of each outcome was done, and one runs."""
    do_some(filled[0])
    return filled
