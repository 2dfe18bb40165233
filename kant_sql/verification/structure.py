"""What the tables stand in: whether indexes, constraints and views are those of the migrations.

Who may change these can make the library, or an auditor, read something else than the tables have.
"""

from __future__ import annotations

from collections import defaultdict
from functools import cache

from ..backends import Session
from ..backends.indexes import index_faults
from ..backends.structure import Statement, live_statements, read_record
from ..backends.views import altered_views
from ..schema import VERSIONS, migrations_folder
from ..tables import Base
from .findings import Report

TABLES = tuple(sorted(Base.metadata.tables))
# How much of a statement a message shows.
_SHOWN = 200


@cache
def recorded(dialect_name: str) -> tuple[Statement, ...]:
    """Give what the migrations make, up to the last one.

    Args:
        dialect_name: the dialect.

    Returns:
        The statements, comments apart: they change nothing that is read.
    """
    path = migrations_folder() / "golden" / f"{dialect_name}-{VERSIONS[-1]}.sql"
    found = read_record(path.read_text(encoding="utf-8"))
    return tuple(each for each in found if not each.head.startswith("COMMENT"))


def check_structure(session: Session, report: Report) -> None:
    """Compare tables, constraints, indexes and views with those that the migrations make.

    What another program keeps in the same database is not looked at, as long as it does not belong
    to a table or a view of the library.

    Args:
        session: the session, in a transaction.
        report: takes what is wrong.
    """
    dialect = session.backend.dialect.name
    expected = {each.head: each for each in recorded(dialect)}
    names = {each.relation for each in expected.values() if each.relation is not None}
    live: defaultdict[str, list[Statement]] = defaultdict(list)
    for each in live_statements(session, names):
        if not each.head.startswith("COMMENT"):
            live[each.head].append(each)
    for head, made in expected.items():
        if head not in live:
            report.add(None, made.relation, f"{_shown(head)} is missing: the migrations make it")
    for head, found in live.items():
        for each in found if head not in expected else found[1:]:
            what = each.text if head.startswith("CREATE") else head.removeprefix("-- ")
            message = f"there is something that the migrations do not make: {_shortened(what)}"
            report.add(None, each.relation, message)
        if head in expected and found[0].text != expected[head].text:
            message = _difference(expected[head].text, found[0].text)
            report.add(None, found[0].relation, f"{_shown(head)} was changed: {message}")


def check_generated(session: Session, report: Report) -> None:
    """Compare the views that `kant-sql views` has made with the marks that they bear.

    Args:
        session: the session, in a transaction.
        report: takes what is wrong.
    """
    for view in altered_views(session):
        report.add(
            None,
            view,
            f"view {view} is not what 'kant-sql views' made; drop it with 'kant-sql views --drop', "
            "and make it again with 'kant-sql views'",
        )


def check_indexes(session: Session, report: Report) -> None:
    """Compare each index with its table, both read in full.

    Args:
        session: the session, in a transaction.
        report: takes what is wrong.
    """
    for fault in index_faults(session, TABLES):
        report.add(None, fault.table, fault.message)


def _shown(head: str) -> str:
    return head.removeprefix("CREATE ").lower()


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _SHOWN else f"{line[:_SHOWN]} ..."


def _difference(expected: str, found: str) -> str:
    """Tell the first line of each that the other does not have."""
    made, there = expected.splitlines(), found.splitlines()
    instead = [
        next((line.strip(" ,;") for line in lines if line not in others), "the same in other order")
        for lines, others in ((made, {*there}), (there, {*made}))
    ]
    return f"{_shortened(instead[0])!r} was made, and {_shortened(instead[1])!r} is there"
