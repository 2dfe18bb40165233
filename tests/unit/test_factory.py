"""The factory method picks the family of DAOs by the URL, and never shows a password."""

from __future__ import annotations

import io
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import kant_sql
from kant_sql.dao import interfaces
from kant_sql.errors import InvalidMetadataError, InvalidUrlError
from kant_sql.factory import FAMILIES, PostgresqlDaoFactory, SqliteDaoFactory
from kant_sql.sql import schema
from kant_sql.sql.catalog import written_names
from kant_sql.sql.schema import create_roles
from tests.support.stores import Connect

SECRET = "correct-horse"
# A port that nothing listens on.
NOBODY = "127.0.0.1:1"


def chain(error: BaseException | None) -> Iterator[BaseException]:
    """An error with all that it was raised from, or while."""
    pending, seen = [error], set()
    while pending:
        current = pending.pop()
        if current is not None and id(current) not in seen:
            seen.add(id(current))
            pending += [current.__cause__, current.__context__]
            yield current


def test_the_url_alone_picks_the_family(tmp_path: Path, one_url: str) -> None:
    for url, family in (
        ("sqlite://", SqliteDaoFactory),
        (f"sqlite:///{tmp_path / 'robot.db'}", SqliteDaoFactory),
        (one_url, PostgresqlDaoFactory),
    ):
        factory = kant_sql.create_dao_factory(url)
        assert type(factory) is family
        factory.close()


@pytest.fixture
def one_url(request: pytest.FixtureRequest) -> str:
    url: str = request.getfixturevalue("server").new_database()
    kant_sql.upgrade(url)
    return url


@pytest.mark.parametrize("scheme", ["postgres", "postgres+psycopg"])
def test_postgres_is_postgresql_wherever_a_url_is_taken(
    one_url: str, tmp_path: Path, scheme: str
) -> None:
    url = one_url.replace("postgresql://", f"{scheme}://")
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.types.save(kant_sql.PddlTypeDto("robot"))
    assert written_names(url) == ["tiago"]
    assert schema.current(url) == schema.VERSIONS[-1]
    assert create_roles(url, dry_run=True).statements
    out = io.StringIO()
    schema.upgrade_sql(url, out)
    assert "BIGINT" in out.getvalue()
    with kant_sql.connect(f"sqlite:///{tmp_path / 'robot.db'}", knowledge_base="rb1") as kb:
        kb.types.save(kant_sql.PddlTypeDto("robot"))
        assert kb.store.archive(kb.revision, to=url).target.startswith("postgresql")


def test_a_factory_creates_a_dao_of_each_element() -> None:
    factory = kant_sql.create_dao_factory("sqlite://")
    assert isinstance(factory.create_pddl_type_dao(), interfaces.PddlTypeDao)
    assert isinstance(factory.create_pddl_object_dao(), interfaces.PddlObjectDao)
    assert isinstance(factory.create_pddl_predicate_dao(), interfaces.PddlPredicateDao)
    assert isinstance(factory.create_pddl_proposition_dao(), interfaces.PddlPropositionDao)
    assert isinstance(factory.create_pddl_action_dao(), interfaces.PddlActionDao)
    factory.close()


def test_a_factory_cannot_be_half_made() -> None:
    with pytest.raises(TypeError, match="abstract"):
        kant_sql.DaoFactory("sqlite://")  # type: ignore[abstract]


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path in which a package is installed that joins with two families."""
    (tmp_path / "duck_family.py").write_text(
        textwrap.dedent(
            """
            from kant_sql.factory import SqliteDaoFactory

            class DuckDaoFactory(SqliteDaoFactory):
                def __init__(self, url, *, knowledge_base="default", actor=None):
                    self.given = (url, knowledge_base, actor)
                    super().__init__("sqlite://", knowledge_base=knowledge_base, actor=actor)

            class Impostor:
                pass
            """
        )
    )
    folder = tmp_path / "duck_family-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: duck-family\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[kant_sql.dao_families]\n"
        "duckdb = duck_family:DuckDaoFactory\n"
        "impostor = duck_family:Impostor\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "duck_family", raising=False)
    return tmp_path


@pytest.mark.usefixtures("plugins")
def test_a_package_joins_with_a_family_by_an_entry_point(connect: Connect) -> None:
    url = "duckdb+driver:///robot.duck"
    kb = connect(url, knowledge_base="tiago", actor="me")
    assert type(kb.store.factory).__name__ == "DuckDaoFactory"
    assert kb.store.factory.given == (url, "tiago", "me")  # type: ignore[attr-defined]
    assert kb.types.get_all() == []


class OtherFactory(kant_sql.DaoFactory):
    """A family that is not built on SQL: it has DAOs, which these tests do without."""

    def __init__(self, url: str, **_: object) -> None:
        assert url == "other://"


def other_family(monkeypatch: pytest.MonkeyPatch) -> kant_sql.KnowledgeBase:
    for name in kant_sql.DaoFactory.__abstractmethods__ - {"__init__"}:
        monkeypatch.setattr(OtherFactory, name, lambda self: None, raising=False)
    monkeypatch.setattr(OtherFactory, "__abstractmethods__", frozenset())
    monkeypatch.setitem(FAMILIES, "other", OtherFactory)
    return kant_sql.connect("other://")


@pytest.mark.parametrize(
    "ask",
    [
        lambda kb: kb.log(),
        lambda kb: kb.restore(0),
        lambda kb: kb.query("(on ?x)"),
        lambda kb: kb.problem_pddl(),
        lambda kb: kb.plan(),
        lambda kb: kb.transaction(),
        lambda kb: kb.at(0),
        lambda kb: kb.branch(),
        lambda kb: kb.revision,
    ],
)
def test_a_question_names_a_family_that_has_daos_only(
    monkeypatch: pytest.MonkeyPatch, ask: Callable[[kant_sql.KnowledgeBase], object]
) -> None:
    with (
        other_family(monkeypatch) as kb,
        pytest.raises(InvalidUrlError, match="OtherFactory: this DAO family lacks "),
    ):
        ask(kb)


@pytest.mark.usefixtures("plugins")
def test_an_entry_point_that_is_no_factory_is_refused() -> None:
    message = r"^impostor: entry point 'duck_family:Impostor' is not a DaoFactory class$"
    with pytest.raises(InvalidUrlError, match=message):
        kant_sql.create_dao_factory("impostor://")


@pytest.mark.usefixtures("plugins")
def test_a_family_that_nobody_has_is_refused_naming_those_that_there_are() -> None:
    with pytest.raises(InvalidUrlError) as caught:
        kant_sql.create_dao_factory("oracle://host/db")
    assert str(caught.value) == (
        "oracle: no DAO family supports this URL; choose one of: duckdb, http, "
        "https, impostor, postgresql, sqlite"
    )


@pytest.mark.parametrize(
    ("url", "known"),
    [
        ("sqlite://?frobnicate=1", "known ones are mode, synchronous, timeout"),
        ("sqlite://?Timeout=1", "known ones are mode, synchronous, timeout"),
        (f"postgresql://{NOBODY}/db?frobnicate=1", "application_name"),
        ("sqlite://?synchronous=off", "synchronous is 'normal' or 'full'"),
        ("sqlite:///robot.db?mode=rw", "mode is 'ro' or 'immutable'"),
        ("sqlite://?timeout=soon", "timeout is a number of seconds"),
        ("sqlite://?timeout=-1", "timeout is a number of seconds"),
        ("sqlite://?timeout=nan", "timeout is a number of seconds"),
        ("sqlite://?timeout=inf", "timeout is a number of seconds"),
        ("sqlite://?timeout=1&timeout=2", "timeout is a number of seconds"),
        ("postgresql://nobody/db?port=soon", "Received non-integer port arguments: ('soon',)"),
    ],
)
def test_an_unknown_option_is_refused_naming_what_is_known(
    url: str, known: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidUrlError) as caught:
        kant_sql.create_dao_factory(url)
    assert known in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "url",
    [
        *("", "robot.db", "sqlite", "sqlite:", "sqlite:/robot.db", "://", " sqlite://"),
        *("postgresql://host:port/db", "sqlite:///a\0b.db", "sqlite:///\ud800.db"),
        *(
            "postgresql://\ud800@host/db",
            "sqlite:///a%00b.db",
            None,
            5,
            b"sqlite://",
            Path("robot.db"),
            object(),
        ),
    ],
)
def test_what_is_no_url_is_refused_with_examples_of_urls(url: object) -> None:
    named = repr(url) if url in ("robot.db", "sqlite") else "this"
    with pytest.raises(InvalidUrlError, match=f"^{named} is not a database URL") as raised:
        kant_sql.create_dao_factory(url)  # type: ignore[arg-type]
    assert "write sqlite:///robot.db" in str(raised.value)


@pytest.mark.parametrize("url", ["sqlite://robot.db", "sqlite://robot.db/x", "sqlite://me@/x.db"])
def test_a_file_with_two_slashes_too_few_does_not_become_a_store_in_memory(url: str) -> None:
    with pytest.raises(InvalidUrlError, match="SQLite has no host; write three slashes"):
        kant_sql.create_dao_factory(url)


@pytest.mark.parametrize(
    "url",
    [
        f"postgresql://me:{SECRET}@{NOBODY}/db",
        f"postgresql://me:{SECRET}@{NOBODY}/db?connect_timeout=soon",
        f"postgresql://me:{SECRET}@{NOBODY}/db?frobnicate=1",
        f"postgresql://me:{SECRET}@127.0.0.1:99999/db",
        f"postgresql://me:{SECRET}@127.0.0.1:port/db",
        f"postgresql://me:{SECRET}",
        f"postgresql://me:{SECRET}@x@{NOBODY}/db",
        f"postgresql://me:x@{SECRET}@{NOBODY}/db",
        f"postgresql://me:{SECRET}@[::1/db",
        f"postgresql://{NOBODY}/db?user=me&password={SECRET}",
        f"postgresql://{NOBODY}/db?user=me&passwd={SECRET}",
        f"postgresql:/me:{SECRET}@{NOBODY}/db",
        f"//me:{SECRET}@{NOBODY}/db",
        f"oracle://me:{SECRET}@{NOBODY}/db",
        f"sqlite://me:{SECRET}@host/robot.db",
        f"sqlite://?password={SECRET}",
    ],
)
def test_no_message_shows_a_password_nor_does_what_it_was_raised_from(url: str) -> None:
    with pytest.raises(kant_sql.KantSqlError) as caught:
        kant_sql.create_dao_factory(url)
    for error in chain(caught.value):
        assert SECRET not in str(error)
        assert SECRET not in repr(error)


def test_a_server_that_does_not_answer_is_named_without_the_password() -> None:
    with pytest.raises(kant_sql.StoreUnreachableError) as caught:
        kant_sql.create_dao_factory(f"postgresql://me:{SECRET}@{NOBODY}/db")
    assert str(caught.value).startswith(f"postgresql://me:***@{NOBODY}/db")
    assert isinstance(caught.value, kant_sql.StoreError)


@pytest.mark.parametrize("name", ["", "x" * 256, "a\0b", "a\nb", "\ud800", None, 5])
def test_a_knowledge_base_has_a_printable_name(name: object) -> None:
    with pytest.raises(InvalidMetadataError, match="cannot name a knowledge base"):
        kant_sql.create_dao_factory("sqlite://", knowledge_base=name)  # type: ignore[arg-type]


@pytest.mark.parametrize("actor", [5, b"me", "a\0b", "\ud800"])
def test_an_actor_that_cannot_be_kept_is_refused_at_once(actor: object) -> None:
    with pytest.raises(InvalidMetadataError, match=r"^actor"):
        kant_sql.create_dao_factory("sqlite://", knowledge_base="tiago", actor=actor)  # type: ignore[arg-type]


def test_every_error_of_the_library_is_one_tree() -> None:
    errors = [
        value
        for name, value in vars(kant_sql.errors).items()
        if isinstance(value, type) and issubclass(value, Exception)
    ]
    assert len(errors) > 20
    assert all(issubclass(error, kant_sql.KantSqlError) for error in errors)
