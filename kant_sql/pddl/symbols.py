"""What the names in a domain and a problem refer to, and which arguments fit which parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain
from typing import NamedTuple

from ..dto.formula import Constant, Formula, Preference, Term, TypedName, Variable
from ..dto.name import ROOT_TYPE, fold, is_name
from ..dto.node import walk
from .cursor import Steps
from .document import Domain
from .hierarchy import Ancestry, Fit, Types
from .signatures import Named, Signature

# What a term is, and the types of what it denotes.
Entity = tuple[Term, Types]
ANY: Types = (ROOT_TYPE,)


class Bound(NamedTuple):
    """A variable that is bound.

    Attributes:
        declared: the variable with its types.
        key: its folded name, with its question mark.
        entity: what it is in a formula.
    """

    declared: TypedName
    key: str
    entity: Entity


# What a word behind a parenthesis begins: an atom, or what a reader's method reads.
Head = Signature | Callable[..., Formula | Steps[Formula]]


class Symbols:
    """The names that formulas may use.

    Attributes:
        unknown_domain: whether names are taken for what their place asks for, since there is no
            domain to look them up in.
        grows: whether types that are not declared are added: those of a domain that is being read.
        types: the types: their names by folded names.
        resolved: lists of types in the spellings that were met, and in the declared spelling.
        parents: the types above each type, by its name.
        predicates: the predicates.
        functions: the functions.
        objects: constants and objects, by the spellings that were met.
        preferences: the names of the preferences that were read, by folded names.
        heads: what begins a formula, by the spellings that were met: a predicate, or an operator.
        effect_heads: the same of effects.
    """

    def __init__(self, unknown_domain: bool = False) -> None:
        self.unknown_domain = unknown_domain
        self.grows = False
        self.types: dict[str, str] = {ROOT_TYPE: ROOT_TYPE}
        self.resolved: dict[Types, Types] = {}
        self.parents: dict[str, Types] = {}
        self.predicates = Named("predicate")
        self.functions = Named("function")
        self.objects: dict[str, Entity] = {}
        self.preferences: dict[str, str] = {}
        self._domain: Domain | None = None
        self.heads: dict[str, Head] = {}
        self.effect_heads: dict[str, Head] = {}
        self._bound: dict[tuple[str, Types], Bound] = {}
        self._declared_objects: dict[str, Entity] = {}
        self._fits: dict[tuple[Types, Types], Fit] = {}
        self._ancestry: Ancestry[str] = Ancestry(lambda type_: self.parents.get(type_, ()))

    @classmethod
    def of_domain(cls, domain: Domain) -> Symbols:
        """Give the names that a domain declares.

        Args:
            domain: the domain.

        Returns:
            Its names; what is added to them does not change the domain.
        """
        symbols = cls()
        symbols._domain = domain
        symbols.add_types(domain.types)
        for constant in domain.constants:
            symbols.add_object(constant)
        for predicate in domain.predicates:
            symbols.predicates.declare(predicate)
        for function in domain.functions:
            symbols.functions.declare(function)
        return symbols

    def add_types(self, types: Iterable[TypedName]) -> None:
        """Declare types.

        Args:
            types: the types, with those above them in their declared spelling.
        """
        for type_ in types:
            self.types[fold(type_.name)] = type_.name
            self.parents[type_.name] = type_.types

    def add_object(self, item: TypedName) -> None:
        """Declare a constant or an object.

        Args:
            item: it, with its types in their declared spelling.
        """
        entity = (Constant(item.name), item.types)
        self._declared_objects[fold(item.name)] = entity
        self.objects[item.name] = entity

    def bound(self, word: str, types: Types) -> Bound:
        """Give a variable that is bound.

        Args:
            word: its name, with its question mark.
            types: its types.

        Returns:
            The variable: the same for the same arguments, since domains repeat them.
        """
        found = self._bound.get((word, types))
        if found is None:
            name = word[1:]
            entity = (Variable(name), types)
            found = Bound(TypedName(name, types), fold(word), entity)
            self._bound[word, types] = found
        return found

    def preference(self, name: str) -> str | None:
        """Look up a preference.

        Args:
            name: its name, in any spelling.

        Returns:
            Its name, as in the first preference of that name; None when there is none.
        """
        found = self.preferences.get(fold(name))
        if found is None and self._domain is not None:
            conditions = [action.condition for action in self._domain.actions]
            nodes = walk(*chain(self._domain.constraints, *conditions))
            # Only metrics ask for it, so the preferences of a domain are not looked for before.
            self._domain = None
            for node in nodes:
                if isinstance(node, Preference) and node.name is not None:
                    self.preferences.setdefault(fold(node.name), node.name)
            return self.preferences.get(fold(name))
        return found

    def object(self, name: str) -> Entity | None:
        """Look up a constant or an object.

        Args:
            name: its name, in any spelling.

        Returns:
            It and its types; None when it is not declared.
        """
        found = self.objects.get(name)
        if found is None:
            found = self._declared_objects.get(fold(name))
            if found is None and self.unknown_domain and is_name(name, "object"):
                found = self._declared_objects[fold(name)] = (Constant(name), ANY)
            if found is not None:
                self.objects[name] = found
        return found

    def is_object(self, name: str) -> bool:
        """Tell whether a constant or an object is declared.

        Args:
            name: its name, in any spelling.

        Returns:
            Whether it is.
        """
        return name in self.objects or fold(name) in self._declared_objects

    def type_names(self) -> list[str]:
        """Give the names of types, as declared.

        Returns:
            The names, `object` first.
        """
        return list(self.types.values())

    def object_names(self) -> list[str]:
        """Give the names of constants and objects, as declared.

        Returns:
            The names.
        """
        return [str(term) for term, _ in self._declared_objects.values()]

    def fit(self, given: Types, wanted: Types) -> Fit:
        """Tell whether an argument fits a parameter.

        Args:
            given: the argument's types: it is of one of them.
            wanted: the parameter's types.

        Returns:
            `Fit.YES` when one of the argument's types is one of the parameter's or below it,
            `Fit.PERHAPS` when one is above, else `Fit.NO`.
        """
        found = self._fits.get((given, wanted))
        if found is None:
            found = Fit.NO
            if ROOT_TYPE in wanted or self._is_below(given, wanted):
                found = Fit.YES
            elif ROOT_TYPE in given or self._is_below(wanted, given):
                found = Fit.PERHAPS
            self._fits[given, wanted] = found
        return found

    def _is_below(self, lower: Types, upper: Types) -> bool:
        """Tell whether one of some types is one of others, or below it."""
        is_below = self._ancestry.is_below
        if not set(lower).isdisjoint(upper):
            return True
        return any(is_below(one, other) for one in lower for other in upper)
