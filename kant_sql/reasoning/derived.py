"""Derived predicates of a world: the components of their rules, in the order of derivation.

The derived facts are the least fixpoint, stratum by stratum (Thiebaux, Hoffmann and Nebel, In
defense of PDDL axioms, Artificial Intelligence 168, 2005).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..knowledge.definitions import Definitions
from ..knowledge.reads import heads_of
from ..knowledge.resolved import Bound, HoldsFact, Part, closure
from ..knowledge.rules import DerivationRule, mentioned, rules_of
from ..pddl.document import Domain, Problem
from .evaluate import Compiler, alternatives
from .world import Relation, Row, World, definitions_of, fill


def world_of(definitions: Definitions) -> World:
    """Make a state without facts and values; refuse rules that are not stratified."""
    world, rules = World(definitions), rules_of(definitions)
    rules.check_stratified(definitions)
    for heads in rules.components:
        world.add_rules(Component(world, heads))
    return world


def read_world(domain: Domain, problem: Problem) -> World:
    """Read the initial state of a problem; raise as `world_of`."""
    world = world_of(definitions_of(domain, problem))
    fill(world, problem)
    return world


class Component:
    """The rules of derived predicates that depend on each other.

    Their facts are derived in rounds. A rule whose conjunction has recursive atoms takes one of
    these from the new facts of the last round (semi-naive evaluation); one with recursion further
    inside is evaluated as a whole.
    """

    def __init__(self, world: World, heads: frozenset[int]) -> None:
        rules = rules_of(world.definitions)
        self.heads = heads
        bodies = [rule.body for head in heads for rule in rules.of(head)]
        self.sources = heads_of(rules, *bodies) - {(True, head) for head in heads}
        self.is_fresh = False
        self._world = world
        self._new = {head: Relation() for head in heads}
        self._first: list[_Rule] = []
        self._again: list[_Rule] = []
        for head in heads:
            for rule in rules.of(head):
                self._compile(head, rule)

    def _compile(self, head: int, rule: DerivationRule) -> None:
        self._first.append(_Rule(self._world, head, rule))
        for _, parts in alternatives((), rule.body):
            recursive = [
                each for each in parts if isinstance(each, HoldsFact) and self._derives(each)
            ]
            inner = sum(used in self.heads for part in parts for used, _ in mentioned(part))
            if inner > len(recursive):
                self._again.append(_Rule(self._world, head, rule))
                continue
            for atom in recursive:
                delta = atom, self._new[atom.predicate]
                self._again.append(_Rule(self._world, head, rule, delta))

    def _derives(self, atom: HoldsFact) -> bool:
        return atom.predicate in self.heads and not atom.is_stored

    def refresh(self) -> None:
        """Derive the facts unless they are fresh."""
        if self.is_fresh:
            return
        # Rules read the facts derived so far.
        self.is_fresh = True
        world = self._world
        for head in self.heads:
            world.relation(head).clear()
            for row in world.relation(head, is_stored=True).rows:
                world.relation(head).add(row)
        found = self._round(self._first)
        while any(found.values()):
            for head, rows in found.items():
                self._new[head].clear()
                for row in rows:
                    world.relation(head).add(row)
                    self._new[head].add(row)
            found = self._round(self._again)

    def _round(self, rules: Sequence[_Rule]) -> dict[int, set[Row]]:
        found: dict[int, set[Row]] = {head: set() for head in self.heads}
        for rule in rules:
            known = self._world.relation(rule.head).rows
            found[rule.head].update(row for row in rule.rows() if row not in known)
        return found


class _Rule:
    """A rule, compiled as a search for the objects of its head."""

    def __init__(
        self,
        world: World,
        head: int,
        rule: DerivationRule,
        delta: tuple[Part, Relation] | None = None,
    ) -> None:
        self.head = head
        compiler = Compiler(world)
        bound = fitting(world.definitions, head, rule)
        self._search = compiler.search(bound, rule.body, delta)
        self._pick = compiler.picker([each.slot for each in bound])
        self._template = compiler.template

    def rows(self) -> Iterator[Row]:
        """Yield the facts that the rule derives, possibly more than once."""
        env = self._template.copy()
        for _ in self._search(env):
            yield self._pick(env)


def fitting(definitions: Definitions, head: int, rule: DerivationRule) -> tuple[Bound, ...]:
    """Return the parameters of a rule; their objects also fit those of its predicate."""
    declared = definitions.predicates.live(head).parameters
    return tuple(
        Bound(each.slot, (*each.types, closure(definitions, parameter.type_ids)))
        for each, parameter in zip(rule.parameters, declared, strict=True)
    )
