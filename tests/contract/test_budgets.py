"""How many statements a call may take: on the hot path, each one costs more than its rows do.

They are counted in the log, a batch of rows being one, which is held against what the drivers are
really given.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import groupby
from typing import Any

import psycopg
import pytest

from kant_sql import KnowledgeBase, PddlObjectDto, PddlPropositionDto
from kant_sql.dto.formulas import Comparison, Derived, Exists, Modal, Not, Number, TimedLiteral
from tests.support.servers import Server
from tests.support.statements import (
    READS,
    VALUE_READS,
    Call,
    count,
    fact,
    fill,
    is_bracket,
    recorded,
)
from tests.support.stores import Connect
from tests.support.worlds.depot import DOMAIN, IDLE, PLACE, TRUCK, P, T, at, fuel
from tests.support.worlds.robots import BATTERY, LOCATION, RB1, WP1, distance, waypoint

WRITE = 5
# What never was: its identity and its arguments have rows of their own.
FIRST_WRITE = WRITE + 2
READ = 2
OPEN = 3
SIZES = (1, 100, 5_000)
LATE = [datetime.now(UTC) - timedelta(minutes=minutes) for minutes in (20, 10)]
ALL_READS = READS | VALUE_READS
RULE = "(always (not (exists (?r - robot) (robot_at ?r wp1))))"


def fill_all(kb: KnowledgeBase, size: int) -> None:
    """Give it as many values as facts, too."""
    fill(kb, size)
    kb.function_values.save_all(map(distance, range(size)))


@pytest.fixture
def warm(kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base that has just written, and knows `fact(0)` to `fact(9)`; and values."""
    fill_all(kb, 10)
    return kb


# Writes.


@pytest.mark.parametrize("given", [fact(1), str(fact(1))], ids=["dto", "text"])
def test_a_warm_save_or_delete_takes_five_statements_at_most(
    warm: KnowledgeBase, given: PddlPropositionDto | str
) -> None:
    facts = warm.propositions
    assert count(lambda: facts.delete(given)) <= WRITE
    assert count(lambda: facts.delete(given)) == 1
    assert count(lambda: facts.save(given)) <= WRITE
    assert count(lambda: facts.save(given)) == 1
    assert count(lambda: facts.insert(given)) <= WRITE
    assert count(lambda: facts.update(given)) <= WRITE


def test_a_warm_change_of_a_value_takes_five_statements_at_most(warm: KnowledgeBase) -> None:
    values, battery = warm.function_values, "(battery rb1)"
    values.set(BATTERY, objects=[RB1], value=10)
    assert count(lambda: values.set(battery, value=9)) <= WRITE
    assert count(lambda: values.increase(BATTERY, objects=[RB1], by=1)) <= WRITE
    assert count(lambda: values.unset(battery)) <= WRITE
    assert count(lambda: values.set(battery, value=9)) <= WRITE
    assert count(lambda: values.set(battery, value=9.0)) == 1
    assert count(lambda: values.increase(battery, by=0)) == 1


def test_the_first_save_adds_only_the_rows_of_an_identity(warm: KnowledgeBase) -> None:
    warm.objects.save(waypoint(10))
    assert count(lambda: warm.propositions.save(fact(10))) <= FIRST_WRITE
    assert count(lambda: warm.function_values.save(distance(10))) <= FIRST_WRITE + 1


def test_what_another_writer_did_in_between_does_not_break_the_budget(
    shared_url: str, connect: Connect
) -> None:
    one, other = connect(shared_url), connect(shared_url)
    fill(one, 10)
    other.propositions.get_all()
    for number in range(3):
        assert count(partial(other.propositions.delete, fact(number))) <= WRITE
        assert count(partial(one.propositions.save, fact(number))) <= WRITE


@pytest.mark.parametrize("size", SIZES[:2])
def test_a_save_takes_as_many_statements_however_much_is_stored(
    kb: KnowledgeBase, request: pytest.FixtureRequest, size: int
) -> None:
    fill(kb, size)
    kb.propositions.delete(fact(0))
    # A server inserts the revision and the version by one statement.
    expected = 3 if "postgresql" in request.node.name else 4
    assert count(lambda: kb.propositions.save(fact(0))) == expected


def test_the_record_of_an_act_takes_three_statements_and_none_of_a_server(
    kb: KnowledgeBase, request: pytest.FixtureRequest
) -> None:
    kb.load_domain(
        "(define (domain d) (:types place) (:predicates (at ?p - place)) (:action go"
        " :parameters (?a ?b - place) :precondition (at ?a)"
        " :effect (and (not (at ?a)) (at ?b))))"
    )
    kb.load_problem(
        "(define (problem p) (:domain d) (:objects a b - place) (:init (at a)) (:goal (and)))"
    )
    kb.apply("(go a b)")
    kb.apply("(go b a)")
    # The lock, the condition, what ends, what begins with its record, and the head.
    assert count(lambda: kb.apply("(go a b)")) == (5 if "postgresql" in request.node.name else 9)


def test_a_transaction_writes_many_changes_in_the_statements_of_one(warm: KnowledgeBase) -> None:
    def delete(numbers: range) -> None:
        with warm.transaction():
            for number in numbers:
                warm.propositions.delete(fact(number))

    assert count(lambda: delete(range(1))) == count(lambda: delete(range(1, 10))) <= WRITE


def test_save_all_takes_as_many_statements_for_a_thousand_as_for_ten(warm: KnowledgeBase) -> None:
    warm.objects.save_all(waypoint(number) for number in range(2_000))
    few, many = range(10, 20), range(20, 1_020)
    facts, values = warm.propositions, warm.function_values
    for numbers in (few, many):
        assert count(partial(facts.save_all, [*map(fact, numbers)])) <= FIRST_WRITE
    taken = {count(partial(values.save_all, [*map(distance, each)])) for each in (few, many)}
    assert len(taken) == 1
    assert max(taken) <= FIRST_WRITE + 1
    others = [distance(number, 2) for number in range(10, 1_020)]
    assert count(lambda: values.save_all(others)) <= WRITE
    assert count(lambda: values.save_all(others)) == 1
    assert values.get("(distance wp1 wp1019)") == 2


@pytest.mark.parametrize(("gone", "sizes"), [(RB1, (1, 100)), (WP1, (10, 500))], ids=str)
def test_deleting_an_object_takes_as_many_statements_however_much_mentions_it(
    kb: KnowledgeBase, gone: PddlObjectDto, sizes: tuple[int, int]
) -> None:
    counts = set()
    for size in sizes:
        fill_all(kb, size)
        kb.function_values.set(LOCATION, objects=[RB1], value=WP1)
        counts.add(count(lambda: kb.objects.delete(gone)))
        assert (kb.propositions if gone == RB1 else kb.function_values).get_all()[1:] == []
    assert len(counts) == 1


# Reads.


def test_a_warm_read_takes_two_statements_however_many_rows_it_gives(kb: KnowledgeBase) -> None:
    taken: dict[str, set[int]] = {name: set() for name in ALL_READS}
    for size in SIZES:
        fill_all(kb, size)
        kb.propositions.get_all()
        for name, read in ALL_READS.items():
            taken[name].add(count(partial(read, kb)))
    assert len(kb.propositions.get_all()) == SIZES[-1]
    assert all(len(counts) == 1 and max(counts) <= READ for counts in taken.values()), taken


@pytest.mark.parametrize("size", SIZES)
def test_a_freshly_opened_store_answers_with_two_statements_at_most(
    shared_url: str, connect: Connect, size: int
) -> None:
    fill_all(connect(shared_url), size)
    taken = {}
    for name, read in ALL_READS.items():
        cold = connect(shared_url)
        taken[name] = count(partial(read, cold))
    assert max(taken.values()) <= READ, taken


@pytest.mark.parametrize("size", SIZES[:2])
def test_reads_of_the_past_take_two_statements_at_most_once_its_definitions_are_known(
    shared_url: str, connect: Connect, size: int
) -> None:
    kb = connect(shared_url)
    fill_all(kb, size)
    kb.propositions.delete_all()
    kb.function_values.delete_all()
    cold = connect(shared_url)
    assert count(lambda: cold.at(3)) <= READ
    past = cold.at(3)
    # Who last changed a definition, by now and by then, and what it was then.
    assert count(past.propositions.get_all) <= READ + 2
    taken = {name: count(partial(read, past)) for name, read in ALL_READS.items()}
    assert max(taken.values()) <= READ, taken
    assert len(past.propositions.get_all()) == len(past.function_values.get_all()) == size
    assert count(cold.at(1).types.get_all) <= READ + 1


def test_new_definitions_of_another_writer_cost_two_statements_once(
    shared_url: str, connect: Connect
) -> None:
    one, other = connect(shared_url), connect(shared_url)
    fill(one, 10)
    other.propositions.get_all()
    one.propositions.save(fact(99))
    assert count(other.propositions.get_all) <= READ + 2
    assert count(other.propositions.get_all) <= READ


@pytest.mark.parametrize("size", SIZES[:2])
def test_reads_in_a_transaction_take_two_statements_at_most(kb: KnowledgeBase, size: int) -> None:
    fill_all(kb, size)
    with kb.transaction():
        kb.propositions.delete(fact(0))
        # What is pending is written first.
        kb.propositions.get_all()
        taken = {name: count(partial(read, kb)) for name, read in ALL_READS.items()}
        assert max(taken.values()) <= READ, taken
        assert kb.propositions.get_by_object("rb1") == kb.propositions.get_all()


# The most statements: beside those of the question, who committed at its ends, and the definitions.
VALID: dict[str, tuple[int, Call]] = {
    "when of a fact": (11, lambda kb: next(iter(kb.when("(robot_at rb1 wp1)", clock="valid")))),
    "when": (12, lambda kb: next(iter(kb.when("(robot_at ?r ?w)", clock="valid")))),
    "check_rules": (12, lambda kb: kb.pddl.check_rules(RULE, clock="valid")),
    "diff": (10, lambda kb: kb.diff(1, kb.revision, clock="valid")),
    # Lanes of few and of many versions are read in two ways.
    "timeline": (19, lambda kb: kb.timeline(clock="valid")),
    "query": (6, lambda kb: list(kb.at(valid=LATE[0]).query("(robot_at ?r ?w)"))),
    "holds": (5, lambda kb: kb.at(valid=LATE[0]).holds("(robot_at rb1 wp1)")),
    "corrections": (5, lambda kb: kb.corrections(limit=10)),
}


def test_questions_of_valid_time_take_as_many_statements_however_much_was_said(
    kb: KnowledgeBase,
) -> None:
    taken: dict[str, list[int]] = {name: [] for name in VALID}
    for size in (2, 200):
        fill(kb, size)
        with kb.transaction(valid_from=LATE[0], valid_until=LATE[1]):
            kb.propositions.save_all(map(fact, range(size)))
        with kb.transaction(valid_from=LATE[0] + timedelta(minutes=1), valid_until=LATE[1]):
            for number in range(size):
                kb.propositions.delete(fact(number))
        for name, (_, ask) in VALID.items():
            ask(kb)
            taken[name].append(count(partial(ask, kb)))
    assert len(kb.corrections()) >= 2 * 200
    most = {name: budget for name, (budget, _) in VALID.items()}
    assert all(few >= many and few <= most[name] for name, (few, many) in taken.items()), taken


def test_a_view_of_valid_time_answers_by_one_statement_after_its_first_answers(
    kb: KnowledgeBase,
) -> None:
    fill(kb, 20)
    with kb.transaction(valid_from=LATE[0], valid_until=LATE[1]):
        kb.propositions.save_all(map(fact, range(20)))
    for moment in (*LATE, kb.store.revisions()[-1].committed_at):
        view = kb.at(valid=moment)
        for _ in range(3):
            view.holds("(robot_at rb1 wp1)")
        assert count(lambda: view.holds("(robot_at rb1 wp1)")) == 1  # noqa: B023
    kb.types.save("another")
    view.holds("(robot_at rb1 wp1)")
    assert count(lambda: view.holds("(robot_at rb1 wp1)")) <= 2


# By names, the versions and their revisions; of facts, also who confirmed them, and of which acts
# they are effects. Of a formula, first all texts. The log is read in pages.
PAST: dict[str, tuple[int, Call]] = {
    "revision": (1, lambda kb: kb.revision),
    "revisions": (1, lambda kb: kb.store.revisions()),
    "blame": (2, lambda kb: kb.blame(fact(0))),
    "history of a fact": (3, lambda kb: kb.history(fact(0))),
    "history of its text": (3, lambda kb: kb.history("(robot_at rb1 wp0)")),
    "history of an object": (3, lambda kb: kb.history("rb1")),
    "history of a value": (3, lambda kb: kb.history("(distance wp1 wp0)")),
    "history of a formula": (3, lambda kb: kb.history("(> (distance wp1 wp0) 0)")),
    "diff": (3, lambda kb: kb.diff(1, kb.revision)),
    "log": (3, lambda kb: [*kb.log()]),
    "log of an actor": (3, lambda kb: [*kb.log(actor="test")]),
    "log between": (3, lambda kb: [*kb.log(1, until=2)]),
    "log between times": (3, lambda kb: [*kb.log("yesterday", until="now")]),
    "log of a fact": (3, lambda kb: [*kb.log(element=fact(0))]),
    "log of an object": (5, lambda kb: [*kb.log(element=RB1)]),
}


def test_questions_of_the_past_take_as_many_statements_whatever_happened(kb: KnowledgeBase) -> None:
    taken: dict[str, set[int]] = {name: set() for name in PAST}
    for size in (1, 30):
        fill_all(kb, size)
        for number in range(size):
            kb.propositions.delete(fact(0))
            kb.propositions.save(fact(0))
            kb.function_values.save(distance(0, number + 2))
            kb.goals.save(f"(> (distance wp1 wp0) {number})")
        for name, (_, ask) in PAST.items():
            taken[name].add(count(partial(ask, kb)))
    assert taken == {name: {number} for name, (number, _) in PAST.items()}
    assert len(kb.history(fact(0))) == 1 + 1 + 30


# The language.


# One for the facts and goals, one for the values, one for their fluents; one for definitions.
DOCUMENT = 5
LANGUAGE: dict[str, Call] = {
    "goals.get_all": lambda kb: kb.goals.get_all(),
    "derived_predicates.get_all": lambda kb: kb.pddl.derived_predicates.get_all(),
    "timed_initial_literals.get_all": lambda kb: kb.pddl.timed_initial_literals.get_all(),
    "initial_literals.get_all": lambda kb: kb.pddl.initial_literals.get_all(),
    "constraints.get_all": lambda kb: kb.pddl.constraints.get_all(),
    "domain_constraints.get_all": lambda kb: kb.pddl.domain_constraints.get_all(),
    "metric.get": lambda kb: kb.pddl.metric.get(),
    "processes.get_all": lambda kb: kb.pddl.processes.get_all(),
    "events.get": lambda kb: kb.pddl.events.get("nothing"),
    "domain": lambda kb: kb.pddl.domain(),
    "domain_pddl": lambda kb: kb.domain_pddl(),
}
DOCUMENTS: dict[str, Call] = {
    "problem": lambda kb: kb.pddl.problem(),
    "problem_pddl": lambda kb: kb.problem_pddl(),
    "requirements": lambda kb: kb.pddl.requirements(),
}


def fill_depot(kb: KnowledgeBase, size: int) -> None:
    """Give a knowledge base so much of everything in the language."""
    trucks = " ".join(f"t{number}" for number in range(1, size + 2))
    init = " ".join(
        f"(at t{number} p1) (= (fuel t{number}) {number}) (= (home t{number}) p1)"
        for number in range(1, size + 1)
    )
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(
            f"(define (problem many) (:domain depot) (:objects {trucks} - truck p1 p2 - place) "
            f"(:init {init}) (:goal (at t1 p2)))"
        )
        for each in range(size):
            bound = Number(each)
            kb.goals.save(Comparison(">", fuel(), bound))
            kb.pddl.timed_initial_literals.save(TimedLiteral(bound, at()))
            kb.pddl.constraints.save(Modal("within", (bound,), (IDLE,)))
        kb.pddl.initial_literals.save(Not(IDLE))
        kb.pddl.derived_predicates.save(Derived("reachable", (PLACE,), Exists((TRUCK,), at(T, P))))


@pytest.mark.parametrize("size", [1, 300])
def test_a_warm_read_of_the_language_takes_as_many_statements_however_much_it_gives(
    kb: KnowledgeBase, size: int
) -> None:
    fill_depot(kb, size)
    kb.pddl.problem()
    taken = {name: count(partial(read, kb)) for name, read in LANGUAGE.items()}
    assert max(taken.values()) <= READ, taken
    taken = {name: count(partial(read, kb)) for name, read in DOCUMENTS.items()}
    assert max(taken.values()) <= DOCUMENT, taken
    assert len(kb.pddl.problem().timed) == size


@pytest.mark.parametrize("size", [1, 300])
def test_a_cold_read_and_one_of_the_past_take_as_many(
    shared_url: str, connect: Connect, size: int
) -> None:
    kb = connect(shared_url)
    fill_depot(kb, size)
    text = kb.problem_pddl()
    kb.load_problem("(define (problem none) (:domain depot) (:init) (:goal (and)))")
    for name in ("goals.get_all", "domain_pddl", *DOCUMENTS):
        read = (LANGUAGE | DOCUMENTS)[name]
        most = READ + 1 if name in LANGUAGE else DOCUMENT + 1
        cold = connect(shared_url)
        assert count(partial(read, cold)) <= most, name
        past = connect(shared_url).at(1)
        # Which definitions were those of then is asked, too.
        assert count(partial(read, past)) <= most + 1, name
    assert kb.at(1).problem_pddl() == text


def test_a_load_takes_as_many_statements_for_many_facts_as_for_some(
    shared_url: str, connect: Connect
) -> None:
    taken = []
    for size in (60, 600):
        kb = connect(shared_url, knowledge_base=f"robot {size}")
        init = " ".join(f"(at t{n} p1) (= (fuel t{n}) 1)" for n in range(size))
        trucks = " ".join(f"t{n}" for n in range(size))
        text = (
            f"(define (problem many) (:domain depot) (:objects {trucks} - truck p1 - place) "
            f"(:init {init}) (:goal (and)))"
        )
        kb.load_domain(DOMAIN)
        taken.append(count(partial(kb.load_problem, text)))
        assert count(partial(kb.load_problem, text)) <= max(taken)
    assert taken[0] == taken[1]


def test_a_formula_takes_few_statements_to_save_and_to_delete(kb: KnowledgeBase) -> None:
    fill_depot(kb, 1)
    goal = Comparison("<", fuel(), Number(77))
    # Lock, identity, its row, revision, head, and version, nodes and terms.
    assert count(lambda: kb.goals.save(goal)) <= 8
    assert count(lambda: kb.goals.save(goal)) == 1
    assert count(lambda: kb.goals.delete(goal)) <= 4
    assert count(lambda: kb.goals.delete(goal)) <= 2


def test_opening_a_store_takes_three_statements_at_most(shared_url: str, connect: Connect) -> None:
    fill(connect(shared_url), 100)
    assert count(lambda: connect(shared_url)) <= OPEN


# The log `kant_sql.sql` has each statement that runs, so counting there is honest.


@contextmanager
def seen_by_sqlite() -> Iterator[list[str]]:
    """Give what SQLite itself runs on the connections that are made in a block."""
    seen: list[str] = []
    connect_ = sqlite3.connect

    def connect(*args: Any, **options: Any) -> sqlite3.Connection:
        connection: sqlite3.Connection = connect_(*args, **options)
        # To look at the file itself, apart from its log, is no statement on the store.
        if "immutable" not in args[0]:
            connection.set_trace_callback(seen.append)
        return connection

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect)
        yield seen


@contextmanager
def seen_by_psycopg() -> Iterator[list[str]]:
    """Give what psycopg is asked to run in a block."""
    seen: list[str] = []

    def spy(owner: Any, name: str) -> None:
        method = getattr(owner, name)

        def spied(self: Any, sql: str, *args: Any, **options: Any) -> Any:
            seen.append(sql)
            return method(self, sql, *args, **options)

        patch.setattr(owner, name, spied)

    with pytest.MonkeyPatch.context() as patch:
        for name in ("execute", "executemany", "copy"):
            spy(psycopg.Cursor, name)
        spy(psycopg.ServerCursor, "execute")
        yield seen


def heads(statements: list[str]) -> list[str]:
    """Tell statements apart by their first words, for a trace has values in place of parameters."""
    return [" ".join(sql.split()[:3]) for sql in statements if not is_bracket(sql)]


def batches_as_one(statements: list[str]) -> list[str]:
    """Take rows that are inserted into one table, one after the other, as one statement."""
    return [
        head
        for head, same in groupby(heads(statements))
        for _ in (same if not head.startswith("INSERT") else [head])
    ]


def work_on(kb: KnowledgeBase) -> None:
    """Use all that runs statements."""
    for read in ALL_READS.values():
        read(kb)
    kb.propositions.delete(fact(1))
    with kb.transaction():
        kb.propositions.save(fact(1))
        kb.propositions.get_all()
        kb.propositions.save(fact(2))
    kb.at(1).propositions.get_by_predicate("robot_at")
    kb.store.revisions()
    list(kb.log())
    kb.objects.save_all(waypoint(number) for number in range(10, 100))
    kb.propositions.save_all(fact(number) for number in range(10, 100))


def test_on_sqlite_the_log_has_what_the_database_runs(file_url: str, connect: Connect) -> None:
    fill_all(connect(file_url), 10)
    with seen_by_sqlite() as seen, recorded() as logged:
        work_on(connect(file_url))
    # A connection's own settings.
    seen = [sql for sql in seen if not sql.startswith("PRAGMA")]
    assert len(logged) > 30
    assert batches_as_one(seen) == batches_as_one(logged)


def test_on_postgresql_the_log_has_what_the_driver_is_given(
    server: Server, connect: Connect
) -> None:
    url = server.new_store()
    fill_all(connect(url), 10)
    with seen_by_psycopg() as seen, recorded() as logged:
        work_on(connect(url))
    assert any(sql.startswith("COPY") for sql in logged)
    # What sets up a connection is not logged.
    made = [
        "SELECT set_config('lock_timeout', '20s',",
        "SELECT extname FROM",
        "SELECT row_security_active(to_regclass('revision'))",
    ]
    assert heads(seen) == [*made, *heads(logged)]
