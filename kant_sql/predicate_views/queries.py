"""What a generated view selects.

Nothing is joined: each column that is not of the version itself is a subquery for one row. Joins of
this many tables ran for minutes on 3,000 facts where PostgreSQL had no statistics. With statistics
they would let a condition on an argument begin at the object (on 100,000 versions 20 ms instead of
500 ms); without, it took 10 s, and all of the view twice its time. SQLite gains nothing by them.
Each subquery sorts its one row, which makes PostgreSQL find it by the index that sorts so, the
primary key. Where it takes a table for small, it would as soon take another that begins with
`kb_id`, and read all of the knowledge base each time.

Readers see this text, so it is written for them. Nothing in it is anybody's words: ids are numbers,
and names of columns are identifiers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

INTERVAL = ("since", "since_at", "until", "until_at")
METADATA = ("asserted_by", "asserted_reason", "retracted_by", "retracted_reason")
# They came later: an argument that has one of these names keeps it.
RECKONED = ("since_epoch", "until_epoch", "duration")

_ARGUMENT = """
    (
        SELECT (
            SELECT o.name FROM object AS o
            WHERE o.kb_id = {kb_id} AND o.id BETWEEN a.object_id AND a.object_id
            ORDER BY o.id LIMIT 1
        )
        FROM proposition_argument AS a
        WHERE a.kb_id = {kb_id} AND a.proposition_id = v.proposition_id AND a.position = {position}
    ) AS {name}"""
_SAID = """
    (
        SELECT {what} FROM revision AS r
        WHERE r.kb_id = {kb_id} AND r.number BETWEEN v.{number} AND v.{number}
        ORDER BY r.number LIMIT 1
    ) AS {name}"""
_BETWEEN = """
    (
        SELECT (
            SELECT {seconds} FROM revision AS u
            WHERE u.kb_id = {kb_id} AND u.number BETWEEN v.until AND v.until
            ORDER BY u.number LIMIT 1
        )
        FROM revision AS s
        WHERE s.kb_id = {kb_id} AND s.number BETWEEN v.since AND v.since
        ORDER BY s.number LIMIT 1
    ) AS {name}"""
_VIEW = """\
SELECT{columns}
FROM proposition_version AS v
WHERE v.kb_id = {kb_id} AND v.predicate_id = {predicate_id} AND {condition}"""


class Words(NamedTuple):
    """What the dialects write differently.

    Attributes:
        condition: what else must be true of a version `v` of a proposition.
        epoch: the time of a revision `r` in seconds since 1970.
        seconds: the seconds from the time of a revision `s` to that of `u`.
    """

    condition: str
    epoch: str
    seconds: str


def view_query(
    kb_id: int, predicate_id: int, words: Words, names: Sequence[str], reckoned: Sequence[str]
) -> str:
    """Write the query of a view.

    Args:
        kb_id: the knowledge base.
        predicate_id: the predicate.
        words: what the dialect writes differently.
        names: the names of the columns of the arguments, in order.
        reckoned: the names of the columns `RECKONED`.

    Returns:
        The SQL.
    """
    arguments = [
        _ARGUMENT.format(kb_id=kb_id, position=position, name=name)
        for position, name in enumerate(names)
    ]
    since_epoch, until_epoch, duration = reckoned
    said = {
        name: _SAID.format(kb_id=kb_id, what=what, number=number, name=name)
        for name, what, number in (
            ("since_at", "r.committed_at", "since"),
            ("until_at", "r.committed_at", "until"),
            ("asserted_by", "r.actor", "since"),
            ("asserted_reason", "r.reason", "since"),
            ("retracted_by", "r.actor", "until"),
            ("retracted_reason", "r.reason", "until"),
            (since_epoch, words.epoch, "since"),
            (until_epoch, words.epoch, "until"),
        )
    }
    said[duration] = _BETWEEN.format(kb_id=kb_id, seconds=words.seconds, name=duration)
    rest = [said.get(name, f"\n    v.{name}") for name in (*INTERVAL, *METADATA, *reckoned)]
    return _VIEW.format(
        columns=",".join([*arguments, *rest]),
        kb_id=kb_id,
        predicate_id=predicate_id,
        condition=words.condition,
    )
