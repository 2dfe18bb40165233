"""Names that a knowledge base has never had: most are misspelled."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sqlalchemy import bindparam, literal_column, select

from ..arguments import shown
from ..dto.lexical import ROOT_TYPE, fold, is_word
from ..errors import UnknownNameError
from ..pddl.cursor import hint
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Session
from ..sql.query import Query, first_rows
from ..sql.rows import KB, KIND_TABLES
from ..sql.tables import RevisionRow
from ..store.store import Store

# How many names are compared with an unknown one.
_COMPARED = 5_000
# How many of the newest revisions are searched for a similar actor.
_RECENT = 1_000

_NAMES = {
    kind: Query(
        first_rows(
            select(tables.identity.c.name).where(tables.identity.c.kb_id == KB),
            literal_column(str(_COMPARED)),
        )
    )
    for kind, tables in KIND_TABLES.items()
}
_OF_ACTOR = Query(
    first_rows(
        select(RevisionRow.number).where(
            RevisionRow.kb_id == KB, RevisionRow.actor == bindparam("actor")
        ),
        literal_column("1"),
    )
)
_RECENT_ACTORS = Query(
    first_rows(
        select(RevisionRow.actor)
        .where(RevisionRow.kb_id == KB)
        .order_by(RevisionRow.number.desc()),
        literal_column(str(_RECENT)),
    )
)


def refuse_unknown(store: Store, name: str, *kinds: str) -> None:
    """Refuse a name that nothing of some kinds has ever had in this knowledge base."""
    if kinds == ("type",) and fold(name) == ROOT_TYPE:
        return
    transaction = store.current()
    names: list[str] = []
    for kind in kinds if transaction is not None else ():
        elements = transaction.definitions.elements(kind)  # type: ignore[union-attr]
        if elements.id_of(name) is not None:
            return
        names += [definition.name for definition in elements]

    def unknown(session: Session, kb_id: int | None) -> bool:
        if kb_id is None:
            return True
        for kind in kinds if is_word(name) else ():
            if find_identities(session, kb_id, kind, {fold(name)})[fold(name)] is not None:
                return False
        for kind in kinds:
            names.extend(str(row[0]) for row in session.rows(_NAMES[kind], kb=kb_id))
        return True

    if store.query(unknown):
        raise UnknownNameError(
            f"knowledge base {store.name!r} has never had {_either(kinds)} {shown(name)}"
            f"{hint(name, names)}"
        )


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
            f"no revision of knowledge base {store.name!r} is of actor {shown(actor)}"
            f"{hint(actor, known)}"
        )


def _either(kinds: Sequence[str]) -> str:
    if len(kinds) > 2:
        return "an element"
    return " or ".join(f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}" for kind in kinds)
