"""The errors of the library, all under `KantSqlError`.

A message names the element, the reason and the remedy, and never contains a password. Errors of the
database are raised `from` the driver's.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

__all__ = [
    "AnchorError",
    "ArchivedError",
    "ArityError",
    "AuthenticationError",
    "ClosedError",
    "ConflictError",
    "ConnectionLostError",
    "DependantsError",
    "DivergedError",
    "ExtraMissingError",
    "ForkedError",
    "InvalidArgumentError",
    "InvalidKnowledgeError",
    "InvalidMetadataError",
    "InvalidNameError",
    "InvalidTimeoutError",
    "InvalidUrlError",
    "KantSqlError",
    "MergeConflictError",
    "NoPlanError",
    "NotADatabaseError",
    "NotApplicableError",
    "OutcomeUnknownError",
    "PddlError",
    "PlanError",
    "PlannerMissingError",
    "QuestionCancelledError",
    "ReadOnlyError",
    "ReadOnlyStoreError",
    "ReplicaError",
    "RuleViolatedError",
    "SchemaError",
    "SchemaMissingError",
    "SchemaOutdatedError",
    "SchemaTooNewError",
    "SourceError",
    "SourceMissingError",
    "StaleRevisionError",
    "StatementTimeoutError",
    "StoreBusyError",
    "StoreError",
    "StoreFullError",
    "StoreIntegrityError",
    "StoreReplacedError",
    "StoreUnreachableError",
    "TableMissingError",
    "TransactionCancelledError",
    "TransactionOpenError",
    "TypeCycleError",
    "TypeMismatchError",
    "UnknownNameError",
    "UnknownRevisionError",
    "UnsupportedConstructError",
]

T = TypeVar("T")
R = TypeVar("R", bound=Sequence[Any])


# Controls, line and paragraph separators, bidirectional overrides, and lone surrogates.
_CONTROLS = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    """Escape characters that could end a line or control a terminal, as JSON does."""
    return _CONTROLS.sub(lambda match: json.dumps(match[0])[1:-1], text)


# A longer message loses its middle: the subject is at its ends.
MAX_MESSAGE = 2_000
_SURROGATES = re.compile("[\ud800-\udfff]")


class KantSqlError(Exception):
    """The base class of all errors that this library raises."""

    def __str__(self) -> str:
        """Return the bounded message, as text that any output can encode."""
        text = _SURROGATES.sub(lambda match: json.dumps(match[0])[1:-1], super().__str__())
        if len(text) <= MAX_MESSAGE:
            return text
        half = MAX_MESSAGE // 2 - 20
        return f"{text[:half]} ... ({len(text):,} characters) ... {text[-half:]}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the attributes of the error, not the arguments of its constructor."""
        return _unpickled, (type(self), self.args, self.__dict__)


def _unpickled(cls: type[KantSqlError], args: tuple[Any, ...], state: dict[str, Any]) -> Exception:
    made = cls.__new__(cls, *args)
    made.args = args
    made.__dict__.update(state)
    return made


class InvalidKnowledgeError(KantSqlError, ValueError):
    """The given knowledge is not well-formed PDDL; none of it was stored."""


class InvalidNameError(InvalidKnowledgeError):
    """The name cannot be written as PDDL text."""


class ArityError(InvalidKnowledgeError):
    """The number of arguments differs from the number of parameters."""


class TypeMismatchError(InvalidKnowledgeError):
    """An object's type is neither the parameter's type nor a subtype of it."""


class TypeCycleError(InvalidKnowledgeError):
    """A type would be its own ancestor."""


class InvalidArgumentError(KantSqlError, ValueError):
    """An argument that is not knowledge, such as a limit, has a wrong type or value."""


class PddlError(InvalidKnowledgeError):
    """The PDDL text cannot be read.

    Attributes:
        source: the file's path, or `<string>`.
        line: the line, from 1.
        column: the column, from 1.
        found: what was found.
        expected: what was expected.
        nesting: the enclosing construct, such as `action move, :effect`; may be empty.
    """

    def __init__(
        self, source: str, line: int, column: int, found: str, expected: str, nesting: str = ""
    ) -> None:
        within = f"in {nesting}: " if nesting else ""
        super().__init__(f"{source}:{line}:{column}: {within}found {found}, expected {expected}")
        self.source, self.line, self.column = source, line, column
        self.found, self.expected, self.nesting = found, expected, nesting


# The longest names of a system may have 4,096 bytes, but text that is not a name may be endless.
_LONGEST_NAME = 1_000


class SourceError(KantSqlError, OSError):
    """A PDDL file cannot be opened or read.

    Attributes:
        errno: the system's error number.
        strerror: the system's error message.
        filename: the file's path as text.
    """

    def __init__(self, errno: int, strerror: str, filename: str) -> None:
        super().__init__(errno, strerror, filename)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.errno, self.strerror, self.filename)

    def __str__(self) -> str:
        name = f"{self.filename!r}"
        if len(name) > _LONGEST_NAME:
            name = f"{name[:_LONGEST_NAME]}..."
        return (
            f"cannot read the file {name}: {self.strerror}; give the path of a readable"
            " file, or PDDL text, which begins with '('"
        )


class SourceMissingError(SourceError, FileNotFoundError):
    """A PDDL file does not exist."""


class ConflictError(KantSqlError):
    """A save refers to an element that is stored with another definition."""


class DivergedError(ConflictError):
    """Two stores have different histories of a knowledge base; nothing was written.

    Attributes:
        revision: the first revision that differs.
        source_hash: its hash in the source.
        target_hash: its hash in the target.
    """

    def __init__(
        self,
        message: str,
        revision: int,
        source_hash: str | None = None,
        target_hash: str | None = None,
    ) -> None:
        super().__init__(message)
        self.revision = revision
        self.source_hash = source_hash
        self.target_hash = target_hash


class MergeConflictError(ConflictError):
    """A merge has conflicts that are not decided.

    Attributes:
        conflicts: each a `MergeConflict`, decided or not.
    """

    def __init__(self, message: str, conflicts: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.conflicts = tuple(conflicts)


class DependantsError(KantSqlError):
    """Live knowledge depends on the present definition; the redefinition was refused.

    Attributes:
        dependants: the PDDL text of each dependent element.
    """

    def __init__(self, message: str, dependants: Sequence[str]) -> None:
        super().__init__(message)
        self.dependants = tuple(dependants)


class ReadOnlyError(KantSqlError):
    """This cannot be written: a past state, for example, is read-only."""


class ReplicaError(KantSqlError):
    """A local write to a replica, or a push to a knowledge base that is not a replica."""


class NotApplicableError(KantSqlError):
    """A step cannot be executed in this state; nothing was written.

    Attributes:
        unsatisfied: the conditions that do not hold, each a `FailedCondition`.
    """

    def __init__(self, message: str, unsatisfied: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.unsatisfied = tuple(unsatisfied)


class StaleRevisionError(KantSqlError):
    """The head is not the revision that the writer expected.

    Attributes:
        expected: the revision that the caller expected.
        actual: the revision of the head.
    """

    def __init__(self, message: str, expected: int, actual: int) -> None:
        super().__init__(message)
        self.expected = expected
        self.actual = actual


class UnknownRevisionError(KantSqlError, LookupError):
    """The knowledge base has not reached this revision or time."""


class UnknownNameError(KantSqlError, LookupError):
    """The knowledge base has never had an element, or an actor, of this name."""


class ArchivedError(UnknownRevisionError):
    """A part of the past state is in an archive, which the message names."""


class PlanError(KantSqlError):
    """A plan, or the status of one of its steps, contradicts the store."""


class AnchorError(InvalidArgumentError):
    """The document is not an anchor."""


class InvalidUrlError(InvalidArgumentError):
    """The database URL cannot be parsed, or has no DAO family."""


class SchemaError(KantSqlError):
    """The tables have another version than this library needs."""


class SchemaMissingError(SchemaError):
    """The database has no kant_sql tables yet."""


class SchemaOutdatedError(SchemaError):
    """The tables have an older version; run the migrations."""


class SchemaTooNewError(SchemaError):
    """The tables have a newer version than this library knows."""


class StoreError(KantSqlError):
    """The database refused or failed; raised `from` the driver's error."""


class ReadOnlyStoreError(StoreError, ReadOnlyError):
    """The file or the user's rights allow only reading."""


class StoreUnreachableError(StoreError):
    """The server does not answer, or the file cannot be opened."""


class AuthenticationError(StoreError):
    """The server refused the user or the password."""


class NotADatabaseError(StoreError):
    """The file is not an SQLite database, or it is damaged."""


class StoreBusyError(StoreError):
    """Another writer held the lock for longer than the timeout; nothing was written."""


class StoreFullError(StoreError):
    """The disk of the store is full; nothing of the open transaction was written."""


class ConnectionLostError(StoreError):
    """The connection was lost inside a transaction; nothing of it was written."""


class StatementTimeoutError(StoreError):
    """A statement took longer than its limit, and the database ended it."""


class QuestionCancelledError(StoreError):
    """The question was cancelled by `Limit.cancel`."""


class ClosedError(StoreError):
    """The knowledge base was closed; nothing was read or written."""


class TransactionOpenError(StoreError):
    """A task, callback or context would wait for a transaction open in its own thread.

    Only the task and context that opened a transaction may use it; waiting for it in the same
    thread would block the event loop forever. The call has written nothing, and the open
    transaction continues.
    """


class TransactionCancelledError(StoreError):
    """A call in an asynchronous transaction was cancelled; nothing of the block was written."""


class OutcomeUnknownError(StoreError):
    """The connection was lost during a commit, and the store stayed unreachable.

    The message names the revision and its hash: if the store has it, all of it was written.
    """


class StoreReplacedError(StoreError):
    """The store's file was deleted, renamed, replaced, or overwritten while it was open.

    The connections are unusable: close the knowledge base and connect again.
    """


class ForkedError(StoreError):
    """The process was forked at a moment at which a child cannot use SQLite."""


class StoreIntegrityError(StoreError):
    """The content of the tables is damaged, or a constraint refused the write."""


class RuleViolatedError(StoreIntegrityError):
    """The write would violate a kept rule with `on_violation="refuse"`; nothing was written.

    Attributes:
        rule: the name of the rule.
        instance: the violated rule, with objects for the variables of its outer quantifiers.
        reads: the knowledge that the violation depends on: each `fact` or `value`, its predicate or
            function, and its objects; None for any object.
    """

    def __init__(
        self, message: str, rule: str, instance: str, reads: tuple[tuple[str | None, ...], ...] = ()
    ) -> None:
        super().__init__(message)
        self.rule = rule
        self.instance = instance
        self.reads = reads


class TableMissingError(StoreError):
    """A table is missing in the database."""


class InvalidMetadataError(InvalidArgumentError):
    """The actor, reason or source of a revision cannot be stored as given."""


class InvalidTimeoutError(InvalidArgumentError):
    """The timeout is not a number of seconds from 0 on."""


class UnsupportedConstructError(KantSqlError):
    """A construct has no exact counterpart in the target format."""


class PlannerMissingError(KantSqlError, ImportError):
    """A package that planning needs is not installed."""


class ExtraMissingError(KantSqlError, ImportError):
    """A required package is not installed; the message names its extra."""


class NoPlanError(KantSqlError):
    """No planner found a plan.

    Attributes:
        status: the reason, a status of unified-planning: `unsolvable_proven`,
            `unsolvable_incompletely`, `timeout`, `memout`, `unsupported_problem`,
            `internal_error`; or `invalid_plan`.
        runs: the run of each engine, as in `Plan.runs`.
    """

    def __init__(self, message: str, status: str) -> None:
        super().__init__(message)
        self.status = status
        self.runs: tuple[Any, ...] = ()


# Code that reads damaged rows raises these.
UNREADABLE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    StopIteration,
    TypeError,
    ValueError,
)


def unreadable(table: str, key: object, error: Exception) -> StoreIntegrityError:
    """Make the error for rows that cannot be read."""
    return StoreIntegrityError(
        f"table {table}, {key}: the rows cannot be read ({type(error).__name__}: "
        f"{printable(str(error))}); they were damaged, or changed by hand: 'kant-sql verify' shows "
        "what else was; restore the store from a copy"
    )


def few_of(items: Sequence[object], most: int, separator: str = "; ") -> str:
    """Name the first items in a message, and the number of the others."""
    said, left = separator.join(map(str, items[:most])), len(items) - most
    return said if left <= 0 else f"{said}{separator.strip(' ,')} and {left} more"


def missing_revision(label: str, name: object, number: object) -> StoreIntegrityError:
    """Make the error for a missing revision up to the head."""
    return StoreIntegrityError(
        f"{label}: table head says that knowledge base {name!r} has revision {number!r}, which is "
        "missing in table revision: the head was altered, or revisions were removed: 'kant-sql "
        "verify' shows what else was; restore the store from a copy"
    )


@contextmanager
def needing(message: str) -> Iterator[None]:
    """Raise `ExtraMissingError` with a message if an import in the block fails."""
    try:
        yield
    except ImportError as error:
        raise ExtraMissingError(message) from error


@contextmanager
def reading_rows(table: str, key: object) -> Iterator[None]:
    """Raise `StoreIntegrityError`, which names the rows, if the block fails on their content."""
    try:
        yield
    except InvalidKnowledgeError as error:
        # Rows that are not well-formed knowledge are damaged, too.
        raise unreadable(table, key, error) from error
    except KantSqlError:
        raise
    except UNREADABLE as error:
        raise unreadable(table, key, error) from error


def all_readable(table: str, rows: Sequence[R], make: Callable[[Sequence[R]], list[T]]) -> list[T]:
    """Convert rows, which begin with their id; the error names the row that fails."""
    try:
        return make(rows)
    except UNREADABLE:
        for row in rows:
            with reading_rows(table, f"id {row[0]!r}"):
                make([row])
        raise


def each_readable(table: str, rows: Sequence[R], make: Callable[[R], T]) -> list[T]:
    """Convert each row, which begins with its id; the error names the row that fails."""
    return all_readable(table, rows, lambda some: [make(row) for row in some])


def check_integer(table: str, key: object, column: str, value: object) -> None:
    """Check that a column has an integer: SQLite stores any type."""
    if not isinstance(value, int):
        raise unreadable(
            table, key, TypeError(f"column {column} has {value!r}, which is not an integer")
        )
