"""Questions about the past: the names of a condition, and the states of a range of revisions.

A condition or a rule is read with the names of the latest state that has all of them. Only relevant
parts of states are kept, and only revisions that touch them are visited: facts that the atoms
match, values of the fluents, and the definitions of mentioned elements. If a quantifier or a free
variable ranges over objects, all objects are relevant.
"""

from __future__ import annotations

import re
from bisect import bisect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple, TypeVar

from ..arguments import shown
from ..dto import PddlObjectDto
from ..dto import formulas as f
from ..dto.lexical import either_text, fold, is_word
from ..errors import InvalidArgumentError, InvalidKnowledgeError, TypeMismatchError
from ..history.moments import Bounds
from ..history.revisions import LARGEST, Revision
from ..knowledge.definitions import Definition, Definitions
from ..knowledge.grounding import substitute
from ..knowledge.symbols import symbols_of
from ..pddl.cursor import hint
from ..pddl.given import ReadCondition, read_condition, text_of
from ..pddl.symbols import Fit, SymbolTable
from ..sql.definition_rows import advance, find_identities, load_at
from ..sql.dialects.base import Session
from ..sql.periods import (
    Meaning,
    Pattern,
    Touch,
    read_last_revisions,
    read_meanings,
    read_redefinitions,
    state_of,
    stream_touches,
    subjects_of,
)
from ..store.snapshot import read_position, refuse_archived
from ..store.store import Store
from .ask import given_variable
from .derived import world_of
from .world import World

_WORD = re.compile(r"[^\s()?]+")
T = TypeVar("T")

Read = Callable[[SymbolTable], ReadCondition]


class PastQuestion(NamedTuple):
    """A condition, and the definitions with which it was read."""

    formula: f.Formula  # the condition, with objects for the variables that the caller binds
    free: tuple[f.TypedName, ...]  # its free variables; `object` where nothing declares a type
    unbound: ReadCondition  # the condition as given, with all its free variables
    objects: tuple[f.Constant, ...]  # the objects that the caller bound variables to
    definitions: Definitions  # those of the latest state that has all names
    # Reads it again with the names of another state; raises `InvalidKnowledgeError` if it has no
    # meaning there.
    read: Read

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the free variables."""
        return tuple([variable.name for variable in self.free])


def ask(
    store: Store,
    condition: f.Formula | str,
    parameters: str | None,
    bindings: Mapping[str, Any],
    upto: int | None,
    definitions: Definitions | None = None,
) -> PastQuestion:
    """Read a condition with given definitions, or the names of the latest state that has all."""
    text = text_of(condition)
    objects = names_of(bindings)

    def whole(symbols: SymbolTable) -> ReadCondition:
        return read_condition(text, symbols=symbols, parameters=parameters)

    def read(symbols: SymbolTable) -> ReadCondition:
        return with_objects(whole(symbols), objects, symbols) if objects else whole(symbols)

    if definitions is None:
        words = " ".join([text, *objects.values()])
        found, definitions = read_at_last(store, words, read, upto)
    else:
        found = read(symbols_of(definitions))
    unbound = whole(symbols_of(definitions))
    bound = tuple([f.Constant(name) for name in objects.values()])
    return PastQuestion(found.formula, found.free, unbound, bound, definitions, read)


def names_of(bindings: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of the objects for the bound variables."""
    names = {}
    for variable, value in bindings.items():
        name = value.name if isinstance(value, PddlObjectDto) else value
        if not isinstance(name, str):
            raise InvalidArgumentError(
                f"{variable}={shown(value)} is not an object; give its name or a PddlObjectDto"
            )
        names[variable] = name
    return names


def with_objects(
    found: ReadCondition, objects: Mapping[str, str], symbols: SymbolTable
) -> ReadCondition:
    """Replace some free variables by objects."""
    free = {fold(variable.name): variable for variable in found.free}
    binding: dict[str, str] = {}
    for name, given in objects.items():
        key = given_variable(name, [variable.name for variable in free.values()])
        binding[key] = _fitting(given, free.pop(key), symbols)
    bound = substitute(found.formula, binding)
    rest = tuple(free.values())
    declared = f.variables_text(rest) if found.are_declared else None
    again = read_condition(str(bound), symbols=symbols, parameters=declared)
    return again._replace(free=rest)


def _fitting(name: str, variable: f.TypedName, symbols: SymbolTable) -> str:
    """Return the declared spelling of an object that fits a variable."""
    entity = symbols.object(name)
    if entity is None:
        known = hint(name, list(symbols.object_names()))
        raise InvalidKnowledgeError(f"the object {name!r} is not known{known}")
    if symbols.fit(entity[1], variable.types) != Fit.YES:
        raise TypeMismatchError(
            f"?{variable.name} is {name} of type {either_text(entity[1])}, expected "
            f"{variable.type_text}"
        )
    return str(entity[0])


def read_at_last(
    store: Store, text: str, read: Callable[[SymbolTable], T], upto: int | None
) -> tuple[T, Definitions]:
    """Read a text with the names of the latest state that has all; or raise as in the last."""
    definitions = store.read_definitions(lambda known: known, upto)
    try:
        return read(symbols_of(definitions)), definitions
    except InvalidKnowledgeError:
        for earlier in _earlier(store, text, LARGEST if upto is None else upto):
            try:
                return read(symbols_of(earlier)), earlier
            except InvalidKnowledgeError:
                continue
        raise


def _earlier(store: Store, text: str, high: int) -> Iterator[Definitions]:
    """Yield the definitions of the last revisions in which names of a text had a meaning."""
    words = sorted({fold(word) for word in _WORD.findall(text) if is_word(word)})

    def work(session: Session, kb_id: int) -> list[int]:
        low = read_position(session, kb_id).archived
        return read_last_revisions(session, kb_id, words, low, high)

    found: list[int] = store.query_known(work, [])
    for revision in found:
        yield store.read_definitions(lambda known: known, revision)


RULE = re.compile(r"\(:derived \(([^\s()]+)")


def revision_text(revision: Revision) -> str:
    """Write a revision: its number, time, actor and reason."""
    said = revision.committed_at.isoformat(timespec="seconds"), *revision.said()
    return f"{revision.number} ({', '.join(said)})"


class Range(NamedTuple):
    """A range of revisions, and the last revision with archived versions: not after `low`."""

    low: int
    high: int
    archived: int


def read_range(session: Session, kb_id: int, bounds: Bounds) -> Range:
    """Return a range; refuse one with an archived part."""
    archived = read_position(session, kb_id).archived
    refuse_archived(session, kb_id, min(bounds.low, bounds.high), archived)
    return Range(bounds.low, bounds.high, archived)


class Visit(NamedTuple):
    """A visited state."""

    revision: int  # its revision; for the first state, the one before the range, if there is one
    world: World  # the relevant parts of the state; the same object while definitions stay
    definitions: Definitions  # the definitions in it


class Sweep:
    """Visits the states of a range in which a change touches some formulas."""

    # The last step's changes: predicates and functions, by their facts and values, or the rest.
    touched: set[tuple[bool, int]]
    is_redefined: bool
    _world: World
    _last: int

    def __init__(
        self,
        session: Session,
        kb_id: int,
        formulas: Sequence[f.Node],
        definitions: Definitions,
        span: Range,
        ranges: bool,
        before: Sweep | None = None,
    ) -> None:
        """Find the relevant elements; `ranges` if not only quantifiers range over objects."""
        self._session = session
        self._kb_id = kb_id
        self._range = span
        self._definitions = self._given = definitions
        _, self._rules = read_meanings(session, kb_id, [], span.low, span.high)
        self._derived = {fold(found[1]) for rule in self._rules if (found := RULE.match(rule))}
        facts, values = self._patterns_found = self._patterns(formulas)
        nodes = [*f.walk(*formulas)]
        has_rules = self._has_derived(nodes)
        # It ended where the range begins, so its state need not be read again.
        self._before = before
        self._subjects = subjects_of(session, kb_id, facts, values, span.low, span.high)
        ranges = (
            ranges
            or has_rules
            or any(isinstance(one, f.Forall | f.Exists | f.Count) for one in nodes)
        )
        known = [
            definitions.objects.named(one.name) for one in nodes if isinstance(one, f.Constant)
        ]
        self._meaning = Meaning(
            tuple(sorted({one.owner for one in facts})),
            tuple(sorted({one.owner for one in values})),
            None if ranges else tuple(sorted({one.id for one in known if one is not None})),
            has_rules,
        )

    def owners_of(self, formulas: Sequence[f.Node]) -> set[tuple[bool, int]]:
        """Return the predicates and functions that some formulas depend on."""
        facts, values = self._patterns(formulas)
        return {(True, one.owner) for one in facts} | {(False, one.owner) for one in values}

    def _has_derived(self, nodes: Iterable[f.Node]) -> bool:
        return any(
            isinstance(one, f.Atom) and fold(one.predicate) in self._derived for one in nodes
        )

    def _patterns(self, formulas: Sequence[f.Node]) -> tuple[list[Pattern], list[Pattern]]:
        """Return the patterns of facts and values that may matter to formulas."""
        definitions, nodes = self._given, [*f.walk(*formulas)]
        facts: list[Pattern] = []
        values: list[Pattern] = []
        for node in nodes:
            if isinstance(node, f.Atom):
                owner: Definition | None = definitions.predicates.named(node.predicate)
            elif isinstance(node, f.Fluent):
                owner = definitions.functions.named(node.function)
            else:
                continue
            if owner is not None:
                objects = tuple([object_id(definitions, term) for term in node.terms])
                (facts if isinstance(node, f.Atom) else values).append(Pattern(owner.id, objects))
        if self._has_derived(nodes):
            more_facts, more_values = self._of_rules
            facts, values = facts + more_facts, values + more_values
        return facts, values

    @cached_property
    def _of_rules(self) -> tuple[list[Pattern], list[Pattern]]:
        """All facts and values of the names in any rule."""
        words = {fold(word) for rule in self._rules for word in _WORD.findall(rule)}
        found: list[list[Pattern]] = []
        for kind in ("predicate", "function"):
            identities = find_identities(self._session, self._kb_id, kind, words)
            known = [identity for identity in identities.values() if identity is not None]
            # With any objects: an empty pattern would mean a fact without arguments.
            found.append([Pattern(id_, (None,)) for id_, _ in known])
        return found[0], found[1]

    def begin(self) -> Visit | None:
        """Read the state before the range, or in its first revision if that state is archived."""
        session, kb_id, (low, high, archived) = self._session, self._kb_id, self._range
        base = low if low == archived else low - 1
        self._redefined = self._read_redefined(base)
        before, self._before = self._before, None
        follows = before is not None and before._range.high == base
        if before is not None and follows and before._patterns_found == self._patterns_found:
            self._definitions, self._world = before._definitions, before._world
            self._last = before._last
        else:
            known = self._given_at(base) or load_at(session, kb_id, base) if base else None
            self._definitions = known or Definitions()
            self._world = world_of(self._definitions)
            self._last = base
            for touch in state_of(session, kb_id, self._subjects, base) if base else ():
                self._apply(touch)
        self._following_redefined = iter([one for one in self._redefined if base < one <= high])
        self._next_redefined = next(self._following_redefined, None)
        touches = stream_touches(session, kb_id, self._subjects, base, high)
        self._touches = groupby(touches, key=lambda touch: touch.revision)
        self._next_touched = next(self._touches, None)
        return Visit(low - 1, self._world, self._definitions) if base else None

    def _read_redefined(self, base: int) -> list[int]:
        """Read the revisions that changed relevant definitions, up to those of the given ones."""
        high, given = self._range.high, self._given.revision
        low, high = (base, high) if given is None else (min(base, given), max(high, given))
        return read_redefinitions(self._session, self._kb_id, self._meaning, low, high)

    def _given_at(self, revision: int) -> Definitions | None:
        """Return the given definitions if all relevant ones were the same at a revision."""
        # Reading those of another revision takes long with thousands of objects.
        given, redefined = self._given, self._redefined
        if given.revision is None:
            return None
        is_alike = bisect(redefined, revision) == bisect(redefined, given.revision)
        return given if is_alike else None

    @property
    def following(self) -> int | None:
        """The revision of the next state; None after the last one."""
        redefined = self._next_redefined
        touched: int | None = self._next_touched and self._next_touched[0]
        if redefined is None or touched is None:
            return touched if redefined is None else redefined
        return min(redefined, touched)

    def step(self) -> Visit:
        """Go to the next state."""
        revision = self.following
        assert revision is not None
        self.touched = set()
        self.is_redefined = self._next_redefined == revision
        if self.is_redefined:
            self._definitions = self._given_at(revision) or advance(
                self._session, self._kb_id, self._definitions, self._last, revision
            )
            self._world, self._last = moved(self._world, self._definitions), revision
            self._next_redefined = next(self._following_redefined, None)
        if self._next_touched is not None and self._next_touched[0] == revision:
            for touch in self._next_touched[1]:
                self.touched.add((touch.is_fact, touch.owner))
                self._apply(touch)
            self._next_touched = next(self._touches, None)
        return Visit(revision, self._world, self._definitions)

    def visits(self) -> Iterator[Visit]:
        """Yield the states, the one before the range first; each is valid until the next one."""
        first = self.begin()
        if first is not None:
            yield first
        while self.following is not None:
            yield self.step()

    def _apply(self, touch: Touch) -> None:
        atom = touch.is_fact, touch.owner, tuple(touch.objects)
        self._world.change(atom, touch.value, not touch.is_end)


def object_id(definitions: Definitions, term: f.Term) -> int | None:
    """Return the id of the object that a term names."""
    known = definitions.objects.named(term.name) if isinstance(term, f.Constant) else None
    return None if known is None else known.id


def moved(world: World, definitions: Definitions) -> World:
    """Make the same state with other definitions."""
    made = world_of(definitions)
    for predicate, row in world.facts():
        made.add(predicate, row)
    for (function, row), value in world.values().items():
        made.set(function, row, value)
    return made
