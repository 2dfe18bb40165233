"""Predicates and functions by their names, with what readers need to know of their arguments."""

from __future__ import annotations

from ..dto.formula import Atom
from ..dto.name import fold
from .document import Function, Predicate
from .hierarchy import Types


class Signature:
    """What a predicate or a function is applied to, as readers need it.

    Attributes:
        name: its name, as declared.
        parameters: the types of its parameters; None when nothing is known of them.
        accepted: for each parameter, its types, and those of arguments that are known to fit.
        types: the types of a function's values; none for numbers, and for a predicate.
        bare: the predicate without arguments.
    """

    __slots__ = ("accepted", "bare", "name", "parameters", "types")

    def __init__(self, name: str, parameters: tuple[Types, ...] | None, types: Types = ()) -> None:
        self.name = name
        self.parameters = parameters
        self.accepted: tuple[tuple[Types, set[Types]], ...] = tuple(
            [(wanted, {wanted}) for wanted in parameters or ()]
        )
        self.types = types
        self.bare = Atom(name)


class Named:
    """The predicates, or the functions, by their names.

    Args:
        kind: what they are, for messages.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._declared: dict[str, Predicate | Function] = {}
        self._found: dict[str, Signature] = {}

    def declare(self, element: Predicate | Function) -> None:
        """Declare one.

        Args:
            element: the predicate or function.
        """
        self._declared[fold(element.name)] = element

    def add(self, signature: Signature) -> None:
        """Add one that is not declared.

        Args:
            signature: what its name stands for.
        """
        self._found[signature.name] = self._found[fold(signature.name)] = signature

    def find(self, name: str) -> Signature | None:
        """Look up a name.

        Args:
            name: the name, in any spelling.

        Returns:
            What it stands for; None when it is not known.
        """
        found = self._found.get(name)
        if found is None:
            key = fold(name)
            found = self._found.get(key)
            if found is None:
                element = self._declared.get(key)
                if element is None:
                    return None
                types = element.types if isinstance(element, Function) else ()
                parameters = tuple([parameter.types for parameter in element.parameters])
                found = self._found[key] = Signature(element.name, parameters, types)
            self._found[name] = found
        return found

    def names(self) -> list[str]:
        """Give the names.

        Returns:
            The names, as declared, and then those that were added.
        """
        names = {key: element.name for key, element in self._declared.items()}
        names |= {fold(one.name): one.name for one in self._found.values()}
        return list(names.values())

    def longest(self) -> int:
        """Give the number of parameters of the one that has most.

        Returns:
            The number.
        """
        return max((len(one.parameters) for one in self._declared.values()), default=0)
