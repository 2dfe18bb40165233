"""State transitions as MCAP, read back with its own reader. The same on both databases."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from mcap.reader import make_reader

import kant_sql
from kant_sql import (
    InvalidArgumentError,
    KantSqlError,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownNameError,
    UnknownRevisionError,
)
from kant_sql.errors import ExtraMissingError
from kant_sql.export import Exported
from kant_sql.knowledge.canonical import time_text
from kant_sql_plugins import mcap
from kant_sql_plugins.mcap import export_transitions
from tests.audit.porter import record_porter
from tests.audit.story import at
from tests.support.processes.commands import one_line, run
from tests.support.worlds import hostile
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, WP1, WP2, robot_at

ROBOT_AT_RB1 = "/courier/fact/robot_at/rb1"
BATTERY_RB1 = "/courier/value/battery/rb1"
STEPS = "/courier/plan/steps"


class Message(NamedTuple):
    """A message as a viewer has it."""

    topic: str
    type: str
    at: datetime
    published: datetime
    data: dict[str, Any]


def messages(folder: Path, name: str = "courier") -> list[Message]:
    """Read a file back, and hold each message against its schema."""
    return [*_messages(folder / f"knowledge_base={name}" / "transitions.mcap")]


def _messages(path: Path) -> Iterator[Message]:
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            described, data = json.loads(schema.data), json.loads(message.data)
            assert set(described["required"]) <= data.keys() <= described["properties"].keys()
            for name, value in data.items():
                assert isinstance(value, TYPES[described["properties"][name]["type"]]), name
            yield Message(
                channel.topic,
                schema.name.removeprefix("kant_sql."),
                _time(message.log_time),
                _time(message.publish_time),
                data,
            )


TYPES: dict[str, Any] = {"string": str, "integer": int, "number": float, "boolean": bool}


def _time(nanoseconds: int) -> datetime:
    assert nanoseconds % 1000 == 0
    microseconds = nanoseconds // 1000
    whole = datetime.fromtimestamp(microseconds // 1_000_000, UTC)
    return whole.replace(microsecond=microseconds % 1_000_000)


def of(found: list[Message], topic: str) -> list[tuple[datetime, Any]]:
    return [(each.at, each.data.get("value")) for each in found if each.topic == topic]


def export(url: str, folder: Path, **given: Any) -> Exported:
    return export_transitions(url, to=folder, **{"knowledge_base": "courier", **given})


def test_a_robot_is_at_one_place_after_the_other(story_url: str, tmp_path: Path) -> None:
    exported = export(story_url, tmp_path)
    found = messages(tmp_path)
    assert of(found, ROBOT_AT_RB1) == [
        (at("08:05"), "dock"),
        (at("09:05:20"), ""),
        (at("09:06:25"), "t1"),
        (at("09:07:15"), ""),
        (at("09:09"), "t1"),
        (at("12:30"), ""),
        (at("12:31"), "dock"),
        (at("13:58"), ""),
        (at("14:01"), "t3"),
        (at("14:20"), "kitchen"),
        (at("08:00", day=3), "dock"),
    ]
    assert of(found, "/courier/fact/robot_at/rb2")[1:] == [
        (at("13:59:58"), "kitchen, t4"),
        (at("14:10"), "t4"),
    ]
    assert of(found, BATTERY_RB1) == [
        *((at("08:05:01"), 100.0), (at("12:00"), 75.5), (at("13:30"), 40.0), (at("15:00"), 100.0))
    ]
    assert of(found, "/courier/fact/waiting/t1") == [
        (at("08:59:59"), True),
        (at("09:07:10"), False),
    ]
    assert [each.at for each in found] == sorted(each.at for each in found)
    (file,) = exported.files
    assert (file.content, file.rows) == ("transitions", len(found))


def test_steps_of_plans_run_and_have_outcomes(story_url: str, tmp_path: Path) -> None:
    export(story_url, tmp_path / "all")
    found = messages(tmp_path / "all")
    assert of(found, STEPS) == [
        (at("09:05:20"), "(move rb1 dock t1)"),
        (at("09:06:25"), "succeeded: (move rb1 dock t1)"),
        (at("09:06:30"), "(serve rb1 cup1 t1)"),
        (at("09:07:10"), "succeeded: (serve rb1 cup1 t1)"),
        (at("09:07:15"), "(move rb1 t1 t2)"),
        (at("09:09"), "failed: (move rb1 t1 t2)"),
        (at("09:09:01"), "aborted: (serve rb1 cup2 t2)"),
    ]
    failed = [each.data for each in found if each.topic == STEPS][-2]
    assert (failed["text"], failed["actor"]) == (
        "(:execution 1.2 (move rb1 t1 t2) failed)",
        "executive",
    )
    export(story_url, tmp_path / "later", since=13, until=13)
    assert of(messages(tmp_path / "later"), STEPS) == [
        (at("09:07:15"), "(move rb1 t1 t2)"),
        (at("09:09"), "failed: (move rb1 t1 t2)"),
    ]


def test_executions_without_a_plan_that_run_are_in_the_first_message(
    scratch_url: str, tmp_path: Path
) -> None:
    with kant_sql.connect(scratch_url, knowledge_base="courier") as kb:
        running = kb.executions.report("dock", arguments=["the charger"], outcome="running")
        kb.executions.report("greet", outcome="succeeded")
        kb.fail(running)
    export(scratch_url, tmp_path, since=2)
    found = [each.data for each in messages(tmp_path)]
    said = '("dock" "the charger")'
    assert [each["value"] for each in found] == [said, said, f"failed: {said}"]
    assert [each["revision"] for each in found] == [1, 2, 3]


def test_messages_say_who_why_and_when_it_was_sensed(story_url: str, tmp_path: Path) -> None:
    export(story_url, tmp_path, elements=["(waiting t1)"])
    first, second = messages(tmp_path)
    assert first.data == {
        "value": True,
        "text": "(waiting t1)",
        "revision": 4,
        "actor": "perception",
        "reason": "guest sat down",
        "source": '{"camera":1}',
        "observed_at": "2026-03-02T08:59:59.000000Z",
        "committed_at": "2026-03-02T09:00:00.000000Z",
    }
    assert (first.at, first.published) == (at("08:59:59"), at("08:59:59"))
    assert second.data["text"] == ""
    assert "source" not in second.data
    assert second.at == second.published == at("09:07:10")


def topic_of(kind: str, text: str) -> str:
    """Give the channel of a fact or a value, by what `docs/export.md` says."""
    words = text.replace("(= ", "").strip("()").replace(")", "").split()
    if kind == "value" or len(words) > 2:
        words = words[:-1]
    return "/".join(["/courier", kind, *words])


def test_a_time_beyond_what_mcap_can_express_is_its_last_one(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'late.db'}"
    late = datetime.max.replace(tzinfo=UTC)
    with (
        kant_sql.connect(url, knowledge_base="courier") as kb,
        kb.transaction(observed_at=late),
    ):
        kb.propositions.save(robot_at())
    export(url, tmp_path / "export")
    (message,) = messages(tmp_path / "export")
    assert (message.at.year, message.data["observed_at"][:4]) == (2554, "9999")


def test_each_transition_is_a_change_of_the_history(story_url: str, tmp_path: Path) -> None:
    """Nothing is lost and nothing is added, and each message says what the state then says."""
    export(story_url, tmp_path)
    found = [each for each in messages(tmp_path) if each.topic != STEPS]
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        changed = {
            (entry.revision.number, topic_of(change.kind, change.text))
            for entry in kb.changes()
            for change in entry.changes
            if change.kind in ("fact", "value")
        }
        assert changed == {(each.data["revision"], each.topic) for each in found}
        assert len(changed) == len(found)
        for each in found:
            state = kb.at(each.data["revision"])
            held = [
                *(("fact", str(fact)) for fact in state.propositions.get_all()),
                *(("value", str(value)) for value in state.function_values.get_all()),
            ]
            texts = sorted(text for kind, text in held if topic_of(kind, text) == each.topic)
            assert each.data["text"] == " ".join(texts)


@pytest.mark.parametrize(
    ("chosen", "topics"),
    [
        ({"names": ["robot_at"]}, {ROBOT_AT_RB1, "/courier/fact/robot_at/rb2"}),
        ({"names": ["BATTERY"]}, {BATTERY_RB1, "/courier/value/battery/rb2"}),
        ({"elements": ["( Robot_At  RB1 dock )"]}, {f"{ROBOT_AT_RB1}/dock"}),
        ({"elements": ["(battery rb1)"]}, {BATTERY_RB1}),
        (
            {"names": ["robot_at"], "elements": ["(robot_at rb1 dock)", "(open front)"]},
            {
                *(ROBOT_AT_RB1, "/courier/fact/robot_at/rb2"),
                *(f"{ROBOT_AT_RB1}/dock", "/courier/fact/open/front"),
            },
        ),
        ({"names": []}, set()),
        ({"elements": ["(robot_at rb1 nowhere)"]}, set()),
    ],
)
def test_what_is_chosen_is_shown_and_nothing_else(
    story_url: str, tmp_path: Path, chosen: dict[str, Any], topics: set[str]
) -> None:
    export(story_url, tmp_path, **chosen)
    found = messages(tmp_path)
    assert {each.topic for each in found} == topics
    if f"{ROBOT_AT_RB1}/dock" in topics:
        assert [value for _, value in of(found, f"{ROBOT_AT_RB1}/dock")] == [True, False] * 2 + [
            True
        ]
    if ROBOT_AT_RB1 in topics:
        assert len(of(found, ROBOT_AT_RB1)) == 11


def test_a_window_begins_with_the_state_before(story_url: str, tmp_path: Path) -> None:
    noon = datetime(2026, 3, 2, 12, tzinfo=UTC)
    by_time = export(story_url, tmp_path / "a", since=noon, until=at("14:00"))
    by_number = export(story_url, tmp_path / "b", since=22, until=29)
    assert by_time.files == by_number.files
    found = messages(tmp_path / "a")
    before = at("11:00:02")
    assert of(found, BATTERY_RB1) == [(before, 100.0), (noon, 75.5), (at("13:30"), 40.0)]
    assert of(found, ROBOT_AT_RB1)[0] == (before, "t1")
    assert of(found, "/courier/fact/robot_at/rb2") == [
        (before, "kitchen"),
        (at("13:59:58"), "kitchen, t4"),
    ]
    assert found[0].data["revision"] == 2
    assert of(found, "/courier/fact/waiting/t1") == []


def test_knowledge_bases_have_files_and_topics_of_their_own(story_url: str, tmp_path: Path) -> None:
    exported = export_transitions(story_url, to=tmp_path)
    assert [file.knowledge_base for file in exported.files] == ["other", "courier"]
    assert {each.topic for each in messages(tmp_path, "other")} == {"/other/fact/robot_at/rb1"}


def test_both_databases_give_the_same_file(
    sqlite_story: str, postgresql_story: str, tmp_path: Path
) -> None:
    made = [
        export(url, tmp_path / str(number))
        for number, url in enumerate((sqlite_story, postgresql_story))
    ]
    assert made[0].files == made[1].files


def test_values_that_are_objects_unset_or_too_large(scratch_url: str, tmp_path: Path) -> None:
    place, load = (
        PddlFunctionDto("place-of", [ROBOT], value_types=[WAYPOINT]),
        PddlFunctionDto("load", [ROBOT]),
    )
    name = "values"
    with kant_sql.connect(scratch_url, knowledge_base=name) as kb:
        values = kb.function_values
        values.set(place, objects=[RB1], value=WP1)
        values.set(place, objects=[RB1], value=WP2)
        values.set(load, objects=[RB1], value=Decimal("-0.5"))
        values.unset(load, objects=[RB1])
        values.set(load, objects=[RB1], value=Decimal(f"1{0:0320}"))
    export(scratch_url, tmp_path, knowledge_base=name)
    found = messages(tmp_path, name)
    assert [v for _, v in of(found, "/values/value/place-of/rb1")] == ["wp1", "wp2"]
    assert [v for _, v in of(found, "/values/value/load/rb1")] == [-0.5, None, None]
    assert [each.data["text"][:13] for each in found if each.type == "number"] == [
        "(= (load rb1)",
        "",
        "(= (load rb1)",
    ]


def test_what_was_archived_is_the_state_that_the_file_begins_with(tmp_path: Path) -> None:
    url, old = (f"sqlite:///{tmp_path / name}.db" for name in ("store", "old"))
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        for number in range(6):
            with kb.transaction():
                kb.propositions.delete_all()
                kb.propositions.save(robot_at(place=(WP1, WP2)[number % 2]))
        kb.store.archive(4, to=old)
        times = {revision.number: revision.committed_at for revision in kb.store.revisions()}
    export(url, tmp_path / "out", knowledge_base="tiago")
    assert of(messages(tmp_path / "out", "tiago"), "/tiago/fact/robot_at/rb1") == [
        (times[3], "wp1"),
        (times[4], "wp2"),
        (times[5], "wp1"),
        (times[6], "wp2"),
    ]
    export(old, tmp_path / "old", knowledge_base="tiago")
    assert [v for _, v in of(messages(tmp_path / "old", "tiago"), "/tiago/fact/robot_at/rb1")] == [
        *("wp1", "wp2", "wp1")
    ]


def test_by_valid_times_a_message_says_what_was_true(scratch_url: str, tmp_path: Path) -> None:
    """At each minute of the morning, the last message of a channel is what was true then."""
    record_porter(scratch_url)
    export(scratch_url, tmp_path, knowledge_base="porter", clock="valid")
    found = messages(tmp_path, "porter")
    place, door, battery = (
        of(found, f"/porter/{each}") for each in ("fact/at/r1", "fact/open/d1", "value/battery/r1")
    )
    assert place == [(at("09:00", day=3), "hall"), (at("09:20", day=3), "lab")]
    assert door == [(at("09:40", day=3), True), (at("09:45", day=3), False)]
    assert {each.published for each in found} == {each.at for each in found}
    with kant_sql.connect(scratch_url, knowledge_base="porter", read_only=True) as kb:
        for minute in range(150):
            moment = at("09:00", day=3) + timedelta(minutes=minute)
            true = kb.at(valid=moment)
            where, is_open, number = (
                ([value for time, value in lane if time <= moment] or [None])[-1]
                for lane in (place, door, battery)
            )
            assert [*true.query("(at r1 ?p)")] == [(where,)]
            assert true.holds("(open d1)") == bool(is_open)
            assert true.holds(f"(= (battery r1) {number})")
    (late,) = [each.data for each in found if each.at == at("09:20", day=3)]
    assert (late["revision"], late["actor"], late["reason"]) == (
        3,
        "camera",
        "the video of that time",
    )


@pytest.mark.parametrize("since", [at("09:20", day=3), at("09:20:00.000001", day=3), 2])
def test_a_window_of_valid_times_begins_with_what_was_true_before(
    scratch_url: str, tmp_path: Path, since: datetime | int
) -> None:
    record_porter(scratch_url)
    window = {"since": since, "until": at("09:42", day=3), "clock": "valid"}
    exported = export(scratch_url, tmp_path, knowledge_base="porter", **window)
    begin = at("09:30", day=3) if since == 2 else since
    assert isinstance(begin, datetime)
    place = "hall" if since == at("09:20", day=3) else "lab"
    found = messages(tmp_path, "porter")
    first = begin - timedelta(microseconds=1)
    assert of(found, "/porter/fact/at/r1")[0] == (first, place)
    assert of(found, "/porter/value/battery/r1") == [(first, 90.0)]
    assert of(found, "/porter/fact/open/d1") == [(at("09:40", day=3), True)]
    assert exported.clock == "valid"


def test_what_nothing_was_said_of_was_true_from_its_commit(story_url: str, tmp_path: Path) -> None:
    export(story_url, tmp_path / "valid", clock="valid")
    export(story_url, tmp_path / "known")
    ours, theirs = messages(tmp_path / "valid"), messages(tmp_path / "known")
    told = [sorted(_told(each)) for each in (ours, theirs)]
    assert told[0] == told[1]
    facts = [each for each in ours if each.topic != STEPS]
    assert all(time_text(each.at) == each.data["committed_at"] for each in facts)
    assert [each for each in ours if each.topic == STEPS] == [
        each for each in theirs if each.topic == STEPS
    ]


def _told(found: list[Message]) -> list[tuple[str, str, str]]:
    return [(each.topic, each.data["committed_at"], json.dumps(each.data)) for each in found]


def test_hostile_names_are_encoded_in_topics(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    type_ = PddlTypeDto("thing")
    predicate = PddlPredicateDto(hostile.NAMES[0], [type_, type_])
    things = [PddlObjectDto(type_, name) for name in (*hostile.NAMES[1:], "a/b", "küche")]
    with kant_sql.connect(url, knowledge_base=hostile.KNOWLEDGE_BASE) as kb:
        for one, other in pairwise(things):
            kb.propositions.save(PddlPropositionDto(predicate, [one, other]))
    exported = export_transitions(url, to=tmp_path / "out")
    found = [*_messages(tmp_path / "out" / exported.files[0].path)]
    assert [each.data["value"] for each in found] == [thing.name for thing in things[1:]]
    for each in found:
        assert each.topic.isascii()
        assert each.topic.count("/") == 4
        assert not set(each.topic) & set("<>\"'&;{}() ")
    assert of(found, found[-1].topic)[-1][1] == "küche"


def test_an_empty_store_has_no_file(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    kant_sql.upgrade(url)
    assert export_transitions(url, to=tmp_path / "out").files == ()


def test_progress_is_told_by_revision(story_url: str, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    export_transitions(story_url, to=tmp_path, progress=lambda *numbers: told.append(numbers))
    assert told == sorted(told)
    assert told[-1] == (38, 38)


def test_more_channels_than_a_viewer_lists_are_refused(
    sqlite_story: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap, "MOST_CHANNELS", 3)
    with pytest.raises(InvalidArgumentError, match="more than 3 facts"):
        export(sqlite_story, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    export(sqlite_story, tmp_path / "out", names=["robot_at"])


WRONG: dict[str, tuple[dict[str, Any], type[KantSqlError], str]] = {
    "name": ({"names": ["robot_att"]}, UnknownNameError, "did you mean robot_at"),
    "element's name": ({"elements": ["(was_at rb1)"]}, UnknownNameError, "was_at"),
    "text": ({"elements": ["robot_at"]}, InvalidArgumentError, "is not an element"),
    "variable": ({"elements": ["(robot_at ?r t1)"]}, InvalidArgumentError, "is not an element"),
    "nested": ({"elements": ["(not (open front))"]}, InvalidArgumentError, "is not an element"),
    "empty": ({"elements": ["()"]}, InvalidArgumentError, "is not an element"),
    "nothing": ({"elements": [""]}, InvalidArgumentError, "is not an element"),
    "no list": ({"names": "robot_at"}, KantSqlError, "names"),
    "no texts": ({"names": [3]}, KantSqlError, "names"),
    "knowledge base": ({"knowledge_base": "nobody"}, KantSqlError, "choose one of"),
    "clock": ({"clock": "observed"}, InvalidArgumentError, "the clock"),
    "future": ({"until": 99}, UnknownRevisionError, "it is at 36"),
    "number": ({"since": 3, "knowledge_base": None}, InvalidArgumentError, "give a time"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_and_nothing_is_made(
    sqlite_story: str, tmp_path: Path, case: str
) -> None:
    given, error, words = WRONG[case]
    with pytest.raises(error, match=words):
        export(sqlite_story, tmp_path / "out", **given)
    assert os.listdir(tmp_path) == []


def test_without_mcap_the_extra_is_named(
    sqlite_story: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'kant-sql\[mcap\]'"):
        export(sqlite_story, tmp_path / "out")


def test_an_export_replaces_another_of_any_format(sqlite_story: str, tmp_path: Path) -> None:
    kant_sql.export.export_store(sqlite_story, to=tmp_path)
    export(sqlite_story, tmp_path, replace=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("_export.json", "knowledge_base=courier")
    ]
    assert ROBOT_AT.name in {each.topic.split("/")[3] for each in messages(tmp_path)}


def test_the_command_writes_what_it_is_asked_for(own_store: str, tmp_path: Path) -> None:
    words = ["--predicate", "robot_at", "--element", "(robot_at rb1 wp2)"]
    out = tmp_path / "out"
    done = run("export", own_store, "--to", str(out), "--format", "mcap", *words)
    assert done.stdout.splitlines()[0] == f"{out}: 1 file with 3 messages"
    with (out / "knowledge_base=tiago" / "transitions.mcap").open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics == ["/tiago/fact/robot_at/rb1"] * 2 + ["/tiago/fact/robot_at/rb1/wp2"]
    words = ["--format", "mcap", "--clock", "valid", "--replace"]
    assert run("export", own_store, "--to", str(out), *words).exit_code == 0
    assert json.loads((out / "_export.json").read_text(encoding="utf-8"))["clock"] == "valid"


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--format", "xlsx"], 2, "parquet, csv, jsonl, mcap"),
        (["--format", "mcap", "--view", "fact"], 2, "--view"),
        (["--format", "csv", "--clock", "valid"], 2, "as columns of the views"),
        (["--format", "mcap", "--predicate", "robotat"], 1, "did you mean robot_at"),
    ],
)
def test_what_is_wrong_is_one_line(
    own_store: str, tmp_path: Path, words: list[str], code: int, said: str
) -> None:
    out = tmp_path / "out"
    done = run("export", own_store, "--to", str(out), *words)
    assert (done.exit_code, out.exists()) == (code, False)
    assert said in one_line(done.stderr)
