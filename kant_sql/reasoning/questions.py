"""Conditions and rules that are asked of the past: read with the names of the state they fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

from ..arguments import shown
from ..dto import PddlObjectDto
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from ..history.revisions import LARGEST, read_archived_revision
from ..knowledge.definitions import Definitions
from ..knowledge.symbols import symbols_of
from ..pddl.conditions import ReadCondition, read_condition, text_of
from ..pddl.cursor import hint
from ..pddl.symbols import SymbolTable
from ..sql.dialects.base import Session
from ..sql.held import read_last_revisions
from ..store.store import Store
from .grounding import substitute

_WORD = re.compile(r"[^\s()?]+")
T = TypeVar("T")

EXAMPLE = "(robot_at rb1 kitchen)"


class PastQuestion(NamedTuple):
    """A condition, and the definitions with which it was read.

    Attributes:
        formula: the condition; variables that are bound by the caller are objects.
        free: its free variables; `object` where nothing declares a type.
        are_declared: whether the caller declared them.
        definitions: those of the latest state in which all names had a meaning.
    """

    formula: f.Formula
    free: tuple[f.TypedName, ...]
    are_declared: bool
    definitions: Definitions

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the free variables."""
        return tuple([variable.name for variable in self.free])

    def read(self, symbols: SymbolTable) -> ReadCondition:
        """Read it again, with the names of another state.

        Raises:
            InvalidKnowledgeError: it has no meaning there.
        """
        declared = f.variables_text(self.free) if self.are_declared else None
        return read_condition(str(self.formula), symbols=symbols, parameters=declared)


def ask(
    store: Store,
    condition: f.Formula | str,
    parameters: str | None,
    bindings: Mapping[str, Any],
    upto: int | None,
) -> PastQuestion:
    """Read a condition with the names of the latest state in which it has a meaning."""
    text = text_of(condition, EXAMPLE)

    def read(symbols: SymbolTable) -> ReadCondition:
        return read_condition(text, symbols=symbols, parameters=parameters)

    found, definitions = read_at_last(store, text, read, upto)
    question = PastQuestion(found.formula, found.free, found.are_declared, definitions)
    return _bound(question, bindings) if bindings else question


def _bound(question: PastQuestion, bindings: Mapping[str, Any]) -> PastQuestion:
    """Put objects in the place of some free variables."""
    free = {fold(variable.name): variable for variable in question.free}
    binding: dict[str, str] = {}
    for name, value in bindings.items():
        # A keyword has `_` where a variable may have `-`.
        key = next((key for key in free if _plain(key) == _plain(fold(name))), None)
        if key is None:
            known = ", ".join(f"?{one}" for one in question.columns) or "none"
            raise InvalidArgumentError(
                f"the condition has no free variable ?{name}{hint(name, [*question.columns])}; "
                f"it has {known}"
            )
        object_ = value.name if isinstance(value, PddlObjectDto) else value
        if not isinstance(object_, str):
            raise InvalidArgumentError(
                f"{name}={shown(value)} is no object; give its name or a PddlObjectDto"
            )
        del free[key]
        binding[key] = object_
    bound = question._replace(
        formula=substitute(question.formula, binding), free=tuple(free.values())
    )
    again = bound.read(symbols_of(question.definitions))
    return bound._replace(formula=again.formula, free=again.free)


def _plain(name: str) -> str:
    return name.replace("-", "_")


def read_at_last(
    store: Store, text: str, read: Callable[[SymbolTable], T], upto: int | None
) -> tuple[T, Definitions]:
    """Read a text with the names of the latest state that has all of them.

    Args:
        store: the knowledge base.
        text: the text.
        read: reads it.
        upto: the revision of a view of the past.

    Raises:
        InvalidKnowledgeError: no state does; the error is that of the last one.
    """
    definitions = store.read_definitions(lambda known: known, upto)
    try:
        return read(symbols_of(definitions)), definitions
    except InvalidKnowledgeError:
        for earlier in _earlier(store, text, LARGEST if upto is None else upto):
            try:
                return read(symbols_of(earlier)), earlier
            except InvalidKnowledgeError:
                continue
        raise


def _earlier(store: Store, text: str, high: int) -> Iterator[Definitions]:
    """Yield the definitions of the last revisions at which names of a text had a meaning."""
    words = sorted({fold(word) for word in _WORD.findall(text)})

    def work(session: Session, kb_id: int | None) -> list[int]:
        if kb_id is None:
            return []
        low = read_archived_revision(session, kb_id)
        return read_last_revisions(session, kb_id, words, low, high)

    for revision in store.query_in_snapshot(work):
        yield store.read_definitions(lambda known: known, revision)
