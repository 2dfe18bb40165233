"""`kant-sql show`: the whole state, now and then."""

from __future__ import annotations

import json
import re
import sys
import time
from datetime import UTC, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest

import kant_sql
import kant_sql.cli.state
from kant_sql import PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from kant_sql.knowledge.canonical import time_text
from tests.support.faults import change
from tests.support.processes.commands import child, complaint, document, one_line, run
from tests.support.worlds.robots import WP1, navigation, robot_at

STATE = """\
requirements (3)
:strips
:typing
:durative-actions

types (3)
type   parent
robot  object
wp     object
drone  robot

objects (4)
object  type
rb1     robot
wp1     wp
wp2     wp
d1      drone

predicates (1)
(robot_at ?r0 - robot ?w1 - wp)

facts (1)
(robot_at rb1 wp2)

goals (1)
(robot_at rb1 wp1)

actions (1)
"""
# What the state says of the elements that it has none of.
OTHER_LISTS = (
    *("functions", "derived_predicates", "function_values", "initial_literals"),
    *("timed_initial_literals", "constraints", "domain_constraints", "processes", "events"),
)


def shown(*words: str) -> Any:
    """The state that `show --json` writes."""
    return document("show", *words)


def facts(*words: str) -> list[str]:
    return [fact["pddl"] for fact in shown(*words)["facts"]]


def test_the_whole_state_is_shown_as_plain_text_in_a_pipe(store: str) -> None:
    head, _, state = child("show", store).stdout.partition("\n\n")
    assert head.startswith("knowledge base tiago, revision 3, 20")
    assert state == f"{STATE}{navigation()}\n"


@pytest.mark.more
def test_an_installed_script_does_the_same(store: str) -> None:
    script = Path(sys.executable).parent / "kant-sql"
    assert child("show", store, program=[str(script)]).stdout == child("show", store).stdout


def test_json_says_all_of_the_state(store: str) -> None:
    state = shown(store)
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        (last,) = kb.store.revisions(after=2)
    committed_at = last.committed_at.isoformat(timespec="microseconds").replace("+00:00", "Z")
    literal = {"predicate": "robot_at", "is_negative": False}
    assert state == {
        "knowledge_base": "tiago",
        "requirements": [":strips", ":typing", ":durative-actions"],
        "revision": 3,
        "committed_at": committed_at,
        "types": [
            {"name": "robot", "parent": None},
            {"name": "wp", "parent": None},
            {"name": "drone", "parent": "robot"},
        ],
        "objects": [
            {"name": "rb1", "type": "robot", "is_constant": False},
            {"name": "wp1", "type": "wp", "is_constant": False},
            {"name": "wp2", "type": "wp", "is_constant": False},
            {"name": "d1", "type": "drone", "is_constant": False},
        ],
        "predicates": [
            {
                "name": "robot_at",
                "types": ["robot", "wp"],
                "pddl": "(robot_at ?r0 - robot ?w1 - wp)",
            }
        ],
        "facts": [
            {"predicate": "robot_at", "objects": ["rb1", "wp2"], "pddl": "(robot_at rb1 wp2)"}
        ],
        "goals": [
            {"predicate": "robot_at", "objects": ["rb1", "wp1"], "pddl": "(robot_at rb1 wp1)"}
        ],
        "actions": [
            {
                "name": "navigation",
                "parameters": [
                    {"name": "r", "type": "robot"},
                    {"name": "s", "type": "wp"},
                    {"name": "d", "type": "wp"},
                ],
                "conditions": [{**literal, "objects": ["r", "s"], "time": "at start"}],
                "effects": [
                    {**literal, "objects": ["r", "s"], "time": "at start", "is_negative": True},
                    {**literal, "objects": ["r", "d"], "time": "at end"},
                ],
                "durative": True,
                "duration": 10,
                "pddl": str(navigation()),
            }
        ],
        **{name: [] for name in OTHER_LISTS},
        "metric": None,
    }


def test_before_the_first_revision_there_is_no_time(store: str) -> None:
    before, first = (shown(store, "--at", at) for at in ("0", "1"))
    assert (before["revision"], before["committed_at"], before["facts"]) == (0, None, [])
    assert (first["revision"], [one["pddl"] for one in first["facts"]]) == (
        1,
        ["(robot_at rb1 wp1)"],
    )
    assert "revision 0, before the first\n" in run("show", store, "--at", "0").stdout


def test_a_revision_of_the_past_is_named_by_a_time_in_any_zone(store: str) -> None:
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        first = kb.store.revisions(limit=1)[0].committed_at
    far = timezone(timedelta(hours=-7))
    for moment in (first, first.astimezone(far)):
        assert facts(store, "--at", moment.isoformat()) == ["(robot_at rb1 wp1)"]
    before = first - timedelta(microseconds=1)
    assert facts(store, "--at", before.isoformat()) == []


def test_a_time_without_a_zone_is_in_utc_wherever_the_reader_is(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        first = kb.store.revisions(limit=1)[0].committed_at
    naive = first.astimezone(UTC).replace(tzinfo=None).isoformat()
    for zone in ("JST-9", "PST8"):
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        assert facts(store, "--at", naive) == ["(robot_at rb1 wp1)"]
    monkeypatch.undo()
    time.tzset()


def test_one_state_is_shown_whatever_is_written_meanwhile(
    own_store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = shown(own_store)
    read_time = kant_sql.cli.state._committed_at

    def write_first(state: kant_sql.KnowledgeBase) -> str | None:
        with kant_sql.connect(own_store, knowledge_base="tiago") as other:
            other.propositions.delete_all()
            other.types.delete_all()
            other.types.save(PddlTypeDto("afterthought"))
        return read_time(state)

    monkeypatch.setattr(kant_sql.cli.state, "_committed_at", write_first)
    assert shown(own_store) == expected


def test_columns_are_aligned_by_the_width_that_letters_take(file_url: str) -> None:
    with kant_sql.connect(file_url) as kb:
        kb.types.save_all([PddlTypeDto("机器人"), PddlTypeDto("x")])
    assert "机器人  object\nx       object\n" in run("show", file_url).stdout


def test_long_texts_are_not_cut_in_a_pipe(file_url: str) -> None:
    places = [kant_sql.PddlObjectDto(WP1.type, f"{letter * 250}") for letter in "abcdef"]
    predicate = PddlPredicateDto("p" * 255, [WP1.type] * 6)
    fact = PddlPropositionDto(predicate, places)
    with kant_sql.connect(file_url) as kb:
        kb.propositions.save(fact)
    lines = child("show", file_url, COLUMNS="40").stdout.splitlines()
    assert str(fact) in lines
    assert str(predicate) in lines


def test_without_a_name_the_only_knowledge_base_is_shown_or_the_default_one(own_store: str) -> None:
    assert shown(own_store)["knowledge_base"] == "tiago"
    for name in ("default", "pepper"):
        with kant_sql.connect(own_store, knowledge_base=name) as kb:
            kb.propositions.save(robot_at())
    assert shown(own_store)["knowledge_base"] == "default"
    assert shown(own_store, "--kb", "tiago")["revision"] == 3


def test_a_name_that_does_not_exist_is_answered_with_those_that_do(own_store: str) -> None:
    with kant_sql.connect(own_store, knowledge_base="pepper") as kb:
        kb.propositions.save(robot_at())
    for words in ([], ["--kb", "tiag"], ["--kb", ""]):
        result = run("show", own_store, *words)
        assert one_line(result.stderr).endswith("choose one with --kb: 'tiago', 'pepper'")
        assert result.exit_code == 1
    assert kant_sql.sql.catalog.written_names(own_store) == ["tiago", "pepper"]


def test_a_store_that_was_never_written_to_has_nothing_to_show(new_url: str) -> None:
    kant_sql.upgrade(new_url)
    assert "no knowledge base yet" in complaint("show", new_url)


@pytest.fixture
def watering(file_url: str) -> str:
    """The URL of a store that has something of nearly all that PDDL has."""
    files = Path(__file__).parent / "files"
    with kant_sql.connect(file_url) as kb:
        kb.load_domain(files / "watering.pddl")
        kb.load_problem(files / "balcony.pddl")
    return file_url


def test_what_not_every_domain_has_is_shown_where_it_is(watering: str) -> None:
    _, *tables = run("show", watering).stdout.rstrip().split("\n\n")
    titles = [table.splitlines()[0] for table in tables]
    assert titles == [
        *("requirements (15)", "types (2)", "objects (3)", "predicates (4)", "functions (3)"),
        *("derived predicates (1)", "facts (2)", "function values (4)", "initial literals (1)"),
        *("timed initial literals (2)", "goals (3)", "constraints (2)", "domain constraints (1)"),
        *("metric (1)", "actions (1)", "processes (1)", "events (1)"),
    ]
    shown = {table.split(" (")[0]: table.splitlines()[1:] for table in tables}
    assert shown["functions"][1] == "(next ?p - plant) - plant"
    assert shown["derived predicates"] == ["(:derived (thirsty) (exists (?p - plant) (dry ?p)))"]
    assert shown["function values"][0] == "(= (water basil) 0.50)"
    assert shown["initial literals"] == ["(not (raining))"]
    assert shown["timed initial literals"] == ["(at 5 (raining))", "(at 6.5 (not (raining)))"]
    assert "(preference wet (>= (water rose) 3))" in shown["goals"]
    assert shown["constraints"] == ["(sometime (thirsty))", "(within 10 (not (thirsty)))"]
    assert shown["domain constraints"] == ["(forall (?p - plant) (always (>= (water ?p) 0)))"]
    assert shown["metric"] == ["(:metric minimize (+ (* 2 (is-violated wet)) (total-cost)))"]
    assert shown["processes"][0] == "(:process rain"
    assert shown["events"][0] == "(:event drown"


def test_json_says_what_not_every_domain_has(watering: str) -> None:
    state = shown(watering)
    assert state["requirements"][:2] == [":typing", ":fluents"]
    assert state["objects"][0] == {"name": "can", "type": "thing", "is_constant": True}
    assert state["functions"][1] == {
        "name": "next",
        "types": ["plant"],
        "value_types": ["plant"],
        "pddl": "(next ?p - plant) - plant",
    }
    values = {value["pddl"]: value["value"] for value in state["function_values"]}
    assert values["(= (water basil) 0.50)"] == "0.50"
    assert values["(= (next basil) rose)"] == "rose"
    assert {"predicate": "full", "objects": ["can"], "pddl": "(full can)"} in state["goals"]
    assert {"pddl": "(not (dry basil))"} in state["goals"]
    assert state["metric"] == {
        "optimization": "minimize",
        "expression": "(+ (* 2 (is-violated wet)) (total-cost))",
        "pddl": "(:metric minimize (+ (* 2 (is-violated wet)) (total-cost)))",
    }
    assert [action["name"] for action in state["processes"] + state["events"]] == ["rain", "drown"]
    assert state["actions"][0]["duration"] == ["(>= ?duration 1)", "(<= ?duration 2.50)"]
    for name in ("derived_predicates", "timed_initial_literals", "constraints"):
        assert all(list(each) == ["pddl"] for each in state[name])
    earlier = shown(watering, "--at", "1")
    assert (earlier["metric"], earlier["goals"]) == (None, [])


FILTERED = [
    (["--facts"], ["(robot_at rb1 wp2)"], [], []),
    (["--predicate", "ROBOT_AT"], ["(robot_at rb1 wp2)"], ["(robot_at rb1 wp1)"], []),
    (["--object", "wp1"], [], ["(robot_at rb1 wp1)"], ["wp1"]),
    (["--object", "WP2"], ["(robot_at rb1 wp2)"], [], ["wp2"]),
    (["--object", "wp2", "--facts"], ["(robot_at rb1 wp2)"], [], []),
    (["--type", "robot"], ["(robot_at rb1 wp2)"], ["(robot_at rb1 wp1)"], ["d1", "rb1"]),
    (["--type", "drone"], [], [], ["d1"]),
    (["--type", "drone", "--object", "rb1"], [], [], []),
    (["--predicate", "robot_at", "--object", "wp2"], ["(robot_at rb1 wp2)"], [], []),
    (["--facts", "--at", "1"], ["(robot_at rb1 wp1)"], [], []),
    (["--type", "object", "--facts"], ["(robot_at rb1 wp2)"], [], []),
]


@pytest.mark.parametrize(("words", "facts", "goals", "objects"), FILTERED)
def test_only_what_is_asked_for_is_shown(
    store: str, words: list[str], facts: list[str], goals: list[str], objects: list[str]
) -> None:
    document = json.loads(run("show", store, "--json", *words).stdout)
    assert [one["pddl"] for one in document["facts"]] == facts
    assert [one["pddl"] for one in document["goals"]] == goals
    assert sorted(one["name"] for one in document["objects"]) == objects
    assert set(document) == {
        *("knowledge_base", "revision", "committed_at"),
        *("objects", "facts", "function_values", "goals"),
    }
    text = run("show", store, *words).stdout
    assert f"facts ({len(facts)})" in text
    assert all(line in text for line in (*facts, *goals, *objects))
    assert "actions" not in text


def test_function_values_of_an_object_are_shown(file_url: str) -> None:
    with kant_sql.connect(file_url) as kb:
        kb.functions.save("(fuel ?r - robot)")
        for name in ("r1", "r2"):
            kb.objects.save(f"{name} - robot")
            kb.function_values.save(f"(= (fuel {name}) 7)")
    document = json.loads(run("show", file_url, "--object", "r1", "--json").stdout)
    assert [value["pddl"] for value in document["function_values"]] == ["(= (fuel r1) 7)"]


def test_kbs_lists_the_knowledge_bases_with_their_last_changes(own_store: str) -> None:
    with kant_sql.connect(own_store, knowledge_base="rb[1]") as kb:
        with kb.transaction(actor="operator", reason="a new shift"):
            kb.types.save(PddlTypeDto("robot"))
        (only,) = kb.store.revisions()
    kant_sql.connect(own_store, knowledge_base="never written").close()
    found = json.loads(run("kbs", own_store, "--json").stdout)["knowledge_bases"]
    assert [(one["name"], one["revision"]) for one in found] == [("tiago", 3), ("rb[1]", 1)]
    assert found[1] == {
        "name": "rb[1]",
        "revision": 1,
        "committed_at": time_text(only.committed_at),
        "actor": "operator",
        "reason": "a new shift",
        "source": None,
        "facts": 0,
        "has_more_facts": False,
        "goals": 0,
        "reached": 0,
        **dict.fromkeys(("origin", "origin_revision", "origin_committed_at", "heard_at")),
        **dict.fromkeys(("behind", "lag", "verified_revision", "verified_at", "complete_at")),
        "error": None,
    }
    text = run("kbs", url=own_store).stdout
    assert text.splitlines()[1] == "knowledge bases (2)"
    assert "operator    a new shift" in text


def test_kbs_shows_origins_and_verifications_where_there_are_any(own_store: str) -> None:
    change(
        own_store,
        "UPDATE head SET origin = 'sqlite:///robot\x1b.db', origin_revision = 5,"
        " origin_committed_at = '2126-03-02T15:00:00.000000Z', heard_at = committed_at",
        "INSERT INTO verification (kb_id, revision, hash, verified_at)"
        " VALUES (1, 2, 'abc', '2026-03-02T15:00:00.000000Z')",
    )
    [found] = json.loads(run("kbs", own_store, "--json").stdout)["knowledge_bases"]
    assert (found["behind"], found["verified_revision"]) == (2, 2)
    assert found["lag"] > 1e9
    assert found["verified_at"] == "2026-03-02T15:00:00.000000Z"
    text = run("kbs", own_store).stdout
    assert "\x1b" not in text
    assert "sqlite:///robot" in text
    assert re.search(r"2, [\d,]{10,} s +up to 2 at 2026-03-02T15:00:00.000000Z", text)
