"""What is asked of the present finds it by the partial indexes, whatever lies behind it.

The statements are those that the calls send. SQLite has no statistics, as always with the library;
PostgreSQL is asked both before it has any, as right after a bulk load, and after ANALYZE.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import islice, product
from typing import Any, NamedTuple

import psycopg
import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.drivers import Driver, bare
from tests.benchmarks.years import Key, Version, Writer
from tests.support.atoms import Atoms
from tests.support.servers import Server, is_old
from tests.support.statements import Statement, explain, is_bracket, seen, work

SIDE, HOT = 1_000, 200
PLACE = PddlTypeDto("place")
PREDICATES = {
    name: PddlPredicateDto(name, [PLACE] * arity)
    for name, arity in (("near", 2), ("lit", 1), ("visited", 2), ("fresh", 2))
}
FACTS = 20_000
LIT = 100
GOALS = 20
SOME = 12
CLOSED = 60_000
FAR = 2**40
BEFORE, AFTER = "postgresql without statistics", "postgresql after ANALYZE"
# The tables are counted, without statistics.
COUNTED = "postgresql after VACUUM"

NOW = {"ix_proposition_version_now"}
LIVE = {"uq_proposition_version_live"}
ALL = NOW | LIVE
OF_KEY = {"pk_proposition_version", "sqlite_autoindex_proposition_version_1"}
HISTORY = {"ix_proposition_version_history"}
OF_GOALS = {"ix_proposition_version_goal", "ix_proposition_version_goal_history"}

Call = Callable[[KnowledgeBase], Any]
READS: dict[str, tuple[Call, set[str]]] = {
    "get_all": (lambda kb: kb.propositions.get_all(), ALL),
    "get_by_predicate of most facts": (lambda kb: kb.propositions.get_by_predicate("near"), NOW),
    "get_by_predicate of few facts": (lambda kb: kb.propositions.get_by_predicate("lit"), NOW),
    "get_by_predicate with a past": (lambda kb: kb.propositions.get_by_predicate("visited"), NOW),
    "get_by_object of many facts": (lambda kb: kb.propositions.get_by_object("p0"), LIVE),
    "get_by_object of the past": (
        lambda kb: kb.at(kb.revision // 2).propositions.get_by_object("p0"),
        OF_KEY,
    ),
    "get_goals": (lambda kb: kb.goals.get_propositions(), OF_GOALS),
    "get_by_predicate of the past": (
        lambda kb: kb.at(kb.revision // 2).propositions.get_by_predicate("visited"),
        HISTORY,
    ),
    "get_goals of the past": (
        lambda kb: kb.at(kb.revision // 2).goals.get_propositions(),
        OF_GOALS,
    ),
}


def fact(predicate: str, *places: int, is_goal: bool = False) -> PddlPropositionDto:
    objects = [PddlObjectDto(PLACE, f"p{place}") for place in places]
    return PddlPropositionDto(PREDICATES[predicate], objects, is_goal)


def move(kb: KnowledgeBase, proposition: PddlPropositionDto) -> None:
    """Let a fact go and come again."""
    assert Atoms(kb).delete(proposition)
    assert Atoms(kb).insert(proposition)


def make(kb: KnowledgeBase, proposition: PddlPropositionDto) -> None:
    """Let a fact come and go again."""
    assert kb.propositions.insert(proposition)
    assert kb.propositions.delete(proposition)


def move_some(kb: KnowledgeBase) -> None:
    """Let facts go and come again, at once; so many that they are closed as a list."""
    facts = [fact("visited", 0, place) for place in range(0, 10 * SOME, 10)]
    with kb.transaction():
        assert [kb.propositions.delete(each) for each in facts] == [True] * SOME
    kb.propositions.save_all(facts)
    with kb.transaction():
        assert [kb.propositions.delete(each) for each in facts] == [True] * SOME
        kb.propositions.save_all(facts)


# Of the first, 300 closed versions lie behind it; of the second, 20,000 others are as young as it.
WRITES: dict[str, tuple[Call, set[str]]] = {
    "a fact with a past": (lambda kb: move(kb, fact("visited", 0, 10)), LIVE),
    "some facts with a past": (move_some, LIVE),
    "a fact of many": (lambda kb: move(kb, fact("near", 3, 3)), LIVE),
    "a fact that was not": (lambda kb: make(kb, fact("fresh", 1, 2)), LIVE),
    "a goal": (lambda kb: move(kb, fact("visited", 0, 1, is_goal=True)), LIVE),
}


class Subject(NamedTuple):
    """A store with much that holds, and more that held."""

    name: str
    url: str

    def ask(self, call: Call) -> list[Statement]:
        """Give the statements of a call that read or change rows, of a process that just began."""
        with kant_sql.connect(self.url) as kb:
            kb.revision  # noqa: B018
            with seen() as statements:
                call(kb)
        return [
            statement
            for statement in statements
            if not is_bracket(statement.sql)
            and not statement.sql.startswith("INSERT")
            and "proposition_version" in statement.sql
        ]


@pytest.fixture(scope="module", params=["sqlite", BEFORE, COUNTED, AFTER])
def subject(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Subject:
    name: str = request.param
    if name == "sqlite":
        url = f"sqlite:///{tmp_path_factory.mktemp('plans') / 'store.db'}"
    else:
        server: Server = request.getfixturevalue("server")
        filled: str = request.getfixturevalue("filled_server")
        if name == BEFORE:
            return Subject(name, filled)
        url = server.copy(filled)
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute("VACUUM" if name == COUNTED else "VACUUM ANALYZE")
        return Subject(name, url)
    fill(url)
    return Subject(name, url)


@pytest.fixture(scope="module")
def filled_server(server: Server) -> str:
    """The URL of a filled PostgreSQL store, to be copied and asked without statistics."""
    url = server.new_store()
    keep_without_statistics(url)
    fill(url)
    return url


def keep_without_statistics(url: str) -> None:
    with psycopg.connect(url, autocommit=True) as connection:
        tables = connection.execute("SELECT tablename FROM pg_tables WHERE schemaname = 'public'")
        for (table,) in tables.fetchall():
            connection.execute(f'ALTER TABLE "{table}" SET (autovacuum_enabled = off)'.encode())


class Visits(Writer):
    """Writes facts of two places."""

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        return "visited", [f"p{place}" for place in key]


def load_past(store: Driver) -> None:
    """Load closed versions behind the last revision: of few facts, which come and go in turn."""
    store.without_checks()
    store.execute("BEGIN")
    writer = Visits(store, "default")
    first = writer.revision + 1
    versions = (Version(divmod(n % HOT, SIDE), first + n, first + n + 1) for n in range(CLOSED))
    writer.write(versions, first + CLOSED)
    store.execute("COMMIT")


def fill(url: str) -> None:
    with kant_sql.connect(url) as kb:
        kb.objects.save_all(PddlObjectDto(PLACE, f"p{number}") for number in range(SIDE))
        kb.predicates.save_all(PREDICATES.values())
        kb.propositions.save_all(fact("lit", place) for place in range(LIT))
        kb.goals.save_all(fact("visited", 0, place, is_goal=True) for place in range(GOALS))
    store = bare(url)
    load_past(store)
    store.close()
    with kant_sql.connect(url) as kb:
        pairs = islice(product(range(SIDE), range(SIDE)), FACTS)
        kb.propositions.save_all(fact("near", *places) for places in pairs)
        kb.propositions.save_all(fact("visited", 0, place) for place in range(0, HOT, 10))


def version_indexes(plan: list[str]) -> set[str]:
    """Give the indexes of `proposition_version` that a plan uses."""
    text = "\n".join(plan)
    found = re.findall(r"(?:INDEX|Bitmap Index Scan on|using) (\w+)", text)
    versions = {"sqlite_autoindex_proposition_version_1"}
    return {name for name in found if "_proposition_version_" in name or name in versions} | {
        name for name in found if name == "pk_proposition_version"
    }


def whole_tables(plan: list[str]) -> list[str]:
    """Give the steps of a plan that walk all propositions, or all that ever held."""
    # `(kb_id=?)` alone is all rows of a knowledge base: fine only in an index of what holds now.
    walks = re.compile(
        r"Seq Scan on prop|SCAN prop|SEARCH prop.* INDEX (?P<index>\w+) \(kb_id=\?\)$"
    )
    found = [(step, walks.search(step)) for step in plan]
    return [step for step, walk in found if walk is not None and walk["index"] not in ALL]


@pytest.mark.parametrize("name", [*READS, *WRITES])
@pytest.mark.more
def test_each_call_finds_rows_by_the_index_made_for_it(subject: Subject, name: str) -> None:
    call, expected = (READS | WRITES)[name]
    plans = [explain(subject.url, statement) for statement in subject.ask(call)]
    steps = [step for plan in plans for step in plan]
    assert not whole_tables(steps), "\n".join(steps)
    used = version_indexes(steps)
    assert used
    assert used <= expected, "\n".join(steps)


# Where all rows are read, or one, another index that is as small does as well.
@pytest.mark.parametrize("subject", ["sqlite", AFTER], indirect=True)
@pytest.mark.parametrize("name", [name for name in READS if "by_predicate" in name])
def test_the_index_covers_what_is_read_of_versions(subject: Subject, name: str) -> None:
    call, expected = READS[name]
    index = "ix_proposition_version_now" if expected == NOW else "ix_proposition_version_history"
    covering = f"COVERING INDEX {index}", f"Index Only Scan using {index}"
    steps = explain(subject.url, subject.ask(call)[-1])
    assert any(text in step for step in steps for text in covering), "\n".join(steps)


@pytest.mark.parametrize("subject", [BEFORE, COUNTED, AFTER], indirect=True)
@pytest.mark.parametrize("name", READS)
@pytest.mark.more
def test_postgresql_looks_at_no_more_rows_than_hold(subject: Subject, name: str) -> None:
    if (subject.name, name) == (BEFORE, "get_by_predicate of the past") and is_old(subject.url):
        pytest.skip("before version 17 it reads all facts that there are")
    for statement in subject.ask(READS[name][0]):
        assert work(subject.url, statement) <= FACTS + LIT + GOALS + HOT


@pytest.mark.parametrize("subject", [BEFORE, COUNTED, AFTER], indirect=True)
@pytest.mark.parametrize("name", WRITES)
def test_postgresql_looks_at_a_handful_of_rows_to_write_one(subject: Subject, name: str) -> None:
    most = SOME if name == "some facts with a past" else 3
    for sql, parameters in subject.ask(WRITES[name][0]):
        # Again, in a revision to come.
        if not isinstance(parameters, dict):
            # It inserts, and looks nothing up.
            continue
        later = parameters | ({"at": FAR} if "at" in parameters else {})
        assert work(subject.url, Statement(sql, later)) <= most
