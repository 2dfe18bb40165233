"""The types of a domain as a hierarchy of unified-planning, where a type has one father at most."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import TYPE_CHECKING

from ..dto.formula import Exists, Forall, TypedName
from ..dto.name import ROOT_TYPE, fold
from ..dto.node import walk
from ..errors import UnsupportedConstructError
from ..pddl.document import Domain, Problem
from .names import TYPE, Names

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Type


class Types:
    """The hierarchy of types.

    `object` is a type of unified-planning only where the documents need it: otherwise the types
    without a supertype stay roots, as unified-planning's own reader has it.
    """

    def __init__(
        self, domain: Domain, problem: Problem, names: Names, environment: Environment
    ) -> None:
        """Build the hierarchy.

        Args:
            domain: the domain.
            problem: the problem.
            names: what the types are called.
            environment: unified-planning's environment.

        Raises:
            UnsupportedConstructError: a type has several supertypes, none above the others.
        """
        self._names, self._manager = names, environment.type_manager
        self._spelling = {ROOT_TYPE: ROOT_TYPE}
        self._above: dict[str, tuple[str, ...]] = {ROOT_TYPE: ()}
        self._declared = [key for part in domain.types if (key := fold(part.name)) != ROOT_TYPE]
        for part in domain.types:
            self._spelling[fold(part.name)] = part.name
            self._above[fold(part.name)] = tuple(map(fold, part.types))
        self._above[ROOT_TYPE] = ()
        used = list(_typed_names(domain, problem))
        for name in chain.from_iterable(part.types for part in (*domain.types, *used)):
            self._spelling.setdefault(fold(name), name)
            self._above.setdefault(fold(name), (ROOT_TYPE,))
        self._father = {key: self._only_father(key) for key in self._above}
        self._rooted = any(self._widest(part.types) == ROOT_TYPE for part in used)
        self._types: dict[str, Type] = {}

    def all(self) -> list[Type]:
        """Give the types that the domain declares.

        Returns:
            Each in the order of the declarations.
        """
        return [self._type(key) for key in self._declared]

    def widest(self, types: Iterable[str]) -> Type:
        """Give the narrowest type that all of some types fit.

        Args:
            types: their names.

        Returns:
            The type; for a single one, that type.
        """
        return self._type(self._widest(types))

    def branches(self, types: Iterable[str]) -> list[Type]:
        """Give types that an `either` is made of, such that no object is of two of them.

        Args:
            types: the names that the `either` lists.

        Returns:
            The types; what is below another is left out.
        """
        keys = list(dict.fromkeys(map(fold, types)))
        kept = [key for key in keys if not set(self._ancestors(key)[1:]) & set(keys)]
        return [self._type(key) for key in kept]

    def _type(self, key: str) -> Type:
        if key not in self._types:
            father = self._father[key]
            above = None
            if father is not None and (father != ROOT_TYPE or self._rooted):
                above = self._type(father)
            name = self._names.of(TYPE, self._spelling[key])
            self._types[key] = self._manager.UserType(name, above)
        return self._types[key]

    def _widest(self, types: Iterable[str]) -> str:
        chains = [self._ancestors(fold(name)) for name in types]
        return next(key for key in chains[0] if all(key in chain for chain in chains))

    def _ancestors(self, key: str) -> list[str]:
        found = [key]
        for above in found:
            found.extend(name for name in self._above[above] if name not in found)
        if ROOT_TYPE in found:
            found.remove(ROOT_TYPE)
        return [*found, ROOT_TYPE]

    def _only_father(self, key: str) -> str | None:
        above = [name for name in dict.fromkeys(self._above[key]) if name != key]
        near = [
            name for name in above if not any(name in self._ancestors(other)[1:] for other in above)
        ]
        if len(near) > 1:
            shown = " and ".join(self._spelling[name] for name in near)
            raise UnsupportedConstructError(
                f"unified-planning cannot express type {self._spelling[key]}: it has the "
                f"supertypes {shown}, where one is possible; give it one supertype"
            )
        return near[0] if near else None


def _typed_names(domain: Domain, problem: Problem) -> Iterator[TypedName]:
    yield from (*domain.constants, *problem.objects)
    for predicate in domain.predicates:
        yield from predicate.parameters
    for function in domain.functions:
        yield from function.parameters
        if function.types:
            yield TypedName(function.name, function.types)
    nodes = [*domain.constraints, *problem.goal, *problem.constraints]
    for rule in domain.derived:
        yield from rule.variables
        nodes.append(rule.formula)
    for action in domain.actions:
        yield from action.parameters
        nodes.extend((*action.condition, *action.effect))
    for node in walk(*nodes):
        if isinstance(node, Forall | Exists):
            yield from node.variables
