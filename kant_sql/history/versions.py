"""The versions of an element, and all that involves an object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, func, null, select, union, union_all

from .. import html
from ..arguments import shown
from ..errors import InvalidKnowledgeError, check_integer, unreadable
from ..sql import tables as t
from ..sql.changes import EXECUTIONS, Change, ends_of, in_range, newest_of, paged
from ..sql.dialects.base import Row, Session
from ..sql.executions import RUNNING, SUCCEEDED, id_text
from ..sql.query import InRange, Query, constant, first_rows, found_rows, in_list, in_rows, integer
from ..sql.rows import (
    FACT,
    GOAL,
    KB,
    PROPOSITION,
    THEN,
    VALUE,
    VERSION_COLUMNS,
    VersionColumns,
    looked_up,
    table_of,
)
from ..store.state import State
from ..store.store import Store
from .elements import (
    NAMED_KINDS,
    Element,
    Lookup,
    Sought,
    Written,
    identity_of,
    look_up,
    refuse_unknown_element,
    sought,
)
from .revisions import LARGEST, Revision, Version, make_revision, read_numbered, revision_of

# Versions of elements with an object to examine for the newest, at most.
INVOLVED = 20_000
# With more versions, revisions to search for the object: first a few, then many.
NEAR, WINDOW = 1_000, 20_000

_OBJECT = integer("object")
# Tables whose objects are in another table, and the key that both share.
_NAMING: tuple[tuple[VersionColumns, Any, tuple[str, ...]], ...] = (
    (VERSION_COLUMNS[PROPOSITION], table_of(t.PropositionArgumentRow).c, ("proposition_id",)),
    (VERSION_COLUMNS[VALUE], table_of(t.FunctionValueArgumentRow).c, ("function_value_id",)),
    (VERSION_COLUMNS["action"], t.TABLES["action_term"].c, ("action_id", "since")),
    (VERSION_COLUMNS["formula"], t.TABLES["formula_term"].c, ("formula_id", "since")),
    (VERSION_COLUMNS["rule"], t.TABLES["rule_term"].c, ("rule_id", "since")),
    (EXECUTIONS, table_of(t.ExecutionArgumentRow).c, ("plan_id", "position")),
)


def involving(
    object_: ColumnElement[int], most: int | None = None, by_revision: bool = False
) -> Iterator[tuple[VersionColumns, ColumnElement[bool]]]:
    """Yield the conditions of versions that involve an object, table by table, without overlap."""
    # It examines `most` elements of each kind, by default all. With `by_revision`, if the revisions
    # are few, it compares their versions with the object.
    own = VERSION_COLUMNS["object"]
    yield own, own.owner == object_
    for columns, arguments, key in _NAMING:
        named = _is_named(columns, arguments, key, object_)
        if by_revision:
            yield columns, named
            continue
        ids = select(arguments[key[0]]).where(arguments.kb_id == KB, arguments.object_id == object_)
        if most is not None:
            # In the order of an index.
            ids = first_rows(ids.order_by(arguments[key[0]]), most)
        found = in_rows(columns.owner, ids, bounded=columns.version.since)
        yield columns, found if len(key) == 1 else found & named
    value, arguments, key = _NAMING[1]
    is_value = value.version.object_id == object_
    yield value, is_value & ~_is_named(value, arguments, key, object_)


def _is_named(
    columns: VersionColumns, arguments: Any, key: tuple[str, ...], object_: ColumnElement[int]
) -> ColumnElement[bool]:
    """Return whether a version names an object."""
    version = columns.version
    own = [arguments[part] == version[part] for part in key]
    # An expression uses no index: an object may be in many versions, which have few arguments.
    is_object = arguments.object_id + constant(0) == object_
    found: Select[Any] = select(constant(1)).where(arguments.kb_id == KB, *own, is_object)
    return found.correlate(version.kb_id.table).exists()


@cache
def _versions_of_object() -> Query:
    """Count the versions that involve the object, up to a bound."""
    counts = []
    for columns, which in involving(_OBJECT, INVOLVED):
        some: Select[Any] = select(constant(1)).where(columns.version.kb_id == KB, which)
        bounded = first_rows(some, INVOLVED).subquery()
        counts.append(select(func.count()).select_from(bounded).scalar_subquery())
    return Query(select(sum(counts[1:], start=counts[0])))


@cache
def _involving(is_recent: bool) -> Query:
    """Select the changes that involve the object, newest first."""
    parts = []
    for columns, which in involving(_OBJECT, INVOLVED, by_revision=is_recent):
        for end in ends_of(columns):
            # An expression uses no index: rows found by ids are neither searched by revision nor
            # read in the order of that index.
            number = end.revision if is_recent else end.revision + constant(0)
            parts.append(end.short_line(number, which, in_range(number)))
    return paged(parts)


class Involvement(NamedTuple):
    """A page of the changes that involve an object, newest first."""

    changes: list[tuple[int, Change]]  # each with its revision
    before: int | None  # the revision before which the next page continues; None after the last
    searched: int | None  # the first searched revision, if it is not the first of all


def read_involvement(
    session: Session,
    kb_id: int,
    object_id: int,
    high: int,
    limit: int,
    low: int = 1,
    *,
    whole: bool = False,
) -> Involvement:
    """Read a page of changes that involve an object, in at most three statements."""
    # A page ends with a revision. A revision with more changes than a page is cut, or read with one
    # more statement if it is wanted whole.
    own = {"kb": kb_id, "object": object_id}
    row = session.first(_versions_of_object(), **own)
    is_recent = row is not None and row[0] >= INVOLVED
    query = _involving(is_recent)
    for window in (NEAR, WINDOW) if is_recent else (high,):
        first = max(low, high - window + 1)
        changes = newest_of(session, query, limit + 1, **own, low=first, high=high)
        if len(changes) > limit or first == low:
            break
    if len(changes) <= limit:
        rest = first if first > low else None
        return Involvement(changes, rest, rest)
    last = changes[limit][0]
    found = [one for one in changes if one[0] > last]
    if found:
        return Involvement(found, last + 1, None)
    if whole:
        changes = newest_of(session, query, LARGEST, **own, low=last, high=last)
    return Involvement(changes if whole else changes[:limit], last, None)


# Lookups per statement: SQLite combines at most 500 queries.
MOST_LOOKUPS = 400


def _versions(source: VersionColumns, owned: ColumnElement[bool]) -> Select[Any]:
    since = source.version.since
    columns: tuple[Any, ...] = source.kind.label("kind"), source.text.label("text")
    rows = select(*columns, since, source.version.until, source.owner.label("owner"))
    return rows.where(source.version.kb_id == KB, owned, since <= THEN)


def _newest_of(lookup: Lookup) -> Select[Any]:
    """Select the newest versions of one identity, with a fixed number of index steps."""
    source = VERSION_COLUMNS[lookup.source]
    rows = _versions(source, source.owner == identity_of(lookup))
    newest_first = rows.order_by(source.version.since.desc())
    return select(first_rows(newest_first, integer("size")).subquery())


# Only lookups that may match: planning and running all of them takes longer.
@lru_cache(maxsize=64)
def _newest(lookups: tuple[Lookup, ...], with_involved: bool, with_revision: bool) -> Query:
    parts = []
    for lookup in lookups:
        if with_involved and lookup.is_involved:
            involved = involving(identity_of(lookup))
            parts += [_versions(source, which) for source, which in involved]
        else:
            parts.append(_newest_of(lookup))
    rows = union_all(*parts)
    if not with_revision:
        return Query(rows)
    found = rows.subquery("found")
    return Query(select(found, *revision_of(found.c.since)))


def read_newest(
    session: Session,
    kb_id: int,
    wanted: Sequence[Sought],
    at: int,
    size: int,
    *,
    with_involved: bool = False,
    with_revision: bool = False,
) -> list[Row]:
    """Read versions that began up to a revision (kind, text, since, until, owner), in any order."""
    # It reads the newest of each identity, in one statement for names and one more for formulas;
    # for an object, if wanted, all that involves it.
    (lookups, parameters), rows = look_up(session, kb_id, wanted), list[Row]()
    for start in range(0, len(lookups), MOST_LOOKUPS):
        some = lookups[start : start + MOST_LOOKUPS]
        query = _newest(some, with_involved, with_revision)
        rows += session.rows(query, kb=kb_id, at=at, size=size, **parameters)
    # Several parts of a question may name the same element.
    return list(dict.fromkeys(rows))


def history(state: State, element: Element) -> list[Version]:
    """Read the versions of an element, and who asserted and retracted each.

    Args:
        element: a DTO (the value of a function value is ignored), a formula, PDDL text, or a
            name, which matches all definitions of that name. The text `(robot_at rb1 wp1)`
            matches the fact and the goal, `(battery rb1)` the values of the fluent; other texts
            are formulas, or definitions as the log shows them. The name or DTO of an object
            matches all that involves it, including facts, goals, values, formulas, actions and
            steps of plans; `rb1 - robot` matches only its declaration.

    Returns:
        Its versions in this store, oldest first, without archived ones; empty for a DTO or a
        formula that never held.

    Raises:
        InvalidKnowledgeError: `element` is not one of the above.

    Examples:
        >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
        >>> for version in kb.history("(robot_at rb1 wp1)"):
        ...     print(version.since.number, version.until.number)
        1 2
    """
    wanted, at = sought(element), _last_known(state)

    def work(session: Session, kb_id: int) -> list[Version]:
        rows = read_newest(session, kb_id, wanted, at, LARGEST, with_involved=True)
        return make_versions(session, kb_id, rows, at)

    versions = _query(state.store, wanted, work)
    if not versions:
        refuse_unknown_element(state.store, element)
    return html.Listing(versions, "version")


def _query(
    store: Store, wanted: list[Sought], work: Callable[[Session, int], list[Version]]
) -> list[Version]:
    """Read versions: revisions never change, so the statements need no common transaction."""
    is_plain = len(wanted) <= MOST_LOOKUPS // len(NAMED_KINDS) and not any(
        isinstance(each, Written) for each in wanted
    )
    return store.query_known(work, [], in_snapshot=not is_plain)


def blame(state: State, element: Element) -> Version | None:
    """Show who asserted an element that holds now, when and why.

    Args:
        element: as for `history`; an object means its declaration.

    Returns:
        The version that holds, with the revision that asserted it in `since`; None if the element
        does not hold. For a text that matches a fact and a goal, the fact.

    Raises:
        InvalidKnowledgeError: `element` is not valid, or matches several present elements.

    Examples:
        >>> kb.blame("(robot_at rb1 wp1)").since.actor
        'perception'
    """
    held = _held(state.store, sought(element), _last_known(state))
    if {version.kind for version in held} == {FACT, GOAL}:
        # A fact takes precedence over a goal.
        held = [version for version in held if version.kind == FACT]
    if len(held) > 1:
        several = ", ".join(f"{version.kind} {version.text}" for version in held)
        raise InvalidKnowledgeError(
            f"{shown(element)} matches several elements: {several}; give a DTO of one of them"
        )
    if not held:
        refuse_unknown_element(state.store, element)
    return held[0] if held else None


def _last_known(state: State) -> int:
    """Return the last visible revision; in memory, the tables hold uncommitted versions, too."""
    upto = state.upto
    return LARGEST if upto is None else upto


def _held(store: Store, wanted: list[Sought], at: int) -> list[Version]:
    """Read the present versions, with their first revisions."""

    def work(session: Session, kb_id: int) -> list[Version]:
        rows = read_newest(session, kb_id, wanted, at, 1, with_revision=True)
        held = [row for row in rows if row[3] is None or row[3] > at]
        found = read_evidence(session, kb_id, held, at)
        return [
            Version(row[0], row[1], make_revision(session, row[5:]), None, *found.of(row))
            for row in held
        ]

    return _query(store, wanted, work)


_FACT, _SEEN = VERSION_COLUMNS[PROPOSITION].version, table_of(t.ConfirmationRow).c
_OUTCOME, _LINK = table_of(t.ExecutionVersionRow).c, table_of(t.RevisionExecutionRow).c
EFFECTIVE: list[Any] = [constant(outcome) for outcome in (RUNNING, SUCCEEDED)]


def had_effect() -> Any:
    """Return whether an outcome has effects, by its key, so that an index finds it."""
    own = table_of(t.ExecutionVersionRow).alias("own").c
    key = (own[name] == _OUTCOME[name] for name in ("plan_id", "position", "since"))
    found = select(constant(1)).where(own.kb_id == KB, *key, own.outcome.in_(EFFECTIVE))
    return found.correlate(_OUTCOME.since.table).exists()


def actor_of(number: Any) -> Any:
    """Look up the actor of a revision."""
    revision = table_of(t.RevisionRow).alias().c
    return looked_up(revision.actor, revision.number, number)


def last_confirmation(by_others: bool) -> Any:
    """Look up the last revision that confirmed a fact while it held, up to a revision."""
    found = select(_SEEN.since).where(
        _SEEN.kb_id == KB,
        _SEEN.proposition_id == _FACT.proposition_id,
        _SEEN.since > _FACT.since,
        _SEEN.since <= func.coalesce(_FACT.until, THEN),
        _SEEN.since <= THEN,
    )
    if by_others:
        found = found.where(actor_of(_SEEN.since).is_distinct_from(actor_of(_FACT.since)))
    found = first_rows(found.order_by(_SEEN.since.desc()), 1)
    return found.correlate(_FACT.since.table).scalar_subquery()


def _evidence() -> Select[Any]:
    """Select the last confirmations of facts, and the executions that revisions record or name."""
    # The executions that the revision records, and the one that it names.
    none = constant(0)
    no_act = none.label("plan_id"), none.label("position")
    seen = last_confirmation(by_others=False).label("confirmed")
    held = select(_FACT.proposition_id, _FACT.since, seen).where(
        _FACT.kb_id == KB,
        # These facts may have many other versions.
        InRange(_FACT.since, integer("low"), integer("high")),
    )
    its = found_rows(held, _FACT.proposition_id, "ids")
    facts = select(its.c.proposition_id, its.c.since, *no_act, its.c.confirmed)
    effective = select(_OUTCOME.since, _OUTCOME.plan_id, _OUTCOME.position)
    its_acts = found_rows(
        effective.where(_OUTCOME.kb_id == KB, had_effect()), _OUTCOME.since, "numbers"
    ).c
    acts = select(none, its_acts.since, its_acts.plan_id, its_acts.position, null())
    named = select(none, _LINK.number, _LINK.plan_id, _LINK.position, null()).where(
        _LINK.kb_id == KB, in_list(_LINK.number, "numbers")
    )
    found = union(facts, acts, named).subquery("found")
    return select(found, *revision_of(found.c.confirmed))


_EVIDENCE = Query(_evidence)
# The kinds that an act may change; only facts have confirmations.
_EFFECTS = FACT, VALUE


class Evidence(NamedTuple):
    """Confirmations of facts, and the acts behind facts and values."""

    confirmed: dict[tuple[int, int], Revision]  # (id, since) -> the last confirmation
    acts: dict[int, tuple[str, ...]]  # revision -> the ids of its acts

    def of(self, row: Row) -> tuple[Revision | None, tuple[str, ...]]:
        """Return the evidence for a version from `read_newest`."""
        if row[0] not in _EFFECTS:
            return None, ()
        seen = self.confirmed.get((row[4], row[2])) if row[0] == FACT else None
        return seen, self.acts.get(row[2], ())


def read_evidence(session: Session, kb_id: int, rows: Sequence[Row], at: int) -> Evidence:
    """Read the evidence for the facts and values among versions, in one statement."""
    found = Evidence({}, {})
    numbers = sorted({row[2] for row in rows if row[0] in _EFFECTS})
    if not numbers:
        return found
    ids = sorted({row[4] for row in rows if row[0] == FACT})
    lists = {"ids": session.list_value(ids), "numbers": session.list_value(numbers)}
    given = {"kb": kb_id, "at": at, "low": numbers[0], "high": numbers[-1], **lists}
    for row in session.rows(_EVIDENCE, **given):
        fact, number, plan_id, position, confirmed = row[:5]
        if confirmed is not None:
            found.confirmed[fact, number] = make_revision(session, row[5:])
        elif not fact:
            found.acts[number] = *found.acts.get(number, ()), id_text((plan_id, position))
    return found


def make_versions(session: Session, kb_id: int, rows: Sequence[Row], at: int) -> list[Version]:
    """Build versions from rows, oldest first; one that ends after `at` holds there."""
    known = []
    for row in rows:
        kind, text, since, until, _ = row
        for number in (since, until or 0):
            check_integer(f"of the versions of each {kind}", repr(text), "since or until", number)
        known.append((since, until if until is not None and until <= at else None, row))
    known.sort(key=lambda each: (each[0], each[1] is None, each[1] or 0, each[2][:2]))
    numbers = {number for each in known for number in each[:2] if number is not None}
    found = read_evidence(session, kb_id, rows, at)
    revisions = read_numbered(session, kb_id, numbers)
    for number in numbers - revisions.keys():
        raise unreadable("revision", f"revision {number!r}", LookupError("there is none"))
    return [
        Version(
            *(row[0], row[1], revisions[since], None if until is None else revisions[until]),
            *found.of(row),
        )
        for since, until, row in known
    ]
