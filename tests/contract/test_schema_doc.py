"""`docs/schema.md` names every table, column and index, and its answers are what a store says."""

from __future__ import annotations

import re
from itertools import count, pairwise

import pytest
from psycopg.errors import FeatureNotSupported

from kant_sql.sql.tables import Base
from kant_sql.sql.tables.base import VERSION_TABLE
from tests.support.pages import Page, ask, rows_of
from tests.support.stores import CITUS

PAGE = Page("schema.md")
TABLES = Base.metadata.tables

QUESTIONS = [
    (question, answer)
    for (language, question), (next_language, answer) in pairwise(PAGE.blocks)
    if (language, next_language) == ("sql", "text")
]


@pytest.fixture
def filled_url(shared_url: str) -> str:
    """The URL of a store that the page's program has filled."""
    (program,) = PAGE.of("python")
    exec(program.replace('"sqlite:///robot.db"', repr(shared_url)), {})
    return shared_url


def described() -> dict[str, list[str]]:
    """The columns that the section of each table lists, after `kb_id`."""
    found: dict[str, list[str]] = {}
    for section in re.split(r"^### ", PAGE.text, flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        body = re.split(r"^## ", body, flags=re.MULTILINE)[0]
        columns = re.findall(r"^\| `(\w+)` \|", body, re.MULTILINE)
        for table in re.findall(r"`(\w+)`", heading):
            found[table] = columns if table == "knowledge_base" else ["kb_id", *columns]
    return found


def test_every_table_and_column_is_described_in_its_order() -> None:
    assert described() == {name: [*table.columns.keys()] for name, table in TABLES.items()}


def test_every_index_is_named_and_no_other() -> None:
    indexes = {str(index.name) for table in TABLES.values() for index in table.indexes}
    uniques = {"uq_proposition_atom", "uq_function_value_fluent"}
    assert set(re.findall(r"`(ix_\w+|uq_\w+)`", PAGE.text)) == indexes | uniques


def test_the_table_of_the_version_is_named() -> None:
    assert f"`{VERSION_TABLE}`" in PAGE.text


def test_every_block_of_sql_has_an_answer() -> None:
    assert len(QUESTIONS) == len(PAGE.of("sql")) == 6


@pytest.mark.parametrize(("question", "answer"), QUESTIONS, ids=count(1))
def test_a_question_has_the_answer_given(
    request: pytest.FixtureRequest, filled_url: str, question: str, answer: str
) -> None:
    if request.node.callspec.params["shared_url"] in CITUS and "RECURSIVE" in question:
        # As docs/citus.md says.
        with pytest.raises(FeatureNotSupported, match="recursive CTEs are only supported"):
            ask(filled_url, question)
    else:
        assert ask(filled_url, question) == answer.splitlines()


def test_the_tree_of_the_effect_is_as_drawn(filled_url: str) -> None:
    drawn = next(block for block in PAGE.of("text") if block.startswith("0 and"))
    columns = "SELECT position, operator, parent FROM action_node"
    rows = rows_of(filled_url, f"{columns} WHERE section = 'effect' ORDER BY position")
    depths: dict[int, int] = {}
    for position, operator, parent in rows:
        depths[position] = 0 if parent is None else depths[parent] + 1
        line = drawn.splitlines()[position]
        assert line.startswith(f"{position} {'  ' * depths[position]}{operator}")
    assert len(rows) == len(drawn.splitlines())
