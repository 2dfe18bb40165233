"""A state of a PDDL world in memory, which conditions are evaluated in and effects change.

- Quantifiers range over the objects, constants included, whose type is one of the variable's types
  or a subtype of it.
- A fluent without a value makes the atom, the equality or the comparison around it false, as in
  VAL; so does a division by zero. Negation is classical: `(not (< (f) 3))` holds then.
- Conditions and effects calculate exactly; what an effect writes has an end.
- A derived predicate holds of what its rules derive, and of the facts that the state has of it: the
  least fixpoint, stratum by stratum (Thiebaux, Hoffmann and Nebel, In defense of PDDL axioms,
  Artificial Intelligence 168, 2005).
- While numbers change continuously, the state is that at `elapsed` since the change began.

Names are those of the documents, in their spelling.
"""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Protocol

from ..dto import formulas as f
from ..dto.lexical import fold
from ..pddl.document import Action, Domain, Problem
from ..pddl.hierarchy import Ancestry, Types
from ..pddl.symbols import ANY
from .arithmetic import Linear, decimal_of
from .relations import Relation, Row

# A fluent: its function, and the names of its objects.
FluentRow = tuple[str, Row]


class Rules(Protocol):
    """The rules of derived predicates that depend on each other.

    Attributes:
        heads: the predicates that they derive.
        sources: the predicates and functions that their facts depend on.
        is_fresh: whether the derived facts are those of the present state.
    """

    heads: tuple[str, ...]
    sources: frozenset[str]
    is_fresh: bool

    def refresh(self) -> None:
        """Derive the facts unless they are fresh."""


class World:
    """The objects, facts and values of one state.

    Attributes:
        domain: the domain.
        problem: the problem.
        elapsed: the time since `rates` began to hold.
        rates: the continuous change of each fluent in a unit of time.
        roots: the times at which comparisons change their value, collected while numbers change.
        total_time: what `total-time` in a metric stands for.
        violations: the number of violations of each preference, by folded name.
    """

    def __init__(self, domain: Domain, problem: Problem) -> None:
        """Read the initial state of a problem; `derived.read_world` adds the rules."""
        self.domain, self.problem = domain, problem
        self.rates: dict[FluentRow, Fraction] = {}
        self.elapsed = Fraction(0)
        self.roots: set[Fraction] = set()
        self.total_time = Decimal(0)
        self.violations: dict[str, int] = {}
        self._parents = {one.name: one.types for one in domain.types}
        self._ancestry: Ancestry[str] = Ancestry(lambda type_: self._parents.get(type_, ()))
        self.objects = {one.name: one.types for one in (*domain.constants, *problem.objects)}
        self._names = {fold(name): name for name in self.objects}
        self._ranges: dict[Types, tuple[str, ...]] = {}
        self._members: dict[Types, frozenset[str]] = {}
        self._relations = {one.name: Relation() for one in domain.predicates}
        self._tables: dict[str, dict[Row, Decimal | str]] = {
            one.name: {} for one in domain.functions
        }
        self._actions = {fold(one.name): one for one in domain.actions}
        self._functions = {fold(one.name) for one in domain.functions}
        self._of_objects = {one.name for one in domain.functions if one.types}
        self._parameters = {
            one.name: tuple([parameter.types for parameter in one.parameters])
            for one in domain.predicates
        }
        self._rules: dict[str, Rules] = {}
        # The facts of derived predicates that hold without a rule.
        self._stored: dict[str, Relation] = {}
        self._dependants: dict[str, list[Rules]] = {}
        for atom in problem.facts:
            self.relation(atom.predicate).add(tuple([str(term) for term in atom.terms]))
        for fluent, value in problem.values:
            table = self.table(fluent.function)
            row = tuple([str(term) for term in fluent.terms])
            table[row] = value.value if isinstance(value, f.Number) else value.name
        for function in domain.functions:
            if fold(function.name) == f.TOTAL_COST and not (function.parameters or function.types):
                # Action costs count from 0 (IPC 2008), whether the problem says so or not.
                self.table(function.name).setdefault((), Decimal(0))

    def add_rules(self, rules: Rules) -> None:
        """Derive the facts of some predicates by rules."""
        self._rules.update(dict.fromkeys(rules.heads, rules))
        for name in rules.heads:
            self._stored[name] = Relation(self.relation(name).rows)
        for name in rules.sources:
            self._dependants.setdefault(name, []).append(rules)

    # Names and types.

    def object(self, name: str) -> str | None:
        """Return the declared spelling of an object's name, or None."""
        return name if name in self.objects else self._names.get(fold(name))

    def action(self, name: str) -> Action | None:
        """Look up an action."""
        return self._actions.get(fold(name))

    def fits(self, types: Types, wanted: Types) -> bool:
        """Return whether an object of some types is of one of others."""
        if ANY[0] in wanted:
            return True
        is_below = self._ancestry.is_below
        return any(is_below(one, other) for one in types for other in wanted)

    def range(self, types: Types) -> tuple[str, ...]:
        """Return the objects of some types, as declared."""
        found = self._ranges.get(types)
        if found is None:
            fitting = {own for own in set(self.objects.values()) if self.fits(own, types)}
            found = tuple([name for name, own in self.objects.items() if own in fitting])
            self._ranges[types] = found
        return found

    def members(self, types: Types) -> frozenset[str]:
        """Return the objects of some types as a set."""
        found = self._members.get(types)
        if found is None:
            found = self._members[types] = frozenset(self.range(types))
        return found

    def range_of(self, variable: f.TypedName) -> tuple[str, ...]:
        """Return the objects of a variable's types."""
        return self.range(variable.types)

    def parameters(self, predicate: str) -> tuple[Types, ...]:
        """Return the types of a predicate's parameters."""
        return self._parameters[predicate]

    def always_fits(self, predicate: str, position: int, wanted: Types) -> bool:
        """Return whether any argument of a predicate at a position is of some types."""
        declared = self._parameters.get(predicate, ())[position : position + 1]
        return any(
            all(any(self.fits((one,), (other,)) for other in wanted) for one in types)
            for types in declared
        )

    # Facts and values.

    def relation(self, predicate: str) -> Relation:
        """Return the facts of a predicate, which may be behind for a derived one."""
        found = self._relations.get(predicate)
        if found is None:
            found = self._relations[predicate] = Relation()
        return found

    def stored(self, predicate: str) -> set[Row]:
        """Return the facts of a predicate that hold without a rule."""
        return self._own(predicate).rows

    def _own(self, predicate: str) -> Relation:
        return self._stored.get(predicate) or self.relation(predicate)

    def rules(self, predicate: str) -> Rules | None:
        """Return the rules of a derived predicate."""
        return self._rules.get(predicate)

    def table(self, function: str) -> dict[Row, Decimal | str]:
        """Return the values of a function."""
        return self._tables.setdefault(function, {})

    def is_declared_function(self, name: str) -> bool:
        """Return whether the domain declares a function."""
        return fold(name) in self._functions

    def is_numeric(self, function: str) -> bool:
        """Return whether the values of a function are numbers."""
        return function not in self._of_objects

    def has(self, predicate: str, row: Row) -> bool:
        """Return whether a fact holds, derived ones included."""
        rules = self._rules.get(predicate)
        if rules is not None:
            rules.refresh()
        return row in self.relation(predicate).rows

    def add(self, predicate: str, row: Row) -> bool:
        """Add a fact; return False if it holds already."""
        added = self._own(predicate).add(row)
        if added:
            self.touch(predicate)
        return added

    def remove(self, predicate: str, row: Row) -> bool:
        """Remove a fact; return False if it does not hold."""
        removed = self._own(predicate).discard(row)
        if removed:
            self.touch(predicate)
        return removed

    def set(self, function: str, row: Row, value: Decimal | str | None) -> None:
        """Set or, with None, remove the value of a fluent."""
        if value is None:
            self.table(function).pop(row, None)
        else:
            self.table(function)[row] = value
        self.touch(function)

    def touch(self, name: str) -> None:
        """Note that the facts of a predicate, or the values of a function, have changed."""
        own = self._rules.get(name)
        if own is not None:
            own.is_fresh = False
        for rules in self._dependants.get(name, ()):
            rules.is_fresh = False

    def facts(self) -> frozenset[tuple[str, Row]]:
        """Return the facts that hold without a rule."""
        return frozenset((name, row) for name in self._relations for row in self.stored(name))

    def values(self) -> dict[FluentRow, Decimal | str]:
        """Return the values of all fluents."""
        tables = self._tables.items()
        return {(name, row): value for name, table in tables for row, value in table.items()}

    # Continuous change.

    def move(self, elapsed: Fraction) -> None:
        """Go to another time since the continuous change began."""
        self.elapsed = elapsed
        for function, _ in self.rates:
            self.touch(function)

    def value_now(self, function: str, row: Row) -> Decimal | None:
        """Return the number of a fluent, moved to the time that elapsed."""
        linear = self.linear(function, row)
        return None if linear is None else decimal_of(linear.at(self.elapsed))

    def linear(self, function: str, row: Row) -> Linear | None:
        """Return the value of a fluent as a function of the time since the change began."""
        value = self.table(function).get(row)
        if not isinstance(value, Decimal):
            return None
        return Linear(Fraction(value), self.rates.get((function, row), Fraction(0)))
