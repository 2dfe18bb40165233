"""Whatever stands in the tables, what reads them raises errors of the library, which say where."""

from __future__ import annotations

import functools
import itertools
import random
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from operator import attrgetter
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KantSqlError, KnowledgeBase
from kant_sql.errors import ArchivedError, StoreIntegrityError
from tests.support.faults import (
    NO_UTF8,
    Damage,
    damages,
    errors_of_reading,
    unguard,
    write_rich_story,
)
from tests.support.profile import PROFILE
from tests.support.servers import Server
from tests.support.stores import Connect, new_file_store
from tests.support.worlds.robots import robot_at, waypoint
from tests.support.worlds.story import DOMAIN, NAME, PROBLEM, write_story

SEEDS = range(10)
DAMAGES_OF_A_SEED = PROFILE.damages // len(SEEDS)
FLIPS = 40


@pytest.fixture(scope="session")
def rich(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with rows in each table; it is copied before it is damaged."""
    path = tmp_path_factory.mktemp("rich") / "story.db"
    write_rich_story(path)
    return path


@pytest.fixture
def copy(rich: Path, tmp_path: Path) -> Callable[[], Path]:
    numbers = itertools.count()

    def make() -> Path:
        path = tmp_path / f"{next(numbers)}.db"
        shutil.copy(rich, path)
        return path

    return make


def raw(errors: list[Exception]) -> list[Exception]:
    return [error for error in errors if not isinstance(error, KantSqlError)]


@pytest.mark.more
@pytest.mark.parametrize("seed", SEEDS)
def test_single_cells(rich: Path, copy: Callable[[], Path], seed: int) -> None:
    for damage in itertools.islice(damages(rich, seed), DAMAGES_OF_A_SEED):
        path = copy()
        damage.apply(path)
        assert not raw([*errors_of_reading(f"sqlite:///{path}")]), damage
        path.unlink()


@pytest.mark.more
@pytest.mark.parametrize("seed", range(100, 104))
def test_single_cells_before_a_write(rich: Path, copy: Callable[[], Path], seed: int) -> None:
    for damage in itertools.islice(damages(rich, seed), 4):
        path = copy()
        damage.apply(path)
        archive = f"sqlite:///{path}.archive"
        assert not raw([*errors_of_reading(f"sqlite:///{path}", archive)]), damage


@pytest.mark.more
@pytest.mark.parametrize("seed", range(4))
def test_flipped_bits(copy: Callable[[], Path], seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(FLIPS // 4):
        path = copy()
        content = bytearray(path.read_bytes())
        place = chance.randrange(100, len(content))
        content[place] ^= 1 << chance.randrange(8)
        path.write_bytes(content)
        assert not raw([*errors_of_reading(f"sqlite:///{path}")]), place
        path.unlink()


def test_what_is_not_damaged_is_read_without_an_error(copy: Callable[[], Path]) -> None:
    errors = errors_of_reading(f"sqlite:///{copy()}")
    # Before revision 9 a part is in the archive.
    assert not [error for error in errors if not isinstance(error, ArchivedError)]


# What was raised as it came from the depths: where, what, by which call, and what the error names.
KNOWN: list[tuple[str, str, Any, str, str]] = [
    ("action_term", "parameter", 99, "actions.get_all", r"table action_version, action \d+"),
    ("action_parameter", "position", "nan", "actions.get_all", r"table action_version, action \d+"),
    ("action_variable", "section", "{", "actions.get_all", r"table action_version, action \d+"),
    ("formula_node", "operator", "x", "pddl.metric.get", "table formula_version"),
    ("formula_node", "value", b"\xff", "problem_pddl", r"table formula_version, formula \d+"),
    ("formula_version", "section", b"", "goals.get_all", r"table formula_version, formula \d+"),
    ("type_version", "text", None, "types.get_all", r"table type_version, type \d+"),
    ("proposition", "arguments", "()", "propositions.get_all", r"table proposition, id \d+"),
    ("function_value", "arguments", None, "function_values.get_all", r"function_value, id \d+"),
    ("head", "definition_revision", "and", "goals.get_all", "head, knowledge base 1: .*'and'"),
    ("head", "committed_at", "\0", "propositions.delete_all", "head, knowledge base 'depot' of "),
    ("revision", "committed_at", "noon", "store.anchor", r"revision \d+ of"),
    ("head", "archived_revision", "1/3", "changes", "table head"),
    ("revision", "committed_at", "noon", "store.revisions", r"table revision, revision \d+"),
    ("revision", "source", "{", "store.revisions", r"table revision, revi.*\d:"),
    ("execution", "start", "{", "plans.get_all", r"table execution, execution \d+\.0"),
    ("plan", "value", "x", "plans.get_all", r"table plan, plan \d+"),
]


@pytest.mark.parametrize(
    ("table", "column", "value", "call", "named"),
    KNOWN,
    ids=[f"{table}.{column}" for table, column, *_ in KNOWN],
)
def test_the_error_names_table_and_key(
    copy: Callable[[], Path],
    connect: Connect,
    table: str,
    column: str,
    value: Any,
    call: str,
    named: str,
) -> None:
    path = copy()
    with closing(sqlite3.connect(path, isolation_level=None)) as bare:
        bare.execute("PRAGMA ignore_check_constraints=ON")
        bare.execute(
            f"UPDATE OR IGNORE {table} SET {column} = ? WHERE {column} IS NOT NULL", (value,)
        )
    kb = connect(f"sqlite:///{path}", knowledge_base=NAME)
    asked = attrgetter(call)(kb.at(10) if table == "proposition" else kb)
    with pytest.raises(StoreIntegrityError, match=named) as caught:
        _ = [*asked(9)] if call == "changes" else asked()
    assert caught.value.__cause__ is not None or "not an integer" in str(caught.value)


def test_text_that_is_no_utf8(copy: Callable[[], Path], connect: Connect) -> None:
    path = copy()
    Damage("type", "name", ("rowid", (1,)), NO_UTF8, ()).apply(path)
    kb = connect(f"sqlite:///{path}", knowledge_base=NAME)
    with pytest.raises(KantSqlError):
        kb.types.get_all()


@pytest.fixture(scope="module")
def rich_server(server: Server, tmp_path_factory: pytest.TempPathFactory) -> str:
    url = server.new_store()
    write_story(url, f"sqlite:///{tmp_path_factory.mktemp('archive') / 'archive.db'}")
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    return url


@pytest.mark.more
@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM formula_node WHERE position = 1",
        "DELETE FROM action_term",
        "DELETE FROM predicate_parameter_type",
        "DELETE FROM type_version",
        "DELETE FROM head",
        "UPDATE proposition SET arguments = 'x'",
        "UPDATE function_value SET arguments = ''",
        "UPDATE formula_node SET operator = 'nonsense'",
        "UPDATE object SET name = '('",
        "UPDATE execution SET start = '{' WHERE plan_id > 0",
        "UPDATE revision SET committed_at = 'infinity'",
        "UPDATE revision SET number = number + 1000",
    ],
)
def test_on_postgresql(rich_server: str, statement: str) -> None:
    name = make_url(rich_server).database
    copy = f"{name}_damaged"
    base = url_of(rich_server, "postgres")
    with psycopg.connect(base, autocommit=True) as connection:
        connection.execute(f'DROP DATABASE IF EXISTS "{copy}"')
        connection.execute(f'CREATE DATABASE "{copy}" TEMPLATE "{name}" STRATEGY file_copy')
    url = url_of(rich_server, copy)
    with psycopg.connect(url, autocommit=True) as connection:
        # Foreign keys and triggers rest.
        connection.execute("SET session_replication_role = replica")
        for table, constraint in connection.execute(
            "SELECT conrelid::regclass::text, conname FROM pg_constraint WHERE contype = 'c' "
            "AND connamespace = 'public'::regnamespace"
        ).fetchall():
            connection.execute(f'ALTER TABLE {table} DROP CONSTRAINT "{constraint}"')
        connection.execute(statement)
    errors = [*errors_of_reading(url)]
    assert not raw(errors)
    assert errors


def url_of(url: str, database: str) -> str:
    """Give the URL of another database of the same server."""
    return make_url(url).set(database=database).render_as_string(hide_password=False)


TIMES = ("-infinity", "infinity", "4000-01-01 BC", "12000-01-01")


@pytest.mark.more
@pytest.mark.parametrize("moment", TIMES)
def test_a_time_that_is_none_stops_only_those_who_read_it(
    moment: str, server: Server, connect: Connect
) -> None:
    url = server.new_store()
    kb, other = (connect(url, knowledge_base=name) for name in ("tiago", "pepper"))
    for place in range(3):
        kb.propositions.save(robot_at(place=waypoint(place)))
        other.propositions.save(robot_at(place=waypoint(place)))
    before = [entry.revision for entry in kb.log(limit=1)]
    with psycopg.connect(url) as owner:
        for column, number in (("committed_at", 1), ("observed_at", 2)):
            owner.execute(
                f"UPDATE revision SET {column} = %s FROM knowledge_base AS k "
                "WHERE k.id = kb_id AND k.name = 'tiago' AND number = %s".encode(),
                (moment, number),
            )
    for opened in (kb, connect(url, knowledge_base="tiago")):
        assert len(opened.propositions.get_all()) == 3
        assert len(opened.at(1).propositions.get_all()) == 1
        assert [entry.revision for entry in opened.log(limit=1)] == before
        with pytest.raises(
            StoreIntegrityError, match=r"table revision, revision 1: .*is not a time"
        ):
            opened.store.revisions()
        with pytest.raises(
            StoreIntegrityError, match=r"table revision, revision 2: .*is not a time"
        ):
            list(opened.log())
        assert {finding.revision for finding in opened.store.verify().findings} == {1, 2}
    kb.propositions.delete(robot_at(place=waypoint(0)))
    assert other.store.verify().is_intact
    assert len(other.store.revisions()) == 3


@pytest.mark.parametrize(
    ("cycle", "name"),
    [
        ("UPDATE type_version SET parent_id = 1 WHERE type_id = 3", "a"),
        ("UPDATE type_version SET parent_id = 3 WHERE type_id = 3", "c"),
        ("INSERT INTO type_parent VALUES (1, 2, 1, 1, 1)", "a"),
    ],
    ids=["of three", "of one", "of a further parent"],
)
def test_types_that_are_above_themselves_end_a_reader(
    tmp_path: Path, connect: Connect, cycle: str, name: str
) -> None:
    url = new_file_store(tmp_path / "cycle.db")
    with kant_sql.connect(url) as kb:
        kb.load_domain("(define (domain d) (:types a - b b - c c - object) (:constants o - a))")
    with closing(sqlite3.connect(tmp_path / "cycle.db", isolation_level=None)) as bare:
        bare.execute(cycle)
    kb = connect(url)
    for call in (kb.types.get_all, lambda: kb.types.get(name), kb.objects.get_all):
        with pytest.raises(StoreIntegrityError, match=r"type_version, type .* above itself"):
            call()
    assert {finding.table for finding in kb.store.verify().findings} & {
        "type_version",
        "type_parent",
    }


# What reads the head before it does anything else.
HEAD_READERS: dict[str, Callable[[KnowledgeBase], object]] = {
    "at": lambda kb: kb.at(2).objects.get_all(),
    "at a time": lambda kb: kb.at(kb.store.revisions()[1].committed_at).objects.get_all(),
    "diff": lambda kb: kb.diff(1, 3),
    "log": lambda kb: list(kb.log()),
    "log of a time": lambda kb: list(kb.log(until=kb.store.revisions()[1].committed_at)),
    "changes": lambda kb: list(kb.changes()),
    "watch": lambda kb: kb.watch(0, timeout=0),
    "restore": lambda kb: kb.restore(1),
    "archive": lambda kb: kb.store.archive(2, to="sqlite:///nowhere.db", dry_run=True),
    "anchor": lambda kb: kb.store.anchor(),
    "save": lambda kb: kb.propositions.save(robot_at(place=waypoint(9))),
}
# By whether the head is at no number, at one that no revision has, or is damaged elsewhere.
NO_NUMBER = ("'abc'", "'12x'", "500.5", "9e999", "-9e999", "NULL", "x'ff'")
BEYOND = ("4611686018427387904", "1000000")


@pytest.mark.parametrize("value", [*NO_NUMBER, "-5"])
def test_a_head_at_no_number_is_an_error_of_each_reader(
    tmp_path: Path, connect: Connect, value: str
) -> None:
    kb = _three_revisions(tmp_path, connect)
    _damage_head(tmp_path, f"revision = {value}")
    for name, call in HEAD_READERS.items():
        with pytest.raises(StoreIntegrityError, match=r"(?i)head|revision"):
            pytest.fail(f"{name} gave {call(kb)}")
    _names_column(kb, "revision", value)


def _names_column(kb: KnowledgeBase, column: str, value: str) -> None:
    """Check that verification finds a head, and names a column that has no integer."""
    found = kb.store.verify().findings
    assert found
    is_integer = value in ("NULL", "-5") or column in ("committed_at", "hash")
    said = f"column {column} has 1 value that"
    assert is_integer or ("head", True) in {(one.table, said in one.message) for one in found}


@pytest.mark.parametrize("value", BEYOND)
@pytest.mark.parametrize("name", ["log", "anchor", "changes"])
def test_a_head_far_beyond_the_last_revision_ends_a_reader(
    tmp_path: Path, connect: Connect, value: str, name: str
) -> None:
    kb = _three_revisions(tmp_path, connect)
    _damage_head(tmp_path, f"revision = {value}")
    with pytest.raises(StoreIntegrityError):
        HEAD_READERS[name](kb)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *(("committed_at", value) for value in ("5", "x'ff'", "1.5", "'soon'", "9e999")),
        *(("hash", value) for value in ("5", "NULL", "x'ff'", "1.5", "9e999")),
        *(("next_id", value) for value in ("'abc'", "500.5", "9e999", "NULL", "-5")),
        *(("definition_revision", value) for value in NO_NUMBER),
        *(("archived_revision", value) for value in NO_NUMBER),
    ],
)
def test_a_head_that_is_damaged_elsewhere_is_not_written_on(
    tmp_path: Path, connect: Connect, column: str, value: str
) -> None:
    kb = _three_revisions(tmp_path, connect)
    _damage_head(tmp_path, f"{column} = {value}")
    with pytest.raises(StoreIntegrityError, match="head"):
        HEAD_READERS["save"](kb)
    _names_column(kb, column, value)
    if column in ("definition_revision", "archived_revision"):
        with pytest.raises(StoreIntegrityError, match=f"column {column} of table head has"):
            HEAD_READERS["log"](kb)


def test_an_archive_of_which_there_is_no_record(tmp_path: Path, connect: Connect) -> None:
    kb = _three_revisions(tmp_path, connect)
    _damage_head(tmp_path, "archived_revision = 4611686018427387904")
    for name in ("at", "diff", "log", "changes", "restore"):
        with pytest.raises(StoreIntegrityError, match="no record of one"):
            pytest.fail(f"{name} gave {HEAD_READERS[name](kb)}")
    assert not kb.store.verify().is_intact


@functools.cache
def _three_revisions_of_a_file() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "head.db")
        with kant_sql.connect(new_file_store(path), actor="tester") as kb:
            for number in range(3):
                kb.propositions.save(robot_at(place=waypoint(number)))
        # Without the checks of columns, as a damaged file has none either.
        with closing(sqlite3.connect(path, isolation_level=None)) as bare:
            unguard(bare)
            bare.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return path.read_bytes()


def _three_revisions(folder: Path, connect: Connect) -> KnowledgeBase:
    (folder / "head.db").write_bytes(_three_revisions_of_a_file())
    return connect(f"sqlite:///{folder / 'head.db'}", actor="tester")


def _damage_head(folder: Path, assignment: str) -> None:
    with closing(sqlite3.connect(folder / "head.db", isolation_level=None)) as bare:
        bare.execute("PRAGMA ignore_check_constraints=ON")
        bare.execute(f"UPDATE head SET {assignment}")
