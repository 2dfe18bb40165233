"""The statements that a call runs, by the log; and calls to check by their statements."""

from __future__ import annotations

import itertools
import logging
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

import psycopg
import pytest

from kant_sql import KnowledgeBase, PddlPropositionDto
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.query import Query
from tests.support.worlds.robots import RB1, navigation, robot_at, waypoint

Call = Callable[[KnowledgeBase], Any]

READS: dict[str, Call] = {
    "propositions.get_all": lambda kb: kb.propositions.get_all(),
    "propositions.get_by_predicate": lambda kb: kb.propositions.get_by_predicate("robot_at"),
    "goals.get_propositions": lambda kb: kb.goals.get_propositions(),
    "propositions.get_by_object": lambda kb: kb.propositions.get_by_object("rb1"),
    "types.get": lambda kb: kb.types.get("wp"),
    "types.get_all": lambda kb: kb.types.get_all(),
    "objects.get": lambda kb: kb.objects.get("wp1"),
    "objects.get_all": lambda kb: kb.objects.get_all(),
    "objects.get_by_type": lambda kb: kb.objects.get_by_type("wp"),
    "predicates.get": lambda kb: kb.predicates.get("robot_at"),
    "predicates.get_all": lambda kb: kb.predicates.get_all(),
    "actions.get": lambda kb: kb.actions.get("navigation"),
    "actions.get_all": lambda kb: kb.actions.get_all(),
}
# These also need a knowledge base with distances.
VALUE_READS: dict[str, Call] = {
    "function_values.get_all": lambda kb: kb.function_values.get_all(),
    "function_values.get_by_function": lambda kb: kb.function_values.get_by_function("distance"),
    "function_values.get": lambda kb: kb.function_values.get("(distance wp1 wp0)"),
    "function_values.get of nothing": lambda kb: kb.function_values.get("(distance wp0 wp0)"),
    "functions.get_all": lambda kb: kb.functions.get_all(),
}


class _Recorder(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.statements: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        # Connection pools log under the same name.
        sql: str | None = getattr(record, "sql", None)
        if sql is not None and not is_bracket(sql):
            self.statements.append(sql)


def is_bracket(sql: str) -> bool:
    """Return whether it only begins or ends a transaction."""
    return sql.startswith(("BEGIN", "COMMIT")) or sql == "ROLLBACK"


@contextmanager
def recorded() -> Iterator[list[str]]:
    """Yield the statements of a block, without BEGIN, COMMIT and ROLLBACK."""
    logger, recorder = logging.getLogger("kant_sql.sql"), _Recorder()
    level, execute = logger.level, Session._execute

    def log(self: Session, statement: str | Query, parameters: Any = ()) -> None:
        # Even in a transaction that is already open.
        self.is_logged = True
        execute(self, statement, parameters)

    logger.addHandler(recorder)
    logger.setLevel(logging.DEBUG)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Session, "_execute", log)
            yield recorder.statements
    finally:
        logger.setLevel(level)
        logger.removeHandler(recorder)


def count(call: Callable[[], Any]) -> int:
    with recorded() as statements:
        call()
    return len(statements)


def fill(kb: KnowledgeBase, size: int) -> None:
    """Save an action, some facts, and half as many goals, in a knowledge base."""
    kb.actions.save(navigation())
    with kb.transaction():
        kb.propositions.save_all(robot_at(RB1, waypoint(number)) for number in range(size))
        kb.goals.save_all(robot_at(RB1, waypoint(number), True) for number in range(0, size, 2))


def fact(number: int) -> PddlPropositionDto:
    return robot_at(RB1, waypoint(number))


class Statement(NamedTuple):
    """A statement as it ran."""

    sql: str
    parameters: Any


def text_of(session: Session, statement: str | Query) -> str:
    """Return the text of a statement that a session executes."""
    return statement if isinstance(statement, str) else statement.text(session.backend.dialect)


@contextmanager
def seen() -> Iterator[list[Statement]]:
    """Yield the statements of a block with their parameters; for a batch, the first row's."""
    statements: list[Statement] = []
    execute, execute_many = Session._execute, Session._execute_many

    def spy(self: Session, statement: str | Query, parameters: Any = ()) -> None:
        statements.append(Statement(*self.for_driver(text_of(self, statement), parameters)))
        execute(self, statement, parameters)

    def spy_many(self: Session, sql: str, parameters: Sequence[Any]) -> None:
        statements.append(Statement(sql, parameters[0]))
        execute_many(self, sql, parameters)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "_execute", spy)
        patch.setattr(Session, "_execute_many", spy_many)
        yield statements


def explain(url: str, statement: Statement) -> list[str]:
    """Return the plan of a statement, in its own connection: a line for each step."""
    if url.startswith("sqlite"):
        with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as lite:
            rows = lite.execute(f"EXPLAIN QUERY PLAN {statement.sql}", statement.parameters)
            return [row[3] for row in rows]
    query: Any = f"EXPLAIN (COSTS OFF) {statement.sql}"
    with psycopg.connect(url) as connection:
        return [row[0] for row in connection.execute(query, statement.parameters)]


def work(url: str, statement: Statement) -> float:
    """Run a statement and undo it; count its work.

    Returns:
        The steps of SQLite's virtual machine, or the number of rows that the busiest step of
        PostgreSQL's plan read.
    """
    if url.startswith("sqlite"):
        steps = itertools.count()
        with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as lite:
            lite.set_progress_handler(lambda: next(steps) < 0, 10)
            lite.execute(statement.sql, statement.parameters).fetchall()
        return 10 * next(steps)
    query: Any = f"EXPLAIN (ANALYZE, FORMAT JSON) {statement.sql}"
    with psycopg.connect(url) as connection:
        ((plan,),) = connection.execute(query, statement.parameters).fetchall()
        connection.rollback()

    def touched(node: dict[str, Any]) -> Iterator[float]:
        removed = sum(node[key] for key in node if key.startswith("Rows Removed"))
        yield (node["Actual Rows"] + removed) * node["Actual Loops"]
        for child in node.get("Plans", ()):
            yield from touched(child)

    return round(max(touched(plan[0]["Plan"])))
