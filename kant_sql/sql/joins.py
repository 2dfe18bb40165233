"""The join of a conjunction: which facts give which variables their objects, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from typing_extensions import override

from ..errors import UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.trees import ParameterDefinition
from .condition_writer import ARGUMENT_COLUMNS, ConditionWriter, JoinedTables, Places
from .estimates import COUNTED_OF_MANY, domain_size

# How many rows a relation gives for each one that is joined with it, where nothing is counted.
SOME = 100.0
# SQLite joins at most 64 tables.
MAX_JOINED = 60


def _fit(have: tuple[r.TypeSet, ...], types: r.TypeSet) -> bool:
    """Return whether all objects of some type sets fit types."""
    return types is None or any(one is not None and one <= types for one in have)


class _Join:
    """One join in the making; `places` has the variables that are bound outside."""

    def __init__(self, writer: JoinWriter, places: Places) -> None:
        self._writer = writer
        self._selection = JoinedTables(writer.words, places)
        self._outer = places
        # Variables that are yet to be bound, in order, and what may bind them.
        self._unbound: dict[r.Slot, tuple[r.TypeSet, ...]] = {}
        self._facts: list[r.HoldsFact | r.FluentIs] = []
        self._equalities: list[r.SameObject] = []
        self._choices: list[r.OneOf] = []
        self._filters: list[r.Part] = []
        # How many rows there are, about.
        self._rows = writer.asked
        # The types that variables have by what binds them.
        self._have: dict[r.Slot, tuple[r.TypeSet, ...]] = {}

    def run(self, parts: Iterable[r.Part], bound: Iterable[r.Bound]) -> JoinedTables:
        """Join."""
        self._open(bound)
        self._spread(list(parts))
        self._join_growing()
        while self._unbound:
            if not (self._equate() or self._next_fact() or self._next_choice()):
                self._range(next(iter(self._unbound)))
        self._equate()
        filters = [part for part in self._filters if not self._is_fitting(part)]
        rest = [*self._equalities, *self._facts, *self._choices, *filters]
        selection = self._selection
        with self._writer.asking(self._rows):
            selection.where += self._writer.operands(rest, selection.places, True)
        if len(selection.tables) > MAX_JOINED:
            raise UnsupportedConstructError(
                f"a conjunction of the condition binds {len(selection.tables)} variables or more, "
                f"and a database joins at most {MAX_JOINED}; ask for parts of it"
            )
        return selection

    def _join_growing(self) -> None:
        """Join first what a recursive statement has found so far: it is read row by row."""
        for fact in list(self._facts):
            if not isinstance(fact, r.HoldsFact) or fact.is_stored:
                continue
            if fact.predicate in self._writer.growing:
                self._facts.remove(fact)
                self._join_relation(fact)
                self._rows *= SOME

    def _open(self, bound: Iterable[r.Bound]) -> None:
        bound = tuple(bound)
        self._writer.declare(bound)
        self._unbound.update((each.slot, each.types) for each in bound)

    def _spread(self, parts: list[r.Part]) -> None:
        """Part a conjunction by what its parts can do; quantifiers become part of the join."""
        parts.reverse()
        while parts:
            part = parts.pop()
            match part:
                case r.AllOf(inner):
                    parts += reversed(inner)
                case r.Witness(bound, inner_part):
                    self._selection.is_distinct = False
                    self._open(bound)
                    parts.append(inner_part)
                case r.HoldsFact() if self._writer.is_derived(part):
                    body = self._writer.inline(part)
                    if body is None:
                        self._facts.append(part)
                    else:
                        parts.append(body)
                case r.HoldsFact() | r.FluentIs():
                    self._facts.append(part)
                case r.SameObject():
                    self._equalities.append(part)
                case r.OneOf() if part != r.FALSE:
                    alternatives = [each for each in part.parts if each != r.FALSE]
                    if len(alternatives) == 1:
                        parts.append(alternatives[0])
                    else:
                        self._choices.append(part)
                case _:
                    self._filters.append(part)

    def _is_bound(self, term: r.Place) -> bool:
        return term not in self._unbound

    def _bind(self, slot: r.Slot, place: str, have: tuple[r.TypeSet, ...]) -> None:
        """Bind a variable; check its types where what binds it allows more."""
        wanted = self._unbound.pop(slot)
        self._have[slot] = have
        self._selection.places[slot] = place
        for types in wanted:
            if not _fit(have, types):
                self._selection.where.append(
                    self._writer.has_type(slot, types, self._selection.places)
                )

    def _is_fitting(self, part: r.Part) -> bool:
        """Return whether a variable has a type by what binds it."""
        return (
            isinstance(part, r.HasType)
            and isinstance(part.term, r.Slot)
            and _fit(self._have.get(part.term, ()), part.types)
        )

    def _equate(self) -> bool:
        """Bind the variables that equal what is bound."""
        found = False
        for part in list(self._equalities):
            for one, other in ((part.left, part.right), (part.right, part.left)):
                if isinstance(one, r.Slot) and one in self._unbound and self._is_bound(other):
                    place = self._writer.place(other, self._selection.places)
                    self._bind(one, place, self._types_of(other))
                    self._equalities.remove(part)
                    found = True
                    break
        return found

    def _types_of(self, term: r.Place) -> tuple[r.TypeSet, ...]:
        if isinstance(term, r.Known):
            object_ = self._writer.definitions.objects.live(term.id)
            # One type of an object suffices to fit.
            return tuple(frozenset((id_,)) for id_ in object_.type_ids)
        return self._writer.types_of(term)

    def _next_fact(self) -> bool:
        """Join the most selective fact that binds a variable."""
        ranks = {n: rank for n, fact in enumerate(self._facts) if (rank := self._rank(fact))}
        if not ranks:
            return False
        first = min(ranks.values())
        equal = [n for n, rank in ranks.items() if rank[0] == first[0]]
        if len(equal) > 1:
            # Only where there is a choice it matters how many facts there are.
            equal.sort(key=lambda n: (self._rows_of(self._facts[n]), ranks[n], n))
        fact = self._facts[equal[0]]
        self._facts.remove(fact)
        found = self._rows_of(fact) if self._writer.is_past else 1
        if isinstance(fact, r.FluentIs):
            found = SOME if ranks[equal[0]][0] else 1
            self._join_value(fact)
        elif self._writer.is_derived(fact):
            found = SOME
            self._join_relation(fact)
        else:
            self._join_fact(fact)
        self._rows = max(self._rows * found, 1)
        return True

    def _rank(self, fact: r.HoldsFact | r.FluentIs) -> tuple[float, ...] | None:
        """Rank a fact: the smaller, the earlier; None where it binds nothing."""
        terms = fact.terms if isinstance(fact, r.HoldsFact) else (*fact.terms, fact.value)
        unbound = {term for term in terms if not self._is_bound(term)}
        if not unbound:
            return None
        bound = len(terms) - len([term for term in terms if term in unbound])
        if isinstance(fact, r.FluentIs):
            # A function has one value: once its arguments are bound, one row.
            if all(self._is_bound(term) for term in fact.terms):
                return (0, 0, 0)
            return (3 if bound else 5, -bound, len(unbound))
        if self._writer.is_derived(fact):
            return (2 if bound else 4, -bound, len(unbound))
        return (1 if bound else 3, -bound, len(unbound))

    def _rows_of(self, fact: r.HoldsFact | r.FluentIs) -> float:
        """Estimate how many facts one row finds: as many for each object that is bound."""
        writer = self._writer
        if isinstance(fact, r.FluentIs) or writer.is_derived(fact):
            return 0
        found = writer.facts_of(fact.predicate, COUNTED_OF_MANY if writer.is_past else 0)
        parameters = writer.definitions.predicates.live(fact.predicate).parameters
        for term, parameter in zip(fact.terms, parameters, strict=True):
            if self._is_bound(term):
                types = r.closure(writer.definitions, parameter.type_ids)
                found /= domain_size(writer.definitions, types)
        return found

    def _join_fact(self, fact: r.HoldsFact) -> None:
        predicate = self._writer.definitions.predicates.live(fact.predicate)
        columns = self._past_facts(fact) if self._writer.is_past else self._found_facts(fact)
        if fact.is_stored and not self._writer.is_past:
            # Facts of a derived predicate are rare: without any, none is looked up.
            version = self._writer.alias("v")
            where = self._writer.versions(version, fact.predicate)
            tables = f"proposition_version AS {version}"
            self._selection.where.append(self._writer.exists(tables, where))
        self._match(fact.terms, columns, predicate.parameters)

    def _found_facts(self, fact: r.HoldsFact) -> list[str]:
        """Join the versions of a predicate that an index finds, and further arguments."""
        writer, selection = self._writer, self._selection
        version = writer.alias("v")
        columns = [f"{version}.{column}" for column in ARGUMENT_COLUMNS[: len(fact.terms)]]
        is_indexed = any(map(self._is_bound, fact.terms[: len(columns)]))
        further = range(len(columns), len(fact.terms))
        # Without an indexed argument, a bound one further on finds the facts.
        first = [n for n in further if not is_indexed and self._is_bound(fact.terms[n])][:1]
        arguments = {n: writer.alias("a") for n in further}
        tables = {n: f"proposition_argument AS {alias}" for n, alias in arguments.items()}
        selection.tables += [tables[n] for n in first]
        if writer.is_past and not writer.words.is_one_state:
            forks = writer.alias("f")
            selection.tables.append(f"{writer.forks()} AS {forks}")
            selection.where.append(f"{version}.fork = {forks}.value")
            selection.sorted[version] = "since"
        selection.tables.append(f"{writer.facts(True)} AS {version}")
        selection.tables += [tables[n] for n in further if n not in first]
        selection.where += writer.versions(version, fact.predicate)
        for position, alias in arguments.items():
            selection.where += writer.argument(alias, f"{version}.proposition_id", position)
        return columns + [f"{alias}.object_id" for alias in arguments.values()]

    def _past_facts(self, fact: r.HoldsFact) -> list[str]:
        """Join what held of a predicate."""
        writer, selection = self._writer, self._selection
        arity = len(fact.terms)
        bound = self._fewest_mentioned(fact)
        if bound is None or self._is_read(fact, *bound):
            alias = writer.alias("h")
            given = {
                n: writer.place(term, selection.places)
                for n, term in enumerate(fact.terms)
                if writer.is_given(term, self._outer)
            }
            selection.tables.append(f"{writer.past(fact.predicate, arity, given)} AS {alias}")
            # For a comparison that the relation makes already, planners expect a row or two.
            return [given.get(n, f"{alias}.c{n}") for n in range(arity)]
        if bound[1] < len(ARGUMENT_COLUMNS):
            return self._found_facts(fact)
        # What is bound finds few atoms, each of which is looked up at that time.
        _, first = bound
        order = [first, *(n for n in range(arity) if n != first)]
        aliases = {n: writer.alias("a") for n in order}
        atom = writer.alias("p")
        for n, alias in aliases.items():
            selection.tables.append(f"proposition_argument AS {alias}")
            selection.where += writer.argument(alias, f"{atom}.id", n)
        selection.tables.insert(len(selection.tables) - arity + 1, f"proposition AS {atom}")
        # As a sum it is not a condition of an index: without statistics PostgreSQL reads all of
        # the predicate's atoms for each one that it looks up by its id.
        selection.where += [
            *writer.atom(atom, fact.predicate, "predicate_id + 0"),
            writer.atom_holds(atom),
        ]
        return [f"{aliases[n]}.object_id" for n in range(arity)]

    def _fewest_mentioned(self, fact: r.HoldsFact) -> tuple[float, int] | None:
        """Return the bound term that finds facts with the fewest lookups, and its position."""
        writer = self._writer
        parameters = writer.definitions.predicates.live(fact.predicate).parameters
        found = [
            (writer.found_by(n, term, r.closure(writer.definitions, parameters[n].type_ids)), n)
            for n, term in enumerate(fact.terms)
            if self._is_bound(term)
        ]
        return min(found, default=None)

    def _is_read(self, fact: r.HoldsFact, mentioned: float, n: int) -> bool:
        """Return whether to join all that held of a predicate, and not to look up atoms."""
        # No index of it is made for what each row of an outer query asks again.
        writer, term = self._writer, fact.terms[n]
        is_known = isinstance(term, r.Known) or term in self._outer
        lookups = self._rows * mentioned / (writer.asked if is_known else 1)
        if n < len(ARGUMENT_COLUMNS) and writer.is_given(term, self._outer):
            # Those of one object are few: they are read once, and joined by hashes.
            return lookups > mentioned or writer.asked > 1
        return writer.is_read(fact.predicate, lookups)

    def _match(
        self,
        terms: Iterable[r.Place],
        columns: Iterable[str],
        parameters: Iterable[ParameterDefinition | None],
    ) -> None:
        """Bind the terms of a joined fact, or compare them with what they are bound to."""
        writer, selection = self._writer, self._selection
        for term, column, parameter in zip(terms, columns, parameters, strict=True):
            if isinstance(term, r.Slot) and term in self._unbound:
                have: tuple[r.TypeSet, ...] = ()
                if parameter is not None:
                    have = (r.closure(writer.definitions, parameter.type_ids),)
                self._bind(term, column, have)
            elif (place := writer.place(term, selection.places)) != column:
                selection.where.append(f"{column} = {place}")

    def _join_relation(self, fact: r.HoldsFact) -> None:
        writer, selection = self._writer, self._selection
        given = {n: term for n, term in enumerate(fact.terms) if writer.is_given(term, self._outer)}
        alias = writer.alias("r")
        selection.tables.append(f"{writer.relation(fact, given, selection.places)} AS {alias}")
        columns = [f"{alias}.c{n}" for n in range(len(fact.terms))]
        self._match(fact.terms, columns, self._derived_types(fact))

    def _derived_types(self, fact: r.HoldsFact) -> list[ParameterDefinition | None]:
        """Return the declared types that the rules of a predicate keep to."""
        # A use that is limited to the facts of the last round has the negated id.
        predicate, definitions = abs(fact.predicate), self._writer.definitions
        rules = self._writer.rules.of(predicate)
        found: list[ParameterDefinition | None] = []
        for n, declared in enumerate(definitions.predicates.live(predicate).parameters):
            have = r.closure(definitions, declared.type_ids)
            keep = have is not None and all(_fit(rule.parameters[n].types, have) for rule in rules)
            found.append(declared if keep else None)
        return found

    def _join_value(self, fact: r.FluentIs) -> None:
        """Join the versions of an object fluent, with its arguments and its value."""
        writer, selection = self._writer, self._selection
        function = writer.definitions.functions.live(fact.function)
        if all(self._is_bound(term) for term in fact.terms):
            places = selection.places
            table, where = writer.value_version(fact.function, fact.terms, places, is_joined=True)
            version = table.split()[-1]
            selection.tables.append(table)
            selection.where += where
        else:
            version = writer.alias("w")
            if writer.is_past:
                forks = writer.alias("f")
                selection.tables.append(f"{writer.words.each.format(':forks')} AS {forks}")
                selection.where.append(f"{version}.fork = {forks}.value")
            selection.tables.append(f"function_value_version AS {version}")
            selection.where += [
                f"{version}.kb_id = :kb",
                f"{version}.function_id = {writer.parameter(fact.function)}",
                writer.held(version),
            ]
            for position, term in enumerate(fact.terms):
                argument = writer.alias("a")
                selection.tables.append(f"function_value_argument AS {argument}")
                fluent = f"{version}.function_value_id"
                selection.where += writer.argument(argument, fluent, position, "function_value")
                parameter = function.parameters[position]
                self._match([term], [f"{argument}.object_id"], [parameter])
        value = ParameterDefinition("value", function.type_ids)
        self._match([fact.value], [f"{version}.object_id"], [value])

    def _next_choice(self) -> bool:
        """Join a disjunction that binds variables, as the union of its parts."""
        for choice in self._choices:
            slots = sorted(r.slots_of(choice), key=lambda slot: slot.number)
            if any(slot in self._unbound for slot in slots):
                self._choices.remove(choice)
                self._join_choice(choice, slots)
                return True
        return False

    def _join_choice(self, choice: r.OneOf, slots: list[r.Slot]) -> None:
        writer, selection = self._writer, self._selection
        # A table of FROM cannot refer to another one, so what those bind is a column, too.
        given = {
            slot: place
            for slot, place in selection.places.items()
            if slot in slots and place.startswith(":")
        }
        columns = [slot for slot in slots if slot not in given]
        bound = [r.Bound(slot, writer.types_of(slot)) for slot in columns]
        alias = writer.alias("u")
        with writer.asking(1):
            selection.tables.append(f"{writer.union(choice, bound, given)} AS {alias}")
        self._rows *= SOME
        for number, slot in enumerate(columns):
            column = f"{alias}.c{number}"
            if slot in self._unbound:
                self._bind(slot, column, self._unbound[slot])
            else:
                selection.where.append(f"{column} = {selection.places[slot]}")

    def _range(self, slot: r.Slot) -> None:
        """Join the objects of a variable that nothing else binds."""
        writer, selection = self._writer, self._selection
        version = writer.alias("o")
        types = self._unbound[slot]
        selection.tables.append(f"object_version AS {version}")
        selection.where += writer.objects(version, types)
        self._bind(slot, f"{version}.object_id", types)
        wanted = types or (None,)
        self._rows *= min(domain_size(writer.definitions, each) for each in wanted)


class JoinWriter(ConditionWriter):
    """Writes conditions with the joins within them."""

    @override
    def selection(
        self, parts: Iterable[r.Part], bound: Iterable[r.Bound], places: Places
    ) -> JoinedTables:
        return _Join(self, places).run(parts, bound)

    def rows(
        self,
        parts: Iterable[r.Part],
        bound: Iterable[r.Bound],
        places: Places,
        *,
        columns: Iterable[r.Place] | None = None,
        first: str = "",
    ) -> str:
        """Write the SELECT of the variables, or of other terms, as columns `c0` ...

        `first` is a table that the places refer to.
        """
        bound = tuple(bound)
        with self.asking(self.asked * SOME if first else self.asked):
            selection = self.selection(parts, bound, places)
        if first:
            selection.tables.insert(0, first)
        terms = [each.slot for each in bound] if columns is None else columns
        found = []
        for number, term in enumerate(terms):
            place = self.place(term, selection.places)
            # A parameter alone would have the driver's type.
            typed = f"CAST({place} AS BIGINT)" if place.startswith(":") else place
            found.append(f"{typed} AS c{number}")
        distinct = "" if selection.is_distinct else "DISTINCT "
        return selection.text(f"{distinct}{', '.join(found) or '1 AS present'}")

    def union(self, choice: r.OneOf, bound: Sequence[r.Bound], places: Places) -> str:
        """Write the relation of the variables for which one of some parts holds."""
        branches = [self.rows([part], bound, places) for part in choice.parts]
        return f"({' UNION '.join(branches)})"
