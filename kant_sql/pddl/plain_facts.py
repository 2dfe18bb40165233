"""What the tight loop over an initial state knows: dictionaries that fill when something is met."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Final

from ..dto.formula import Constant, Number
from .hierarchy import Fit, Types
from .signatures import Named
from .symbols import ANY, Symbols

# Of predicates that no domain declares.
MAX_ARITY: Final = 32
_NO_NAME: Final = frozenset({"(", ")", "?", ""})
_PLAIN_NUMBER = re.compile(r"-?[0-9]{1,50}(\.[0-9]{1,50})?")


class NotPlainError(Exception):
    """A token is not what the tight loop knows."""


class _Fitting(dict[str, Constant]):
    """The objects that fit a parameter, by their declared spelling; looked up when first met."""

    def __init__(self, symbols: Symbols, wanted: Types) -> None:
        super().__init__()
        self._symbols = symbols
        self._wanted = wanted

    def __missing__(self, token: str) -> Constant:
        if token[:1] in _NO_NAME:
            raise NotPlainError
        entity = self._symbols.object(token)
        if entity is None or self._symbols.fit(entity[1], self._wanted) is not Fit.YES:
            raise NotPlainError
        constant = entity[0]
        if not isinstance(constant, Constant) or constant.name != token:
            raise NotPlainError
        self[token] = constant
        return constant


class _Numbers(dict[str, Number]):
    """Numbers in standard spelling, by their text."""

    def __missing__(self, token: str) -> Number:
        if _PLAIN_NUMBER.fullmatch(token) is None:
            raise NotPlainError
        number = self[token] = Number(Decimal(token))
        return number


class Plain:
    """A predicate or a function, as the tight loop needs it.

    Attributes:
        name: its name.
        arity: how many arguments it has.
        fitting: for each parameter, the objects that fit.
        value: for a function, the numbers or objects that it may have as value.
        facts: the arguments of which it holds, in their declared spelling.
        values: which of all values it has, by its arguments, in their declared spelling.
    """

    __slots__ = ("arity", "facts", "fitting", "name", "value", "values")

    def __init__(self, name: str, fitting: list[_Fitting], value: _Fitting | _Numbers) -> None:
        self.name = name
        self.arity = len(fitting)
        self.fitting = fitting
        self.value = value
        self.facts: set[tuple[str, ...]] = set()
        self.values: dict[tuple[str, ...], int] = {}


class Entries(dict[str, Plain | None]):
    """Predicates, or functions, in the spellings that were met; None for all other words."""

    def __init__(self, symbols: Symbols, named: Named) -> None:
        super().__init__()
        self._symbols = symbols
        self._named = named
        self._fitting: dict[Types, _Fitting] = {}
        self._numbers = _Numbers()
        self.update(dict.fromkeys(("=", "not")))

    def __missing__(self, word: str) -> Plain | None:
        signature = self._named.find(word)
        if signature is None:
            return None
        entry = self.get(signature.name)
        if entry is None:
            fitting = [self._fits(wanted) for wanted in signature.parameters or ()]
            value = self._fits(signature.types) if signature.types else self._numbers
            entry = self[signature.name] = Plain(signature.name, fitting, value)
        self[word] = entry
        return entry

    def _fits(self, wanted: Types) -> _Fitting:
        return self._fitting.setdefault(wanted, _Fitting(self._symbols, wanted))

    def slow(self, name: str, arity: int) -> Plain:
        """Give the entry of what was read slowly.

        Args:
            name: the name, as declared.
            arity: how many arguments there were; others are likely to have as many.

        Returns:
            The entry.
        """
        entry = self[name]
        assert entry is not None
        if self._symbols.unknown_domain and entry.arity != arity <= MAX_ARITY:
            entry.arity, entry.fitting = arity, [self._fits(ANY)] * arity
        return entry
