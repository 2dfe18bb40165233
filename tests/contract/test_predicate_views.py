"""Generated views: one relation for each predicate, whatever it is called."""

from __future__ import annotations

import logging
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from kant_sql.dto.lexical import fold, is_name
from kant_sql.errors import KantSqlError, StoreError
from kant_sql.sql import predicate_views as updating
from kant_sql.sql.predicate_views import (
    RESERVED_WORDS,
    PredicateView,
    column_names,
    drop_views,
    prefixes,
    update_views,
    view_names,
)
from kant_sql.sql.schema import create_roles
from tests.contract.test_plans import keep_without_statistics
from tests.support.pages import opened, rows_of
from tests.support.profile import PROFILE, hunting
from tests.support.servers import Server
from tests.support.statements import Statement, count, work
from tests.support.stores import Connect, make_store_url
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, WP1, WP2, robot_at, waypoint

REST = (
    *("since", "since_at", "until", "until_at"),
    *("asserted_by", "asserted_reason", "retracted_by", "retracted_reason"),
    *("since_epoch", "until_epoch", "duration"),
)
HOSTILE = [
    *("select", "order", "fact_x", "x", "audit_fact", "proposition", "sqlite_master", "pg_class"),
    *("a-b", "a_b", "A.B", "a--b", "_a_b_", "a_b_2", "-1", "1", "__", "_", "+", "%s", "$1"),
    *("drop,table", "/*", "*/", "--", "\\", "{}", "[x]", "é", "e\u0301", "ß", "SS", "机器人", "🤖"),
    *("x" * 255, "x" * 254 + "y", "é" * 255, "🤖" * 255, "a" * 58, "a" * 59, "robot@home"),
]


def names(views: list[PredicateView]) -> list[str]:
    return [view.name for view in views]


def changes(views: list[PredicateView]) -> dict[str, str]:
    return {view.name: view.change for view in views}


def arguments(url: str) -> list[tuple[str, ...]]:
    """The columns of the arguments of all views of facts."""
    views = [view for view in update_views(url) if view.kind == "fact"]
    assert all(view.columns[-len(REST) :] == REST for view in views)
    return [view.columns[: -len(REST)] for view in views]


def save(kb: KnowledgeBase, predicate: PddlPredicateDto, *objects: PddlObjectDto) -> None:
    kb.predicates.save(predicate, cascade=True)
    kb.propositions.save(PddlPropositionDto(predicate, objects))


@pytest.fixture(params=["sqlite-file", "postgresql"])
def shared_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store on each backend that has views to keep."""
    return make_store_url(request, request.param, tmp_path)


@pytest.fixture
def story_url(shared_url: str, connect: Connect) -> str:
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(robot_at())
    with kb.transaction(actor="executive", reason="navigation finished"):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
    kb.goals.save(robot_at(is_goal=True))
    kb.close()
    return shared_url


def test_each_predicate_has_a_view_of_its_facts_and_one_of_its_goals(story_url: str) -> None:
    fact, goal = update_views(story_url)
    assert (fact.name, goal.name) == ("fact_robot_at", "goal_robot_at")
    assert fact.columns == goal.columns == ("robot", "wp", *REST)
    columns = "robot, wp, since, until, asserted_by, asserted_reason, retracted_by"
    facts = f"SELECT {columns}, retracted_reason FROM fact_robot_at ORDER BY since"
    assert rows_of(story_url, facts) == [
        ("rb1", "wp1", 1, 2, "perception", None, "executive", "navigation finished"),
        ("rb1", "wp2", 2, None, "executive", "navigation finished", None, None),
    ]
    assert rows_of(story_url, f"SELECT {columns} FROM goal_robot_at WHERE until IS NULL") == [
        ("rb1", "wp1", 3, None, "perception", None, None)
    ]


def test_times_are_those_of_the_revisions_and_seconds_those_of_the_audit(story_url: str) -> None:
    update_views(story_url)
    times = dict(rows_of(story_url, "SELECT number, committed_at FROM revision"))
    assert rows_of(story_url, "SELECT since_at, until_at FROM fact_robot_at ORDER BY since") == [
        (times[1], times[2]),
        (times[2], None),
    ]
    later = f"SELECT since FROM fact_robot_at WHERE since_at > '{times[1]}'"
    assert rows_of(story_url, later) == [(2,)]
    columns = "since, since_epoch, until_epoch, duration"
    rows = rows_of(story_url, f"SELECT {columns} FROM fact_robot_at ORDER BY since")
    question = f"SELECT {columns} FROM audit_fact WHERE kind = 'fact' ORDER BY since"
    assert [*map(repr, rows)] == [*map(repr, rows_of(story_url, question))]
    (first, second) = rows
    assert first[3] == pytest.approx(first[2] - first[1], abs=1e-5)
    assert second[1] == first[2]
    assert second[2:] == (None, None)


def test_an_argument_keeps_the_name_of_a_later_column(shared_url: str, connect: Connect) -> None:
    predicate = PddlPredicateDto(
        "held", [WAYPOINT] * 3, parameter_names=["duration", "Since_Epoch", "duration_2"]
    )
    save(connect(shared_url), predicate, WP1, WP2, WP1)
    view = update_views(shared_url)[0]
    assert view.columns[:3] == ("duration", "since_epoch", "duration_2")
    assert view.columns[-3:] == ("since_epoch_2", "until_epoch", "duration_3")
    assert rows_of(shared_url, f"SELECT {', '.join(view.columns[:3])} FROM fact_held") == [
        ("wp1", "wp2", "wp1")
    ]
    assert rows_of(shared_url, "SELECT duration_3, until_epoch FROM fact_held") == [(None, None)]


def test_views_without_these_columns_are_replaced(story_url: str) -> None:
    """Whoever updates the views of a store that an older version made them for gets all columns."""
    update_views(story_url)
    for name in ("fact_robot_at", "goal_robot_at"):
        forget_last_columns(story_url, name)
    assert changes(update_views(story_url)) == {
        "fact_robot_at": "replaced",
        "goal_robot_at": "replaced",
    }
    assert len(rows_of(story_url, "SELECT duration FROM fact_robot_at")) == 2


def forget_last_columns(url: str, name: str) -> None:
    """Make a view as it was before: without seconds, and with another digest."""
    (view,) = (view for view in drop_views(url, dry_run=True) if view.name == name)
    mark = f"kb_id=1 predicate_id=1 kind={view.kind} sha256={'0' * 64}"
    with opened(url) as store:
        ((predicate_id,),) = store.execute("SELECT id FROM predicate", {})
        mark = mark.replace("predicate_id=1", f"predicate_id={predicate_id}")
        store.execute(f"DROP VIEW {name}", {})
        said = f"generated by kant-sql views: {mark}"
        begin = f"/* {said} */" if store.dialect == "SQLite" else ""
        store.execute(f"CREATE VIEW {name} AS {begin} SELECT 1 AS since", {})
        if store.dialect == "PostgreSQL":
            store.execute(f"COMMENT ON VIEW {name} IS '{said}'", {})


def test_the_views_are_relations_of_the_columns_told_and_no_revision(
    story_url: str, connect: Connect
) -> None:
    for view in update_views(story_url):
        with opened(story_url) as store:
            rows = store.execute(f"SELECT {', '.join(view.columns)} FROM {view.name}", {})
            assert store.execute(f"SELECT * FROM {view.name}", {}) == rows
    assert connect(story_url, knowledge_base="tiago").revision == 3


def test_what_is_up_to_date_is_left_alone(story_url: str, connect: Connect) -> None:
    update_views(story_url)
    again = update_views(story_url)
    assert changes(again) == {"fact_robot_at": "unchanged", "goal_robot_at": "unchanged"}
    assert not any(view.statements for view in again)
    kb = connect(story_url, knowledge_base="tiago")
    kb.predicates.save(PddlPredicateDto("idle", [ROBOT]))
    kb.predicates.save(
        PddlPredicateDto("robot_at", ROBOT_AT.types, parameter_names=["who", "where"])
    )
    assert changes(update_views(story_url)) == {
        **{"fact_robot_at": "replaced", "fact_idle": "created"},
        **{"goal_robot_at": "replaced", "goal_idle": "created"},
    }
    assert rows_of(story_url, "SELECT who, where_ FROM fact_robot_at WHERE until IS NULL") == [
        ("rb1", "wp2")
    ]


def test_a_predicate_that_had_more_parameters_shows_them(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    save(kb, PddlPredicateDto("at", [ROBOT], parameter_names=["r"]), RB1)
    save(kb, PddlPredicateDto("at", [ROBOT, WAYPOINT], parameter_names=["r", "to"]), RB1, WP1)
    save(kb, PddlPredicateDto("at", [WAYPOINT], parameter_names=["place"]), WP2)
    kb.predicates.delete(PddlPredicateDto("at"))
    update_views(shared_url)
    assert rows_of(shared_url, "SELECT place, to_ FROM fact_at ORDER BY since") == [
        ("rb1", None),
        ("rb1", "wp1"),
        ("wp2", None),
    ]


def test_what_columns_of_arguments_are_called(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    either = kant_sql.PddlEitherTypeDto([ROBOT, WAYPOINT])
    for name, types, given_names in (
        ("near", [WAYPOINT, WAYPOINT, ROBOT], None),
        ("seen", [either, PddlTypeDto("Since")], None),
        ("moved", [WAYPOINT] * 3, ["from", "TO", "since"]),
        ("odd", [WAYPOINT] * 5, ["1", "x", "X", "x-y", "x" * 255]),
        ("none", [], None),
    ):
        kb.predicates.save(PddlPredicateDto(name, types, parameter_names=given_names))
    long = arguments(shared_url)[3].__getitem__(4)
    assert arguments(shared_url) == [
        ("wp", "wp_2", "robot"),
        ("robot_or_wp", "since_2"),
        ("from_", "to_", "since_2"),
        ("_1", "x", "x_2", "x_y", long),
        (),
    ]
    assert re.fullmatch("x{54}_[0-9a-f]{8}", long)


def test_a_predicate_of_very_many_parameters(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    save(kb, PddlPredicateDto("wide", [WAYPOINT] * 90), *[WP1] * 89, WP2)
    update_views(shared_url)
    assert rows_of(shared_url, "SELECT wp, wp_89, wp_90 FROM fact_wide") == [("wp1", "wp1", "wp2")]


def test_the_first_knowledge_base_keeps_plain_names(shared_url: str, connect: Connect) -> None:
    for name, place in (("tiago", WP1), ("T-2", WP2), ("T 2", WP1)):
        connect(shared_url, knowledge_base=name).propositions.save(robot_at(place=place))
        update_views(shared_url)
        assert rows_of(shared_url, "SELECT wp FROM fact_robot_at") == [("wp1",)]
    first, second, third = (view for view in update_views(shared_url) if view.kind == "fact")
    assert (first.knowledge_base, second.name) == ("tiago", "fact__t_2__robot_at")
    assert re.fullmatch("fact__t_2_[0-9a-f]{8}__robot_at", third.name)
    assert rows_of(shared_url, "SELECT wp FROM fact__t_2__robot_at") == [("wp2",)]


def test_names_that_come_to_the_same_are_told_apart_by_age(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(PddlPropositionDto(PddlPredicateDto("a-b", [ROBOT]), [RB1]))
    assert names(update_views(shared_url))[0] == "fact_a_b"
    kb.propositions.save(PddlPropositionDto(PddlPredicateDto("a_b", [WAYPOINT]), [WP1]))
    older, younger, *_ = update_views(shared_url)
    assert (older.name, older.change) == ("fact_a_b", "unchanged")
    assert re.fullmatch("fact_a_b_[0-9a-f]{8}", younger.name)
    assert rows_of(shared_url, "SELECT robot FROM fact_a_b") == [("rb1",)]
    assert rows_of(shared_url, f"SELECT wp FROM {younger.name}") == [("wp1",)]


@pytest.mark.parametrize(
    "theirs",
    ["CREATE TABLE FACT_A_B (x INTEGER)", "CREATE VIEW fact_a_b AS SELECT 7 AS x"],
    ids=["table", "view"],
)
def test_what_others_made_is_never_replaced_or_dropped(
    shared_url: str, connect: Connect, theirs: str
) -> None:
    rows_of(shared_url, theirs)
    before = rows_of(shared_url, "SELECT * FROM fact_a_b")
    kb = connect(shared_url)
    for name in ("a-b", "a_b"):
        kb.predicates.save(PddlPredicateDto(name))
    first, second = names(update_views(shared_url))[:2]
    drop_views(shared_url)
    assert rows_of(shared_url, "SELECT * FROM fact_a_b") == before
    rows_of(shared_url, f"DROP {theirs.split()[1]} fact_a_b")
    # What `fact_a_b` means, and what the other names mean, is not what was in the way.
    assert names(update_views(shared_url))[:2] == ["fact_a_b", second]
    assert first != second


def test_an_index_in_the_way_is_no_place_for_a_view(shared_url: str, connect: Connect) -> None:
    rows_of(shared_url, "CREATE INDEX fact_a ON object (name)")
    connect(shared_url).predicates.save(PddlPredicateDto("a"))
    assert re.fullmatch("fact_a_[0-9a-f]{8}", names(update_views(shared_url))[0])


def test_drop_leaves_nothing_but_what_others_made(story_url: str, connect: Connect) -> None:
    connect(story_url, knowledge_base="other").propositions.save(robot_at())
    rows_of(story_url, "CREATE VIEW mine AS SELECT 1 AS x")
    update_views(story_url)
    gone = drop_views(story_url, knowledge_base="tiago")
    assert changes(gone) == {"fact_robot_at": "dropped", "goal_robot_at": "dropped"}
    assert {(view.knowledge_base, view.predicate) for view in gone} == {("tiago", "robot_at")}
    assert names(drop_views(story_url)) == ["fact__other__robot_at", "goal__other__robot_at"]
    assert drop_views(story_url) == []
    assert rows_of(story_url, "SELECT x FROM mine") == [(1,)]


def test_one_knowledge_base_can_be_chosen(story_url: str, connect: Connect) -> None:
    connect(story_url, knowledge_base="other").propositions.save(robot_at())
    assert names(update_views(story_url, knowledge_base="other")) == [
        "fact__other__robot_at",
        "goal__other__robot_at",
    ]
    assert set(changes(update_views(story_url)).values()) == {"created", "unchanged"}
    with pytest.raises(KantSqlError, match=r"no knowledge base 'nobody'.*'tiago', 'other'"):
        update_views(story_url, knowledge_base="nobody")


def test_the_sql_of_a_dry_run_makes_the_same_views(story_url: str) -> None:
    planned = update_views(story_url, dry_run=True)
    assert changes(planned) == {"fact_robot_at": "created", "goal_robot_at": "created"}
    assert changes(update_views(story_url, dry_run=True)) == changes(planned)
    for view in planned:
        for statement in view.statements:
            rows_of(story_url, statement)
    assert set(changes(update_views(story_url)).values()) == {"unchanged"}
    assert len(drop_views(story_url, dry_run=True)) == len(drop_views(story_url)) == 2


def test_reads_do_not_grow_with_predicates(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    counted = []
    for size in (1, 50):
        kb.predicates.save_all(PddlPredicateDto(f"p{n}", [ROBOT] * 3) for n in range(size))
        update_views(shared_url)
        counted.append(count(lambda: update_views(shared_url)))
    assert counted[0] == counted[1] <= 13


def test_many_are_made_and_dropped_by_parts(
    story_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(story_url, knowledge_base="tiago").predicates.save(PddlPredicateDto("idle"))
    monkeypatch.setattr(updating, "CHANGES_AT_ONCE", 3)
    made = update_views(story_url)
    assert [view.change for view in made] == ["created"] * 4
    assert [view.change for view in update_views(story_url)] == ["unchanged"] * 4
    assert sorted(names(drop_views(story_url))) == sorted(names(made))
    assert drop_views(story_url) == []


def test_several_can_run_at_once(story_url: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        done = [*pool.map(lambda _: update_views(story_url), range(8))]
    created = [views for views in done if "created" in changes(views).values()]
    assert len(created) == 1


def hostile_kb(kb: KnowledgeBase, predicates: list[str]) -> dict[str, int]:
    """Save facts of each predicate, of some more than of others; give how many there are."""
    found: dict[str, int] = {}
    dtos = []
    for name in predicates:
        if fold(name) not in map(fold, found):
            found[name] = len(found) % 3 + 1
            predicate = PddlPredicateDto(name, [WAYPOINT], parameter_names=[name])
            dtos += [
                PddlPropositionDto(predicate, [waypoint(number)]) for number in range(found[name])
            ]
    kb.propositions.save_all(dtos)
    return found


def check_hostile(url: str, kb_name: str, found: dict[str, int]) -> None:
    views = [view for view in update_views(url, knowledge_base=kb_name) if view.change != "dropped"]
    assert len({*names(views)}) == len(views) == 2 * len(found)
    with opened(url) as store:
        for view in views:
            assert len(view.name.encode()) <= 63
            assert view.predicate is not None
            # None of the names is in quotes.
            rows = store.execute(f"SELECT {', '.join(view.columns)} FROM {view.name}", {})
            assert len(rows) == (found[view.predicate] if view.kind == "fact" else 0), view
    assert {view.change for view in update_views(url, knowledge_base=kb_name)} <= {"unchanged"}


def test_hostile_names_are_safe(shared_url: str, connect: Connect) -> None:
    connect(shared_url).predicates.save(PddlPredicateDto("_fact__x"))
    short = ["a b", "a-b", "fact_x", "_x"]
    for kb_name, predicates in (
        *(('\'; DROP TABLE "object"; --', HOSTILE), ("default", HOSTILE)),
        *((name, short) for name in ("x" * 255, "é" * 255, "fact", "__", " ", "sqlite", "a_b")),
    ):
        kb = connect(shared_url, knowledge_base=kb_name)
        found = hostile_kb(kb, [name for name in predicates if is_name(name, "predicate")])
        kb.close()
        if kb_name == "default":
            found["_fact__x"] = 0
        check_hostile(shared_url, kb_name, found)


PDDL_NAMES = st.text(min_size=1, max_size=80).filter(lambda name: is_name(name, "predicate"))


@pytest.mark.parametrize("backend", ["one_file", "one_database"])
def test_any_name_is_safe(request: pytest.FixtureRequest, backend: str, connect: Connect) -> None:
    url: str = request.getfixturevalue(backend)

    @hunting(PROFILE.tasks)
    @given(st.lists(PDDL_NAMES, max_size=4), st.text("ab-_é ", min_size=1, max_size=5))
    def check(predicates: list[str], kb_name: str) -> None:
        kb = connect(url, knowledge_base=kb_name)
        kb.propositions.delete_all()
        known = [dto.name for dto in kb.predicates.get_all()]
        fresh = [name for name in predicates if fold(name) not in map(fold, known)]
        hostile_kb(kb, fresh)
        kb.close()
        if known or fresh:
            counts = dict.fromkeys(known, 0)
            for name, size in ask_counts(url, kb_name):
                counts[name] = size
            check_hostile(url, kb_name, counts)

    check()


def ask_counts(url: str, kb_name: str) -> list[tuple[Any, ...]]:
    """How often a fact of each predicate held."""
    with opened(url) as store:
        return store.execute(
            "SELECT predicate.name, (SELECT count(*) FROM proposition_version AS v "
            "WHERE v.kb_id = predicate.kb_id AND v.predicate_id = predicate.id) "
            "FROM predicate JOIN knowledge_base AS k ON k.id = kb_id WHERE k.name = :name",
            {"name": kb_name},
        )


@given(
    st.lists(PDDL_NAMES, min_size=1, unique_by=fold), st.sets(st.sampled_from(["fact_a", "fact_b"]))
)
def test_a_name_never_changes_its_meaning(predicates: list[str], taken: set[str]) -> None:
    all_names = (
        [*predicates, "a", "b"] if {"a", "b"}.isdisjoint(map(fold, predicates)) else predicates
    )
    meaning: dict[str, str] = {}
    for known in range(len(all_names) + 1):
        for others in (taken, set[str]()):
            for predicate, name in zip(
                all_names, view_names("fact_", all_names[:known], others), strict=False
            ):
                assert meaning.setdefault(name, predicate) == predicate
                assert name not in others


@given(st.lists(st.text(st.sampled_from("aA_- é"), min_size=1, max_size=60), unique=True))
def test_no_two_knowledge_bases_have_names_in_common(kbs: list[str]) -> None:
    found = [*prefixes("fact", kbs)]
    assert len(set(found)) == len(kbs)
    views = [{*view_names(prefix, ["a", "_a", "a__a", "__a__a", "-"], ())} for prefix in found]
    assert sum(map(len, views)) == len(set[str]().union(*views))
    assert [*prefixes("fact", kbs[:3])] == found[:3]


def test_reserved_words_are_all_that_a_database_would_refuse(shared_url: str) -> None:
    with opened(shared_url) as store:
        if store.dialect == "PostgreSQL":
            rows = store.execute(
                "SELECT word FROM pg_get_keywords() WHERE catcode IN ('R', 'T')", {}
            )
            assert {row[0] for row in rows} <= RESERVED_WORDS
        for word in RESERVED_WORDS:
            (safe,) = column_names([word], REST)
            assert store.execute(f"SELECT {safe} FROM (SELECT 7 AS {safe}) AS v", {}) == [(7,)]


@pytest.mark.parametrize("version", ["-1", "base"])
@pytest.mark.more
def test_migrations_take_them_out_of_the_way(
    story_url: str, caplog: pytest.LogCaptureFixture, version: str
) -> None:
    whole = update_views(story_url)
    rows_of(story_url, "CREATE VIEW mine AS SELECT 1 AS x")

    def of_schema() -> list[logging.LogRecord]:
        return [one for one in caplog.records if one.name == "kant_sql.schema"]

    with caplog.at_level(logging.WARNING, "kant_sql.schema"):
        kant_sql.upgrade(story_url)
        assert not of_schema()
        kant_sql.operations.downgrade(story_url, revision=version)
    (record,) = of_schema()
    assert "2 views" in record.getMessage()
    assert "kant-sql views" in record.getMessage()
    kant_sql.upgrade(story_url)
    assert rows_of(story_url, "SELECT x FROM mine") == [(1,)]
    again = update_views(story_url)
    assert again == ([] if version == "base" else whole)


def test_a_view_that_others_made_of_one_is_not_dropped(story_url: str) -> None:
    update_views(story_url)
    if make_url(story_url).get_backend_name() == "sqlite":
        pytest.skip("SQLite lets a view outlive what it is of")
    rows_of(story_url, "CREATE VIEW mine AS SELECT robot FROM fact_robot_at")
    with pytest.raises(StoreError, match="view mine depends on view fact_robot_at"):
        drop_views(story_url)
    assert rows_of(story_url, "SELECT count(*) FROM mine") == [(2,)]


PLANS = {
    "SELECT robot FROM fact_robot_at WHERE until IS NULL": "now",
    "SELECT wp FROM fact_robot_at WHERE since <= 2 AND (until IS NULL OR until > 2)": "",
    "SELECT * FROM fact_robot_at WHERE since = 2": "",
    "SELECT retracted_by FROM fact_robot_at WHERE until = 2": "until",
    "SELECT since_at FROM goal_robot_at WHERE until IS NULL": "",
}


def test_sqlite_answers_by_indexes(file_url: str, connect: Connect) -> None:
    connect(file_url).propositions.save(robot_at())
    update_views(file_url)
    for question, index in PLANS.items():
        plan = [str(row[3]) for row in rows_of(file_url, f"EXPLAIN QUERY PLAN {question}")]
        assert f"INDEX ix_proposition_version_{index}" in plan[0], question
        steps = [step for step in plan if step.startswith(("SCAN", "SEARCH"))]
        assert len(steps) > 1
        # Each look-up is by more than the knowledge base.
        assert all(re.search(r"SEARCH .*\(kb_id=\? AND \w+[=<>]\?", step) for step in steps), plan


def test_postgresql_needs_no_statistics(server: Server, connect: Connect) -> None:
    url, size = server.new_store(), 1_000
    keep_without_statistics(url)
    kb = connect(url)
    kb.propositions.save_all(robot_at(place=waypoint(number)) for number in range(size))
    update_views(url)
    for question in ("count(*) FROM fact_robot_at", "* FROM fact_robot_at WHERE wp < 'wp9'"):
        assert work(url, Statement(f"SELECT {question}", {})) < 10 * size


def test_whoever_may_audit_may_read_them(server: Server, connect: Connect) -> None:
    url = server.new_store()
    kb = connect(url)
    kb.propositions.save(robot_at())
    create_roles(url)
    update_views(url)
    kb.predicates.save(PddlPredicateDto("robot_at", ROBOT_AT.types, parameter_names=["a", "b"]))
    assert changes(update_views(url))["fact_robot_at"] == "replaced"
    for right, expected in (("SELECT", True), ("UPDATE", False)):
        sql = f"SELECT has_table_privilege('kant_sql_auditor', 'fact_robot_at', '{right}')"
        assert rows_of(url, sql) == [(expected,)]
