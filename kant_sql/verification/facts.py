"""Facts, goals and the values of functions: texts against ids, and versions against identities."""

from __future__ import annotations

from collections.abc import Callable
from math import copysign

from sqlalchemy import func

from ..backends import Query, Row, Session
from ..dto.atom_dto import atom_text
from ..dto.pddl_function_value_dto import value_text
from ..knowledge.past import fork
from ..knowledge.rows import table_of
from ..tables import (
    FunctionValueArgumentRow,
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionArgumentRow,
    PropositionRow,
    PropositionVersionRow,
)
from .findings import Report
from .merging import in_order, side
from .naming import Names, ObjectFunctions, doubles

_ATOM, _FLUENT = table_of(PropositionRow), table_of(FunctionValueRow)

# What the checks of both have in common comes first.
_ATOMS = in_order(_ATOM, "id", "predicate_id", "arguments", "text", "is_goal", key=1)
_FLUENTS = in_order(_FLUENT, "id", "function_id", "arguments", "text", key=1)
_ATOM_ARGUMENTS = in_order(table_of(PropositionArgumentRow), key=2)
_FLUENT_ARGUMENTS = in_order(table_of(FunctionValueArgumentRow), key=2)
_ATOM_VERSIONS = in_order(
    table_of(PropositionVersionRow),
    *("proposition_id", "since", "until", "predicate_id", "fork", "is_goal"),
    key=2,
)
_VALUES = in_order(
    table_of(FunctionValueVersionRow),
    *("function_value_id", "since", "until", "function_id", "fork"),
    *("value", "number", "object_id", "text"),
    key=2,
)

_DOUBLE_ATOMS, _DOUBLE_FLUENTS = (
    Query(doubles(table, *key).order_by(func.min(table.c.id)))
    for table, key in (
        (_ATOM, ("is_goal", "predicate_id", "arguments")),
        (_FLUENT, ("function_id", "arguments")),
    )
)


class FactCheck:
    """Compares interned propositions and fluents, and their versions, with what they are of."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        names: Names,
        object_functions: ObjectFunctions,
        report: Report,
        tick: Callable[[int], None],
    ) -> None:
        """Make it.

        Args:
            session: the session, in a transaction.
            kb_id: the knowledge base.
            names: the names of predicates, functions and objects.
            object_functions: tells which functions have objects for values.
            report: takes what is wrong.
            tick: called with the id of each proposition that is checked.
        """
        self._session = session
        self._kb_id = kb_id
        self._report = report
        self._tick = tick
        self._predicates = names.known["predicate"]
        self._functions = names.known["function"]
        self._objects = names.known["object"]
        self._object_functions = object_functions

    def run(self) -> None:
        """Check all of them."""
        self._check("proposition", _ATOMS, _ATOM_ARGUMENTS, _ATOM_VERSIONS)
        self._check("function_value", _FLUENTS, _FLUENT_ARGUMENTS, _VALUES)
        for table, query in (("proposition", _DOUBLE_ATOMS), ("function_value", _DOUBLE_FLUENTS)):
            for first, second in self._session.rows(query, kb=self._kb_id):
                self._report.add(None, table, f"rows {first} and {second} of {table} are the same")

    def _check(self, table: str, identities: Query, arguments: Query, versions: Query) -> None:
        """Read identities, arguments and versions side by side, each by the id of the identity."""
        is_atom = table == "proposition"
        owners = self._predicates if is_atom else self._functions
        is_right = _has_its_kind if is_atom else self._is_value_right
        session, kb_id, stray = self._session, self._kb_id, self._stray
        argument_side = side(session, kb_id, arguments, 1, stray(f"{table}_argument", table))
        version_side = side(session, kb_id, versions, 1, stray(f"{table}_version", table))
        for row in session.stream(identities, kb=kb_id):
            self._check_text(table, row, owners[row[1]], [*argument_side.take(row[0])])
            before: int | None = 0
            for version in version_side.take(row[0]):
                _, since, until, owner, kept, *_ = version
                if (
                    before is None
                    or since < before
                    or (until is not None and until <= since)
                    or kept != fork(since, until)
                ):
                    self._report_interval(table, row, before, version)
                if owner != row[1] or not is_right(row, version):
                    self._report_version(table, row, version)
                before = until
            self._tick(row[0])
        argument_side.end()
        version_side.end()

    def _check_text(self, table: str, row: Row, owner: str, arguments: list[Row]) -> None:
        ids = [argument[2] for argument in arguments]
        if atom_text(owner, [self._objects[id_] for id_ in ids]) != row[3]:
            self._report.add(
                None,
                table,
                f"row {row[0]}, '{row[3]}', is not what its predicate or function "
                "and the rows of its arguments say",
            )
        positions = [each[1] for each in arguments]
        if " ".join(map(str, ids)) != row[2] or positions != [*range(len(ids))]:
            self._report.add(
                None,
                f"{table}_argument",
                f"row {row[0]} of {table}, '{row[3]}', has the arguments {row[2]!r}, and other "
                f"rows in {table}_argument",
            )

    def _report_interval(self, table: str, row: Row, before: int | None, version: Row) -> None:
        since, until, kept = version[1], version[2], version[4]
        fault = f"has the fork {kept}, which is not that of its revisions"
        if until is not None and until <= since:
            fault = "ends before it begins"
        elif before is None or since < before:
            fault = "overlaps the version before it"
        message = f"'{row[3]}' since revision {since} {fault}"
        self._report.add(since, f"{table}_version", message)

    def _report_version(self, table: str, row: Row, version: Row) -> None:
        if table == "proposition":
            fault = f"'{row[3]}' since revision {version[1]} has another predicate_id or is_goal "
            fault += "than its proposition"
        else:
            fault = f"'{version[-1]}' since revision {version[1]} has another function_id than its "
            fault += "fluent, or a value, number or object that its text does not say"
        self._report.add(version[1], f"{table}_version", fault)

    def _is_value_right(self, row: Row, version: Row) -> bool:
        value, number, object_id, text = version[5:]
        # Else a number could be made an object that is called so.
        if (object_id is not None) != (row[1] in self._object_functions.at(version[1])):
            return False
        if object_id is not None:
            name = self._objects[object_id]
            return value is None and number is None and value_text(row[3], name) == text
        if value is None or number is None:
            return False
        return value_text(row[3], value) == text and _is_nearest(number, value)

    def _stray(self, table: str, identity: str) -> Callable[[Row], None]:
        def report(row: Row) -> None:
            self._report.add(
                None, table, f"a row of {table} is of {row[0]}, of which {identity} has no row"
            )

        return report


def _has_its_kind(row: Row, version: Row) -> bool:
    # SQLite takes any number for true, and the queries only 1.
    return version[5] == row[4] and row[4] in (False, True)


def _is_nearest(number: float, value: str) -> bool:
    try:
        nearest = float(value)
    except ValueError:
        return False
    # Zero has no sign, but where a number is too small for a double; SQLite drops it even there.
    return nearest == number and (number != 0 or copysign(1, number) >= copysign(1, nearest))
