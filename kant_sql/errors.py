"""Every error of the library: one tree under `KantSqlError`.

A message says what was refused, which element it was and what to do about it. Errors that come
from the database are raised `from` the driver's own, and never carry a password.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R", bound=Sequence[Any])


def printable(text: str) -> str:
    """Escape what could pass for another line of a log, or command a terminal.

    Args:
        text: any text.

    Returns:
        The same on one line, with what is not printable as Python escapes it.
    """
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


class KantSqlError(Exception):
    """The root: catch it to catch all that this library raises on purpose."""


class InvalidKnowledgeError(KantSqlError, ValueError):
    """The knowledge given is not well formed PDDL; nothing of it was stored."""


class InvalidNameError(InvalidKnowledgeError):
    """A name that PDDL text could not carry."""


class ArityError(InvalidKnowledgeError):
    """A predicate was given more or fewer arguments than it has parameters."""


class TypeMismatchError(InvalidKnowledgeError):
    """An object's type is neither the parameter's type nor a subtype of it."""


class TypeCycleError(InvalidKnowledgeError):
    """A type would be its own ancestor."""


class InvalidArgumentError(KantSqlError, ValueError):
    """An argument of a call that is no knowledge, as a limit: it is of a wrong type or value."""


class PddlError(InvalidKnowledgeError):
    """PDDL text that cannot be read.

    Attributes:
        source: the file's path, or `<string>`.
        line: the line, from 1.
        column: the column, from 1.
        found: what is there.
        expected: what should be there.
        nesting: what it is in, such as `action move, :effect`; empty when it is in nothing.
    """

    def __init__(
        self, source: str, line: int, column: int, found: str, expected: str, nesting: str = ""
    ) -> None:
        within = f"in {nesting}: " if nesting else ""
        super().__init__(f"{source}:{line}:{column}: {within}found {found}, expected {expected}")
        self.source, self.line, self.column = source, line, column
        self.found, self.expected, self.nesting = found, expected, nesting

    def __reduce__(self) -> tuple[type[PddlError], tuple[str, int, int, str, str, str]]:
        parts = (self.source, self.line, self.column, self.found, self.expected, self.nesting)
        return PddlError, parts


class SourceError(KantSqlError, OSError):
    """A file of PDDL that cannot be opened or read.

    It has the attributes of any `OSError`.

    Attributes:
        errno: the system's number of the error.
        strerror: what the system says.
        filename: the file's path as text.
    """

    def __init__(self, errno: int, strerror: str, filename: str) -> None:
        super().__init__(errno, strerror, filename)

    def __str__(self) -> str:
        return (
            f"cannot read the file {self.filename!r}: {self.strerror}; give the path of a file that"
            " can be read, or PDDL text, which begins with '('"
        )


class SourceMissingError(SourceError, FileNotFoundError):
    """A file of PDDL that does not exist."""


class ConflictError(KantSqlError):
    """What a save refers to is stored already, with another definition."""


class DependantsError(KantSqlError):
    """A redefinition was refused, because live knowledge depends on the present definition.

    Attributes:
        dependants: the PDDL text of each element that depends on it.
    """

    def __init__(self, message: str, dependants: Sequence[str]) -> None:
        super().__init__(message)
        self.dependants = tuple(dependants)


class ReadOnlyError(KantSqlError):
    """A write was tried where only reading is possible, as on the past."""


class StaleRevisionError(KantSqlError):
    """The knowledge base has moved on from the revision that the writer had read.

    Attributes:
        expected: the revision that the caller expected to be the head.
        actual: the revision that is the head.
    """

    def __init__(self, message: str, expected: int, actual: int) -> None:
        super().__init__(message)
        self.expected = expected
        self.actual = actual


class UnknownRevisionError(KantSqlError, LookupError):
    """A revision, or a time, that the knowledge base has not reached."""


class ArchivedError(UnknownRevisionError):
    """What held at a revision was moved to an archive; the message names it."""


class PlanError(KantSqlError):
    """A plan, or the state of one of its steps, that does not go with what is stored."""


class AnchorError(InvalidArgumentError):
    """A document that should be an anchor, and is none."""


class InvalidUrlError(InvalidArgumentError):
    """A database URL that cannot be read, or that no DAO family answers to."""


class SchemaError(KantSqlError):
    """The tables in the database are not the ones that this version of the library works on."""


class SchemaMissingError(SchemaError):
    """The database has no kant_sql tables yet."""


class SchemaOutdatedError(SchemaError):
    """The tables are of an older version; migrations are pending."""


class SchemaTooNewError(SchemaError):
    """The tables are of a newer version than this library knows."""


class StoreError(KantSqlError):
    """The database refused or failed; raised `from` the driver's error."""


class ReadOnlyStoreError(StoreError, ReadOnlyError):
    """The file, or the user's rights, allow only reading."""


class StoreUnreachableError(StoreError):
    """The server does not answer, or the file cannot be opened."""


class AuthenticationError(StoreError):
    """The server refused the user or the password."""


class NotADatabaseError(StoreError):
    """The file is not an SQLite database, or it is damaged."""


class StoreBusyError(StoreError):
    """Another writer held the store for longer than a writer waits; nothing was written."""


class ConnectionLostError(StoreError):
    """The connection was lost inside a transaction; nothing of it was written."""


class ClosedError(StoreError):
    """The knowledge base was closed; nothing was read or written."""


class TransactionOpenError(StoreError):
    """A task, callback or context would wait for a transaction that its own thread has open.

    Only the task and context that opened a transaction may use it, and to wait for it in the same
    thread would block the event loop for ever. The call has written nothing, and the open
    transaction goes on.
    """


class TransactionCancelledError(StoreError):
    """A call within an asynchronous transaction was cancelled; nothing of the block was written."""


class OutcomeUnknownError(StoreError):
    """The connection was lost while a revision was committed, and the store did not come back.

    The message names the revision and its hash: if the store has it, all of it was written.
    """


class StoreReplacedError(StoreError):
    """The file of the store was deleted, renamed, replaced, or overwritten while it was open.

    The connections are of no use from then on: close the knowledge base and connect again.
    """


class ForkedError(StoreError):
    """A process was forked at a moment that its share of the store cannot survive."""


class StoreIntegrityError(StoreError):
    """A constraint of the database refused the write; nothing was written."""


class TableMissingError(StoreError):
    """A statement names a table that the database does not have."""


class InvalidMetadataError(InvalidArgumentError):
    """The actor, reason or source of a revision cannot be kept as given."""


class InvalidTimeoutError(InvalidArgumentError):
    """How long to wait was given as something that is no number of seconds from 0 on."""


class UnsupportedConstructError(KantSqlError):
    """A construct that the other side has no exact counterpart for; nothing was left out."""


class PlannerMissingError(KantSqlError, ImportError):
    """A package that planning needs is not installed."""


class NoPlanError(KantSqlError):
    """No planner found a plan.

    Attributes:
        status: why, in one word of unified-planning's: `unsolvable_proven`,
            `unsolvable_incompletely`, `timeout`, `memout`, `unsupported_problem`,
            `internal_error`.
    """

    def __init__(self, message: str, status: str) -> None:
        super().__init__(message)
        self.status = status


# What breaks where rows make no sense: damaged, or changed by hand.
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
    """Make the error for rows that make no sense.

    Args:
        table: the table.
        key: what names the rows there.
        error: what broke.

    Returns:
        The error to raise from it.
    """
    return StoreIntegrityError(
        f"table {table}, {key}: the rows cannot be read ({type(error).__name__}: "
        f"{printable(str(error))}); they were damaged, or changed by hand: 'kant-sql verify' shows "
        "what else was; restore the store from a copy"
    )


@contextmanager
def reading_rows(table: str, key: object) -> Iterator[None]:
    """Say of rows that make no sense where they are.

    Args:
        table: the table.
        key: what names the rows there.

    Raises:
        StoreIntegrityError: the block broke on what the rows hold.
    """
    try:
        yield
    except InvalidKnowledgeError as error:
        # Rows that make no well-formed knowledge are damaged, too.
        raise unreadable(table, key, error) from error
    except KantSqlError:
        raise
    except UNREADABLE as error:
        raise unreadable(table, key, error) from error


def each_readable(table: str, rows: Sequence[R], make: Callable[[R], T]) -> list[T]:
    """Make something of each row.

    Args:
        table: the table.
        rows: the rows, each with its id first.
        make: what makes it; it is called again where a row makes no sense.

    Returns:
        What was made.

    Raises:
        StoreIntegrityError: a row makes no sense; it is named.
    """
    try:
        return [make(row) for row in rows]
    except UNREADABLE:
        for row in rows:
            with reading_rows(table, f"id {row[0]!r}"):
                make(row)
        raise


def check_integer(table: str, key: object, column: str, value: object) -> None:
    """Refuse a number that is none: a column of SQLite keeps whatever it is given.

    Args:
        table: the table.
        key: what names the row there.
        column: the column.
        value: what stands there.

    Raises:
        StoreIntegrityError: it is no integer.
    """
    if not isinstance(value, int):
        raise unreadable(table, key, TypeError(f"column {column} has {value!r}, no integer"))
