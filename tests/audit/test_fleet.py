"""The questions about a fleet in `docs/stores.md` have the answers that it gives."""

from __future__ import annotations

import re

import pytest

from tests.audit.fleet import write_fleet
from tests.support.pages import Page, ask
from tests.support.stores import CITUS, make_store_url

PAGE = Page("stores.md")
TITLES = re.findall(r"^\d+\. (.+)$", PAGE.text, re.MULTILINE)


@pytest.fixture(scope="session", params=["sqlite-file", "postgresql", *CITUS])
def fleet_url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_fleet(make_store_url(request, request.param, tmp_path_factory.mktemp("fleet")))


@pytest.mark.parametrize("number", range(len(TITLES)), ids=TITLES)
def test_a_question_has_the_answer_given(fleet_url: str, number: int) -> None:
    assert ask(fleet_url, PAGE.of("sql")[number]) == PAGE.of("text")[number].splitlines()


def test_every_question_has_a_statement_and_an_answer() -> None:
    assert len(TITLES) == len(PAGE.of("sql")) == len(PAGE.of("text")) == 6
