"""Refusing rules: the changes of a transaction must not break them.

A rule forbids a condition on some objects. Only a change that makes a part of the condition true
can violate it, so that part has the objects of the change, and one statement searches for the
others: its cost does not grow with the store. Derived facts are searched as a whole.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from ..dto import formulas as f
from ..dto.elements import atom_text
from ..errors import RuleViolatedError, UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.definitions import (
    DERIVED_PREDICATE,
    REFUSE,
    Definitions,
    PendingDefinitions,
    RuleDefinition,
)
from ..knowledge.formulas import TreeReader
from ..knowledge.grounding import bound, substitute
from ..knowledge.reads import Reading, heads_of, read_by
from ..knowledge.rules import rules_of
from ..sql.answers import Question, Reader
from ..sql.dialects.base import Session
from ..sql.relations import ConditionStatement
from ..sql.rows import FACT, VALUE

# The content of elements before a transaction and now, by kind; None if it does not hold.
Changes = Mapping[str, Sequence[tuple[Any, Any, Any]]]
PROPOSITIONS, VALUES = "propositions", "values"
_STATE = {PROPOSITIONS, VALUES}
# The kinds that affect the meaning of a rule.
_MEANING = ("type", "predicate", "function", "formula", "rule")


@dataclass(frozen=True, eq=False)
class Forbidden:
    """A condition that a rule forbids, with its objects."""

    rule: RuleDefinition
    formula: f.Formula  # the part of the rule within its quantifiers
    variables: tuple[f.TypedName, ...]  # the variables of the quantifiers
    bound: tuple[r.Bound, ...]  # the variables of the condition, those of the quantifiers first
    part: r.Part


@dataclass(eq=False)
class _Trigger:
    """A part of a forbidden condition that changes can make true."""

    forbidden: Forbidden
    terms: tuple[r.Place, ...]
    # The positions of variables among the terms; without any, search for all objects.
    places: Mapping[r.Slot, int]
    statement: ConditionStatement | None = None

    def fits(self, definitions: Definitions, row: Sequence[int]) -> bool:
        """Return whether the terms can have these objects."""
        pairs = dict(zip(self.terms, row, strict=True))
        own = [one for one in self.forbidden.bound if one.slot in pairs]
        return all(
            (term.id if isinstance(term, r.Known) else pairs[term]) == id_
            for term, id_ in zip(self.terms, row, strict=True)
        ) and all(_ranges(one.types, definitions.objects.get(pairs[one.slot])) for one in own)

    def written(self, question: Question) -> ConditionStatement:
        """Write the statement that finds the first of some rows for which the condition holds."""
        one = self.forbidden
        rest = tuple([each for each in one.bound if each.slot not in self.places])
        part = r.Witness(rest, one.part) if rest else one.part
        return question.touched(part, self.places, len(self.terms))


def _ranges(types: Iterable[r.TypeSet], found: Any) -> bool:
    """Return whether a variable of some types ranges over an object, which may be deleted."""
    return found is not None and all(
        one is None or not one.isdisjoint(found.type_ids) for one in types
    )


def forbidden_by(
    definitions: Definitions,
    rule: RuleDefinition,
    formula: f.Formula,
    variables: tuple[f.TypedName, ...] = (),
) -> Iterator[Forbidden]:
    """Yield the forbidden conditions of a rule; refuse a part that no single state violates."""
    match formula:
        case f.And(parts):
            for each in parts:
                yield from forbidden_by(definitions, rule, each, variables)
        case f.Forall(own, inner):
            yield from forbidden_by(definitions, rule, inner, (*variables, *own))
        case f.Modal("always", _, (condition,)) | (f.Count() as condition):
            resolver = r.Resolver(definitions)
            slots = resolver.variables(variables)
            part = r.negate(resolver.part(condition))
            # Each way to violate it separately, so that an error names its facts.
            for way in part.parts if isinstance(part, r.OneOf) else (part,):
                open_, within = slots, way
                while isinstance(within, r.Witness):
                    open_, within = (*open_, *within.bound), within.part
                r.check_levels(within)
                yield Forbidden(rule, formula, variables, open_, within)
        case _:
            raise UnsupportedConstructError(
                f"no single state violates {formula}, so it cannot refuse a transaction: give "
                "(always ...), (at-most-one ...) and (exactly-one ...) in conjunctions and "
                "universal quantifiers, or on_violation='report'"
            )


def _leaves(part: Any, begins: bool = True) -> Iterator[tuple[Any, bool]]:
    """Yield the leaves and variables of a condition, and whether their beginning makes it true."""
    if isinstance(part, r.Witness):
        yield from ((one, begins) for one in part.bound)
    inner = r.inner_parts(part)
    for each in inner:
        yield from _leaves(each, begins != isinstance(part, r.Lacks))
    if not inner:
        yield part, begins


class RuleGuard:
    """The forbidden conditions of a state's refusing rules, and the changes that may cause them."""

    def __init__(self, definitions: Definitions) -> None:
        self.definitions = definitions
        self.all: list[Forbidden] = []
        # Keyed by the kind of a change, its predicate or function, and whether it is a beginning.
        self.triggers: defaultdict[tuple[str, int, bool], list[_Trigger]] = defaultdict(list)
        self.objects: list[_Trigger] = []  # the conditions that a new object may cause
        # The variables within conditions, and whether more objects make these true.
        self.ranges: list[tuple[Forbidden, Iterable[r.TypeSet], bool]] = []
        self.rules = rules_of(definitions)
        for rule in definitions.rules:
            if rule.on_violation == REFUSE:
                formula = TreeReader(definitions, rule.constraint).formula()
                for one in forbidden_by(definitions, rule, formula):
                    self._add(one)

    def _add(self, one: Forbidden) -> None:
        self.all.append(one)
        derived = self.rules.of
        parts = one.part.parts if isinstance(one.part, r.AllOf) else (one.part,)
        facts = [each for each in parts if isinstance(each, r.HoldsFact)]
        # A new object in a fact is found by the fact.
        found = {term for each in facts if not derived(each.predicate) for term in each.terms}
        for each in one.bound:
            if each.slot not in found:
                self.objects.append(_trigger(one, (each.slot,)))
        for leaf, begins in _leaves(one.part):
            match leaf:
                case r.Bound(_, types):
                    self.ranges.append((one, types, begins))
                case r.HoldsFact(predicate) if derived(predicate):
                    self._depend(one, leaf)
                case r.HoldsFact(predicate, terms):
                    self.triggers[PROPOSITIONS, predicate, begins].append(_trigger(one, terms))
                case r.FluentIs(function, terms) | r.NumberOf(function, terms):
                    for sign in (True, False):
                        self.triggers[VALUES, function, sign].append(_trigger(one, terms))

    def _depend(self, one: Forbidden, derived: r.HoldsFact) -> None:
        """Search for all objects if a dependency of a derived predicate changes."""
        self.ranges += [(one, (), True), (one, (), False)]
        for is_fact, owner in heads_of(self.rules, derived):
            for sign in (True, False):
                kind = PROPOSITIONS if is_fact else VALUES
                self.triggers[kind, owner, sign].append(_trigger(one, ()))


def _trigger(one: Forbidden, terms: tuple[r.Place, ...]) -> _Trigger:
    slots = [each.slot for each in one.bound if each.slot in terms]
    return _Trigger(one, terms, {slot: terms.index(slot) for slot in slots})


def guard_of(definitions: PendingDefinitions, touched: Container[str]) -> RuleGuard:
    """Return the guard of a state, cached until the meaning of rules changes."""
    if any(kind in touched and definitions.elements(kind).changes for kind in _MEANING):
        return RuleGuard(definitions)
    origin = definitions.origin
    key = tuple([origin.elements(kind) for kind in _MEANING])
    found: RuleGuard | None = origin.guards.get(key)
    if found is None:
        origin.guards.clear()
        found = origin.guards[key] = RuleGuard(origin)
    return found


class TouchedRules:
    """The rules that a transaction may have violated, for all objects or for some."""

    def __init__(self, definitions: PendingDefinitions, changes: Changes | None) -> None:
        """Find them; without a list of changes, which may be too long, check all."""
        self.guard = guard_of(definitions, _MEANING if changes is None else changes)
        self.definitions = definitions
        self.whole: dict[Forbidden, None] = {}
        self.rows: defaultdict[_Trigger, list[Sequence[int]]] = defaultdict(list)
        if changes is not None and changes.keys() <= _STATE:
            self._read_state(changes)
        elif changes is None or self._is_other(changes):
            self.whole = dict.fromkeys(self.guard.all)
        else:
            self._read_state(changes)
            self._read(changes)

    def _is_other(self, changes: Changes) -> bool:
        """Return whether elements that rules mention have another meaning."""
        kinds = ("type", "predicate", "function")
        others = (before for kind in kinds for _, before, _ in changes.get(kind, ()))
        objects = (None not in pair for _, *pair in changes.get("object", ()))
        formulas = (one for _, *pair in changes.get("formula", ()) for one in pair if one)
        return any((*others, *objects)) or any(one.section == DERIVED_PREDICATE for one in formulas)

    def _read_state(self, changes: Changes) -> None:
        guard = self.guard
        for kind in (PROPOSITIONS, VALUES):
            for _, before, now in changes.get(kind, ()):
                one = before or now
                key = one.key if kind == PROPOSITIONS else one.fluent.key
                own = guard.triggers.get((kind, key[-2], now is not None))
                if own and not (kind == PROPOSITIONS and key.is_goal):
                    self._add(own, [int(id_) for id_ in key[-1].split()])

    def _read(self, changes: Changes) -> None:
        guard = self.guard
        for _, before, now in changes.get("object", ()):
            if now is not None:
                self._add(guard.objects, [now.id])
            for one, types, begins in guard.ranges:
                if begins == (now is not None) and _ranges(types, now or before):
                    self.whole[one] = None
        made = {now for *_, now in changes.get("rule", ()) if now is not None}
        self.whole |= dict.fromkeys([one for one in guard.all if one.rule in made])

    def _add(self, triggers: Iterable[_Trigger], row: Sequence[int]) -> None:
        for one in triggers:
            if not one.places:
                self.whole[one.forbidden] = None
            elif one.fits(self.definitions, row):
                self.rows[one].append(row)

    def refuse(self, session: Session, kb_id: int) -> None:
        """Raise if a forbidden condition holds."""
        self._reader = Reader(session, kb_id)
        for one in self.whole:
            self._refuse(one, {})
        for trigger, rows in self.rows.items():
            if trigger.forbidden in self.whole:
                continue
            statement = trigger.statement
            if statement is None:
                question = self._question(self.guard.definitions)
                statement = trigger.statement = trigger.written(question)
            # The first row for whose objects the condition holds.
            for place, *_ in self._reader.run(statement, {"touched": json.dumps(rows)}):
                known = {slot: r.Known(rows[place][n]) for slot, n in trigger.places.items()}
                self._refuse(trigger.forbidden, known)

    def _question(self, definitions: Definitions) -> Question:
        words = self._reader.session.backend.words
        return Question(words, definitions, False, None, rules_of(definitions))

    def _refuse(self, one: Forbidden, known: Mapping[r.Slot, r.Known]) -> None:
        """Raise for the first objects for which the condition holds, if any."""
        definitions = self.definitions
        part = r.replaced(one.part, {**known}, count(1_000_000))
        columns = [r.Column("", each) for each in one.bound if each.slot not in known]
        statement = self._question(definitions).answers(part, columns, {}, True)
        found = self._reader.run(statement, {"most": 1})[1:]
        if not found:
            return
        slots = [each.bound.slot for each in columns]
        ids = {**known, **dict(zip(slots, map(r.Known, found[0][1:]), strict=False))}
        quantified = one.bound[: len(one.variables)]
        own = [definitions.objects.live(ids[each.slot].id) for each in quantified]
        instance = substitute(one.formula, bound(one.variables, [each.name for each in own]))
        part = r.replaced(one.part, {**ids}, count(1_000_000))
        parts = part.parts if isinstance(part, r.AllOf) else (part,)
        read: list[Reading[int]] = read_by(self.guard.rules, parts, {})
        said = ", ".join(sorted({*filter(None, (_text(definitions, each) for each in parts))}))
        raise RuleViolatedError(
            f"rule {one.rule.name!r} refuses this: {instance} would be violated"
            f"{f' by {said}' if said else ''}; nothing was written: change these "
            "first or in the same transaction, or redefine or delete the rule (kb.rules)",
            one.rule.name,
            str(instance),
            tuple([_reading(definitions, each) for each in read]),
        )


def _reading(definitions: Definitions, read: Reading[int]) -> tuple[str | None, ...]:
    """Write the read facts and values with names."""
    is_fact, owner, row = read
    kind, owners = (FACT, definitions.predicates) if is_fact else (VALUE, definitions.functions)
    names = [None if id_ is None else definitions.objects.live(id_).name for id_ in row]
    return kind, owners.live(owner).name, *names


def _text(definitions: Definitions, part: r.Part) -> str | None:
    """Write a fact or its absence; None for other parts."""
    if isinstance(part, r.Lacks):
        text = _text(definitions, part.part)
        return text and f"(not {text})"
    if not isinstance(part, r.HoldsFact):
        return None
    names = [
        definitions.objects.live(each.id).name for each in part.terms if isinstance(each, r.Known)
    ]
    name = definitions.predicates.live(part.predicate).name
    return atom_text(name, names) if len(names) == len(part.terms) else None
