"""Changes of several rows that go together, behind which the hashed texts are what they were."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kant_sql.knowledge.definitions import formula_name
from tests.verify.bare import Bare

FREE = 5_000
GOAL, FACT = "(at t1 p2)", "(ready c1)"


@pytest.fixture(autouse=True)
def _tampering(bare: Bare) -> Iterator[None]:
    with bare.tampering():
        bare.run("UPDATE head SET next_id = ?", FREE + 1)
        yield


def messages(bare: Bare) -> str:
    return "\n".join(finding.message for finding in bare.findings())


def name(bare: Bare, table: str, text: str) -> None:
    """Add a name that no version is of."""
    bare.run(f"INSERT INTO {table} VALUES (1, {FREE}, ?, ?)", text, text)


def test_two_arguments_are_not_one_with_a_space(bare: Bare) -> None:
    name(bare, "object", "t1 p2")
    mine = f"proposition_id IN (SELECT id FROM proposition WHERE text = '{GOAL}')"
    bare.run(f"DELETE FROM proposition_argument WHERE position = 1 AND {mine}")
    bare.run(f"UPDATE proposition_argument SET object_id = {FREE} WHERE {mine}")
    bare.run(f"UPDATE proposition SET arguments = '{FREE}' WHERE text = '{GOAL}'")
    copies = f"first_object_id = {FREE}, second_object_id = NULL"
    bare.run(f"UPDATE proposition_version SET {copies} WHERE {mine}")
    assert messages(bare) == "no object can be called 't1 p2'"


def test_two_parameters_are_not_one_with_a_space(bare: Bare) -> None:
    mine = "predicate_id = (SELECT id FROM predicate WHERE name = 'at')"
    for table in ("predicate_parameter", "predicate_parameter_type"):
        bare.run(f"DELETE FROM {table} WHERE position = 0 AND {mine}")
        bare.run(f"UPDATE {table} SET position = 0 WHERE {mine}")
    bare.run(f"UPDATE predicate_parameter SET name = ? WHERE {mine}", "t - truck ?p")
    assert "no parameter can be called 't - truck ?p'" in messages(bare)


def test_two_types_are_not_one_that_is_called_either(bare: Bare) -> None:
    name(bare, "type", "(either place crane)")
    mine = "predicate_id = (SELECT id FROM predicate WHERE name = 'open')"
    bare.run(f"DELETE FROM predicate_parameter_type WHERE alternative = 1 AND {mine}")
    bare.run(f"UPDATE predicate_parameter_type SET type_id = {FREE} WHERE {mine}")
    assert f"element {FREE} is referred to but not live" in messages(bare)


def test_a_definition_mentions_nothing_that_there_never_was(bare: Bare) -> None:
    """As a predicate that is called like an operator, and an object like a number."""
    name(bare, "function", "total-time")
    sql = f"UPDATE formula_node SET operator = 'function', function_id = {FREE} WHERE operator = "
    bare.run(f"{sql}'total-time'")
    assert f"element {FREE} is referred to but not live" in messages(bare)


def test_a_number_is_no_object_that_is_called_so(bare: Bare) -> None:
    name(bare, "object", "7.50")
    bare.run(
        f"UPDATE function_value_version SET object_id = {FREE}, value = NULL, number = NULL"
        " WHERE value = '7.50'"
    )
    assert "'(= (fuel t1) 7.50)' since revision 2 has another function_id" in messages(bare)


def test_two_steps_of_a_plan_are_not_one_with_a_long_start(bare: Bare) -> None:
    mine = "plan_id = (SELECT min(id) FROM plan)"
    for table in ("execution_version", "execution_argument", "execution"):
        bare.run(f"DELETE FROM {table} WHERE position = 0 AND {mine}")
        bare.run(f"UPDATE {table} SET position = 0 WHERE {mine}")
    start = "0 (load t1 c1) null) (0.5"
    bare.run(f"UPDATE execution SET start = ? WHERE {mine}", start)
    found = messages(bare)
    assert "'(drive t1 p1 p2)' has a time that is not a number" in found
    assert "differ from its text" not in found


@pytest.mark.parametrize("column", ["name", "section"])
def test_two_items_of_a_document_are_not_one(bare: Bare, column: str) -> None:
    items = bare.run("SELECT name FROM document_item WHERE section = 'type' ORDER BY position")
    bare.run("DELETE FROM document_item WHERE section = 'type' AND position > 0")
    first, *others = [name for (name,) in items]
    joined = {"name": " ".join([first, *others]), "section": " ".join(["type", first])}
    if column == "section":
        bare.run("UPDATE document_item SET name = ? WHERE section = 'type'", " ".join(others))
    sql = f"UPDATE document_item SET {column} = ? WHERE section = 'type'"
    bare.run(sql, joined[column])
    found = messages(bare)
    assert "is not an item of it" in found or "there is no section" in found


def test_a_document_is_not_called_all_that_it_says(bare: Bare) -> None:
    bare.run("DELETE FROM document_item WHERE section = 'action'")
    title = "depot) (:action load drive"
    bare.run("UPDATE document_version SET title = ? WHERE domain IS NULL", title)
    assert f"no domain can be called {title!r}" in messages(bare)


@pytest.mark.parametrize(
    ("text", "section", "message"),
    [
        (GOAL, "goal", "a goal that is a ground atom is a proposition"),
        (FACT, "fact", "there is no section 'fact'"),
    ],
)
def test_a_fact_or_a_goal_is_no_formula_of_the_same_text(
    bare: Bare, text: str, section: str, message: str
) -> None:
    """What a revision changed is the same: so it would be a fact that no state has."""
    key = formula_name(section, text)
    mine = f"(SELECT id FROM proposition WHERE text = '{text}')"
    bare.run(f"INSERT INTO formula VALUES (1, {FREE}, ?, ?)", key, key)
    bare.run(
        "INSERT INTO formula_version (kb_id, formula_id, since, until, section, text) SELECT 1,"
        f" {FREE}, since, until, ?, ? FROM proposition_version WHERE proposition_id = {mine}",
        *(section, text),
    )
    bare.run(
        "INSERT INTO formula_node"
        " (kb_id, formula_id, since, section, position, operator, predicate_id) SELECT 1,"
        f" {FREE}, since, ?, 0, 'predicate', predicate_id FROM proposition_version"
        f" WHERE proposition_id = {mine}",
        section,
    )
    bare.run(
        "INSERT INTO formula_term"
        " (kb_id, formula_id, since, section, position, term, object_id) SELECT 1,"
        f" {FREE}, since, ?, 0, a.position, a.object_id FROM proposition_version AS v"
        " JOIN proposition_argument AS a ON a.proposition_id = v.proposition_id"
        f" WHERE v.proposition_id = {mine}",
        section,
    )
    bare.run(f"DELETE FROM proposition_version WHERE proposition_id = {mine}")
    assert f"'{text}' since revision 2: {message}" in messages(bare)


def test_no_source_is_not_an_empty_one(bare: Bare) -> None:
    bare.run("UPDATE revision SET source = 'null' WHERE number = 20")
    assert "an empty source is not NULL" in messages(bare)


def test_a_value_is_assigned_at_a_time_and_not_compared(bare: Bare) -> None:
    bare.run(
        "UPDATE formula_node SET operator = '=' WHERE section = 'timed' AND operator = 'assign'"
    )
    assert "the effect of a TimedLiteral is a Atom or Not or Assign, not Comparison" in messages(
        bare
    )
