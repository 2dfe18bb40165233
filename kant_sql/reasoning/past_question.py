"""Conditions and rules that are asked of the past: read with the names of the state they fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

from ..arguments import shown
from ..dto import PddlObjectDto
from ..dto import formulas as f
from ..dto.lexical import either_text, fold, is_word
from ..errors import InvalidArgumentError, InvalidKnowledgeError, TypeMismatchError
from ..history.revisions import LARGEST, read_position
from ..knowledge.definitions import Definitions
from ..knowledge.symbols import symbols_of
from ..pddl.cursor import hint
from ..pddl.given import ReadCondition, read_condition, text_of
from ..pddl.symbols import Fit, SymbolTable
from ..sql.dialects.base import Session
from ..sql.periods import read_last_revisions
from ..store.store import Store
from .ask import given_variable
from .grounding import substitute

_WORD = re.compile(r"[^\s()?]+")
T = TypeVar("T")

EXAMPLE = "(robot_at rb1 kitchen)"


Read = Callable[[SymbolTable], ReadCondition]


class PastQuestion(NamedTuple):
    """A condition, and the definitions with which it was read.

    Attributes:
        formula: the condition; variables that are bound by the caller are objects.
        free: its free variables; `object` where nothing declares a type.
        unbound: the condition as it was given, with all its free variables.
        objects: the objects that the caller bound variables to.
        definitions: those of the latest state in which all names had a meaning.
        read: reads it again with the names of another state; raises `InvalidKnowledgeError` where
            it has no meaning.
    """

    formula: f.Formula
    free: tuple[f.TypedName, ...]
    unbound: ReadCondition
    objects: tuple[f.Constant, ...]
    definitions: Definitions
    read: Read

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the free variables."""
        return tuple([variable.name for variable in self.free])


def ask(
    store: Store,
    condition: f.Formula | str,
    parameters: str | None,
    bindings: Mapping[str, Any],
    upto: int | None,
) -> PastQuestion:
    """Read a condition with the names of the latest state in which it has a meaning."""
    text = text_of(condition, EXAMPLE)
    objects = names_of(bindings)

    def whole(symbols: SymbolTable) -> ReadCondition:
        return read_condition(text, symbols=symbols, parameters=parameters)

    def read(symbols: SymbolTable) -> ReadCondition:
        return with_objects(whole(symbols), objects, symbols) if objects else whole(symbols)

    words = " ".join([text, *objects.values()])
    found, definitions = read_at_last(store, words, read, upto)
    unbound = whole(symbols_of(definitions))
    bound = tuple([f.Constant(name) for name in objects.values()])
    return PastQuestion(found.formula, found.free, unbound, bound, definitions, read)


def names_of(bindings: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of the objects that variables are bound to."""
    names = {}
    for variable, value in bindings.items():
        name = value.name if isinstance(value, PddlObjectDto) else value
        if not isinstance(name, str):
            raise InvalidArgumentError(
                f"{variable}={shown(value)} is not an object; give its name or a PddlObjectDto"
            )
        names[variable] = name
    return names


def with_objects(
    found: ReadCondition, objects: Mapping[str, str], symbols: SymbolTable
) -> ReadCondition:
    """Put objects in the place of some free variables."""
    free = {fold(variable.name): variable for variable in found.free}
    binding: dict[str, str] = {}
    for name, given in objects.items():
        key = given_variable(name, [variable.name for variable in free.values()])
        binding[key] = _fitting(given, free.pop(key), symbols)
    bound = substitute(found.formula, binding)
    rest = tuple(free.values())
    declared = f.variables_text(rest) if found.are_declared else None
    again = read_condition(str(bound), symbols=symbols, parameters=declared)
    return again._replace(free=rest)


def _fitting(name: str, variable: f.TypedName, symbols: SymbolTable) -> str:
    """Return the declared spelling of an object that a variable can be."""
    entity = symbols.object(name)
    if entity is None:
        known = hint(name, list(symbols.object_names()))
        raise InvalidKnowledgeError(f"the object {name!r} is not known{known}")
    if symbols.fit(entity[1], variable.types) != Fit.YES:
        raise TypeMismatchError(
            f"?{variable.name} is {name} of type {either_text(entity[1])}, expected "
            f"{variable.type_text}"
        )
    return str(entity[0])


def read_at_last(
    store: Store, text: str, read: Callable[[SymbolTable], T], upto: int | None
) -> tuple[T, Definitions]:
    """Read a text with the names of the latest state that has all of them.

    Args:
        store: the knowledge base.
        text: the text, whose names are looked for in the past.
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
    words = sorted({fold(word) for word in _WORD.findall(text) if is_word(word)})

    def work(session: Session, kb_id: int | None) -> list[int]:
        if kb_id is None:
            return []
        low = read_position(session, kb_id).archived
        return read_last_revisions(session, kb_id, words, low, high)

    for revision in store.query_in_snapshot(work):
        yield store.read_definitions(lambda known: known, revision)
