"""Finding the identities of an element that someone asks about, live or not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from sqlalchemy import bindparam, literal_column, select, union_all

from ..backends import Query, Session, in_list
from ..dto.name import is_word
from ..knowledge.loading import KB
from ..knowledge.rows import KIND_TABLES, table_of
from ..knowledge.sources import FACT, GOAL, PROPOSITION, VALUE
from ..tables import FormulaVersionRow, FunctionValueRow, PropositionRow
from .elements import NAMED_KINDS, Applied, Named, Sought, Written, comparable


class Owner(NamedTuple):
    """An identity, whose versions are looked for.

    Attributes:
        source: where its versions are: one of the keys of `SOURCES`.
        id: its id.
    """

    source: str
    id: int


def _identities(kind: str) -> Any:
    identity = KIND_TABLES[kind].identity.c
    name: Any = literal_column(f"'{kind}'")
    return select(name, identity.key, identity.id).where(
        identity.kb_id == KB, in_list(identity.key, "keys")
    )


def _propositions(role: str) -> Any:
    atom = PropositionRow
    return select(literal_column(f"'{role}'"), atom.id, atom.predicate_id, atom.arguments).where(
        atom.kb_id == KB,
        # Of the one index, `is_goal` is the first column.
        atom.is_goal == bindparam(role),
        in_list(atom.predicate_id, "applied"),
        in_list(atom.arguments, "arguments"),
    )


_IDENTITIES = Query(union_all(*map(_identities, NAMED_KINDS)))
_INTERNED = Query(
    union_all(
        _propositions(FACT),
        _propositions(GOAL),
        select(
            literal_column(f"'{VALUE}'"),
            FunctionValueRow.id,
            FunctionValueRow.function_id,
            FunctionValueRow.arguments,
        ).where(
            FunctionValueRow.kb_id == KB,
            in_list(FunctionValueRow.function_id, "applied"),
            in_list(FunctionValueRow.arguments, "arguments"),
        ),
    )
)
_VERSION = table_of(FormulaVersionRow).c
_FORMULAS = Query(select(_VERSION.formula_id, _VERSION.text).where(_VERSION.kb_id == KB).distinct())
_Ids = dict[tuple[str, str], int]


def find_owners(session: Session, kb_id: int, wanted: list[Sought]) -> list[Owner]:
    """Find identities, in three statements at most.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        wanted: what is asked about.

    Returns:
        Those that were ever known, each once.
    """
    keys = sorted({key for each in wanted for key in _keys(each) if is_word(key)})
    ids: _Ids = {}
    if keys:
        rows = session.rows(_IDENTITIES, kb=kb_id, keys=session.list_value(keys))
        ids = {(kind, key): id_ for kind, key, id_ in rows}
    found = [
        Owner(kind, ids[kind, each.name])
        for each in wanted
        if isinstance(each, Named)
        for kind in each.kinds
        if (kind, each.name) in ids
    ]
    applied = [each for each in wanted if isinstance(each, Applied)]
    found += _interned(session, kb_id, applied, ids)
    texts = {each.words for each in wanted if isinstance(each, Written)}
    if texts:
        rows_of_formulas = session.stream(_FORMULAS, kb=kb_id)
        found += [
            Owner("formula", id_) for id_, text in rows_of_formulas if comparable(text) in texts
        ]
    return list(dict.fromkeys(found))


def _keys(wanted: Sought) -> tuple[str, ...]:
    if isinstance(wanted, Written):
        return ()
    return (wanted.name, *wanted.arguments) if isinstance(wanted, Applied) else (wanted.name,)


def _interned(
    session: Session, kb_id: int, applied: Iterable[Applied], ids: _Ids
) -> Iterator[Owner]:
    """Find what predicates and functions are applied to objects."""
    wanted = {place for each in applied for place in _places(each, ids)}
    if not wanted:
        return
    rows = session.rows(
        _INTERNED,
        kb=kb_id,
        fact=False,
        goal=True,
        applied=session.list_value(sorted({id_ for _, id_, _ in wanted})),
        arguments=session.list_value(sorted({arguments for _, _, arguments in wanted})),
    )
    for role, id_, applied_id, arguments in rows:
        if (role, applied_id, arguments) in wanted:
            yield Owner(VALUE if role == VALUE else PROPOSITION, id_)


def _places(applied: Applied, ids: _Ids) -> Iterator[tuple[str, int, str]]:
    """Give role, predicate or function, and what interns the arguments, if all are known."""
    objects = [ids.get(("object", name)) for name in applied.arguments]
    if None in objects:
        return
    arguments = " ".join(map(str, objects))
    for role in applied.roles:
        id_ = ids.get(("function" if role == VALUE else "predicate", applied.name))
        if id_ is not None:
            yield role, id_, arguments
