"""The questions about a fleet in `docs/stores.md` have the answers that it gives."""

from __future__ import annotations

import re

import pytest

from tests.audit.fleet import write_fleet
from tests.support.citus import Cluster
from tests.support.pages import Page, ask
from tests.support.servers import Server
from tests.support.stores import CITUS

PAGE = Page("stores.md")
TITLES = re.findall(r"^\d+\. (.+)$", PAGE.text, re.MULTILINE)


@pytest.fixture(scope="session")
def sqlite_fleet(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of the fleet's store on SQLite."""
    return write_fleet(f"sqlite:///{tmp_path_factory.mktemp('fleet') / 'store.db'}")


@pytest.fixture(scope="session")
def postgresql_fleet(server: Server) -> str:
    """The URL of the fleet's store on PostgreSQL."""
    return write_fleet(server.new_store())


@pytest.fixture(scope="session")
def citus_fleet(cluster: Cluster) -> str:
    """The URL of the fleet's store, distributed."""
    return write_fleet(cluster.new_store())


@pytest.mark.parametrize("number", range(len(TITLES)), ids=TITLES)
@pytest.mark.parametrize("dialect", ["sqlite", "postgresql", *CITUS])
def test_a_question_has_the_answer_given(
    request: pytest.FixtureRequest, dialect: str, number: int
) -> None:
    url: str = request.getfixturevalue(f"{dialect}_fleet")
    assert ask(url, PAGE.of("sql")[number]) == PAGE.of("text")[number].splitlines()


def test_every_question_has_a_statement_and_an_answer() -> None:
    assert len(TITLES) == len(PAGE.of("sql")) == len(PAGE.of("text")) == 6
