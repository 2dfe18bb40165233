"""Arguments given as text: PDDL and names, with similar names for unknown ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from sqlalchemy import bindparam, select

from ..arguments import refuse_many, shown
from ..dto.formulas import MODALS, Node
from ..dto.lexical import NUMBER, RESERVED, ROOT_TYPE, fold, is_word
from ..errors import InvalidKnowledgeError, PddlError, UnknownNameError
from ..knowledge.definitions import DECLARED
from ..knowledge.symbols import symbols_of
from ..pddl.cursor import hint
from ..pddl.lexer import tokenize
from ..sql.definition_rows import find_id
from ..sql.dialects.base import Session
from ..sql.query import Query, first_rows
from ..sql.rows import KB, KIND_TABLES, table_of
from ..sql.tables import RevisionRow
from ..store.store import Store
from ..store.transaction import Transaction

T = TypeVar("T")

_KEYWORDS = frozenset({ROOT_TYPE, "preference", *MODALS}).union(*RESERVED.values())


def expect_text(given: object, what: str, article: str, example: str, *also: type) -> None:
    """Refuse an argument that is neither text, nor a node, nor of an accepted class."""
    refuse_many(given)
    if not isinstance(given, (str, Node, *also)):
        raise InvalidKnowledgeError(
            f"{what} takes {article}, for example '{example}', not {type(given).__name__}: "
            f"{shown(given)}"
        )


def read_text(
    transaction: Transaction, read: Callable[..., T], given: str | Node, *, needs_names: bool = True
) -> T:
    """Read a text with one of the functions of `pddl.given`, most of which need known names."""
    if not needs_names:
        return read(str(given))
    return read(str(given), symbols=symbols_of(transaction.definitions.current()))


def read_stored(transaction: Transaction, read: Callable[..., T], given: str | Node) -> T | None:
    """Read an element that may be stored; None if it names a deleted element."""
    try:
        return read_text(transaction, read, given)
    except PddlError:
        if _names_what_was(transaction, str(given)):
            return None
        raise


def _names_what_was(transaction: Transaction, text: str) -> bool:
    """Return whether a text names deleted elements, and none that never existed."""
    elements = transaction.definitions.elements
    words = {
        word
        for word in tokenize(fold(text))
        if is_word(word) and word[0] not in "?:" and not NUMBER.fullmatch(word)
    }
    words -= _KEYWORDS
    gone = {word for word in words if all(elements(kind).named(word) is None for kind in DECLARED)}
    for kind in DECLARED if gone else ():
        transaction.look_up(kind, gone)
    return bool(gone) and all(
        any(elements(kind).id_of(word) is not None for kind in DECLARED) for word in gone
    )


# The number of names that are compared with an unknown one.
_COMPARED = 5_000
# The number of newest revisions that are searched for a similar actor.
_RECENT = 1_000

_NAMES = {
    kind: Query(first_rows(select(names.c.name).where(names.c.kb_id == KB), _COMPARED))
    for kind, names in ((kind, tables.identity) for kind, tables in KIND_TABLES.items())
}
_REVISIONS = table_of(RevisionRow).c
_BY_ACTOR = _REVISIONS.kb_id == KB, _REVISIONS.actor == bindparam("actor")
_OF_ACTOR = Query(first_rows(select(_REVISIONS.number).where(*_BY_ACTOR), 1))
_ACTORS = select(_REVISIONS.actor).where(_REVISIONS.kb_id == KB)
_RECENT_ACTORS = Query(first_rows(_ACTORS.order_by(_REVISIONS.number.desc()), _RECENT))


def refuse_unknown(store: Store, name: str, *kinds: str) -> None:
    """Refuse a name that no element of some kinds ever had in this knowledge base."""
    if kinds == ("type",) and fold(name) == ROOT_TYPE:
        return
    transaction = store.current()
    names: list[str] = []
    for kind in kinds if transaction is not None else ():
        elements = transaction.definitions.elements(kind)  # type: ignore[union-attr]
        if elements.id_of(name) is not None:
            return
        names += [definition.name for definition in elements]

    def unknown(session: Session, kb_id: int) -> bool:
        if any(find_id(session, kb_id, kind, name) is not None for kind in kinds):
            return False
        for kind in kinds:
            names.extend(str(row[0]) for row in session.rows(_NAMES[kind], kb=kb_id))
        return True

    if store.query_known(unknown, True, in_snapshot=False):
        raise UnknownNameError(
            f"knowledge base {store.name!r} has never had {_either(kinds)} {shown(name)}"
            f"{hint(name, names)}"
        )


def refuse_unknown_names(store: Store, predicate: str | None, object_: str | None) -> None:
    """Refuse names of predicates, functions or objects that never existed."""
    if predicate is not None:
        refuse_unknown(store, predicate, "predicate", "function")
    if object_ is not None:
        refuse_unknown(store, object_, "object")


def refuse_unknown_actor(store: Store, actor: str) -> None:
    """Refuse an actor who has made no revision of this knowledge base."""

    def recent(session: Session, kb_id: int | None) -> Iterable[str | None] | None:
        if kb_id is None:
            return ()
        if session.first(_OF_ACTOR, kb=kb_id, actor=actor) is not None:
            return None
        return dict.fromkeys(row[0] for row in session.rows(_RECENT_ACTORS, kb=kb_id))

    found = store.query(recent)
    if found is not None:
        known = [one for one in found if one is not None]
        raise UnknownNameError(
            f"knowledge base {store.name!r} has no revision by actor {shown(actor)}"
            f"{hint(actor, known)}"
        )


def _either(kinds: Sequence[str]) -> str:
    if len(kinds) > 2:
        return "an element"
    return " or ".join(f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}" for kind in kinds)
