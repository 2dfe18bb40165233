"""What the commands write: nothing steers a terminal, nothing is cut off, and no bar in a pipe."""

from __future__ import annotations

import io
import sys

import pytest

from kant_sql.cli.output import Printer, bar
from tests.cli.conftest import write_history
from tests.support.pages import opened
from tests.support.processes.commands import run

# Clears the screen; both ways to begin a sequence; text that runs backwards.
STEERING = "\x1b[2J\x9b31m\u202e"
ESCAPED = r"\u001b[2J\u009b31m\u202e"
AT_WP1 = "(robot_at rb1 wp1)"


class Terminal(io.StringIO):
    """A terminal that remembers what it was sent."""

    def isatty(self) -> bool:
        return True


def use_terminal(monkeypatch: pytest.MonkeyPatch, **variables: str) -> Terminal:
    """Let both outputs go to a terminal."""
    shown = Terminal()
    monkeypatch.setattr(sys, "stdout", shown)
    monkeypatch.setattr(sys, "stderr", shown)
    for name, value in {"TERM": "xterm", **variables}.items():
        monkeypatch.setenv(name, value)
    return shown


@pytest.fixture(scope="module")
def tampered(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store that somebody has changed without the library."""
    url = f"sqlite:///{tmp_path_factory.mktemp('tampered') / 'robot.db'}"
    write_history(url)
    with opened(url) as store:
        for change in (
            "UPDATE object SET name = name || :text",
            "UPDATE object_version SET text = text || :text",
            "UPDATE proposition SET text = text || :text",
            "UPDATE revision SET reason = :text",
        ):
            store.execute(change, {"text": STEERING})
    return url


@pytest.mark.parametrize(
    "words",
    [
        *(["show"], ["log"], ["diff", "0", "2"], ["history", AT_WP1], ["blame", "wp1"]),
        *(["verify"], ["watch", "--after", "0", "--timeout", "0"], ["log", "--json"]),
    ],
)
def test_what_tampering_left_does_not_steer_the_terminal(tampered: str, words: list[str]) -> None:
    command, *rest = words
    written = run(command, tampered, *rest).output
    assert ESCAPED in written
    assert not set("\x1b\x9b\u202e") & set(written)


@pytest.mark.parametrize("width", ["0", "1", "7"])
def test_nothing_is_lost_in_a_terminal_without_width(
    monkeypatch: pytest.MonkeyPatch, width: str
) -> None:
    terminal = use_terminal(monkeypatch, COLUMNS=width)
    printer = Printer()
    printer.line("line")
    printer.table("robots", ["robot", "place", "kitchen", "task"], [["rb1", "x" * 30, "z", "y"]])
    shown = terminal.getvalue()
    assert "line" in shown
    assert "rb1" in shown
    assert shown.count("x") == 30


def test_a_bar_moves_in_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch)
    with bar("tiago") as told:
        assert told is not None
        told(1, 2)
    assert "50%" in terminal.getvalue()


def test_a_dumb_terminal_has_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch, TERM="dumb")
    with bar("tiago") as told:
        assert told is None
    assert terminal.getvalue() == ""


def test_a_pipe_has_no_bar_whatever_is_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)
    monkeypatch.setenv("FORCE_COLOR", "1")
    with bar("tiago") as told:
        assert told is None
    assert pipe.getvalue() == ""


@pytest.mark.parametrize("words", [["--help"], ["db", "--help"]])
def test_no_summary_of_a_command_is_cut_off(words: list[str]) -> None:
    summaries = run(*words).stdout.partition("Commands:")[2]
    assert "  db " in summaries or "  upgrade " in summaries
    assert "..." not in summaries
