"""`kant-sql export`: the store as files."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from pyarrow import parquet

import kant_sql
from kant_sql.sql.audit_views import AUDIT_VIEWS
from tests.support.processes.commands import complaint, one_line, run


def test_all_views_are_written_and_told(own_store: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    lines = run("export", own_store, "--to", str(out)).stdout.splitlines()
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        moment = kb.store.anchor().heads[0].committed_at
        assert parquet.read_table(out / "audit_fact").num_rows == kb.store.to_arrow("fact").num_rows
    total = sum(parquet.read_table(out / view).num_rows for view in AUDIT_VIEWS)
    assert lines[0] == f"{out}: {len(AUDIT_VIEWS)} files with {total} rows"
    assert lines[1] == f"tiago: revision 3 of {moment}"
    assert lines[3:5] == [f"files ({len(AUDIT_VIEWS)})", lines[4]]
    assert lines[4].split() == ["file", "rows", "bytes"]
    assert [line.split()[0] for line in lines[5:]] == [
        f"{view}/knowledge_base=tiago/{view}.parquet" for view in AUDIT_VIEWS
    ]


@pytest.mark.parametrize("folder", ["out", "caf\udce9"])
def test_json_is_what_the_folder_has(own_store: str, tmp_path: Path, folder: str) -> None:
    words = ["--format", "csv", "--view", "fact", "--view", "audit_goal", "--kb", "tiago"]
    bounds = ["--since", "1", "--until", "2"]
    out = tmp_path / folder
    done = run("export", own_store, "--to", str(out), *words, *bounds, "--json")
    document = json.loads(done.stdout)
    assert document == json.loads((out / "_export.json").read_text(encoding="utf-8"))
    assert [file["content"] for file in document["files"]] == ["audit_fact", "audit_goal"]
    assert (document["since"], document["until"], document["format"]) == (1, 2, "csv")
    assert [file["rows"] for file in document["files"]] == [2, 0]


def test_a_folder_is_replaced_only_if_asked(own_store: str, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    for _ in range(2):
        done = run("export", "--to", out, "--view", "fact", "--replace", url=own_store)
        assert done.exit_code == 0
    error = run("export", own_store, "--to", out)
    assert error.exit_code == 1
    assert "--replace" in one_line(error.stderr)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--format", "xlsx"], 2, "parquet, csv, jsonl"),
        (["--predicate", "robot_at"], 2, "--predicate"),
        (["--element", "(robot_at rb1 wp1)", "--format", "csv"], 2, "--element"),
        (["--since", "soon"], 2, "--since"),
        (["--view", "facts"], 1, "choose one of: knowledge_base"),
        (["--kb", "nobody"], 1, "nobody"),
        (["--until", "2"], 1, "give a time"),
    ],
)
def test_what_is_wrong_is_one_line(
    own_store: str, tmp_path: Path, words: list[str], code: int, said: str
) -> None:
    out = tmp_path / "out"
    assert said in complaint("export", own_store, "--to", str(out), *words, code=code)
    assert not out.exists()


def test_a_place_that_cannot_be_written_is_one_line(own_store: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert str(tmp_path / "file" / "out") in complaint(
        "export", own_store, "--to", str(tmp_path / "file" / "out")
    )


def test_without_the_extra_one_line_names_it(
    own_store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install 'kant-sql[data]'" in complaint(
        "export", own_store, "--to", str(tmp_path / "out")
    )
    assert not (tmp_path / "out").exists()
