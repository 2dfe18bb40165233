"""What a caller gives as PDDL text, or as nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from ..arguments import refuse_many, shown
from ..dto.formulas import MODALS, Node
from ..dto.lexical import NUMBER, RESERVED, ROOT_TYPE, fold, is_word
from ..errors import InvalidKnowledgeError, PddlError
from ..knowledge.symbols import symbols_of
from ..pddl.lexer import tokenize
from ..pddl.symbols import SymbolTable
from ..store.transaction import Transaction

T = TypeVar("T")

# The kinds of definitions that formulas name.
_NAMED = ("predicate", "object", "function", "type")
_KEYWORDS = frozenset({ROOT_TYPE, "preference", *MODALS}).union(*RESERVED.values())


def expect_text(given: object, what: str, article: str, example: str, *also: type) -> None:
    """Refuse what is neither text, nor a node, nor of another class that is taken."""
    refuse_many(given)
    if not isinstance(given, (str, Node, *also)):
        raise InvalidKnowledgeError(
            f"{what} takes {article}, for example '{example}', not {type(given).__name__}: "
            f"{shown(given)}"
        )


class TextReader:
    """Reads what is given as text, with the names of a transaction as it is now."""

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        self._symbols: SymbolTable | None = None

    def read(self, read: Callable[..., T], given: str | Node, *, needs_names: bool = True) -> T:
        """Read it with one of the functions of `pddl.given`, most of which need known names."""
        if not needs_names:
            return read(str(given))
        if self._symbols is None:
            self._symbols = symbols_of(self._transaction.definitions)
        return read(str(given), symbols=self._symbols)

    def read_stored(
        self, read: Callable[..., T], given: str | Node, *, needs_names: bool = True
    ) -> T | None:
        """Read what may be stored; None if it names something that holds no more.

        Raises:
            PddlError: the text is wrong, or it names an element that never existed.
        """
        try:
            return self.read(read, given, needs_names=needs_names)
        except PddlError:
            if self._names_what_was(str(given)):
                return None
            raise

    def _names_what_was(self, text: str) -> bool:
        """Return whether a text names something that is gone, and nothing that never was."""
        elements = self._transaction.definitions.elements
        words = {
            word
            for word in tokenize(fold(text))
            if is_word(word) and word[0] not in "?:" and not NUMBER.fullmatch(word)
        }
        words -= _KEYWORDS
        gone = {
            word for word in words if all(elements(kind).named(word) is None for kind in _NAMED)
        }
        for kind in _NAMED if gone else ():
            self._transaction.look_up(kind, gone)
        return bool(gone) and all(
            any(elements(kind).id_of(word) is not None for kind in _NAMED) for word in gone
        )
