"""The report: all that happened, in one file that needs nothing else, bounded, and only data."""

from __future__ import annotations

import base64
import re
import shlex
import shutil
import sqlite3
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from hashlib import sha256
from html import unescape
from pathlib import Path

import pytest

import kant_sql
from kant_sql import InvalidArgumentError, KantSqlError, KnowledgeBase
from kant_sql.errors import PddlError, SourceError, UnknownNameError, UnknownRevisionError
from kant_sql.operations import parse_anchor
from kant_sql.planning import Plan, PlanStep
from kant_sql.web import report_sections
from kant_sql.web.rendering import STATIC
from kant_sql.web.report import report_html, write_report
from tests.audit.story import at, record_store
from tests.support.crawling import Markup
from tests.support.notebooks import UNSEEN
from tests.support.processes.commands import run
from tests.support.profile import PROFILE
from tests.support.statements import count, fact, fill
from tests.support.stores import Connect, new_file_store
from tests.support.worlds.hostile import (
    KNOWLEDGE_BASE,
    NAMES,
    overwrite,
    record_hostile,
    text_columns,
)
from tests.web.conftest import do_some

SECTIONS = {
    *("summary", "timeline", "plans", "acts", "rules", "goals", "effects", "corrections", "log"),
    "verification",
}
LIMITS = {"ACTORS": 2, "LANES": 3, "BARS": 2, "STEPS": 1, "ENTRIES": 4, "CHANGES": 1}
DOORS = """(define (domain doors) (:predicates (open) (seen))
  (:action look :precondition (open) :effect (seen)))"""
RULES = ("(always (not (served t1)))", "(always (not (served t2)))")


class Page(Markup):
    """A report, taken apart as a browser does."""

    def __init__(self, text: str) -> None:
        self.styles: list[str] = []
        super().__init__(text)
        given = self.attributes
        named = [value for _, name, value in given if name == "id"]
        self.ids = set(named)
        assert len(named) == len(self.ids), "an id is there twice"
        self.handlers = [name for _, name, _ in given if name.startswith("on") or name == "style"]
        self.loads = [
            value
            for tag, name, value in given
            if name in ("src", "srcset", "action") or (tag, name) == ("link", "href")
        ]
        place = given.index(("meta", "http-equiv", "Content-Security-Policy"))
        self.policy = dict(part.strip().split(" ", 1) for part in given[place + 1][2].split(";"))

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())

    def handle_data(self, data: str) -> None:
        if self._open[-1:] == ["style"]:
            self.styles.append(data)
        else:
            super().handle_data(data)


@pytest.fixture
def story(story_url: str) -> Iterator[KnowledgeBase]:
    """The story, on each dialect in turn."""
    with kant_sql.connect(story_url, knowledge_base="courier", read_only=True) as kb:
        yield kb


@pytest.fixture
def sqlite_kb(sqlite_story: str) -> Iterator[KnowledgeBase]:
    with kant_sql.connect(sqlite_story, knowledge_base="courier", read_only=True) as kb:
        yield kb


def test_it_says_what_happened(story: KnowledgeBase) -> None:
    page = Page(report_html(story, objects=["rb2"]))
    assert SECTIONS | {"objects"} <= page.ids
    for said in (
        "36, with 83 changes",
        "executive 13 8 32",
        "fact 18 13",
        "guest sat down",
        "blocked by a chair",
        "2 succeeded, 1 failed, 1 aborted",
        "1 not reached",
        "(robot_at rb2 dock)",
        "There are no rules.",
        "Intact : 36 revisions and 83 changes",
        'Source: {"camera": 4}',
        "Observed at 2026-03-02 13:59:58",
        story.store.revisions()[-1].hash,
    ):
        assert said in page.text, said
    assert "Left out" not in page.text


def test_each_link_of_a_cause_is_further_in_than_the_one_before() -> None:
    sheet = (STATIC / "style.css").read_text()
    found = re.findall(r"^\.depth-(\d) { margin-inline-start: ([\d.]+)em; }$", sheet, re.MULTILINE)
    assert [int(depth) for depth, _ in found] == [*range(2, report_sections.DEPTH + 1)]
    assert [float(indent) for _, indent in found] == [1.5, 3, 4.5, 6]


def test_it_lists_the_acts_of_its_range_as_they_were_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with kant_sql.connect(f"sqlite:///{tmp_path / 'acts.db'}", actor="executive") as kb:
        do_some(kb)
        running = next(kb.executions.get_all(outcome="running"))
        kb.end(running)
        after = kb.revision

        def rows(since: int | None = None, until: int | None = None) -> list[str]:
            text = report_html(kb, verify=False, since=since, until=until)
            acts = text[text.index('<section id="acts">') : text.index('<section id="rules">')]
            assert Page(text).links
            return re.findall(r'<span class="tag [a-z]*">(\w+)<', acts)

        assert rows() == ["succeeded", "refused", "failed", "succeeded"]
        assert rows(until=after - 1) == ["succeeded", "refused", "failed", "running"]
        assert rows(since=5, until=6) == ["refused", "running"]
        monkeypatch.setattr(report_sections, "ACTS", 1)
        assert rows() == ["succeeded"]
        assert "earlier acts" in Page(report_html(kb, verify=False)).text


def test_it_needs_nothing_else(story: KnowledgeBase) -> None:
    page = Page(report_html(story))
    assert page.loads == []
    assert page.handlers == []
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links), page.links
    assert {f"#{section}" for section in SECTIONS} <= {*page.links}
    assert page.policy["default-src"] == "'none'"
    assert "script" not in page.elements
    assert not {"script-src", "img-src", "connect-src"} & page.policy.keys()
    digests = (base64.b64encode(sha256(each.encode()).digest()).decode() for each in page.styles)
    assert page.policy["style-src"] == " ".join(f"'sha256-{digest}'" for digest in digests)


def drawing(text: str) -> str:
    found = re.findall(r"<svg.*</svg>", text, re.DOTALL)
    assert len(found) == 1
    return str(found[0])


@pytest.mark.more
def test_the_drawing_shows_what_the_table_lists(story: KnowledgeBase) -> None:
    text = report_html(story, verify=False)
    drawn = drawing(text)
    assert "executive +6 " in drawn
    assert "plan 1 by aries: 4 steps" in drawn
    for lane in story.timeline().lanes:
        assert lane.text in Page(text).text
        assert lane.text in drawn


def test_the_drawing_has_what_changed_most(
    sqlite_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_sections, "LANES", 2)
    drawn = drawing(report_html(sqlite_kb, since=17, until=22, verify=False))
    assert "(open front)" in drawn
    assert "(battery rb1)" in drawn
    assert "(served t1)" not in drawn
    assert "more never changed in this time." in drawn


def test_a_wrong_fact_led_to_these_acts(kb: KnowledgeBase) -> None:
    kb.load_domain(DOORS)
    with kb.transaction(actor="camera", reason="frame 812"):
        kb.propositions.save_all(["(open)"])
    kb.apply("(look)")
    page = Page(report_html(kb, facts=["(open)", "(seen)"], verify=False))
    assert "facts" in page.ids
    assert [one for one in page.attributes if one[2] == "causes"] == [
        ("svg", "class", "causes")
    ] * 2
    for said in ("Consequences 1", "(look)", "Origins 2", "frame 812"):
        assert said in page.text
    with pytest.raises(UnknownNameError):
        report_html(kb, facts=["(shut)"], verify=False)


def test_a_plan_that_used_a_fact_is_led_to(kb: KnowledgeBase) -> None:
    kb.load_domain(DOORS)
    kb.propositions.save("(open)")
    kb.plans.record(Plan((PlanStep(Decimal(0), "look", (), None),), "by hand", "unknown"))
    page = Page(report_html(kb, facts=["(open)"], verify=False))
    assert page.links.count("#plan-1") >= 2


def test_its_timeline_goes_by_the_clock_that_it_is_given(kb: KnowledgeBase) -> None:
    fill(kb, 2)
    begin, end = (datetime.now(UTC) - timedelta(minutes=minutes) for minutes in (20, 10))
    with kb.transaction(actor="camera", valid_from=begin, valid_until=end):
        kb.propositions.save(fact(1))
    with kb.transaction(valid_from=begin, valid_until=end):
        kb.propositions.delete(fact(0))
        kb.propositions.save("(robot_at rb1 wp1)")
    committed, valid = (
        Page(report_html(kb, verify=False, objects=["rb1"], clock=clock)).text
        for clock in ("committed", "valid")
    )
    note = "when they were true"
    assert (note in committed, note in valid) == (False, True)
    moment = f"{begin:%Y-%m-%d %H:%M:%S}"
    assert valid.count(moment) > committed.count(moment)
    with pytest.raises(InvalidArgumentError, match="clock"):
        report_html(kb, until=0, clock="wall")


def test_a_range_is_all_that_it_is_about(story: KnowledgeBase) -> None:
    for since, until in ((28, 32), (at("13:58"), at("14:20"))):
        page = Page(report_html(story, since=since, until=until))
        assert {each for each in page.ids if each.startswith("revision-")} == {
            f"revision-{number}" for number in range(28, 33)
        }
        assert "5, with" in page.text
        assert "guest sat down" not in "".join(re.findall("Log .*", page.text))
        # The history is verified as a whole: its hashes are a chain.
        assert "36 revisions and 83 changes" in page.text


def test_a_range_without_a_revision_says_so(story: KnowledgeBase) -> None:
    page = Page(report_html(story, since=at("10:10"), until=at("10:20")))
    assert "This range has no revision." in page.text
    assert "Intact" in page.text
    assert page.links == ["#summary", "#verification"]


def test_what_was_true_without_a_revision_is_reported(kb: KnowledgeBase) -> None:
    begin, end = (datetime(2026, 1, 31, hour, tzinfo=UTC) for hour in (9, 17))
    fill(kb, 2)
    with kb.transaction(actor="camera", valid_from=begin, valid_until=end):
        kb.propositions.delete(fact(0))
        kb.propositions.save(fact(1))
    for since in (begin, None):
        page = Page(report_html(kb, verify=False, clock="valid", since=since, until=end))
        assert "This range has no revision." in page.text
        assert page.links[:3] == ["#summary", "#timeline", "#corrections"]
        assert page.text.count("2026-01-31 09:00:00") >= 2
    page = Page(report_html(kb, verify=False, clock="valid", until=0))
    assert "2026-01-31" not in page.text


@pytest.mark.more
def test_rules_are_held_against_the_range(connect: Connect, tmp_path: Path) -> None:
    kb = connect(record_store(new_file_store(tmp_path / "ruled.db")), knowledge_base="courier")
    for rule in RULES:
        kb.pddl.constraints.save(rule)
    said = Page(report_html(kb)).text
    assert "1 violated" in said
    assert re.search(
        r"\(served t1\)\)\) violated 11 2026-03-02 09:07:10 executive : cup taken", said
    )
    assert re.search(r"\(served t2\)\)\) kept", said)
    assert "0 violated of 2" in Page(report_html(kb, until=10)).text
    others = "(sometime (served t2))\n(always (not (open front)))"
    said = Page(report_html(kb, rules=others, verify=False)).text
    assert "2 violated of 2" in said
    assert "door_sensor" in said


def test_kept_rules_are_held_against_the_range(connect: Connect, tmp_path: Path) -> None:
    kb = connect(new_file_store(tmp_path / "ruled.db"), knowledge_base="courier")
    fill(kb, 1)
    kb.propositions.delete("(robot_at rb1 wp0)")
    # What was before it was saved does not count.
    kb.rules.save("gone", "(always (not (robot_at rb1 wp0)))")
    kb.rules.save("away", "(always (not (robot_at rb1 wp0)))")
    kb.propositions.save("(robot_at rb1 wp0)")
    broken = kb.revision
    kb.rules.delete("gone")
    said = Page(report_html(kb, verify=False)).text
    assert "1 violated of 1" in said
    assert "away : (always (not (robot_at rb1 wp0))) violated" in said
    assert "none violated" in Page(report_html(kb, until=broken - 1, verify=False)).text


def test_wrong_rules_are_refused(sqlite_kb: KnowledgeBase, tmp_path: Path) -> None:
    for wrong, error in (("(always (nonsense))", PddlError), (Path("no file"), SourceError)):
        with pytest.raises(error):
            write_report(sqlite_kb, tmp_path / "day.html", rules=wrong)
    assert [*tmp_path.iterdir()] == []


def test_what_is_left_out_is_said_with_the_command_that_shows_it(
    sqlite_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, sqlite_story: str
) -> None:
    for name, number in LIMITS.items():
        monkeypatch.setattr(report_sections, name, number)
    text = report_html(sqlite_kb, objects=["rb1"])
    page = Page(text)
    for said in (
        *("5 more actors with fewer revisions", "periods, the earlier or shorter ones"),
        *("facts, goals and values that changed less", "3 more steps", "the first 32 revisions"),
        "more changes",
    ):
        assert said in page.text, said
    commands = set(re.findall(r'<code class="command">(kant-sql [^<]*)</code>', text))
    commands -= {each for each in commands if "FILE" in each}
    assert len(commands) >= 5
    for command in commands:
        # Exit code 1: a goal is not reached.
        words = shlex.split(unescape(command))[1:]
        assert run(*words, url=sqlite_story).exit_code in (0, 1), command
    assert len(text) < len(report_html(sqlite_kb, objects=["rb1", "rb2", "t1"]))


@pytest.mark.more
def test_names_and_reasons_are_data(connect: Connect, shared_url: str) -> None:
    kb = connect(record_hostile(shared_url), knowledge_base=KNOWLEDGE_BASE)
    text = report_html(kb, objects=NAMES)
    page = Page(text)
    assert page.loads == page.handlers == []
    assert all(link[1:] in page.ids for link in page.links)
    assert "script" not in page.elements
    without = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", text, flags=re.DOTALL)
    assert list(Markup(without).faults()) == []
    assert UNSEEN.search(page.text) is None
    assert "{{8191*99991}}" in page.text
    assert len(text) < 2_000_000


@pytest.mark.more
def test_a_report_of_a_day_is_small(kb: KnowledgeBase) -> None:
    fill(kb, 2_000)
    for number in range(400):
        with kb.transaction(actor=f"actor{number % 9}", reason="navigation finished"):
            for each in range(10):
                kb.propositions.delete(fact((number * 10 + each) % 2_000))
                kb.propositions.save(fact((number * 10 + each + 10) % 2_000))
    text = report_html(kb, objects=["rb1"], verify=False)
    assert "Left out" in Page(text).text
    assert len(text.encode()) < 1_000_000


def test_it_takes_few_statements_however_much_happened(kb: KnowledgeBase) -> None:
    for size in (10, 2_000):
        fill(kb, size)
        kb.propositions.delete(fact(1))
        # What is large is read in another way.
        assert count(lambda: report_html(kb, objects=["rb1"], verify=False)) <= 62


def test_a_history_that_was_changed_is_reported(connect: Connect, tmp_path: Path) -> None:
    path = tmp_path / "changed.db"
    kb = connect(record_store(new_file_store(path)), knowledge_base="courier")
    anchor = kb.store.anchor()
    with sqlite3.connect(path) as lite:
        lite.execute("UPDATE revision SET reason = 'not so' WHERE number = 13 AND kb_id = 2")
    lite.close()
    said = Page(report_html(kb, anchor=anchor)).text
    assert "Not intact" in said
    assert "revision" in said
    done = run(
        "report", f"sqlite:///{path}", "--kb", "courier", "--out", str(tmp_path / "day.html")
    )
    assert done.exit_code == 0


def test_the_anchor_in_it_verifies_the_store(story: KnowledgeBase) -> None:
    text = report_html(story, verify=False)
    page = Page(text)
    assert "The history was not verified." in page.text
    written = re.search(r"<pre>(.*?)</pre>", text, re.S)
    assert written is not None
    anchor = parse_anchor(unescape(written[1]))
    assert [head.knowledge_base for head in anchor.heads] == ["courier"]
    assert story.store.verify(anchor).is_intact
    assert "compared with an anchor of revision 36" in Page(report_html(story, anchor=anchor)).text


def test_a_section_that_cannot_be_read_says_why(connect: Connect, tmp_path: Path) -> None:
    kb = connect(record_store(new_file_store(tmp_path / "old.db")), knowledge_base="courier")
    kb.store.archive(20, to=f"sqlite:///{tmp_path / 'archive.db'}")
    page = Page(report_html(kb))
    assert "This section could not be read" in page.text
    assert "archive" in page.text
    assert "moved to an archive" in page.text
    assert "Intact" in page.text


@pytest.mark.more
def test_a_store_that_was_written_over_is_reported(tmp_path: Path) -> None:
    sound, path = tmp_path / "sound.db", tmp_path / "damaged.db"
    record_hostile(f"sqlite:///{sound}")
    columns = set(text_columns(str(sound))) - {("knowledge_base", "name")}
    told = set()
    for table, column in sorted(columns)[:: 1 if PROFILE.is_whole else 3]:
        shutil.copy(sound, path)
        if overwrite(str(path), table, column):
            with kant_sql.connect(f"sqlite:///{path}", knowledge_base=KNOWLEDGE_BASE) as kb:
                text = report_html(kb)
            without = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", text, flags=re.DOTALL)
            assert list(Markup(without).faults()) == [], (table, column)
            told.add("Not intact" in Page(text).text)
    # Some tables of the store are empty.
    assert True in told


def test_what_is_wrong_is_refused_before_reading(sqlite_kb: KnowledgeBase, tmp_path: Path) -> None:
    path = tmp_path / "day.html"
    with pytest.raises(UnknownNameError, match="nobody"):
        write_report(sqlite_kb, path, objects=["nobody"])
    with pytest.raises(UnknownRevisionError):
        write_report(sqlite_kb, path, since=99)
    with pytest.raises(UnknownRevisionError):
        write_report(sqlite_kb, path, until=datetime.now(UTC) + timedelta(days=1))
    for wrong in ({"objects": [1]}, {"verify": 1}, {"progress": 1}, {"objects": "rb1"}):
        with pytest.raises(KantSqlError):
            write_report(sqlite_kb, path, **wrong)
    for arguments in ((1, path), (sqlite_kb, 1)):
        with pytest.raises(InvalidArgumentError):
            write_report(*arguments)
    assert [*tmp_path.iterdir()] == []


def test_a_file_is_replaced_whole_or_not_at_all(
    sqlite_kb: KnowledgeBase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "day.html"
    path.write_text("the one before")
    told: list[tuple[int, int]] = []

    def stop(done: int, whole: int) -> None:
        told.append((done, whole))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_report(sqlite_kb, path, progress=stop)
    assert told
    assert path.read_text() == "the one before"
    assert write_report(sqlite_kb, str(path)) == path
    assert path.read_text().startswith("<!doctype html>")
    assert [*tmp_path.iterdir()] == [path]
    with pytest.raises(IsADirectoryError):
        write_report(sqlite_kb, tmp_path)
    with pytest.raises(FileNotFoundError) as missing:
        write_report(sqlite_kb, tmp_path / "nowhere" / "day.html")
    assert missing.value.filename == str(tmp_path / "nowhere" / "day.html")


def test_the_command_writes_it(story_url: str, tmp_path: Path) -> None:
    path = tmp_path / "day.html"
    words = ("report", story_url, "--kb", "courier", "--object", "rb1", "--no-verify")
    done = run(*words, "--since", "2026-03-02 13:00", "--until", "32", "--out", str(path))
    assert (done.exit_code, done.output) == (0, f"{path}\n")
    page = Page(path.read_text(encoding="utf-8"))
    assert "7, with" in page.text
    printed = run(*words, "--out", "-")
    assert printed.stdout.startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--kb", "courier", "--out", "."], "directory"),
        (["--kb", "courier", "--out", "nowhere/day.html"], "No such file"),
        (["--kb", "nobody", "--out", "day.html"], "no knowledge base"),
        (["--kb", "courier", "--object", "nobody", "--out", "day.html"], "nobody"),
        (["--kb", "courier"], "--out"),
    ],
)
def test_what_the_command_cannot_do_is_one_line(
    sqlite_story: str,
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("report", sqlite_story, *words)
    assert done.exit_code != 0
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert [*tmp_path.iterdir()] == []


def test_without_the_extra_it_says_what_to_install(
    sqlite_story: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "kant_sql.web.report", None)
    done = run("report", sqlite_story, "--out", "day.html")
    assert done.exit_code == 1
    assert "pip install 'kant-sql[web]'" in done.stderr
