"""Derived predicates of a world: components of rules, in the order in which they are derived."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..dto import formulas as f
from ..errors import InvalidKnowledgeError
from ..knowledge.rules import strong_components
from ..pddl.document import Domain, Problem
from ..pddl.symbols import ANY
from .conditions import Compiler
from .junctions import alternatives, junction
from .relations import Relation, Row, picker
from .world import World


def read_world(domain: Domain, problem: Problem) -> World:
    """Read the initial state of a problem.

    Args:
        domain: the domain.
        problem: the problem.

    Returns:
        The state.

    Raises:
        InvalidKnowledgeError: the derived predicates cannot be stratified.
    """
    world = World(domain, problem)
    uses = {rule.predicate: dict[str, bool]() for rule in domain.derived}
    for rule in domain.derived:
        for name, negated in used_by(rule.formula):
            known = uses[rule.predicate]
            known[name] = known.get(name, False) or negated
    below: dict[str, frozenset[str]] = {}
    for heads in strata(uses):
        found = {name for head in heads for name in uses[head]}
        sources = found.union(*(below.get(name, ()) for name in found))
        below.update(dict.fromkeys(heads, frozenset(sources)))
        rules = [rule for rule in domain.derived if rule.predicate in heads]
        world.add_rules(Component(world, rules, heads, frozenset(sources - set(heads))))
    return world


def used_by(formula: f.Formula) -> Iterator[tuple[str, bool]]:
    """Yield the predicates and functions of a formula, and whether each is negated there."""
    stack: list[tuple[f.Node, bool]] = [(formula, False)]
    while stack:
        part, negated = stack.pop()
        if isinstance(part, f.Atom):
            yield part.predicate, negated
        elif isinstance(part, f.Fluent):
            yield part.function, False
        inner = junction(part, negated)
        if inner is not None:
            stack.extend(inner[0])
        else:
            stack.extend((child, negated) for child in f.children(part))


def strata(uses: dict[str, dict[str, bool]]) -> list[tuple[str, ...]]:
    """Order derived predicates; those that depend on each other stand together.

    Args:
        uses: what each uses, and whether in a negation.

    Raises:
        InvalidKnowledgeError: one depends on its own negation.
    """
    found: list[tuple[str, ...]] = []
    derived = {name: [one for one in used if one in uses] for name, used in uses.items()}
    for component in strong_components(derived):
        together = set(component)
        for name in component:
            for used, negated in uses[name].items():
                if negated and used in together:
                    raise InvalidKnowledgeError(
                        f"the derived predicate {name} depends on its own negation, through "
                        f"(not ({used} ...)); rules must be stratified: derive {used} without "
                        f"{name}, or leave the negation out"
                    )
        found.append(tuple(component))
    return found


class Component:
    """The rules of derived predicates that depend on each other.

    Their facts are derived in rounds. A rule whose conjunction has recursive atoms takes one of
    them from the new facts of the last round (semi-naive evaluation); one with recursion further
    inside is evaluated as a whole.
    """

    def __init__(
        self,
        world: World,
        rules: Sequence[f.Derived],
        heads: tuple[str, ...],
        sources: frozenset[str],
    ) -> None:
        self.heads, self.sources = heads, sources
        self.is_fresh = False
        self._world = world
        self._new = {head: Relation() for head in heads}
        self._first: list[_Rule] = []
        self._again: list[_Rule] = []
        for rule in rules:
            self._compile(rule)

    def _compile(self, rule: f.Derived) -> None:
        self._first.append(_Rule(self._world, rule, None))
        for parts in alternatives([(rule.formula, False)]):
            recursive = [
                atom
                for atom, negated in parts
                if isinstance(atom, f.Atom) and not negated and self._is_plain(atom)
            ]
            inner = [name for part, _ in parts for name, _ in used_by(part) if name in self.heads]
            if len(inner) > len(recursive):
                self._again.append(_Rule(self._world, rule, None))
                continue
            for atom in recursive:
                delta = atom, self._new[atom.predicate]
                self._again.append(_Rule(self._world, rule, delta))

    def _is_plain(self, atom: f.Atom) -> bool:
        terms = atom.terms
        return atom.predicate in self.heads and not any(isinstance(one, f.Fluent) for one in terms)

    def refresh(self) -> None:
        """Derive the facts unless they are fresh."""
        if self.is_fresh:
            return
        # Rules read the facts that are derived so far.
        self.is_fresh = True
        world = self._world
        for head in self.heads:
            world.relation(head).clear()
            for row in world.stored(head):
                world.relation(head).add(row)
        found = self._round(self._first)
        while any(found.values()):
            for head, rows in found.items():
                self._new[head].clear()
                for row in rows:
                    world.relation(head).add(row)
                    self._new[head].add(row)
            found = self._round(self._again)

    def _round(self, rules: Sequence[_Rule]) -> dict[str, set[Row]]:
        found: dict[str, set[Row]] = {head: set() for head in self.heads}
        for rule in rules:
            known = self._world.relation(rule.head).rows
            found[rule.head].update(row for row in rule.rows() if row not in known)
        return found


class _Rule:
    """A rule, compiled as a search for the objects of its head."""

    def __init__(
        self, world: World, rule: f.Derived, delta: tuple[f.Atom, Relation] | None
    ) -> None:
        self.head = rule.predicate
        compiler = Compiler(world, ())
        # A variable without a type has that of the parameter.
        variables = [
            f.TypedName(one.name, types if one.types == ANY else one.types)
            for one, types in zip(rule.variables, world.parameters(self.head), strict=True)
        ]
        self._search, slots = compiler.open_search(variables, [(rule.formula, False)], delta)
        self._pick = picker(slots)
        self._kinds = [
            (at, world.members(types))
            for at, types in enumerate(world.parameters(self.head))
            if variables[at].types != types
        ]
        self._template = compiler.template

    def rows(self) -> Iterator[Row]:
        """Yield the facts that the rule derives, perhaps repeatedly."""
        env = self._template.copy()
        for _ in self._search(env):
            row = self._pick(env)
            if all(row[at] in members for at, members in self._kinds):
                yield row
