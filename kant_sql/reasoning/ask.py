"""Queries: whether a condition holds in a state, and for which objects."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Any, TypeVar, overload

from .. import html
from ..arguments import count_limit, expect, shown
from ..dto import PddlObjectDto
from ..dto import formulas as f
from ..dto.formulas import Node
from ..dto.lexical import decimal_text, either_text, fold
from ..errors import InvalidArgumentError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions, ObjectDefinition
from ..knowledge.rules import DerivationRules, rules_of
from ..knowledge.symbols import symbols_of
from ..pddl.cursor import hint
from ..pddl.given import read_condition, text_of
from ..sql.answers import GUARDS, Question
from ..sql.audit_views import text_table
from ..sql.dialects.base import Row
from ..sql.estimates import Size, estimates_of
from ..sql.relations import ConditionStatement
from ..store.snapshot import DefinitionsMovedError, View, refuse_archived
from ..store.state import State

if TYPE_CHECKING:
    import pyarrow

T = TypeVar("T")
_ATOM = re.compile(r"\s*\(\s*[a-z][\w-]*(?:\s+[a-z][\w-]*)*\s*\)\s*", re.ASCII | re.IGNORECASE)
Binding = str | PddlObjectDto
# The number of prepared conditions to keep per snapshot of definitions, and of rows in `str`.
KEPT, SHOWN = 512, 20

Answer = tuple[str, ...]


class Prepared:
    """A resolved condition, with its statements for the present and the past."""

    def __init__(self, condition: r.ResolvedCondition) -> None:
        self.condition = condition
        self.columns = tuple([column.name for column in condition.columns])
        self.places = {
            column.bound.slot: f":b{number}" for number, column in enumerate(condition.given)
        }
        self._statements: dict[Any, ConditionStatement] = {}

    def statement(
        self, view: View, kind: str, write: Callable[[Question], ConditionStatement]
    ) -> ConditionStatement:
        """Return a statement for a state; write it on first use."""
        key = (kind, *statement_key(view))
        found = self._statements.get(key)
        if found is None:
            found = self._statements[key] = write(question(view))
        return found

    def values(self, definitions: Definitions, bindings: Mapping[str, Binding]) -> dict[str, int]:
        """Return the ids of the objects for the variables."""
        values: dict[str, int] = {}
        if not bindings:
            return values
        names = [column.name for column in self.condition.given]
        given = {given_variable(keyword, names): value for keyword, value in bindings.items()}
        for number, column in enumerate(self.condition.given):
            object_ = find_object(definitions, given[fold(column.name)])
            check_fit(definitions, object_, column)
            values[f"b{number}"] = object_.id
        return values


def statement_key(view: View, numbers: Iterable[str] = ()) -> tuple[Any, ...]:
    """Return what a statement depends on besides its condition."""
    session = view.session
    generation = estimates_of(view.definitions).current(session, view.kb_id)
    is_past, is_overlaid = view.at is not None, session.overlay is not None
    return is_past, is_overlaid, session.backend.dialect.name, generation, *sorted(numbers)


def given_numbers(numbers: Mapping[str, Decimal]) -> dict[str, str]:
    """Write the numbers of an evaluation as parameters of its statement."""
    return {name: decimal_text(number) for name, number in numbers.items()}


def question(
    view: View, numbers: Iterable[str] = (), rules: DerivationRules | None = None
) -> Question:
    """Begin a question about a state."""
    size = Size(estimates_of(view.definitions), view.session, view.kb_id)
    own = view.session.words, view.definitions, view.at is not None
    rules = rules_of(view.definitions) if rules is None else rules
    return Question(*own, size, rules, frozenset(numbers))


def find_object(definitions: Definitions, given: Binding, role: str = "") -> ObjectDefinition:
    """Return the object of a name or a DTO; `role` describes it in messages."""
    kinds: tuple[type[Any], ...] = (str, PddlObjectDto)
    expect(given, kinds, "an object", InvalidArgumentError)
    name = given if isinstance(given, str) else given.name
    found = definitions.objects.named(name)
    if found is None:
        names = [object_.name for object_ in definitions.objects]
        near = hint(name, names)
        raise InvalidKnowledgeError(f"the object {shown(name)}{role} is not known{near}")
    return found


def check_fit(definitions: Definitions, object_: ObjectDefinition, column: r.Column) -> None:
    """Refuse an object that does not fit a variable."""
    for types in column.bound.types:
        if not r.fits(definitions, object_.id, types):
            live = definitions.types.live
            given = either_text(live(id_).name for id_ in object_.type_ids)
            wanted = either_text(live(id_).name for id_ in sorted(types or ()))
            raise TypeMismatchError(
                f"?{column.name} is {object_.name} of type {given}, expected {wanted}"
            )


def variable_of(keyword: str, variables: Iterable[str]) -> str | None:
    """Return the variable that a keyword names: `_` in it may stand for `-`."""
    plain = fold(keyword).replace("-", "_")
    # A variable with exactly this name comes before one with `-` for `_`.
    ordered = sorted(variables, key=lambda name: fold(name) != fold(keyword))
    return next((name for name in ordered if fold(name).replace("-", "_") == plain), None)


def prepare(
    definitions: Definitions,
    condition: object,
    parameters: str | None,
    bindings: Mapping[str, Binding],
) -> Prepared:
    """Read and resolve a condition, or find it in the cache of the snapshot."""
    text = condition if isinstance(condition, str) else text_of(condition)
    if parameters is not None:
        expect(parameters, str, "the parameters", InvalidArgumentError)
    key = (text, parameters, *sorted(bindings))
    kept: dict[Any, Prepared] = definitions.derived.setdefault(Prepared, {})
    found = kept.get(key)
    if found is None:
        read = read_condition(text, symbols=symbols_of(definitions), parameters=parameters)
        names = [variable.name for variable in read.free]
        given: dict[str, str] = {}
        for keyword in bindings:
            other = given.setdefault(given_variable(keyword, names), keyword)
            if other != keyword:
                raise InvalidArgumentError(
                    f"{other!r} and {keyword!r} are both for ?{keyword}; give one of them"
                )
        resolved = r.resolve(definitions, read, given.keys())
        for column in (*resolved.columns, *resolved.given):
            _check_possible(definitions, column)
        found = Prepared(resolved)
        if len(kept) >= KEPT:
            kept.clear()
        kept[key] = found
    return found


def _check_possible(definitions: Definitions, column: r.Column) -> None:
    """Refuse a variable whose atoms require different types, so no object fits all of them."""
    wanted = [types for types in column.bound.types if types is not None]
    if len(wanted) < 2 or frozenset.intersection(*wanted):
        return
    for object_ in definitions.objects:
        if all(r.fits(definitions, object_.id, types) for types in wanted):
            return
    live = definitions.types.live
    names = [either_text(live(id_).name for id_ in sorted(types)) for types in wanted]
    raise TypeMismatchError(
        f"?{column.name} is used as {' and as '.join(names)}, and no object is both; give its "
        f"types, as in parameters='(?{column.name} - ...)'"
    )


_OF_TIME = "clock", "valid"


def given_variable(keyword: str, variables: Sequence[str]) -> str:
    """Return the variable that a keyword names, folded."""
    name = variable_of(keyword, variables)
    if name is not None:
        return fold(name)
    known = ", ".join(f"?{name}" for name in variables) or "none"
    way = "; ask kb.at(valid=...) for what was true at a time" if keyword in _OF_TIME else ""
    raise InvalidArgumentError(
        f"the condition has no free variable ?{keyword}{hint(keyword, [*variables])}; it has "
        f"{known}{way}"
    )


def asked(
    view: View, statement: ConditionStatement, given: Mapping[str, Any], guards: slice
) -> list[Row]:
    """Run a statement whose first row has the guards of the head, and compare these."""
    if statement.steps and view.definition_revision is not None:
        # Several statements need one snapshot.
        raise DefinitionsMovedError
    rows = view.reader.run(statement, given)
    if not rows or view.kb_id is None:
        return rows
    definition_revision, archived = rows[0][guards]
    if view.definition_revision not in (None, definition_revision):
        raise DefinitionsMovedError
    if view.at is not None:
        refuse_archived(view.session, view.kb_id, view.at, archived)
    return rows


# The positions of the guards: in a row of truth values, and in the row before the answers.
OF_TRUTHS, OF_ANSWERS = slice(0, GUARDS), slice(1, 1 + GUARDS)


def holds(state: State, condition: str | Node, /, **bindings: Binding) -> bool:
    """Return whether a condition holds.

    The database evaluates a condition in one statement, unless it needs recursion. A fluent without
    a value makes the comparison or the atom around it false, as in the validator VAL; so does a
    division by zero. Numbers are compared exactly. Facts count, goals do not; a derived predicate
    holds by its rules (PDDL 2.2), or as a stored fact.

    Args:
        condition: PDDL text or a node: any condition of PDDL except preferences and constraints.
            With free variables, it holds if it holds for some objects.
        **bindings: objects, or their names, for free variables; write `_` for `-`.

    Returns:
        Whether it holds.

    Raises:
        PddlError: the text is not a condition, or it names an unknown element; with the position,
            and a similar name.
        TypeMismatchError: a given object does not fit its variable.
        UnsupportedConstructError: the condition is nested too deeply for a database.
        ArchivedError: a part of the state was moved to an archive.

    Examples:
        >>> kb.holds("(robot_at rb1 wp1)")
        True
        >>> kb.holds("(exists (?w - wp) (not (robot_at ?r ?w)))", r="rb1")
        False
    """

    def work(view: View) -> bool:
        prepared, values = (None, {}) if bindings else _ground(view.definitions, condition)
        if prepared is None:
            prepared = prepare(view.definitions, condition, None, bindings)
            values = prepared.values(view.definitions, bindings)
        whole, places = prepared.condition, prepared.places
        statement = prepared.statement(view, "truth", lambda q: q.truths([r.exists(whole)], places))
        [row] = asked(view, statement, values, OF_TRUTHS)
        return bool(row[GUARDS])

    return state.store.read(work, state.at)


def _seen(definitions: Definitions, condition: object) -> tuple[Prepared | None, dict[str, int]]:
    """Recognise a ground atom of a prepared predicate; leave all others to the PDDL reader."""
    if not isinstance(condition, str) or _ATOM.fullmatch(condition) is None:
        return None, {}
    name, *terms = condition.strip().strip("()").split()
    predicate = definitions.predicates.named(name)
    kept = definitions.derived.get(Prepared)
    if predicate is None or not kept or len(terms) != len(predicate.parameters):
        return None, {}
    found: Prepared | None = kept.get(("ground", predicate.id, False))
    if found is None:
        return None, {}
    values = {}
    for number, (term, parameter) in enumerate(zip(terms, predicate.parameters, strict=True)):
        object_ = definitions.objects.named(term)
        if object_ is None:
            return None, {}
        types = r.closure(definitions, parameter.type_ids)
        if types is not None and types.isdisjoint(object_.type_ids):
            return None, {}
        values[f"b{number}"] = object_.id
    return found, values


def _ground(definitions: Definitions, condition: object) -> tuple[Prepared | None, dict[str, int]]:
    """Prepare a ground literal by its predicate, for any objects: there are many of them."""
    seen = _seen(definitions, condition)
    if seen[0] is not None:
        return seen
    text = text_of(condition)
    formula = read_condition(text, symbols=symbols_of(definitions)).formula
    is_negative = isinstance(formula, f.Not)
    atom = formula.formula if isinstance(formula, f.Not) else formula
    if not isinstance(atom, f.Atom) or not all(isinstance(x, f.Constant) for x in atom.terms):
        return None, {}
    predicate = definitions.predicates.named(atom.predicate)
    assert predicate is not None
    key = ("ground", predicate.id, is_negative)
    kept: dict[Any, Prepared] = definitions.derived.setdefault(Prepared, {})
    found = kept.get(key)
    if found is None:
        if rules_of(definitions).of(predicate.id):
            return None, {}
        slots = tuple(map(r.Slot, range(len(atom.terms))))
        part = r.HoldsFact(predicate.id, slots)
        found = Prepared(r.ResolvedCondition(r.negate(part) if is_negative else part, ()))
        found.places = {slot: f":b{slot.number}" for slot in slots}
        kept[key] = found
    named = definitions.objects.named
    values = {}
    for number, term in enumerate(atom.terms):
        object_ = named(str(term))
        assert object_ is not None
        values[f"b{number}"] = object_.id
    return found, values


class Answers:
    """The objects for which a condition holds, without duplicates, in the order of declaration.

    They are read from the state once, on first use; iterate, index and use `len` as with a list. An
    answer is a tuple of objects' names.

    Attributes:
        columns: the free variables, without question marks.
    """

    def __init__(
        self,
        read: Callable[[], list[Answer]],
        *,
        columns: tuple[str, ...],
        sql: Callable[[], str],
    ) -> None:
        self._read = read
        self.columns = columns
        self._sql = sql
        self._answers: list[Answer] | None = None

    @property
    def sql(self) -> str:
        """The statement with its values, for `sqlite3` or `psql`."""
        return self._sql()

    def _found(self) -> list[Answer]:
        if self._answers is None:
            self._answers = self._read()
        return self._answers

    def __iter__(self) -> Iterator[Answer]:
        """Return the answers one by one."""
        return iter(self._found())

    def __len__(self) -> int:
        """Return the number of answers."""
        return len(self._found())

    @overload
    def __getitem__(self, index: int) -> Answer: ...
    @overload
    def __getitem__(self, index: slice) -> list[Answer]: ...
    def __getitem__(self, index: int | slice) -> Answer | list[Answer]:
        """Return an answer, or several."""
        return self._found()[index]

    def to_dicts(self) -> list[dict[str, str]]:
        """Return each answer as a dictionary.

        Returns:
            The objects' names by variable.
        """
        return [dict(zip(self.columns, answer, strict=True)) for answer in self]

    def to_arrow(self) -> pyarrow.Table:
        """Return the answers as a table, for pandas, polars and DuckDB.

        Returns:
            A column of objects' names for each variable.

        Raises:
            ExtraMissingError: pyarrow is not installed; it comes with the extra `data`.
        """
        return text_table(self.columns, [*self])

    def __str__(self) -> str:
        """Write the first answers as a table."""
        shown = self._found()[:SHOWN]
        if not self.columns:
            return "holds" if self else "does not hold"
        lines = [tuple(f"?{name}" for name in self.columns), *shown]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        text = "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
        more = len(self) - len(shown)
        return f"{text}\n... and {more} more" if more else text

    def __repr__(self) -> str:
        """Write the columns, and the answers if they have been read."""
        found = "not read yet" if self._answers is None else f"{len(self._answers)} answers"
        return f"<Answers {', '.join(self.columns) or 'without columns'}: {found}>"

    def _repr_html_(self) -> str:
        return html.guarded(self._table)

    def _table(self) -> str:
        if not self.columns:
            return html.heading(str(self))
        names = [f"?{name}" for name in self.columns]
        rows = [dict(zip(names, answer, strict=True)) for answer in self[: html.ROWS]]
        return html.titled(rows, len(self), "answer")


class Asking:
    """A question for objects, independent of a state."""

    def __init__(
        self,
        condition: object,
        parameters: str | None,
        limit: int | None,
        bindings: Mapping[str, Binding],
    ) -> None:
        self.asked = text_of(condition), parameters, bindings
        self.limit = limit

    def prepared(self, definitions: Definitions) -> tuple[Prepared, dict[str, Any]]:
        """Prepare it with definitions, or refuse it; also return the values of its parameters."""
        prepared = prepare(definitions, *self.asked)
        given: dict[str, Any] = {**prepared.values(definitions, self.asked[2])}
        if self.limit is not None:
            given["most"] = self.limit
        return prepared, given

    def read(self, view: View) -> list[Answer]:
        """Read the answers in a state."""
        prepared, given = self.prepared(view.definitions)
        condition, is_limited = prepared.condition, self.limit is not None

        def write(question: Question) -> ConditionStatement:
            part, columns = condition.part, condition.columns
            return question.answers(part, columns, prepared.places, is_limited)

        statement = prepared.statement(view, f"answers {is_limited}", write)
        rows = asked(view, statement, given, OF_ANSWERS)
        # Without a head, there is no row for it.
        found = [row[1 : len(prepared.columns) + 1] for row in rows[view.kb_id is not None :]]
        live = view.definitions.objects.live
        names = {id_: live(id_).name for id_ in set().union(*found)}
        return [tuple(map(names.__getitem__, ids)) for ids in found]

    def sql(self, view: View) -> str:
        """Write the statement with all its values, including computed ones."""
        prepared, given = self.prepared(view.definitions)
        condition, session = prepared.condition, view.session
        if session.overlay is not None:
            raise InvalidArgumentError(
                "a state of a valid time has no statement for a shell: ask the views "
                "audit_fact_valid and audit_value_valid"
            )
        statement = question(view).readable(
            condition.part, condition.columns, prepared.places, self.limit is not None
        )
        values = view.reader.literal_values(statement, given)
        return statement.literal(session.backend.words, values)


def query(
    state: State,
    condition: str | Node,
    /,
    *,
    parameters: str | None = None,
    limit: int | None = None,
    **bindings: Binding,
) -> Answers:
    """Find the objects for which a condition holds.

    Args:
        condition: as for `holds`; its free variables are the columns. A variable that no
            positive atom binds ranges over the objects of its types.
        parameters: the free variables with their types, `"(?r - robot ?w - wp)"`, which also
            gives their order; by default a variable has the types that all atoms with it
            allow.
        limit: the maximum number of answers.
        **bindings: objects, or their names, for free variables.

    Returns:
        The answers, without duplicates, in the order of the objects' declarations. They are read on
        first use.

    Raises:
        PddlError, TypeMismatchError, UnsupportedConstructError, ArchivedError: as `holds`.
        InvalidArgumentError: a binding names no free variable, or `limit` is not a number.

    Examples:
        >>> for robot, wp in kb.query("(robot_at ?r ?w)"):
        ...     print(robot, wp)
        rb1 wp1
        >>> kb.query("(robot_at ?r ?w)", w="wp1").to_dicts()
        [{'r': 'rb1'}]
    """
    store, at = state
    if limit is not None:
        limit = count_limit(limit)
    asking = Asking(condition, parameters, limit, bindings)
    prepared, _ = store.check_definitions(asking.prepared, at)
    return Answers(
        lambda: store.read(asking.read, at),
        columns=prepared.columns,
        sql=lambda: store.read_in_snapshot(asking.sql, at),
    )
