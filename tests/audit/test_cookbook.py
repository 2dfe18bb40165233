"""The questions of `docs/audit.md` have the answers that it gives, on both databases."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from sqlalchemy import make_url

import kant_sql
from tests.audit.porter import record_porter
from tests.audit.story import Clock, at
from tests.audit.ward import record_ward
from tests.support.pages import Ask, Page, ask
from tests.support.stores import CITUS

PAGE = Page("audit.md")
TITLES = re.findall(r"^\d+\. (.+)$", PAGE.text, re.MULTILINE)
QUESTIONS = [
    (question, answer)
    for (language, question), (next_language, answer) in pairwise(PAGE.blocks)
    if (language, next_language) == ("sql", "text")
]


@pytest.fixture
def asked(
    request: pytest.FixtureRequest, story_url: str, asked: Ask, scratch: Callable[[str], str]
) -> Ask:
    """Ask the question's store; where it is distributed, by the views of one knowledge base."""
    kind, name = request.node.callspec.params["story_url"], "courier"
    if "'ward'" in request.node.callspec.params["question"]:
        story_url = record_ward(scratch(kind))
        name, asked = "ward", partial(ask, story_url)
    if "'porter'" in request.node.callspec.params["question"]:
        story_url = record_porter(scratch(kind))
        name, asked = "porter", partial(ask, story_url)
    if kind not in CITUS:
        return asked
    schema = kant_sql.operations.create_roles(story_url, knowledge_base=name).schema
    path = {"options": f"-csearch_path={schema},public"}
    url = make_url(story_url).update_query_dict(path).render_as_string(hide_password=False)
    return lambda sql: ask(url, sql)


def test_every_question_has_a_statement_and_an_answer() -> None:
    assert len(TITLES) == len(QUESTIONS) == len(PAGE.of("sql")) >= 24


@pytest.mark.parametrize(("question", "answer"), QUESTIONS, ids=TITLES)
def test_a_question_has_the_answer_given(asked: Ask, question: str, answer: str) -> None:
    assert asked(question) == answer.splitlines()


def test_a_statement_that_repeats_another_corrects_nobody(tmp_path: Path) -> None:
    url = record_porter(f"sqlite:///{tmp_path / 'porter.db'}")
    times = (at(time).replace(day=3) for time in ("11:20", "09:21", "09:29"))
    with Clock().ruling() as clock, kant_sql.connect(url, knowledge_base="porter") as kb:
        clock.moment, begin, end = times
        with kb.transaction(actor="second camera", valid_from=begin, valid_until=end):
            kb.propositions.save("(at r1 lab)")
        assert kb.revision == 8
    about = {question: answer for question, answer in QUESTIONS if "corrected_by" in question}
    assert len(about) == 3
    for question, answer in about.items():
        assert ask(url, question) == answer.splitlines()


@pytest.mark.parametrize("question", [question for question, _ in QUESTIONS], ids=TITLES)
def test_a_question_is_one_statement_about_the_stable_views_alone(question: str) -> None:
    assert ";" not in question
    mentioned = set(re.findall(r"\b(?:FROM|JOIN) (\w+)", question))
    assert mentioned
    named = set(re.findall(r"(\w+) AS (?:MATERIALIZED )?\(\s+SELECT", question))
    assert {name for name in mentioned if not name.startswith("audit_")} <= named
