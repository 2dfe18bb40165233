"""The store as files: types, rows, folders, and all of them or none. The same on both databases."""

from __future__ import annotations

import csv
import json
import os
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import duckdb
import pandas
import polars
import pyarrow
import pytest
from pyarrow import parquet

import kant_sql
from kant_sql import InvalidArgumentError, KantSqlError, UnknownRevisionError
from kant_sql.errors import ExtraMissingError, SchemaMissingError
from kant_sql.export import FORMATS, Exported, export_store, open_reader
from kant_sql.export.files import MANIFEST, WRITERS, folder_name
from kant_sql.json_values import json_value
from kant_sql.sql import audit_views
from kant_sql.sql.audit_views import AUDIT_VIEWS
from tests.support.pages import ask, rows_of
from tests.support.worlds.robots import WP2, robot_at

OF_COURIER = "knowledge_base=courier"
# Names that are not folders, or mean something to who reads partitions.
HOSTILE = (
    *("a/b", "..", "../up", ".hidden", "a=b", "a%2Fb", "ü ß 🤖", "NULL", "007", "true"),
    *("__HIVE_DEFAULT_PARTITION__", "2026-01-01", "a\\b:c*?\"<>|'", "$(rm -rf x) `y`"),
    *("e" * 255, "🤖" * 255),
)


def read(folder: Path, view: str, knowledge_base: str = "courier") -> pyarrow.Table:
    """Read the Parquet file of a view, with the name as text."""
    path = folder / view / folder_name(knowledge_base) / f"{view}.parquet"
    table = parquet.ParquetFile(path).read()
    return table.set_column(0, "knowledge_base", table[0].cast(pyarrow.string()))


def listed(folder: Path) -> set[str]:
    """Give the files of a folder."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_parquet_has_what_the_knowledge_base_gives(story_url: str, tmp_path: Path) -> None:
    exported = export_store(story_url, to=tmp_path / "out")
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        for view in AUDIT_VIEWS:
            assert read(tmp_path / "out", view) == kb.store.to_arrow(view)
        (state,) = (each for each in exported.knowledge_bases if each.name == "courier")
        (head,) = (each for each in kb.store.anchor().heads if each.knowledge_base == "courier")
        assert (state.revision, state.hash, state.committed_at) == (
            *(head.revision, head.hash),
            head.committed_at,
        )
    assert len(exported.files) == 2 * len(AUDIT_VIEWS)


@pytest.mark.parametrize("format", FORMATS)
def test_both_databases_give_the_same_files(
    sqlite_story: str, postgresql_story: str, tmp_path: Path, format: str
) -> None:
    """Byte for byte: the order of rows, too."""
    made = [
        export_store(url, to=tmp_path / str(number), format=format, knowledge_base="courier")
        for number, url in enumerate((sqlite_story, postgresql_story))
    ]
    assert made[0].files == made[1].files
    assert made[0].knowledge_bases == made[1].knowledge_bases


def test_the_manifest_says_what_is_there(story_url: str, tmp_path: Path) -> None:
    exported = export_store(story_url, to=tmp_path, format="jsonl")
    document = json.loads((tmp_path / MANIFEST).read_text(encoding="utf-8"))
    assert document == json_value(exported)
    assert listed(tmp_path) == {MANIFEST, *(file.path for file in exported.files)}
    for file in exported.files:
        content = (tmp_path / file.path).read_bytes()
        assert (file.bytes, file.sha256) == (len(content), sha256(content).hexdigest())
        assert file.rows == content.count(b"\n")
        assert file.path.startswith(f"{file.content}/{folder_name(file.knowledge_base)}/")


def test_csv_has_text_in_quotes_and_nothing_for_null(story_url: str, tmp_path: Path) -> None:
    export_store(story_url, to=tmp_path, format="csv", views=["fact", "object"])
    name = f"audit_fact/{OF_COURIER}/audit_fact.csv"
    with (tmp_path / name).open(encoding="utf-8", newline="") as file:
        found = [*csv.DictReader(file)]
    kept = ask(
        story_url,
        "SELECT text, since_at, until FROM audit_fact WHERE "
        "knowledge_base = 'courier' ORDER BY since, kind, proposition_id",
    )
    assert [
        f"{row['text']} | {row['since_at']} | {row['until'] or 'NULL'}" for row in found
    ] == kept
    objects = (tmp_path / f"audit_object/{OF_COURIER}/audit_object.csv").read_text()
    assert '"rb1",' in objects
    assert ",false," in objects
    assert objects.splitlines()[1].endswith(",,,,,,,,2")


def test_json_lines_have_every_column_with_its_type(story_url: str, tmp_path: Path) -> None:
    export_store(story_url, to=tmp_path, format="jsonl", views=["revision", "audit_object"])
    lines = (tmp_path / f"audit_revision/{OF_COURIER}/audit_revision.jsonl").read_text("utf-8")
    rows = [json.loads(line) for line in lines.splitlines()]
    assert [*rows[0]] == [*AUDIT_VIEWS["audit_revision"].columns]
    assert rows[3]["committed_at"] == "2026-03-02T09:00:00.000000Z"
    assert rows[3]["observed_at"] == "2026-03-02T08:59:59.000000Z"
    assert rows[3]["source"] == '{"camera":1}'
    assert rows[3]["delay"] == 1.0
    assert rows[0]["observed_at"] is None


def test_a_number_too_large_for_a_double_is_null_in_json(tmp_path: Path) -> None:
    table = pyarrow.record_batch({"number": [1.5, float("inf"), None, float("nan")]})
    with (tmp_path / "x").open("wb") as file, WRITERS["jsonl"](file, table.schema) as write:
        write(table)
    found = [json.loads(line)["number"] for line in (tmp_path / "x").read_text().splitlines()]
    assert found == [1.5, None, None, None]


def test_tools_read_the_partitions_as_one_table(story_url: str, tmp_path: Path) -> None:
    export_store(story_url, to=tmp_path / "out")
    export_store(story_url, to=tmp_path / "csv", format="csv")
    export_store(story_url, to=tmp_path / "jsonl", format="jsonl")
    counts = dict(rows_of(story_url, "SELECT knowledge_base, count(*) FROM audit_fact GROUP BY 1"))
    for folder, ending in (("out", "parquet"), ("csv", "csv"), ("jsonl", "jsonl")):
        files = f"'{tmp_path}/{folder}/audit_fact/*/*.{ending}'"
        question = f"SELECT knowledge_base, count(*) FROM {files} GROUP BY 1"
        assert dict(duckdb.sql(question).fetchall()) == counts
        types = {row[0]: row[1] for row in duckdb.sql(f"DESCRIBE SELECT * FROM {files}").fetchall()}
        assert (types["since"], types["duration"]) == ("BIGINT", "DOUBLE")
        assert types["since_at"].startswith("TIMESTAMP")
    frame = pandas.read_parquet(tmp_path / "out" / "audit_fact")
    assert frame.groupby("knowledge_base", observed=True).size().to_dict() == counts
    assert str(frame["since_at"].dtype) == "datetime64[us, UTC]"
    lazy = polars.scan_parquet(tmp_path / "out" / "audit_fact")
    by_name = lazy.group_by(polars.col("knowledge_base").cast(polars.String)).len().collect()
    assert dict(by_name.rows()) == counts


@pytest.fixture
def hostile_url(scratch_url: str) -> str:
    """The URL of a store with knowledge bases of hostile names."""
    for name in HOSTILE:
        with kant_sql.connect(scratch_url, knowledge_base=name, actor=name) as kb:
            if not kb.revision:
                kb.propositions.save(robot_at())
    return scratch_url


def test_no_name_leaves_the_folder_or_is_lost(hostile_url: str, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    exported = export_store(hostile_url, to=tmp_path / "in" / "out", views=["fact"])
    assert os.listdir(tmp_path) == ["in"]
    assert os.listdir(tmp_path / "in") == ["out"]
    assert listed(tmp_path / "in" / "out") == {MANIFEST, *(file.path for file in exported.files)}
    named = {file.knowledge_base: file.path for file in exported.files}
    assert named.keys() >= set(HOSTILE)
    assert all(path.isascii() and path.count("/") == 2 for path in named.values())
    for name in HOSTILE:
        (row,) = read(tmp_path / "in" / "out", "audit_fact", name).to_pylist()
        assert (row["knowledge_base"], row["asserted_by"]) == (name, name)


def test_tools_read_hostile_names(hostile_url: str, tmp_path: Path) -> None:
    export_store(hostile_url, to=tmp_path, views=["fact"])
    frames = {
        "duckdb": duckdb.sql(
            f"SELECT knowledge_base FROM read_parquet('{tmp_path}/audit_fact/*/*.parquet', "
            "hive_partitioning = false)"
        ).fetchall(),
        "polars": polars.scan_parquet(f"{tmp_path}/audit_fact/*/*.parquet")
        .select(polars.col("knowledge_base").cast(polars.String))
        .collect()
        .rows(),
        "pandas": [
            (name,)
            for name in pandas.read_parquet(tmp_path / "audit_fact", partitioning=None)[
                "knowledge_base"
            ]
        ],
    }
    for found in frames.values():
        assert {row[0] for row in found} >= set(HOSTILE)
    # What DuckDB makes of the folders' names where these could be as they are.
    hive = duckdb.sql(f"SELECT knowledge_base FROM '{tmp_path}/audit_fact/*/*.parquet'").fetchall()
    assert {row[0] for row in hive} >= {name for name in HOSTILE if len(name) < 255}


def test_folders_are_named_alike_everywhere() -> None:
    assert folder_name("tiago") == "knowledge_base=tiago"
    assert folder_name("a/b ü") == "knowledge_base=a%2Fb%20%C3%BC"
    assert folder_name("..") == "knowledge_base=%2E."
    long = [folder_name("🤖" * 255), folder_name("🤖" * 254), folder_name("e" * 255)]
    assert all(len(name) <= 255 and "~" in name for name in long)
    assert len(set(long)) == 3


def test_bounds_choose_revisions_times_and_intervals(story_url: str, tmp_path: Path) -> None:
    noon = datetime(2026, 3, 2, 12, tzinfo=UTC)
    two = datetime(2026, 3, 2, 14, tzinfo=UTC)
    by_time = export_store(
        story_url, to=tmp_path / "a", knowledge_base="courier", since=noon, until=two
    )
    by_number = export_store(
        story_url, to=tmp_path / "b", knowledge_base="courier", since=22, until=29
    )
    assert by_time.files == by_number.files
    assert (by_time.since, by_number.until) == ("2026-03-02T12:00:00.000000Z", 29)
    assert read(tmp_path / "a", "audit_revision")["revision"].to_pylist() == [*range(22, 30)]
    for row in read(tmp_path / "a", "audit_fact").to_pylist():
        assert row["since"] <= 29
        assert row["until"] is None or row["until"] >= 22
    assert read(tmp_path / "a", "audit_plan").num_rows == 0
    assert read(tmp_path / "a", "audit_plan_step").num_rows == 0
    assert read(tmp_path / "a", "audit_knowledge_base").num_rows == 1
    all_of_it = export_store(
        story_url, to=tmp_path / "c", knowledge_base="courier", since=1, until=36
    )
    whole = export_store(story_url, to=tmp_path / "d", knowledge_base="courier")
    assert all_of_it.files == whole.files
    nothing = export_store(
        story_url, to=tmp_path / "e", until=datetime(1, 1, 1, tzinfo=UTC), views=["revision"]
    )
    assert sum(file.rows for file in nothing.files) == 0


WRONG: dict[str, tuple[dict[str, Any], type[KantSqlError], str]] = {
    "format": ({"format": "xlsx"}, InvalidArgumentError, "expected one of parquet, csv, jsonl"),
    "no format": ({"format": None}, InvalidArgumentError, "format"),
    "view": ({"views": ["facts"]}, InvalidArgumentError, "choose one of"),
    "views": ({"views": "fact"}, KantSqlError, "views"),
    "knowledge base": ({"knowledge_base": "nobody"}, KantSqlError, "choose one of: 'other'"),
    "no name": ({"knowledge_base": 3}, InvalidArgumentError, "knowledge_base"),
    "number": ({"since": 3}, InvalidArgumentError, "choose that, or give a time"),
    "future": ({"since": 99, "knowledge_base": "courier"}, UnknownRevisionError, "it is at 36"),
    "text": ({"until": "late", "knowledge_base": "courier"}, InvalidArgumentError, "nor a time"),
    "zone": ({"since": datetime(2026, 3, 2)}, UnknownRevisionError, "no zone"),
    "reversed": (
        {"since": 5, "until": 4, "knowledge_base": "courier"},
        InvalidArgumentError,
        "since 5 is after until 4; swap them",
    ),
    "times": (
        {"since": datetime(2026, 3, 2, 14, tzinfo=UTC), "until": "2026-03-02 12:00"},
        InvalidArgumentError,
        "ends before it begins",
    ),
    "time and number": (
        {"since": "2026-03-02 14:00", "until": 3, "knowledge_base": "courier"},
        InvalidArgumentError,
        "is after until 3; swap them",
    ),
    "replace": ({"replace": "yes"}, InvalidArgumentError, "replace"),
    "progress": ({"progress": 3}, InvalidArgumentError, "progress"),
    "folder": ({"to": ""}, InvalidArgumentError, "folder"),
    "bytes": ({"to": b"x"}, InvalidArgumentError, "folder"),
    "zero": ({"to": "a\0b"}, InvalidArgumentError, "folder"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_and_nothing_is_made(
    sqlite_story: str, tmp_path: Path, case: str
) -> None:
    given, error, words = WRONG[case]
    with pytest.raises(error, match=words):
        export_store(sqlite_story, **{"to": tmp_path / "out", **given})
    assert os.listdir(tmp_path) == []


def test_a_store_without_tables_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(KantSqlError):
        export_store(f"sqlite:///{tmp_path / 'no.db'}", to=tmp_path / "out")
    sqlite3.connect(tmp_path / "empty.db").close()
    with pytest.raises(SchemaMissingError):
        export_store(f"sqlite:///{tmp_path / 'empty.db'}", to=tmp_path / "out")
    assert {path.name for path in tmp_path.iterdir()} <= {"empty.db"}


def test_an_empty_store_is_an_empty_export(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    kant_sql.upgrade(url)
    exported = export_store(url, to=tmp_path / "out")
    assert (exported.files, exported.knowledge_bases) == ((), ())
    assert listed(tmp_path / "out") == {MANIFEST}
    with open_reader(url, view="fact") as reader:
        assert reader.read_all().num_rows == 0


def test_other_files_are_never_touched(sqlite_story: str, tmp_path: Path) -> None:
    export_store(sqlite_story, to=tmp_path)
    with pytest.raises(InvalidArgumentError, match="--replace"):
        export_store(sqlite_story, to=tmp_path)
    (tmp_path / "audit_fact" / "mine.txt").write_text("mine")
    before = listed(tmp_path)
    with pytest.raises(InvalidArgumentError, match=r"audit_fact/mine\.txt"):
        export_store(sqlite_story, to=tmp_path, replace=True)
    assert listed(tmp_path) == before
    file = tmp_path / "audit_fact" / "mine.txt"
    for replace in (False, True):
        with pytest.raises((InvalidArgumentError, OSError)):
            export_store(sqlite_story, to=file, replace=replace)
    assert file.read_text() == "mine"


def test_a_manifest_cannot_name_what_is_outside(sqlite_story: str, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    out = tmp_path / "out"
    export_store(sqlite_story, to=out, views=["fact"])
    document = json.loads((out / MANIFEST).read_text())
    document["files"].append({"path": "../victim"})
    (out / MANIFEST).write_text(json.dumps(document))
    export_store(sqlite_story, to=out, views=["fact"], replace=True)
    assert victim.read_text() == "mine"


def test_replacing_leaves_nothing_of_the_export_before(sqlite_story: str, tmp_path: Path) -> None:
    export_store(sqlite_story, to=tmp_path, format="csv")
    second = export_store(
        sqlite_story, to=tmp_path, views=["fact"], knowledge_base="other", replace=True
    )
    assert listed(tmp_path) == {MANIFEST, *(file.path for file in second.files)}
    assert len(second.files) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == [MANIFEST, "audit_fact"]


@pytest.mark.parametrize("is_there", [False, True])
def test_a_failure_leaves_the_folder_as_it_was(
    story_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_there: bool
) -> None:
    out = tmp_path / "out"
    if is_there:
        export_store(story_url, to=out, views=["object"])
    before = listed(tmp_path)

    def fail(done: int, whole: int) -> None:
        if done > whole // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_store(story_url, to=out, replace=True, progress=fail)
    assert listed(tmp_path) == before
    assert out.exists() == is_there


def test_progress_goes_on_to_the_end(story_url: str, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    export_store(story_url, to=tmp_path, progress=lambda *numbers: told.append(numbers))
    assert told == sorted(told)
    assert len({whole for _, whole in told}) == 1
    assert told[-1][0] == told[-1][1] > 0


def test_what_is_written_meanwhile_is_not_in_it(tmp_path: Path, scratch_url: str) -> None:
    """Every view is of the state in which the first was read."""
    with kant_sql.connect(scratch_url, knowledge_base="busy") as kb:
        kb.propositions.save(robot_at())

        def write(done: int, whole: int) -> None:
            kb.propositions.save(robot_at(place=WP2))
            kb.propositions.delete(robot_at(place=WP2))

        exported = export_store(scratch_url, to=tmp_path, knowledge_base="busy", progress=write)
        assert kb.revision > 30
    assert [state.revision for state in exported.knowledge_bases] == [1]
    for view in ("audit_revision", "audit_change", "audit_plan", "audit_fact", "audit_archive"):
        table = read(tmp_path, view, "busy")
        assert not table.num_rows or max(table[AUDIT_VIEWS[view].order[0]].to_pylist()) == 1


def test_batches_end_by_rows_and_by_characters(
    story_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = export_store(story_url, to=tmp_path / "0", format="jsonl")
    for number, (name, size) in enumerate((("BATCH_ROWS", 3), ("BATCH_CHARACTERS", 100)), 1):
        with monkeypatch.context() as patch:
            patch.setattr(audit_views, name, size)
            parts = export_store(story_url, to=tmp_path / str(number), format="jsonl")
            with open_reader(story_url, view="change") as reader:
                assert len([*reader]) > 10
        assert parts.files == whole.files


def test_a_reader_gives_all_knowledge_bases_or_one(story_url: str) -> None:
    with open_reader(story_url, view="audit_fact", knowledge_base="courier") as reader:
        courier = reader.read_all()
    with open_reader(story_url, view="fact") as reader:
        assert reader.read_all().slice(2) == courier
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        assert kb.store.to_arrow("fact") == courier
    for wrong in ({"view": "x"}, {"view": "fact", "knowledge_base": "nobody"}):
        with pytest.raises(KantSqlError), open_reader(story_url, **wrong):
            pass


def test_a_reader_left_early_leaves_the_store_free(sqlite_story: str, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save(robot_at())
    with open_reader(url, view="change") as reader:
        assert reader.read_next_batch().num_rows
    with closing(sqlite3.connect(tmp_path / "store.db", timeout=0)) as other:
        other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert other.execute("PRAGMA journal_mode=DELETE").fetchone() == ("delete",)


def test_an_archived_store_says_where_its_history_begins(tmp_path: Path) -> None:
    url, old = (f"sqlite:///{tmp_path / name}.db" for name in ("store", "old"))
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        for place in (None, WP2, None, WP2):
            kb.propositions.delete_all()
            kb.propositions.save(robot_at() if place is None else robot_at(place=place))
        kb.store.archive(4, to=old)
    exported = export_store(url, to=tmp_path / "out")
    assert exported.knowledge_bases[0].archived == 3
    assert read(tmp_path / "out", "audit_archive", "tiago").num_rows == 1
    moved = export_store(old, to=tmp_path / "old")
    assert moved.knowledge_bases[0].revision == 3


def test_without_pyarrow_the_extra_is_named(
    sqlite_story: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    calls: list[Callable[[], Exported | object]] = [
        lambda: export_store(sqlite_story, to=tmp_path / "out"),
        lambda: open_reader(sqlite_story, view="fact").__enter__(),
    ]
    for call in calls:
        with pytest.raises(ExtraMissingError, match=r"pip install 'kant-sql\[data\]'"):
            call()
    assert os.listdir(tmp_path) == []
