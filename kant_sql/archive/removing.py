"""Removing what has left."""

from __future__ import annotations

from functools import cache
from typing import Any

from sqlalchemy import BigInteger, bindparam, delete, select, update

from ..backends import Query, Session, in_list
from ..errors import StoreError
from ..knowledge.changes import in_range
from ..knowledge.loading import KB
from ..tables import HeadRow, ObjectRow, ObjectVersionRow
from .converting import batches
from .leaving import Leaving
from .parts import PARTS, Atoms, Part, children_of

# No knowledge base has this id.
_NONE = -1
# So many objects at a time are looked at, with the atoms that mention them.
_OBJECTS = 200

_SET = Query(
    update(HeadRow)
    .where(HeadRow.kb_id == bindparam("kb"))
    .values(archived_revision=bindparam("upto", type_=BigInteger))
)
_OBJECT_VERSIONS = select(ObjectVersionRow.since).where(
    ObjectVersionRow.kb_id == ObjectRow.kb_id, ObjectVersionRow.object_id == ObjectRow.id
)
_GONE_OBJECTS = Query(select(ObjectRow.id).where(ObjectRow.kb_id == KB, ~_OBJECT_VERSIONS.exists()))


@cache
def _ended(part: Part) -> tuple[Query, ...]:
    """Give what removes the versions that ended in the range, after what is below them."""
    ended = in_range(part.version.c.until)
    below = (
        delete(child).where(*children_of(part, child, ended)) for child in reversed(part.children)
    )
    versions = delete(part.version).where(part.version.c.kb_id == KB, ended)
    return tuple(map(Query, (*below, versions)))


@cache
def _without_version(part: Part, atoms: Atoms) -> Query:
    """Give the atoms that mention some objects and have no version."""
    version, argument = part.version.c, atoms.arguments.c
    (name,) = part.owner
    versions = (
        select(version.since)
        .where(version.kb_id == argument.kb_id, version[name] == argument[name])
        .correlate(atoms.arguments)
    )
    return Query(
        select(argument[name])
        .where(argument.kb_id == KB, in_list(argument.object_id, "objects"), ~versions.exists())
        .distinct()
    )


@cache
def _remove_atoms(part: Part, atoms: Atoms) -> tuple[Query, ...]:
    owners = (atoms.arguments.c[part.owner[0]], atoms.identity.c.id)
    return tuple(
        Query(delete(owner.table).where(owner.table.c.kb_id == KB, in_list(owner, "ids")))
        for owner in owners
    )


def refuse_without_right(session: Session) -> None:
    """Find out whether this user may archive, before much is done.

    Args:
        session: the session, in a transaction that writes.

    Raises:
        ReadOnlyStoreError: the user may not.
    """
    session.run(_SET, kb=_NONE, upto=0)


def remove(session: Session, kb_id: int, leaving: Leaving) -> None:
    """Remove what has left, and what only it needs, and let the head say so.

    Names stay, each with its spelling and its id, and so do ground atoms of objects of which
    something is left: they may come back, and a state is told in the order of ids. What mentions
    an object of which nothing is left goes.

    Args:
        session: the session, in a transaction that holds the head's lock.
        kb_id: the knowledge base.
        leaving: what leaves.

    Raises:
        StoreError: the database has removed something else.
    """
    session.replan()
    parameters = {"kb": kb_id, "low": leaving.low, "high": leaving.high}
    for part in PARTS:
        wanted = leaving.versions.get(part.version.name, 0)
        if wanted:
            *below, versions = _ended(part)
            for query in below:
                session.run(query, **parameters)
            removed = session.run(versions, **parameters)
            if removed != wanted:
                raise StoreError(
                    f"{session.backend.label}: {removed} of {wanted} rows of {part.version.name} "
                    "could be removed; nothing was: connect as the owner of the tables"
                )
    for rows in batches(session.stream(_GONE_OBJECTS, kb=kb_id), _OBJECTS):
        objects = session.list_value([id_ for (id_,) in rows])
        for part in PARTS:
            if part.atoms is not None:
                _remove_atoms_of(session, kb_id, part, part.atoms, objects)
    session.run(_SET, kb=kb_id, upto=leaving.high)


def _remove_atoms_of(session: Session, kb_id: int, part: Part, atoms: Atoms, objects: Any) -> None:
    rows = session.rows(_without_version(part, atoms), kb=kb_id, objects=objects)
    if rows:
        ids = session.list_value([id_ for (id_,) in rows])
        for query in _remove_atoms(part, atoms):
            session.run(query, kb=kb_id, ids=ids)
