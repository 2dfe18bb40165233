"""Whatever stands in the tables, what reads them raises errors of the library, which say where."""

from __future__ import annotations

import itertools
import random
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import ArchivedError, KantSqlError, KnowledgeBase, StoreIntegrityError
from tests.conftest import Connect, Server
from tests.damaging import NO_UTF8, Damage, damages, errors_of_reading, write_rich_story
from tests.verify.story import DOMAIN, NAME, PROBLEM, write_story
from tests.worlds import robot_at, waypoint

SEEDS, DAMAGES_OF_A_SEED = range(10), 20
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


@pytest.mark.parametrize("seed", SEEDS)
def test_single_cells(rich: Path, copy: Callable[[], Path], seed: int) -> None:
    for damage in itertools.islice(damages(rich, seed), DAMAGES_OF_A_SEED):
        path = copy()
        damage.apply(path)
        assert not raw([*errors_of_reading(f"sqlite:///{path}")]), damage
        path.unlink()


@pytest.mark.parametrize("seed", range(100, 104))
def test_single_cells_before_a_write(rich: Path, copy: Callable[[], Path], seed: int) -> None:
    for damage in itertools.islice(damages(rich, seed), 4):
        path = copy()
        damage.apply(path)
        archive = f"sqlite:///{path}.archive"
        assert not raw([*errors_of_reading(f"sqlite:///{path}", archive)]), damage


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


def goals(kb: KnowledgeBase) -> object:
    return kb.goals.get_all()


def actions(kb: KnowledgeBase) -> object:
    return kb.actions.get_all()


def problem(kb: KnowledgeBase) -> object:
    return kb.problem_pddl()


# What was raised as it came from the depths: where, what, by which call, and what the error names.
KNOWN: list[tuple[str, str, Any, Callable[[KnowledgeBase], object], str]] = [
    ("action_term", "parameter", 99, actions, r"table action_version, action \d+"),
    ("action_parameter", "position", "nan", actions, r"table action_version, action \d+"),
    ("action_variable", "section", "{", actions, r"table action_version, action \d+"),
    ("formula_node", "operator", "x", lambda kb: kb.metric.get(), "table formula_version"),
    ("formula_node", "value", b"\xff", problem, r"table formula_version, formula \d+"),
    ("formula_version", "section", b"", goals, r"table formula_version, formula \d+"),
    ("type_version", "text", None, lambda kb: kb.types.get_all(), r"table type_version, type \d+"),
    (
        "proposition",
        "arguments",
        "()",
        lambda kb: kb.at(10).propositions.get_all(),
        r"table proposition, id \d+",
    ),
    (
        "function_value",
        "arguments",
        None,
        lambda kb: kb.function_values.get_all(),
        r"table function_value, id \d+",
    ),
    ("head", "definition_revision", "and", goals, "table head, knowledge base 1: .*'and'"),
    (
        "head",
        "committed_at",
        "\0",
        lambda kb: kb.propositions.delete_all(),
        "table head, knowledge base 1",
    ),
    ("revision", "committed_at", "noon", lambda kb: kb.anchor(), r"revision \d+ of"),
    ("head", "archived_revision", "1/3", lambda kb: list(kb.changes(9)), "table head"),
    (
        "revision",
        "committed_at",
        "noon",
        lambda kb: kb.revisions(),
        r"table revision, revision \d+",
    ),
    ("revision", "source", "{", lambda kb: kb.revisions(), r"table revision, revi.*\d:"),
    (
        "plan_step",
        "start",
        "{",
        lambda kb: kb.plans.get_all(),
        r"table plan_step, step 0 of plan \d+",
    ),
    ("plan", "value", "x", lambda kb: kb.plans.get_all(), r"table plan, plan \d+"),
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
    call: Callable[[KnowledgeBase], object],
    named: str,
) -> None:
    path = copy()
    with closing(sqlite3.connect(path, isolation_level=None)) as bare:
        bare.execute("PRAGMA ignore_check_constraints=ON")
        bare.execute(
            f"UPDATE OR IGNORE {table} SET {column} = ? WHERE {column} IS NOT NULL", (value,)
        )
    kb = connect(f"sqlite:///{path}", knowledge_base=NAME)
    with pytest.raises(StoreIntegrityError, match=named) as caught:
        call(kb)
    assert caught.value.__cause__ is not None or "no integer" in str(caught.value)


def test_text_that_is_no_utf8(copy: Callable[[], Path], connect: Connect) -> None:
    path = copy()
    Damage("type", "name", 1, NO_UTF8, ()).apply(path)
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
        "UPDATE plan_step SET start = '{'",
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
        connection.execute(f'CREATE DATABASE "{copy}" TEMPLATE "{name}"')
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
        with pytest.raises(StoreIntegrityError, match=r"table revision, revision 1: .*is no time"):
            opened.revisions()
        with pytest.raises(StoreIntegrityError, match=r"table revision, revision 2: .*is no time"):
            list(opened.log())
        assert {finding.revision for finding in opened.verify().findings} == {1, 2}
    kb.propositions.delete(robot_at(place=waypoint(0)))
    assert other.verify().is_intact
    assert len(other.revisions()) == 3
