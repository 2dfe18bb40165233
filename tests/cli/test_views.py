"""`kant-sql views`: one relation for each predicate."""

from __future__ import annotations

import json

import pytest

import kant_sql
from tests.migrations.stores import run_script, views
from tests.support.pages import opened
from tests.support.processes.commands import child, complaint, one_line, run
from tests.support.worlds.robots import WP2, robot_at

VIEWS = ["fact_robot_at", "goal_robot_at"]


def relations(url: str) -> list[str]:
    """Which of the views are there."""
    return [view for view in VIEWS if view in views(url)]


def test_what_became_of_each_view_is_told(own_store: str) -> None:
    for words, change in (([], "created"), ([], "unchanged"), (["--drop"], "dropped")):
        lines = run("views", own_store, *words).stdout.splitlines()
        assert lines[1] == "views (2)"
        assert lines[2].split() == ["view", "change", "knowledge", "base", "predicate"]
        assert [line.split() for line in lines[3:]] == [
            [view, change, "tiago", "robot_at"] for view in VIEWS
        ]
        assert relations(own_store) == ([] if words else VIEWS)
    assert run("views", "--drop", url=own_store).stdout == "\nviews (0)\n"


def test_json_is_one_document(own_store: str) -> None:
    document = json.loads(run("views", own_store, "--json").stdout)
    fact, goal = document["views"]
    assert [fact["name"], goal["name"]] == VIEWS
    assert fact["columns"][:3] == ["robot", "wp", "since"]
    assert {name: fact[name] for name in fact if name not in ("name", "columns")} == {
        **{"kind": "fact", "change": "created"},
        **{"knowledge_base": "tiago", "predicate": "robot_at"},
    }
    gone = json.loads(run("views", own_store, "--json", "--drop").stdout)["views"]
    assert [view["change"] for view in gone] == ["dropped"] * 2


@pytest.mark.parametrize("option", ["--sql", "--dry-run"])
def test_the_sql_is_written_and_not_run(own_store: str, option: str) -> None:
    result = run("views", own_store, option)
    assert relations(own_store) == []
    with opened(own_store) as store:
        for statement in result.stdout.split(";\n"):
            if statement:
                store.execute(statement, {})
    assert relations(own_store) == VIEWS
    assert run("views", own_store, option).stdout == ""
    document = json.loads(run("views", own_store, option, "--drop", "--json").stdout)
    assert document["views"][0]["statements"] == ["DROP VIEW fact_robot_at"]
    assert relations(own_store) == VIEWS


def test_the_sql_is_a_script(own_store: str) -> None:
    """Whoever runs it with a tool of the database has the views that the command makes."""
    run_script(own_store, run("views", own_store, "--sql").stdout)
    assert relations(own_store) == VIEWS
    lines = run("views", own_store).stdout.splitlines()
    assert {line.split()[1] for line in lines[3:]} == {"unchanged"}


def test_one_knowledge_base_can_be_named(own_store: str) -> None:
    with kant_sql.connect(own_store, knowledge_base="other robot") as kb:
        kb.propositions.save(robot_at(place=WP2))
    lines = run("views", own_store, "--kb", "other robot").stdout.splitlines()
    assert [line.split()[0] for line in lines[3:]] == [
        "fact__other_robot__robot_at",
        "goal__other_robot__robot_at",
    ]
    assert relations(own_store) == []
    assert "'tiago', 'other robot'" in complaint("views", own_store, "--kb", "nobody")


def test_a_store_that_is_only_to_be_read_is_left_alone(own_store: str) -> None:
    if own_store.startswith("postgresql"):
        pytest.skip("a user's rights are a server's")
    result = run("views", f"{own_store}?mode=ro")
    assert "cannot be written" in one_line(result.stderr)
    assert run("views", f"{own_store}?mode=ro", "--sql").stdout.startswith("CREATE VIEW fact_")


def test_a_downgrade_says_that_they_are_gone(own_store: str) -> None:
    run("views", own_store)
    result = child("db", "downgrade", own_store, "0010")
    assert result.returncode == 0
    assert "create them again with: kant-sql views" in result.stderr
    assert relations(own_store) == []
