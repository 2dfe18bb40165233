"""Fixtures of the command line's tests."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

import kant_sql
from kant_sql import PddlObjectDto, PddlTypeDto
from tests.support.processes.commands import start
from tests.support.stores import make_store_url
from tests.support.worlds.robots import ROBOT, WP2, navigation, robot_at

FILES = Path(__file__).parent / "files"
BACKENDS = ("sqlite-file", "postgresql")


def new_database(request: pytest.FixtureRequest, folder: Path) -> str:
    """The URL of a database without any table, on the backend that the fixture asks for."""
    if request.param == "sqlite-file":
        return f"sqlite:///{folder / 'new.db'}"
    url: str = request.getfixturevalue("server").new_database()
    return url


def write_history(url: str) -> None:
    """Give a store one knowledge base, tiago, of three revisions."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="perception") as kb:
        kb.propositions.save(robot_at())
        with kb.transaction(actor="executive", reason="navigation finished", source={"step": 3}):
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at(place=WP2))
        with kb.transaction():
            kb.goals.save(robot_at(is_goal=True))
            kb.objects.save(PddlObjectDto(PddlTypeDto("drone", parent=ROBOT), "d1"))
            kb.actions.save(navigation())


def write_breakfast(url: str) -> None:
    """Give a store one knowledge base of two revisions: a problem, and a step."""
    with kant_sql.connect(url) as kb:
        with kb.transaction(actor="operator", reason="breakfast"):
            kb.load_domain(FILES / "kitchen.pddl")
            kb.load_problem(FILES / "breakfast.pddl")
        with kb.transaction(actor="executive", reason="the cup is there"):
            kb.apply("(move rb1 table1 kitchen)")


@contextmanager
def in_background(*words: str, program: Sequence[str] = ()) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command in a process of its own, which is gone at the end."""
    process = start(*words, program=program)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session", params=BACKENDS)
def breakfast(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store with two revisions of a problem, which no test changes."""
    url = make_store_url(request, request.param, tmp_path_factory.mktemp("breakfast"))
    write_breakfast(url)
    return url


@pytest.fixture(params=BACKENDS)
def own_breakfast(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store with two revisions of a problem, which the test may change."""
    url = make_store_url(request, request.param, tmp_path)
    write_breakfast(url)
    return url


@pytest.fixture(params=BACKENDS)
def new_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a database without any table."""
    return new_database(request, tmp_path)


@pytest.fixture(scope="session", params=BACKENDS)
def store(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store with history, which no test changes."""
    url = make_store_url(request, request.param, tmp_path_factory.mktemp("store"))
    write_history(url)
    return url


@pytest.fixture(params=BACKENDS)
def own_store(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store with history, which the test may change."""
    url = make_store_url(request, request.param, tmp_path)
    write_history(url)
    return url


@pytest.fixture(scope="session")
def sqlite_store(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of an SQLite store whose log and state fill more than a pipe; no test changes it."""
    url = f"sqlite:///{tmp_path_factory.mktemp('large') / 'large.db'}"
    with kant_sql.connect(url) as kb:
        kb.propositions.save_all(
            robot_at(place=PddlObjectDto(WP2.type, f"a_place_with_a_long_name_{number}"))
            for number in range(3000)
        )
    return url
