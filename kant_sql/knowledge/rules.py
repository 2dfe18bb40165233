"""The rules of derived predicates at one revision, their dependencies and strata.

A predicate that follows by a rule holds in the least model, stratum by stratum (Edelkamp and
Hoffmann, PDDL 2.2, 2004, section 2.1; Thiebaux, Hoffmann and Nebel, In Defense of PDDL Axioms,
2005). Stored facts of such a predicate hold, too.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from itertools import count
from typing import TypeVar

from ..dto.formulas import Derived
from ..errors import UNREADABLE, InvalidKnowledgeError, KantSqlError, unreadable
from .definitions import DERIVED_PREDICATE, Definitions, FormulaDefinition
from .formulas import TreeReader
from .resolved import AllOf, Bound, HoldsFact, Lacks, OneOf, Part, Resolver, Witness, check_levels

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True, slots=True)
class DerivationRule:
    """A rule: the parameters of the predicate, and the body that implies it."""

    parameters: tuple[Bound, ...]
    body: Part


class DerivationRules:
    """The rules of a state.

    Attributes:
        numbers: allocates unique numbers of variables.
        component: for each derived predicate, those that it depends on and that depend on it.
    """

    def __init__(self, definitions: Definitions, given: Iterable[Derived] | None = None) -> None:
        """Resolve the stored or given rules of a state."""
        self.numbers: Iterator[int] = count(1_000_000)
        self._rules: dict[int, list[DerivationRule]] = {}
        self._checked: set[int] = set()
        if given is None:
            for formula in definitions.formulas:
                if formula.section == DERIVED_PREDICATE:
                    self._read(definitions, formula)
        else:
            for node in given:
                self._add(definitions, node)
        self.component = {
            each: frozenset(component)
            for component in strong_components({each: self._uses(each) for each in self._rules})
            for each in component
        }

    def _read(self, definitions: Definitions, formula: FormulaDefinition) -> None:
        """Add a stored rule, whose rows may be damaged."""
        try:
            self._add(definitions, TreeReader(definitions, formula.tree).formula())
        except KantSqlError:
            raise
        except UNREADABLE as error:
            raise unreadable("formula_version", f"rule {formula.text!r}", error) from error

    def _add(self, definitions: Definitions, node: Derived) -> None:
        predicate = definitions.predicates.named(node.predicate)
        assert predicate is not None
        resolver = Resolver(definitions, self.numbers)
        rule = DerivationRule(resolver.variables(node.variables), resolver.part(node.formula))
        self._rules.setdefault(predicate.id, []).append(rule)

    @property
    def components(self) -> list[frozenset[int]]:
        """The groups of predicates that depend on each other, dependencies first."""
        return [*dict.fromkeys(self.component.values())]

    def replaced(self, of: Callable[[Part], Part]) -> DerivationRules:
        """Return rules with other bodies that use the same derived predicates."""
        found = copy(self)
        found._checked = set()
        found._rules = {
            predicate: [DerivationRule(rule.parameters, of(rule.body)) for rule in rules]
            for predicate, rules in self._rules.items()
        }
        return found

    def of(self, predicate: int) -> list[DerivationRule]:
        """Return the rules of a predicate; none if it is not derived."""
        return self._rules.get(predicate, [])

    def evaluated(self, predicate: int) -> list[DerivationRule]:
        """Return the rules of a predicate for evaluation; stored ones may have any depth."""
        rules = self.of(predicate)
        if predicate not in self._checked:
            for rule in rules:
                check_levels(rule.body)
            self._checked.add(predicate)
        return rules

    def is_recursive(self, predicate: int) -> bool:
        """Return whether a predicate depends on itself."""
        component = self.component.get(predicate, frozenset())
        return len(component) > 1 or predicate in self._uses(predicate)

    def _uses(self, predicate: int) -> list[int]:
        found = (used for rule in self.of(predicate) for used, _ in mentioned(rule.body))
        return [each for each in dict.fromkeys(found) if each in self._rules]

    def check_stratified(self, definitions: Definitions) -> None:
        """Refuse a predicate that depends on its own negation, naming it and the rule."""
        name = {each: definitions.predicates.live(each).name for each in self._rules}
        for predicate, component in self.component.items():
            for rule in self.of(predicate):
                for used, is_negative in mentioned(rule.body):
                    if is_negative and used in component:
                        others = sorted(name[each] for each in component - {predicate})
                        through = f", through {', '.join(others)}" if others else ""
                        raise InvalidKnowledgeError(
                            f"the rules of derived predicates are not stratified: a rule of "
                            f"{name[predicate]!r} negates {name[used]!r}, which depends on "
                            f"{name[predicate]!r} itself{through}; a negated predicate must be "
                            "derived without the predicate whose rule negates it"
                        )


def mentioned(body: Part) -> Iterator[tuple[int, bool]]:
    """Yield each predicate of a body, and whether it is below a negation."""
    stack: list[tuple[Part, bool]] = [(body, False)]
    while stack:
        part, is_negative = stack.pop()
        match part:
            case HoldsFact(predicate, _):
                yield predicate, is_negative
            case Lacks(inner):
                stack.append((inner, not is_negative))
            case Witness(_, inner):
                stack.append((inner, is_negative))
            case AllOf(parts) | OneOf(parts):
                stack += [(inner, is_negative) for inner in parts]


def strong_components(uses: Mapping[K, Iterable[K]]) -> list[list[K]]:
    """Return the strongly connected components, dependencies first (Tarjan, 1972)."""
    index: dict[K, int] = {}
    low: dict[K, int] = {}
    open_: list[K] = []
    found: list[list[K]] = []
    for start, first in uses.items():
        pending: list[tuple[K, Iterator[K]]] = []
        if start not in index:
            index[start] = low[start] = len(index)
            open_.append(start)
            pending.append((start, iter(first)))
        while pending:
            each, below = pending[-1]
            for used in below:
                if used not in index:
                    index[used] = low[used] = len(index)
                    open_.append(used)
                    pending.append((used, iter(uses[used])))
                    break
                if used in open_:
                    low[each] = min(low[each], index[used])
            else:
                pending.pop()
                if pending:
                    above = pending[-1][0]
                    low[above] = min(low[above], low[each])
                if low[each] == index[each]:
                    at = open_.index(each)
                    found.append(open_[at:])
                    del open_[at:]
    return found


def rules_of(definitions: Definitions) -> DerivationRules:
    """Return the rules of a state, cached with it."""
    return definitions.derive(DerivationRules)


def check_stratified(definitions: Definitions) -> None:
    """Refuse rules in which a predicate depends on its own negation."""
    rules_of(definitions).check_stratified(definitions)
