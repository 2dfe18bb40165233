"""Fixtures of the tests of verification."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import kant_sql
from tests.support.servers import Server
from tests.support.worlds.story import NAME, write_story
from tests.verify.bare import Bare, bare_store

BOTH = ["sqlite", "postgresql"]


def write_on(request: pytest.FixtureRequest, folder: Path) -> str:
    """Write the story on a dialect, and give its URL."""
    url = f"sqlite:///{folder / 'story.db'}"
    if request.param == "postgresql":
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
    write_story(url, f"sqlite:///{folder / 'archive.db'}")
    return url


@pytest.fixture(scope="session", params=BOTH)
def bare(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """The story without constraints, on each dialect."""
    with bare_store(write_on(request, tmp_path_factory.mktemp("story"))) as store:
        yield store


def act(kb: kant_sql.KnowledgeBase) -> None:
    """Do something without a plan, with each outcome and all that can be said of it."""
    report = kb.executions.report
    step = kb.plans.get_all()[0].steps[0]
    report(step.action, arguments=step.arguments, outcome="succeeded")
    running = report("pick up", arguments=[step.arguments[0], "left hand"], outcome="running")
    kb.fail(running, code="E4", text="no grip")
    report("say hello", outcome="refused", text="nobody is here")
    begun, ended = "2026-01-31T09:00:00Z", "2026-01-31T09:01:00Z"
    done = report(step.action, arguments=["?"], outcome="running", started_at=begun)
    report(done, outcome="aborted", ended_at=ended)
    report("wait", outcome="running", started_at=begun)
    kb.propositions.save("(idle)")
    kb.propositions.confirm("(idle)")
    with kb.transaction(valid_from=begun, valid_until=ended):
        kb.propositions.save_all(["(linked hub p2)", "(ready c1)"])
        kb.propositions.delete("(idle)")
        kb.function_values.save_all(["(= (fuel t1) 8.25)", "(= (home t1) p2)"])
        kb.function_values.unset("(fuel t2)")
    rule = "(forall (?w - (either place crane)) (sometime (not (open ?w))))"
    kb.rules.save("closes", rule)
    kb.rules.save("closes", "(always (idle))")
    kb.rules.save("closes", rule)


@pytest.fixture(scope="session", params=BOTH)
def full(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """The same with a row in each table: it was a replica, was promoted, and was verified."""
    folder = tmp_path_factory.mktemp("full")
    url = write_on(request, folder)
    replica = f"sqlite:///{folder / 'replica.db'}"
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        act(kb)
        kb.store.push(replica, archive=f"sqlite:///{folder / 'archive.db'}")
    with kant_sql.connect(replica, knowledge_base=NAME) as kb:
        kb.store.promote()
        kb.store.push(url, adopt=True)
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        kb.store.promote()
    with bare_store(url) as store:
        yield store
