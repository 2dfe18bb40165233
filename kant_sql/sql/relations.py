"""Recursive predicates as relations, and whole statements of conditions.

A predicate with one recursive rule that uses it once is a recursive table of the WITH clause. What
the condition gives of its arguments is pushed into it: an argument that the rule hands on unchanged
limits the table, and for one that it replaces the table follows the replaced argument alone (the
factoring of right-linear rules: Naughton, Ramakrishnan, Sagiv, Ullman, Argument reduction by
factoring, 1989). All other recursion is computed round by round, semi-naively (Bancilhon 1986), by
`sql/answers.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, count, product
from math import inf, prod
from typing import Any, NamedTuple

from sqlalchemy import text
from typing_extensions import override

from ..knowledge import resolved as r
from ..knowledge.rules import DerivationRule
from .comparisons import MAX_LEVELS, levels_of
from .condition_writer import Places
from .dialects.words import Words
from .joins import JoinWriter
from .query import Query, text_literal

# A rule whose recursive disjunctions have more combinations is computed without parting them.
MAX_ALTERNATIVES = 64
# A parameter, or a quoted name or text, in which a colon is one.
_PARAMETER = re.compile(r""":(\w+)|"[^"]*"|'[^']*'""")


class Iteration(NamedTuple):
    """A recursive component that is computed round by round.

    Each row of a statement has the predicate's id, and the arguments of a fact.

    Attributes:
        arities: the predicates, each with its number of parameters.
        first: finds what follows without the component itself.
        further: finds what follows from the facts of the last round.
    """

    arities: Mapping[int, int]
    first: ConditionStatement
    further: ConditionStatement | None


@dataclass(eq=False)
class ConditionStatement:
    """A statement: its text, and the values of its parameters.

    Attributes:
        sql: the text, with named parameters.
        values: the values of the parameters that do not come with each evaluation.
        steps: what is computed first, in this order.
    """

    sql: str
    values: Mapping[str, Any]
    steps: Sequence[Iteration] = ()
    query: Query = field(init=False)

    def __post_init__(self) -> None:
        self.query = Query(text(self.sql))

    def literal(self, words: Words, values: Mapping[str, Any]) -> str:
        """Write it with all values in their places."""
        known = {**self.values, **values}

        def write(found: re.Match[str]) -> str:
            if found[1] is None:
                return found[0]
            value = known[found[1]]
            if isinstance(value, str):
                return text_literal(value)
            if value in (inf, -inf):
                # More than a double holds, as both dialects read it.
                return f"{'-' if value < 0 else ''}9e999"
            return words.list_text(value) if isinstance(value, tuple | list) else repr(value)

        return _PARAMETER.sub(write, self.sql)


class _Alternative(NamedTuple):
    """A conjunction that implies a predicate, without disjunctions that contain its component."""

    parameters: tuple[r.Bound, ...]
    parts: tuple[r.Part, ...]
    bound: tuple[r.Bound, ...]
    uses: tuple[r.HoldsFact, ...]


def rows_parameter(predicate: int) -> str:
    """Return the parameter that has the facts of a predicate computed round by round."""
    return f"rows_{predicate}"


def delta_parameter(predicate: int) -> str:
    """Return the parameter that has the facts of the last round."""
    return f"delta_{predicate}"


# How many entries of a parser's stack a subquery takes.
_SUBQUERY = 10


def _weight(part: r.Part) -> int:
    """Return how many entries of a parser's stack the text around the inner parts takes."""
    match part:
        case r.Witness():
            return _SUBQUERY
        case r.AllOf() | r.OneOf():
            return 3
        case r.Lacks():
            return 2
        case r.Compares(_, left, right):
            # A calculation stands in a CASE, and once more in a subquery, exactly.
            levels = min(levels_of(left, right), MAX_LEVELS)
            return 9 + 3 * levels if levels > 1 else 3
    return 0


@dataclass(eq=False)
class ConditionCompiler(JoinWriter):
    """Writes the statements of one condition, with the relations that it needs."""

    steps: list[Iteration] = field(default_factory=list)
    # How deep the parentheses are nested around what is being written.
    _level: int = 0

    def statement(self, sql: str) -> ConditionStatement:
        """Make the statement of a SELECT, with the WITH clause that it needs."""
        if self._tables:
            sql = f"WITH RECURSIVE {', '.join(self._tables)} {sql}"
        return ConditionStatement(sql, self.values, tuple(self.steps))

    # Depth.

    @override
    def truth(self, part: r.Part, places: Places) -> str:
        weight = _weight(part)
        if not self._is_too_deep(part, weight) and not self._is_asked_often(part, places):
            with self._at(self._level + weight):
                return super().truth(part, places)
        slots = sorted(r.slots_of(part), key=lambda slot: slot.number)
        given = {slot: places[slot] for slot in slots if places[slot].startswith(":")}
        columns = [slot for slot in slots if slot not in given]
        with self._at(0), self.asking(1):
            bound = [r.Bound(slot, self.types_of(slot)) for slot in columns]
            name = self._apart(self.rows([part], bound, given), len(columns))
        if not columns:
            return f"EXISTS (SELECT 1 FROM {name})"
        return self._listed_in(name, dict(enumerate(columns)), places)

    @override
    def union(self, choice: r.OneOf, bound: Sequence[r.Bound], places: Places) -> str:
        if not self._is_too_deep(choice, _SUBQUERY):
            with self._at(self._level + _SUBQUERY):
                return super().union(choice, bound, places)
        with self._at(0):
            sql = super().union(choice, bound, places)
        return self._apart(f"SELECT * FROM {sql} AS found", len(bound))

    def _is_too_deep(self, part: r.Part, weight: int) -> bool:
        """Return whether a part has to be a table of the WITH clause.

        A subquery is better there than a junction: fewer rows are found for it.
        """
        levels = self.words.levels
        if levels is None or not weight or not self._level:
            return False
        spare = 0 if weight == _SUBQUERY else 9
        return self._level + weight > levels + spare and not self._is_growing(part)

    def _is_growing(self, part: r.Part) -> bool:
        """Return whether a part uses what a recursive statement has found so far.

        That is known in that statement alone.
        """
        return any(
            isinstance(inner, r.HoldsFact) and self.growing.get(inner.predicate, "(")[0] != "("
            for inner in r.parts_of(part)
        )

    def _is_asked_often(self, part: r.Part, places: Places) -> bool:
        """Return whether to find all for which there is a witness, and not to look for each one.

        In the past, what held of a predicate is read as a whole, and has no index for each row.
        """
        if not self.is_past or not isinstance(part, r.Witness) or self._is_growing(part):
            return False
        facts = [fact for fact in _conjuncts(part) if not self.is_derived(fact)]
        asking = {slot for slot in r.slots_of(part) if not places[slot].startswith(":")}
        if not asking or not _are_connected(facts, asking):
            return False
        return any(
            self.is_read(fact.predicate, self.asked * self.found_by(n, term, types))
            for fact in facts
            for n, (term, types) in enumerate(zip(fact.terms, self._declared(fact), strict=True))
            if term in asking
        )

    def _declared(self, fact: r.HoldsFact) -> list[r.TypeSet]:
        declared = self.definitions.predicates.live(fact.predicate).parameters
        return [r.closure(self.definitions, each.type_ids) for each in declared]

    @contextmanager
    def _at(self, level: int) -> Iterator[None]:
        before, self._level = self._level, level
        try:
            yield
        finally:
            self._level = before

    def _apart(self, sql: str, columns: int) -> str:
        """Add a table; return its name."""
        name = f"apart_{len(self._tables)}"
        self._table(name, columns, sql)
        return name

    # Recursion.

    @override
    def relation(self, fact: r.HoldsFact, given: Mapping[int, r.Place], places: Places) -> str:
        predicate = fact.predicate
        growing = self.growing.get(predicate)
        if growing is not None:
            return growing
        texts = {n: self.place(term, places) for n, term in given.items()}
        alternatives = self._alternatives(predicate)
        recursive = [each for each in alternatives or () if each.uses]
        is_linear = (
            alternatives is not None
            and len(self.rules.component[predicate]) == 1
            and len(recursive) <= 1
            and all(len(each.uses) == 1 for each in recursive)
        )
        if not is_linear or alternatives is None:
            return self._iterated(predicate)
        limits = self._limits(alternatives, recursive, texts)
        key = (predicate, *sorted(limits.items())) if limits is not None else None
        if key is None:
            key = ("factored", predicate, *sorted(texts.items()))
        name = self._relations.get(key)
        if name is None:
            name = self._relations[key] = f"derived_{len(self._relations)}"
            with self._at(0):
                if limits is None:
                    self._factored(name, alternatives, recursive[0], texts)
                else:
                    self._recursive(name, predicate, alternatives, limits)
        return name

    def _alternatives(self, predicate: int) -> list[_Alternative] | None:
        """Part the rules of a predicate; None if one uses the component outside of conjunctions."""
        component = self.rules.component[predicate]
        found = []
        for rule in self.rules.evaluated(predicate):
            made = _alternatives(rule, component)
            if made is None:
                return None
            found += made
        return [*found, self.stored(predicate)]

    def stored(self, predicate: int) -> _Alternative:
        """Return that a fact of a derived predicate is stored, and so holds; in new variables."""
        declared = self.definitions.predicates.live(predicate).parameters
        slots = tuple([r.Bound(r.Slot(next(self.rules.numbers)), ()) for _ in declared])
        fact = r.HoldsFact(predicate, tuple([each.slot for each in slots]), is_stored=True)
        return _Alternative(slots, (fact,), (), ())

    def _limits(
        self,
        alternatives: Sequence[_Alternative],
        recursive: Sequence[_Alternative],
        texts: Mapping[int, str],
    ) -> dict[int, str] | None:
        """Return which given arguments limit the table; None if following them is better."""

        def is_kept(position: int) -> bool:
            return all(
                each.uses[0].terms[position] == each.parameters[position].slot for each in recursive
            )

        limits = {n: place for n, place in texts.items() if is_kept(n)}
        if limits or not texts or not recursive:
            return limits
        others = [n for n in range(len(recursive[0].parameters)) if n not in texts]
        step = recursive[0]
        rest = [part for part in step.parts if part is not step.uses[0]]
        mentioned = set().union(*map(r.slots_of, rest)) if rest else set()
        mentioned |= {term for n, term in enumerate(step.uses[0].terms) if n in texts}  # type: ignore[misc]
        are_apart = all(
            is_kept(n)
            and step.parameters[n].slot not in mentioned
            and self._have_one_type(alternatives, step, n)
            for n in others
        )
        # What does not fit the step would not even begin.
        begin = all(self._have_one_type(alternatives, step, n) for n in texts)
        return None if are_apart and begin else limits

    def _have_one_type(
        self, alternatives: Sequence[_Alternative], step: _Alternative, position: int
    ) -> bool:
        """Return whether all rules allow the same objects at a position, and facts no others."""
        wanted = step.parameters[position].types
        predicate = self.definitions.predicates.live(step.uses[0].predicate)
        have = r.closure(self.definitions, predicate.parameters[position].type_ids)
        return all(
            types is None or (have is not None and have <= types) for types in wanted
        ) and all(each.parameters[position].types == wanted for each in alternatives[:-1])

    def _select(
        self,
        alternative: _Alternative,
        given: Mapping[int, str],
        columns: Iterable[r.Place] | None = None,
        parts: Iterable[r.Part] | None = None,
        first: str = "",
        checked: Mapping[int, tuple[r.TypeSet, ...]] | None = None,
    ) -> str:
        """Write the facts that an alternative implies.

        `checked` are the types that given arguments are known to fit.
        """
        fitting = {} if checked is None else checked
        parameters = alternative.parameters
        self.declare(parameters)
        places = {parameters[n].slot: place for n, place in given.items()}
        typed = [
            r.HasType(parameters[n].slot, types)
            for n in given
            if parameters[n].types != fitting.get(n)
            for types in parameters[n].types
            if types is not None
        ]
        free = [each for n, each in enumerate(parameters) if n not in given]
        terms = [each.slot for each in parameters] if columns is None else columns
        conjuncts = [*typed, *(alternative.parts if parts is None else parts)]
        return self.rows(conjuncts, [*free, *alternative.bound], places, columns=terms, first=first)

    def _recursive(
        self,
        name: str,
        predicate: int,
        alternatives: Sequence[_Alternative],
        limits: Mapping[int, str],
    ) -> None:
        """Add the table of a predicate, limited to some arguments."""
        arity = len(alternatives[0].parameters)
        selects = [self._select(each, limits) for each in alternatives if not each.uses]
        self.growing[predicate] = name
        selects += [self._select(each, limits) for each in alternatives if each.uses]
        del self.growing[predicate]
        self._table(name, arity, " UNION ".join(selects))

    def _factored(
        self,
        name: str,
        alternatives: Sequence[_Alternative],
        step: _Alternative,
        texts: Mapping[int, str],
    ) -> None:
        """Add the table of what the given arguments lead to, and that of the facts from there."""
        given = sorted(texts)
        reached = f"{name}_from"
        arity = len(step.parameters)
        others = [n for n in range(arity) if n not in texts]
        from_here = {n: f"{reached}.c{column}" for column, n in enumerate(given)}
        # The types of the given arguments are checked where they are reached.
        checked = {n: step.parameters[n].types for n in given}
        base = [each for each in alternatives if not each.uses]
        is_closure = _is_closure(base[:-1], step, given, others)
        self._reached(reached, step, given, texts, is_closure)
        selects: list[str] = []
        if is_closure:
            # What a step reaches is what follows: only stored facts are added to it.
            places = dict(zip(others, range(len(given)), strict=True))
            columns = ", ".join(
                f"{reached}.c{places[n]} AS c{n}" if n in places else f"NULL AS c{n}"
                for n in range(arity)
            )
            selects.append(f"SELECT {columns} FROM {reached}")
            selects.append(self._select(base[-1], dict(texts)))
            base = base[-1:]
        selects += [self._select(each, from_here, first=reached, checked=checked) for each in base]
        facts = " UNION ALL ".join(selects)
        columns = ", ".join(
            f"CAST({texts[n]} AS BIGINT)" if n in texts else f"c{n}" for n in range(arity)
        )
        self._table(name, arity, f"SELECT DISTINCT {columns} FROM ({facts}) AS facts")

    def _reached(
        self,
        name: str,
        step: _Alternative,
        given: Sequence[int],
        texts: Mapping[int, str],
        is_closure: bool,
    ) -> None:
        """Add the table of what the given arguments lead to, themselves included or by a step."""
        start = ", ".join(f"CAST({texts[n]} AS BIGINT)" for n in given)
        next_ = [step.uses[0].terms[n] for n in given]
        # Types are checked once: at the start, and of each object that is reached.
        typed = [
            (n, term, types)
            for n, term in zip(given, next_, strict=True)
            for types in step.parameters[n].types
            if types is not None
        ]
        slots = {n: step.parameters[n].slot for n in given}
        begun = [self.has_type(slots[n], types, {slots[n]: texts[n]}) for n, _, types in typed]
        parts = [part for part in step.parts if part is not step.uses[0]]
        parts += [r.HasType(term, types) for _, term, types in typed]
        # The other parameters are handed on, so the step does not need them.
        own = step._replace(parameters=tuple(step.parameters[n] for n in given), parts=tuple(parts))
        places = {column: f"{name}.c{column}" for column in range(len(given))}
        fitting = {column: step.parameters[n].types for column, n in enumerate(given)}
        select = self._select(own, places, next_, first=name, checked=fitting)
        started = f"SELECT {start}" + (f" WHERE {' AND '.join(begun)}" if begun else "")
        if is_closure:
            own_start = dict(enumerate(texts[n] for n in given))
            started = self._select(own, own_start, next_)
        self._table(name, len(given), f"{started} UNION {select}")

    def _iterated(self, predicate: int) -> str:
        """Have a component computed round by round; return the relation of one predicate."""
        component = sorted(self.rules.component[predicate])
        if ("iterated", *component) not in self._relations:
            self._relations["iterated", *component] = ""
            made, steps = self._iteration(component)
            known = [each.arities for each in self.steps]
            self.steps += [each for each in (*steps, made) if each.arities not in known]
        return self.listed(predicate, rows_parameter(predicate))

    def _iteration(self, component: Sequence[int]) -> tuple[Iteration, Sequence[Iteration]]:
        """Make the statements that compute a component; return also what they need before."""
        live = self.definitions.predicates.live
        arities = {each: len(live(each).parameters) for each in component}
        width = max(arities.values())
        own = self.words, self.definitions, self.is_past, self.size, self.rules
        first, further = (ConditionCompiler(*own) for _ in range(2))
        for writer in (first, further):
            for each in component:
                writer.growing[each] = writer.listed(each, rows_parameter(each))
                # A use that is limited to the facts of the last round.
                writer.growing[-each] = writer.listed(each, delta_parameter(each))
        made = {True: list[str](), False: list[str]()}
        for predicate in component:
            for select, is_first in _selects(first, further, predicate, frozenset(component)):
                pad = "".join(", 0" for _ in range(width - arities[predicate]))
                columns = ", ".join(f"c{n}" for n in range(arities[predicate]))
                listed = f"{predicate} AS predicate{', ' if columns else ''}{columns}{pad}"
                made[is_first].append(f"SELECT {listed} FROM ({select}) AS found")
        before = first.statement(" UNION ALL ".join(made[True]))
        after = further.statement(" UNION ALL ".join(made[False])) if made[False] else None
        needed = [*before.steps, *(after.steps if after else ())]
        return Iteration(arities, before, after), list({id(each): each for each in needed}.values())

    def listed(self, predicate: int, parameter: str) -> str:
        """Return the relation of the facts of a predicate that a parameter has."""
        declared = self.definitions.predicates.live(predicate).parameters
        return self.words.loops.rows(parameter, len(declared))


def _conjuncts(part: r.Part) -> Iterator[r.HoldsFact]:
    """Yield the facts that a part is a conjunction of, with those of its quantifiers."""
    parts = [part]
    while parts:
        match parts.pop():
            case r.HoldsFact() as fact:
                yield fact
            case r.AllOf(inner):
                parts += inner
            case r.Witness(_, inner_part):
                parts.append(inner_part)


def _are_connected(facts: Iterable[r.HoldsFact], slots: AbstractSet[r.Slot]) -> bool:
    """Return whether facts bind some variables, and are not a product of facts that share none."""
    groups: list[set[r.Place]] = []
    for fact in facts:
        own: set[r.Place] = {term for term in fact.terms if isinstance(term, r.Slot)}
        joined = [group for group in groups if not group.isdisjoint(own)]
        groups = [group for group in groups if group.isdisjoint(own)]
        groups.append(own.union(*joined))
    return sum(not group.isdisjoint(slots) for group in groups) == 1 and any(
        slots <= group for group in groups
    )


def _is_closure(
    base: Sequence[_Alternative], step: _Alternative, given: Sequence[int], others: Sequence[int]
) -> bool:
    """Return whether what the base says of the other arguments is what a step says of the next."""
    if len(base) != 1 or len(given) != len(others):
        return False
    [first] = base
    next_ = [step.uses[0].terms[n] for n in given]
    ends = [first.parameters[n].slot for n in others]
    own = {each.slot: each.types for each in step.bound}
    if len(set(next_)) < len(next_) or not all(term in own for term in next_):
        return False
    if any(
        not first.parameters[g].types == first.parameters[o].types == step.parameters[g].types
        for g, o in zip(given, others, strict=True)
    ):
        return False
    parts = tuple(part for part in step.parts if part is not step.uses[0])
    rest = [each for each in step.bound if each.slot not in next_]
    return _shape(first.parts, [first.parameters[n].slot for n in given], ends, first.bound) == (
        _shape(parts, [step.parameters[n].slot for n in given], next_, rest)
    )


def _shape(
    parts: Iterable[r.Part],
    starts: Sequence[r.Slot],
    ends: Sequence[r.Place],
    bound: Iterable[r.Bound],
) -> tuple[object, ...]:
    """Return the parts with their variables in one numbering, and the types of those bound."""
    numbers = count()
    places: dict[r.Slot, r.Place] = {slot: r.Slot(next(numbers)) for slot in starts}
    places.update((slot, r.Slot(next(numbers))) for slot in ends if isinstance(slot, r.Slot))
    bound = tuple(bound)
    places.update((each.slot, r.Slot(next(numbers))) for each in bound)
    made = tuple(r.replaced(part, places, numbers) for part in parts)
    return *made, *(each.types for each in bound)


# The parts of a conjunction, and the variables that it binds.
_Conjunction = tuple[tuple[r.Part, ...], tuple[r.Bound, ...]]


def _spread(part: r.Part, component: frozenset[int]) -> list[_Conjunction] | None:
    """Part a body at its disjunctions that contain a component."""
    if isinstance(part, r.HoldsFact) or not _uses(part, component):
        return [((part,), ())]
    if isinstance(part, r.Witness):
        within = _spread(part.part, component)
        return within and [(parts, (*part.bound, *bound)) for parts, bound in within]
    if not isinstance(part, r.AllOf | r.OneOf):
        return None
    each = [_spread(inner, component) for inner in part.parts]
    found = [one for one in each if one is not None]
    if len(found) < len(each):
        return None
    if isinstance(part, r.OneOf):
        return [one for several in found for one in several]
    if prod(map(len, found)) > MAX_ALTERNATIVES:
        return None
    return [
        (tuple(chain(*(parts for parts, _ in chosen))), tuple(chain(*(one for _, one in chosen))))
        for chosen in product(*found)
    ]


def _uses(part: r.Part, component: frozenset[int]) -> bool:
    return any(
        isinstance(inner, r.HoldsFact) and inner.predicate in component
        for inner in r.parts_of(part)
    )


def _alternatives(rule: DerivationRule, component: frozenset[int]) -> list[_Alternative] | None:
    """Part a rule at its disjunctions; None if it uses the component outside of conjunctions."""
    made = _spread(rule.body, component)
    if made is None or len(made) > MAX_ALTERNATIVES:
        return None
    return [
        _Alternative(
            rule.parameters,
            parts,
            bound,
            tuple(
                part
                for part in parts
                if isinstance(part, r.HoldsFact) and part.predicate in component
            ),
        )
        for parts, bound in made
        if r.FALSE not in parts
    ]


def _selects(
    first: ConditionCompiler, further: ConditionCompiler, predicate: int, component: frozenset[int]
) -> Iterator[tuple[str, bool]]:
    """Yield the SELECTs of a predicate's rules, and whether each belongs to the first round."""
    for rule in first.rules.evaluated(predicate):
        alternatives = _alternatives(rule, component)
        if alternatives is None:
            # Not in conjunctions alone: each round asks it of all that is known.
            whole = _Alternative(rule.parameters, (rule.body,), (), ())
            yield first._select(whole, {}), True
            yield further._select(whole, {}), False
            continue
        for each in alternatives:
            if not each.uses:
                yield first._select(each, {}), True
            for use in each.uses:
                newest = r.HoldsFact(-use.predicate, use.terms)
                parts = [newest if part is use else part for part in each.parts]
                yield further._select(each, {}, parts=parts), False
    yield first._select(first.stored(predicate), {}), True
