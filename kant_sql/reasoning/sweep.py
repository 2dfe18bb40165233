"""The states of a range of revisions, one after the other, as far as some formulas mention them.

Only what is mentioned is kept, and only revisions that touch it are visited: facts that the atoms
match, values of the fluents, and the definitions of what is named. Where a quantifier or a free
variable ranges over objects, all objects are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from itertools import groupby
from typing import NamedTuple

from ..dto import formulas as f
from ..dto.lexical import fold
from ..history.moments import Bounds
from ..history.revisions import read_position
from ..knowledge.definitions import Definitions
from ..sql.definition_rows import advance, find_identities, load_at
from ..sql.dialects.base import Session
from ..sql.periods import (
    Meaning,
    Pattern,
    Touch,
    read_meanings,
    read_redefinitions,
    state_of,
    stream_touches,
    subjects_of,
)
from ..store.snapshot import refuse_archived
from .derived import world_of
from .world import World

RULE = re.compile(r"\(:derived \(([^\s()]+)")
_WORD = re.compile(r"[^\s()?]+")


class Range(NamedTuple):
    """A range of revisions.

    Attributes:
        low: the first.
        high: the last.
        archived: what ended up to this revision is in an archive; not after `low`.
    """

    low: int
    high: int
    archived: int


def read_range(session: Session, kb_id: int, bounds: Bounds) -> Range:
    """Return a range that was not archived.

    Raises:
        ArchivedError: a part of it was.
    """
    archived = read_position(session, kb_id).archived
    refuse_archived(session, kb_id, min(bounds.low, bounds.high), archived)
    return Range(bounds.low, bounds.high, archived)


class Visit(NamedTuple):
    """A state that is visited.

    Attributes:
        revision: its revision; that before the range in the first state, if there is one.
        world: the state, as far as it matters; the same object while definitions stay.
        definitions: what is defined in it.
    """

    revision: int
    world: World
    definitions: Definitions


class Sweep:
    """Visits the states of a range in which something changed that formulas mention."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        formulas: Sequence[f.Node],
        definitions: Definitions,
        span: Range,
        ranges: bool,
    ) -> None:
        """Find out what matters.

        Args:
            session: the session, in a transaction that sees one state.
            kb_id: the knowledge base.
            formulas: the formulas, and further objects.
            definitions: those with which their names have a meaning.
            span: the range; not empty.
            ranges: whether variables range over objects besides those of quantifiers.
        """
        self._session = session
        self._kb_id = kb_id
        self._range = span
        self._definitions = definitions
        nodes = [*f.walk(*formulas)]
        facts, values = self._patterns(nodes)
        _, rules = read_meanings(session, kb_id, [], span.low, span.high)
        derived = {fold(found[1]) for rule in rules if (found := RULE.match(rule))}
        has_rules = any(fold(one.predicate) in derived for one in nodes if isinstance(one, f.Atom))
        if has_rules:
            more_facts, more_values = self._of_rules(rules)
            facts, values = facts + more_facts, values + more_values
        self._subjects = subjects_of(session, kb_id, facts, values, span.low, span.high)
        ranges = ranges or has_rules or any(isinstance(one, f.Forall | f.Exists) for one in nodes)
        known = [
            definitions.objects.named(one.name) for one in nodes if isinstance(one, f.Constant)
        ]
        self._meaning = Meaning(
            tuple(sorted({one.owner for one in facts})),
            tuple(sorted({one.owner for one in values})),
            None if ranges else tuple(sorted({one.id for one in known if one is not None})),
            has_rules,
        )

    def _patterns(self, nodes: Iterable[f.Node]) -> tuple[list[Pattern], list[Pattern]]:
        """Return the facts and values that atoms and fluents may be about."""
        definitions = self._definitions
        facts: list[Pattern] = []
        values: list[Pattern] = []
        for node in nodes:
            if not isinstance(node, f.Atom | f.Fluent):
                continue
            objects: list[int | None] = []
            for term in node.terms:
                objects.append(object_id(definitions, term))
            if isinstance(node, f.Atom):
                predicate = definitions.predicates.named(node.predicate)
                if predicate is not None:
                    facts.append(Pattern(predicate.id, tuple(objects)))
            else:
                function = definitions.functions.named(node.function)
                if function is not None:
                    values.append(Pattern(function.id, tuple(objects)))
        return facts, values

    def _of_rules(self, rules: Iterable[str]) -> tuple[list[Pattern], list[Pattern]]:
        """Return all facts and values of what any rule names."""
        words = {fold(word) for rule in rules for word in _WORD.findall(rule)}
        found: list[list[Pattern]] = []
        for kind in ("predicate", "function"):
            identities = find_identities(self._session, self._kb_id, kind, words)
            known = [identity for identity in identities.values() if identity is not None]
            # Any objects: only a pattern of none would be a fact without arguments.
            found.append([Pattern(id_, (None,)) for id_, _ in known])
        return found[0], found[1]

    def begin(self) -> Visit | None:
        """Read the state before the range, or None at the beginning.

        Where earlier revisions are archived, it is that of the range's first revision.
        """
        session, kb_id, (low, high, archived) = self._session, self._kb_id, self._range
        base = low if low == archived else low - 1
        self._definitions = load_at(session, kb_id, base) if base else Definitions()
        self._world = world_of(self._definitions)
        self._last = base
        for touch in state_of(session, kb_id, self._subjects, base) if base else ():
            self._apply(self._world, touch)
        self._redefined = iter(read_redefinitions(session, kb_id, self._meaning, base, high))
        self._next_redefined = next(self._redefined, None)
        touches = stream_touches(session, kb_id, self._subjects, base, high)
        self._touches = groupby(touches, key=lambda touch: touch.revision)
        self._next_touched = next(self._touches, None)
        return Visit(low - 1, self._world, self._definitions) if base else None

    @property
    def following(self) -> int | None:
        """The revision of the next state; None after the last one."""
        ends = self._next_redefined, self._next_touched and self._next_touched[0]
        return min((end for end in ends if end is not None), default=None)

    def step(self) -> Visit:
        """Go to the next state."""
        revision = self.following
        assert revision is not None
        if self._next_redefined == revision:
            self._definitions = advance(
                self._session, self._kb_id, self._definitions, self._last, revision
            )
            self._world, self._last = _moved(self._world, self._definitions), revision
            self._next_redefined = next(self._redefined, None)
        if self._next_touched is not None and self._next_touched[0] == revision:
            for touch in self._next_touched[1]:
                self._apply(self._world, touch)
            self._next_touched = next(self._touches, None)
        return Visit(revision, self._world, self._definitions)

    def visits(self) -> Iterator[Visit]:
        """Yield the states, first that before the range; each is gone when the next one comes."""
        first = self.begin()
        if first is not None:
            yield first
        while self.following is not None:
            yield self.step()

    def _apply(self, world: World, touch: Touch) -> None:
        row = tuple(touch.objects)
        if touch.is_fact:
            (world.remove if touch.is_end else world.add)(touch.owner, row)
        elif touch.is_end:
            world.set(touch.owner, row, None)
        else:
            value = touch.value
            world.set(touch.owner, row, value if isinstance(value, int) else Decimal(str(value)))


def object_id(definitions: Definitions, term: f.Term) -> int | None:
    """Return the id of the object that a term names."""
    known = definitions.objects.named(term.name) if isinstance(term, f.Constant) else None
    return None if known is None else known.id


def _moved(world: World, definitions: Definitions) -> World:
    """Make the same state with other definitions."""
    made = world_of(definitions)
    for predicate, row in world.facts():
        made.add(predicate, row)
    for (function, row), value in world.values().items():
        made.set(function, row, value)
    return made
