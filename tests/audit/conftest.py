"""A store with a story in it, on each dialect, recorded once for all tests that only read it."""

from __future__ import annotations

import pytest

import kant_sql
from kant_sql import PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.audit.story import record
from tests.support.pages import Ask, ask
from tests.support.servers import Server


@pytest.fixture(scope="session")
def sqlite_story(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of the store on SQLite."""
    return _recorded(f"sqlite:///{tmp_path_factory.mktemp('audit') / 'store.db'}")


@pytest.fixture(scope="session")
def postgresql_story(server: Server) -> str:
    """The URL of the store on PostgreSQL."""
    url = server.new_store()
    return _recorded(url)


@pytest.fixture(params=["sqlite", "postgresql"])
def story_url(request: pytest.FixtureRequest) -> str:
    """The URL of the store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_story")
    return url


def _recorded(url: str) -> str:
    """Record the story in a store; another robot in it has the same names for other things."""
    with kant_sql.connect(url, knowledge_base="other", actor="nobody") as other:
        robot, place = PddlTypeDto("robot"), PddlTypeDto("place")
        robot_at = PddlPredicateDto("robot_at", [robot, place])
        objects = [PddlObjectDto(robot, "rb1"), PddlObjectDto(place, "t2")]
        for is_goal in (False, True):
            other.propositions.save(PddlPropositionDto(robot_at, objects, is_goal))
    with kant_sql.connect(url, knowledge_base="courier") as kb:
        record(kb)
    return url


@pytest.fixture
def asked(story_url: str) -> Ask:
    """Ask that store in SQL."""
    return lambda sql: ask(story_url, sql)


@pytest.fixture(scope="session")
def sqlite_scratch(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store that tests share, each with knowledge bases of its own, on SQLite."""
    url = f"sqlite:///{tmp_path_factory.mktemp('audit') / 'store.db'}"
    kant_sql.upgrade(url)
    return url


@pytest.fixture(scope="session")
def postgresql_scratch(server: Server) -> str:
    """The URL of such a store on PostgreSQL."""
    return server.new_store()


@pytest.fixture(params=["sqlite", "postgresql"])
def scratch_url(request: pytest.FixtureRequest) -> str:
    """The URL of such a store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_scratch")
    return url
