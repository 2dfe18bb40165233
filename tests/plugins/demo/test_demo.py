"""The demos: each world is written everywhere, and its page leads to what it promises."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from urllib.request import urlopen

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql.web.application import create_app
from kant_sql_plugins.demo.pages import PAGES
from kant_sql_plugins.demo.worlds import WORLDS, find, write
from tests.support.crawling import Markup
from tests.support.processes.commands import complaint, run, start, written
from tests.support.processes.workers import PATIENCE, wait_for

NAMES = [world.name for world in WORLDS]
HANDED = "(hand_over rb1 heparin noor room2)"
# What the page of each step says that makes its point, and what its command writes.
POINTS = {
    "coffee-shop": (
        ("(ready espresso counter)", "(ready espresso counter)"),
        ("robot_at rb1", "charger"),
        ("carla followed to table", "carla followed to table"),
        ("SELECT", "table5"),
        ("(ordered order1 croissant)", "(ordered order1 croissant)"),
        ("(ordered order1 espresso)", "(ordered order1 espresso)"),
        ("1 period", "the camera sees carla sit down"),
    ),
    "warehouse": (
        ("BLOCKED", "BLOCKED"),
        ("fire_door hall store", "fire_door hall store"),
        ("coral", "coral"),
        ("BLOCKED", "BLOCKED"),
        ("(pass fire_door hall store) failed", "failed"),
        ("the fire door fails too often", "(pass side garden store)"),
        ("side garden store", "(pass side garden store)"),
    ),
    "late-reports": (
        ("place iris", "workshop"),
        ("depot", "depot"),
        ("workshop", "workshop"),
        ("I had put it into the depot", "I had put it into the depot"),
        ("1 period", "the log of the week"),
        ("humidity depot", "(= (humidity depot) 52)"),
        ("(open depot)", "(open depot)"),
    ),
    "failed-plan": (
        ("the night planner", "by hand"),
        ("the lock is closed", "2 (move rb1 kitchen lab) failed"),
        ("unlocked it for the robot", "unlocked it for the robot"),
        ("the lock is closed", "(open lab)"),
        ("(checked lab): does not hold", "(checked lab)"),
        ("by hand", "(move rb1 kitchen lab)"),
        ("(define (problem night)", "(define (problem night)"),
    ),
    "hospital": (
        ("he found it on his table", "violated rule: own_medicine: (always (not (and (took omar"),
        (HANDED, HANDED),
        ("observation by bed_list", "(lies_in noor room2)"),
        ("beds.csv", "bed_list"),
        (HANDED, HANDED),
        ("line 12 was about a visitor", "line 12 was about a visitor"),
        ("Verify now", ""),
    ),
}
# The world's name, its store and its pages.
Told = tuple[str, str, TestClient]


@pytest.fixture(scope="module", params=NAMES)
def told(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Told]:
    name = request.param
    url = f"sqlite:///{tmp_path_factory.mktemp(name) / name}.db"
    fill(url, name)
    app = create_app(url, added=[PAGES])
    with TestClient(app, base_url="http://127.0.0.1") as client:
        yield name, url, client


def fill(url: str, name: str) -> None:
    world = find(name)
    assert world is not None
    with kant_sql.open_store(url) as store:
        write(world, store)
        kb = store.knowledge_base(name)
        assert 10 < kb.revision < 500
        assert kb.store.verify().is_intact


@pytest.mark.parametrize("name", NAMES)
def test_each_store_takes_each_world(name: str, url: str) -> None:
    fill(url, name)


@pytest.mark.smoke
def test_each_step_leads_to_a_page_that_makes_its_point(told: Told) -> None:
    name, _, client = told
    page = Markup(client.get(f"/guide?kb={name}").text)
    shown = " ".join((*page.texts, *page.links))
    steps = client.get(f"/api/guide?kb={name}").json()["steps"]
    assert 5 <= len(steps) <= 8
    for step, (point, _) in zip(steps, POINTS[name], strict=True):
        assert all(step[each] in shown for each in ("title", "text", "address", "command"))
        answer = client.get(step["address"])
        assert answer.status_code == 200, step
        said = "".join(Markup(answer.text).texts)
        assert point in said, step
        # Each page leads back.
        assert f"/guide?kb={name}" in Markup(answer.text).links


def test_each_command_and_each_line_of_python_answers(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, url, client = told
    monkeypatch.chdir(tmp_path)
    with kant_sql.connect(url, knowledge_base=name, read_only=True) as kb:
        steps = client.get(f"/api/guide?kb={name}").json()["steps"]
        for step, (_, point) in zip(steps, POINTS[name], strict=True):
            program, *words = shlex.split(step["command"])
            done = run(*words, url=url)
            # A violated rule, and a step that cannot be done, are an answer, too.
            assert (program, done.exit_code <= 1, done.stderr) == ("kant-sql", True, ""), step
            said = " ".join(done.stdout.split())
            assert point in said, step
            assert eval(step["python"], {"kb": kb}), step


def test_another_knowledge_base_has_no_guide(file_url: str) -> None:
    with kant_sql.connect(file_url, knowledge_base="own") as kb:
        kb.types.save("robot")
    app = create_app(file_url, added=[PAGES])
    with TestClient(app, base_url="http://127.0.0.1") as client:
        answer = client.get("/guide?kb=own")
    assert answer.status_code == 404
    assert "'own' is not of a demo" in unescape(answer.text)


def test_without_a_name_it_lists_the_worlds() -> None:
    *lines, last = written("demo").splitlines()
    assert [line.split()[0] for line in lines] == NAMES
    assert last == f"Open one with: kant-sql demo {NAMES[0]}"


def test_a_name_that_is_no_world_and_a_store_that_has_it_are_refused(file_url: str) -> None:
    assert "there is no demo 'hospice'; choose one of: " in complaint("demo", "hospice")
    with kant_sql.connect(file_url, knowledge_base="hospital") as kb:
        kb.types.save("robot")
    assert "kant-sql serve" in complaint("demo", "hospital", "--store", file_url)


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kant_sql.web.application", None)
    assert "pip install 'kant-sql[web]'" in complaint("demo", "hospital")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_interrupted_and_leaves_nothing(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = tmp_path / "opened"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > {opened}.part\nmv {opened}.part {opened}\n')
    browser.chmod(0o755)
    for name, value in {"TMPDIR": tmp_path / "tmp", "BROWSER": browser}.items():
        monkeypatch.setenv(name, str(value))
    (tmp_path / "tmp").mkdir()
    process = start("demo", "hospital")
    assert process.stdout is not None
    try:
        address = process.stdout.readline().decode().strip()
        lines = [process.stdout.readline().decode() for _ in range(5)]
        assert "What went wrong?" in urlopen(address, timeout=PATIENCE).read().decode()
        url = lines[2].partition("=")[2].strip()
        assert "own_medicine" in run("rules", "--kept", url=url).stdout
        wait_for(opened.exists)
    finally:
        process.send_signal(number)
        _, error = process.communicate(timeout=PATIENCE)
    assert b"Traceback" not in error
    assert [*(tmp_path / "tmp").iterdir()] == []
    assert opened.read_text() == address
