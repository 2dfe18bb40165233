"""`kant-sql verify` and `kant-sql anchor`."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

import kant_sql
from tests.cli.conftest import write_history
from tests.support.faults import be_impatient, change, held
from tests.support.processes.commands import child, complaint, environment, in_terminal, run
from tests.support.worlds.robots import robot_at, waypoint

MOMENT = "2026-03-02T15:00:00.000000Z"
ALTER = "UPDATE revision SET reason = 'well done' WHERE number = 2"


@pytest.fixture
def own_file(tmp_path: Path) -> str:
    """The URL of a store with history that the test may change: one dialect will do."""
    url = f"sqlite:///{tmp_path / 'own.db'}"
    write_history(url)
    return url


def anchor_file(url: str, folder: Path) -> Path:
    """What `kant-sql anchor` writes of a store, as a file."""
    result = run("anchor", url)
    assert result.exit_code == 0, result.stderr
    path = folder / "anchor.json"
    path.write_text(result.stdout)
    return path


def test_an_intact_store_is_told_so(store: str) -> None:
    done = child("verify", store)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "tiago: intact (3 revisions, 13 changes)\n"


def test_findings_are_a_line_each_and_the_exit_code(own_store: str) -> None:
    change(own_store, ALTER)
    done = child("verify", own_store)
    assert (done.returncode, done.stderr) == (1, "")
    first, last = done.stdout.splitlines()
    assert first.startswith("tiago: revision 2: its contents differ from what was hashed")
    assert last == "tiago: 1 finding (3 revisions, 13 changes)"


def test_json_says_all_of_it(own_file: str) -> None:
    change(own_file, "UPDATE head SET next_id = 1")
    result = run("verify", own_file, "--json")
    document: dict[str, Any] = json.loads(result.stdout)
    (finding,) = document.pop("findings")
    assert result.exit_code == 1
    assert document == {
        "knowledge_base": "tiago",
        "revisions": 3,
        "changes": 13,
        "is_intact": False,
        "archives": [],
        "erasures": [],
        "anchored": None,
        **dict.fromkeys(("continued_from", "continued_at", "complete_at")),
        "is_kept": False,
    }
    assert (finding["revision"], finding["table"]) == (None, "head")
    assert finding["message"].startswith("next_id is 1, and ")


def test_all_knowledge_bases_or_one(own_file: str) -> None:
    with kant_sql.connect(own_file, knowledge_base="[bold]") as kb:
        kb.propositions.save(robot_at())
    assert "choose one with --kb" in complaint("verify", own_file)
    result = run("verify", own_file, "--kb", "[bold]")
    assert result.stdout == "[bold]: intact (1 revisions, 6 changes)\n"
    names = [line.split(":")[0] for line in run("verify", own_file, "--all").stdout.splitlines()]
    assert names == ["tiago", "[bold]", "[bold]", "2 knowledge bases"]


def test_a_knowledge_base_without_a_head_is_not_passed_over(own_file: str) -> None:
    change(own_file, "DELETE FROM head")
    result = run("verify", own_file, "--all")
    assert result.exit_code == 1
    assert "head has 0 rows of the knowledge base, not one" in result.stdout


def test_an_anchor_is_one_small_document(store: str) -> None:
    document = json.loads(child("anchor", store).stdout)
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        last = kb.store.revisions()[-1]
    (head,) = document["heads"]
    assert document["format"] == 1
    assert document["made_at"].endswith("Z")
    moment = last.committed_at.isoformat(timespec="microseconds")[:26] + "Z"
    assert head == {
        "knowledge_base": "tiago",
        "revision": 3,
        "hash": last.hash,
        "committed_at": moment,
    }


def test_an_anchor_is_compared(own_store: str, tmp_path: Path) -> None:
    file = str(anchor_file(own_store, tmp_path))
    assert run("verify", own_store, "--anchor", file).exit_code == 0
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        kb.propositions.delete_all()
    assert run("verify", own_store, "--anchor", file).exit_code == 0
    document = json.loads(Path(file).read_text())
    document["heads"][0]["revision"] = 9
    Path(file).write_text(json.dumps(document))
    result = run("verify", own_store, "--anchor", file)
    assert result.exit_code == 1
    assert "revision 5: the history was cut off: it ends at revision 4" in result.stdout


@pytest.mark.parametrize("words", [(), ("--all",), ("--kb", "tiago"), ("--kb", "pepper")])
def test_a_knowledge_base_that_is_anchored_and_gone_is_a_finding(
    own_file: str, tmp_path: Path, words: tuple[str, ...]
) -> None:
    file = anchor_file(own_file, tmp_path)
    file.write_text(file.read_text().replace('"tiago"', '"pepper"'))
    result = run("verify", own_file, "--anchor", str(file), *words)
    assert result.exit_code == 1
    assert "knowledge base 'pepper' is missing" in result.stdout


def test_what_an_anchor_says_nothing_of_is_said(own_file: str, tmp_path: Path) -> None:
    file = anchor_file(own_file, tmp_path)
    save_more(own_file, "newer", 7)
    lines = run("verify", own_file, "--all", "--anchor", str(file)).stdout.splitlines()
    assert lines[-2] == "newer: not in the anchor"
    assert sum("anchor" in line for line in lines) == 1
    documents = run("verify", own_file, "--all", "--anchor", str(file), "--json").stdout
    assert [json.loads(line)["anchored"] for line in documents.splitlines()] == [3, None]


@pytest.mark.parametrize("name", ["'a' || char(10)", "x'00ff'"])
def test_what_is_no_name_is_a_finding_and_the_others_are_verified(own_file: str, name: str) -> None:
    save_more(own_file, "newer", 7)
    change(own_file, f"UPDATE knowledge_base SET name = {name} WHERE name = 'tiago'")
    result = run("verify", own_file, "--all")
    assert result.exit_code == 1
    first, _, last, _ = result.stdout.splitlines()
    assert "cannot name a knowledge base" in first
    assert last.startswith("newer: intact")
    result = run("verify", own_file, "--all", "--json")
    assert result.exit_code == 1
    assert "cannot name a knowledge base" in result.stdout
    assert "newer" in result.stdout


def test_an_empty_store_has_an_empty_anchor(new_url: str, tmp_path: Path) -> None:
    kant_sql.upgrade(new_url)
    file = anchor_file(new_url, tmp_path)
    assert json.loads(file.read_text())["heads"] == []
    assert run("verify", new_url, "--all", "--anchor", str(file)).exit_code == 0
    assert "it has no knowledge base yet" in complaint("verify", new_url)


HEAD = {"knowledge_base": "tiago", "revision": 1, "hash": "0" * 64, "committed_at": MOMENT}
TWICE = json.dumps({"format": 1, "made_at": MOMENT, "heads": [HEAD, HEAD]}).encode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not an anchor, because it is not JSON"),
        (b"\xff\xfe\xfd", "not an anchor, because it is not JSON"),
        (b"[]", "this JSON document is not an anchor"),
        (b'{"format": 1}', "this JSON document is not an anchor"),
        (b'{"format": 7, "heads": []}', "is of format 7, and this version of kant_sql reads 1"),
        (b'{"format": 1, "heads": [{"revision": 1}]}', "head 0 of this anchor lacks"),
        (b'{"format": 1, "heads": [5]}', "head 0 of this anchor lacks"),
        (TWICE, "two heads of knowledge base 'tiago'"),
    ],
)
def test_a_file_that_is_no_anchor_is_refused(
    own_file: str, tmp_path: Path, content: bytes, message: str
) -> None:
    file = tmp_path / "anchor.json"
    file.write_bytes(content)
    assert message in complaint("verify", own_file, "--anchor", str(file))


def test_an_anchor_is_json_with_the_option_and_without(own_file: str) -> None:
    documents = [json.loads(run("anchor", own_file, *more).stdout) for more in ([], ["--json"])]
    assert documents[0]["heads"] == documents[1]["heads"]
    assert documents[1]["heads"][0]["revision"] == 3


# All of them, night after night.


TIME = r"\d{4}-\d\d-\d\dT[\d:.]+Z"


@pytest.fixture
def fleet(own_store: str) -> str:
    """The URL of a store with five knowledge bases."""
    with kant_sql.open_store(own_store) as store:
        for number in range(4):
            store.knowledge_base(f"robot {number}").propositions.save(robot_at())
    return own_store


def save_more(url: str, name: str, *numbers: int) -> None:
    with kant_sql.connect(url, knowledge_base=name) as kb:
        for number in numbers:
            kb.objects.save(waypoint(number))


def verify_all(url: str, *more: str) -> list[str]:
    done = run("verify", url, "--all", *more)
    assert (done.exit_code, done.stderr) == (0, "")
    return done.stdout.splitlines()


def test_the_next_run_continues_and_says_so(fleet: str) -> None:
    assert verify_all(fleet)[-1] == (
        "5 knowledge bases: all intact; 7 revisions verified, 0 continued"
    )
    save_more(fleet, "robot 2", 7, 8)
    save_more(fleet, "robot 9", 9)
    lines = verify_all(fleet)
    assert lines[-1] == "6 knowledge bases: all intact; 3 revisions verified, 5 continued"
    assert "robot 9: intact (1 revisions, 2 changes)" in lines
    place = lines.index("robot 2: intact (2 revisions, 2 changes)")
    assert re.fullmatch(
        rf"robot 2: revisions 1 to 1 verified at {TIME}, continued from there, all of it last at "
        rf"{TIME}",
        lines[place + 1],
    )
    assert verify_all(fleet, "--complete")[-1] == (
        "6 knowledge bases: all intact; 10 revisions verified, 0 continued"
    )


def test_one_alone_continues_when_asked_to(own_file: str) -> None:
    for _ in range(2):
        assert run("verify", own_file).stdout == "tiago: intact (3 revisions, 13 changes)\n"
    save_more(own_file, "tiago", 50)
    document = json.loads(run("verify", own_file, "--continue", "--json").stdout)
    assert (document["revisions"], document["continued_from"]) == (1, 3)
    assert document["is_kept"] is True
    assert re.fullmatch(TIME, document["continued_at"])


def test_complete_since_begins_again_where_it_was_long_ago(fleet: str) -> None:
    verify_all(fleet)
    change(
        fleet, "UPDATE verification SET complete_at = '2020-01-01T00:00:00.000000Z' WHERE kb_id < 3"
    )
    assert verify_all(fleet, "--complete-since", "7 days ago")[-1].endswith("3 continued")
    # What was begun again is complete now, so that a run that was ended goes on.
    assert verify_all(fleet, "--complete-since", "7 days ago")[-1].endswith("5 continued")


@pytest.mark.more
def test_a_fault_is_found_again_until_it_is_mended(fleet: str) -> None:
    verify_all(fleet)
    change(fleet, "UPDATE proposition_version SET fork = fork + 1 WHERE kb_id = 2")
    # Of an earlier revision: only a complete verification finds it.
    assert verify_all(fleet)[-1].endswith("5 continued")
    found = []
    for words in (["--complete"], [], ["--jobs", "2"]):
        done = run("verify", fleet, "--all", *words)
        found.append((done.exit_code, done.stdout.splitlines()[-1].partition(";")[0]))
    assert found == [(1, "5 knowledge bases: 1 not intact")] * 3
    change(fleet, "UPDATE proposition_version SET fork = fork - 1 WHERE kb_id = 2")
    assert verify_all(fleet)[-1].endswith("4 continued")


def test_indexes_are_compared_with_the_first_that_is_complete(fleet: str) -> None:
    verify_all(fleet)
    save_more(fleet, "robot 9", 9)
    change(fleet, "DROP INDEX ix_revision_committed_at")
    # The structure is checked once, whether continued or not.
    done = run("verify", fleet, "--all")
    assert done.exit_code == 1
    assert done.stdout.count("ix_revision_committed_at") == 1
    assert done.stdout.startswith("tiago: intact")


def test_processes_find_what_one_finds_in_the_same_order(fleet: str) -> None:
    change(fleet, "UPDATE revision SET reason = 'x' WHERE kb_id = 4")
    alone = run("verify", fleet, "--all", "--json")
    together = run("verify", fleet, "--all", "--jobs", "2", "--complete", "--json")
    assert alone.exit_code == together.exit_code == 1
    assert together.stderr == ""

    def found(output: str) -> list[Any]:
        documents = [json.loads(line) for line in output.splitlines()]
        return [(one["knowledge_base"], one["findings"], one["revisions"]) for one in documents]

    assert found(alone.stdout) == found(together.stdout)
    assert len(found(alone.stdout)) == 5


# The command, each verification of which waits for its turn, in whatever process it is.
BY_TURNS = """
import os
from kant_sql.cli import main, verifying

verify = verifying._verify

def wait_and_verify(*given):
    with open(os.environ["TURNS"], "rb", buffering=0) as turns:
        turns.read(1)
    return verify(*given)

verifying._verify = wait_and_verify

if __name__ == "__main__":
    main.run()
"""


@pytest.mark.more
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_run_that_was_killed_goes_on(tmp_path: Path, jobs: str) -> None:
    """What was verified before is not verified again, and no process outlives the first."""
    url = f"sqlite:///{tmp_path / 'fleet.db'}"
    names = [f"robot {number}" for number in range(30)]
    with kant_sql.open_store(url) as store:
        for name in names:
            kb = store.knowledge_base(name)
            kb.propositions.save_all(robot_at(place=waypoint(each)) for each in range(20))
            kb.propositions.delete_all()
    program, turns = tmp_path / "program.py", tmp_path / "turns"
    program.write_text(BY_TURNS)
    words = [sys.executable, str(program), "verify", url, "--all", "--json", "--jobs", jobs]
    own = {**environment(), "TURNS": str(turns)}
    verified = 0
    for _ in range(3):
        turns.unlink(missing_ok=True)
        os.mkfifo(turns)
        with (
            turns.open("r+b", buffering=0) as given,
            subprocess.Popen(words, stdout=subprocess.PIPE, env=own) as process,
        ):
            assert process.stdout is not None
            # So many may begin; it is killed when three fewer, at least, have ended.
            given.write(b"x" * (verified + 7))
            for _ in range(verified + 4):
                assert process.stdout.readline()
            children = psutil.Process(process.pid).children(recursive=True)
            assert len(children) >= int(jobs != "1")
            process.send_signal(signal.SIGKILL)
        _, alive = psutil.wait_procs(children, 20)
        assert alive == []
        now = [one for one in kant_sql.operations.knowledge_bases(url) if one.verified_revision]
        assert verified + 4 <= len(now) <= verified + 7 < len(names)
        verified = len(now)
    last = verify_all(url)[-1]
    assert last.startswith("30 knowledge bases: all intact; ")
    assert last.endswith(f"{verified} continued")


def test_who_may_only_read_is_told_that_nothing_is_kept(own_file: str) -> None:
    url = f"{own_file}?mode=ro"
    for _ in range(2):
        first, why, last = run("verify", url, "--all").stdout.splitlines()
        assert first == "tiago: intact (3 revisions, 13 changes)"
        assert why.startswith(f"tiago: where this ended is not kept: {url}: the file cannot be ")
        assert last == "1 knowledge base: all intact; 3 revisions verified, 0 continued"
    assert run("verify", url).stdout == "tiago: intact (3 revisions, 13 changes)\n"


def test_a_store_that_another_writer_holds_is_verified_to_the_end(
    own_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    be_impatient(monkeypatch)
    save_more(own_file, "newer", 7)
    with held(own_file):
        done = run("verify", f"{own_file}?timeout=0.1", "--all")
    assert done.exit_code == 0
    assert done.stdout.count("is not kept") == done.stdout.count("held the store for too long") == 2
    assert done.stdout.splitlines()[-1].startswith("2 knowledge bases: all intact; ")
    change(own_file, ALTER)
    with held(own_file):
        done = run("verify", f"{own_file}?timeout=0.1", "--kb", "tiago", "--continue")
    assert done.exit_code == 1
    assert "may still be kept, so verify with --complete next: " in done.stdout.splitlines()[-1]


def test_a_terminal_shows_how_far_it_is(sqlite_store: str) -> None:
    shown, told = in_terminal("verify", sqlite_store, is_output=False)
    assert "100%" in shown
    assert told == "default: intact (1 revisions, 6004 changes)\n"
