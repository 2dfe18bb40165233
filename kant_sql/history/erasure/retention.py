"""Rules of retention, which erase actors, reasons and sources of old revisions."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from datetime import timedelta
from functools import cache
from typing import NamedTuple

from sqlalchemy import String, bindparam, select, true

from ...arguments import expect, iterate, one_of, period, shown, storable_text
from ...errors import InvalidArgumentError
from ...knowledge.canonical import SAID
from ...sql import tables as t
from ...sql.dialects.base import Session
from ...sql.query import Query, constant
from ...sql.rows import KB, table_of
from ...sql.tables.base import UtcTime
from ...store.state import State
from ..verify.parts import SAID_AT
from .erase import Erased, Wanted, run_erasure

ANY = "*"
_AGE = re.compile(r"(\d{1,6})([smhd])")
_QUOTED = re.compile(r'"(.*)"', re.DOTALL)
_UNITS = {"s": 1, "m": 60, "h": 3_600, "d": 86_400}  # in seconds
_REVISION, _PART = table_of(t.RevisionRow).c, table_of(t.CommitmentRow).c
_ERASURE = table_of(t.ErasureRow).c


class RetentionRule(NamedTuple):
    """A rule that erases parts of an actor's revisions after some time.

    Attributes:
        actor: whose revisions; None for all.
        after: the age.
        parts: those of `actor`, `reason` and `source` to erase.
    """

    actor: str | None
    after: timedelta
    parts: tuple[str, ...]


def read_rules(lines: Iterable[str]) -> list[RetentionRule]:
    """Read rules, each an actor or `*`, an age and parts: `camera 30d reason,source`.

    Put an actor with spaces in quotes; empty lines and lines that begin with `#` are ignored.

    Raises:
        InvalidArgumentError: a line is not a rule.

    Examples:
        >>> read_rules(["camera 30d reason"])[0].after.days
        30
    """
    error = InvalidArgumentError
    given = iterate(lines, "the rules of retention", "a list of lines", error)
    texts = (expect(line, str, "a line of the rules of retention", error).strip() for line in given)
    return [_read_rule(text) for text in texts if text and not text.startswith("#")]


def _read_rule(line: str) -> RetentionRule:
    words = line.rsplit(maxsplit=2)
    age = _AGE.fullmatch(words[1]) if len(words) == 3 else None
    parts = tuple(words[-1].split(","))
    if age is None or not {*parts} <= {*SAID}:
        raise InvalidArgumentError(
            f"{shown(line)} is not a rule of retention; write an actor or *, an age and parts: "
            "camera 30d reason,source"
        )
    # Quotes around it, not quotes within it.
    quoted = _QUOTED.fullmatch(words[0])
    actor = storable_text(words[0] if quoted is None else quoted[1], "actor")
    after = period(_UNITS[age[2]] * int(age[1]), "the age")
    return RetentionRule(None if actor == ANY else actor, after, parts)


@cache
def _old(label: str, is_any: bool) -> Query:
    """Find older revisions of form 2 whose part has not been erased yet."""
    position = constant(SAID_AT[label])
    gone = select(_PART.number).where(
        *(_PART.kb_id == KB, _PART.number == _REVISION.number, _PART.position == position),
        _PART.erasure_id.is_not(None),
    )
    # The actors and reasons of erasures stay.
    erased = select(_ERASURE.id).where(_ERASURE.kb_id == KB, _ERASURE.since == _REVISION.number)
    return Query(
        select(_REVISION.number).where(
            *(_REVISION.kb_id == KB, _REVISION[label].is_not(None)),
            _REVISION.form > constant(1),
            _REVISION.committed_at < bindparam("before", type_=UtcTime()),
            true() if is_any else _REVISION.actor == bindparam("actor", type_=String()),
            ~gone.exists(),
            ~erased.exists(),
        )
    )


def _checked(rules: Iterable[RetentionRule]) -> list[RetentionRule]:
    """Check rules, each by itself and together with the others."""
    listed = iterate(rules, "the rules of retention", "a list of rules", InvalidArgumentError)
    given = [_checked_rule(rule) for rule in listed]
    for rule in given:
        is_lost = rule.actor is not None and any(
            "actor" in other.parts
            and other.actor in (None, rule.actor)
            and other.after < rule.after
            for other in given
        )
        if is_lost and {*rule.parts} != {"actor"}:
            raise InvalidArgumentError(
                f"a rule of retention finds the revisions of {shown(rule.actor)} by their actor, "
                "which another rule erases earlier, so that the rest would stay forever; erase "
                "the actor no earlier than the rest, or give * instead of the name for the rest"
            )
    return given


def _checked_rule(rule: RetentionRule) -> RetentionRule:
    error = InvalidArgumentError
    actor, after, parts = expect(rule, RetentionRule, "a rule of retention", error)
    seconds = expect(after, timedelta, "the age of a rule of retention", error).total_seconds()
    listed = iterate(
        parts, "the parts of a rule of retention", f"a list of {', '.join(SAID)}", error
    )
    return RetentionRule(
        storable_text(actor, "actor"),
        period(seconds, "the age of a rule of retention"),
        tuple([one_of(each, SAID, "what to erase") for each in listed]),
    )


def retain(
    state: State,
    rules: Iterable[RetentionRule],
    *,
    reason: str | None = None,
    archive: str | None = None,
    actor: str | None = None,
) -> Erased:
    """Erase parts of old revisions by rules, in one revision, or in none if nothing is old enough.

    It keeps the actors and reasons of erasures, and all of revisions of form 1 of the hash.

    Args:
        rules: from `kant_sql.history.erasure.retention.read_rules`.
        reason: the reason of the revision; by default it names the rules.
        archive: as for `erase`.
        actor: who erases; by default the knowledge base's actor.

    Returns:
        The erasure.

    Raises:
        InvalidArgumentError: a rule is wrong, or needs an actor that another rule erases earlier.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.

    Examples:
        >>> from kant_sql.history.erasure.retention import read_rules
        >>> kb.store.retain(read_rules(["camera 30d reason,source"])).revision is None
        True
    """
    store, given = state.store, _checked(rules)

    def find(session: Session, kb_id: int | None) -> dict[int, tuple[str, ...]]:
        now, found = store.clock(session), defaultdict[int, set[str]](set)
        for rule in given if kb_id is not None else ():
            before = session.from_time(now - rule.after)
            own = {} if rule.actor is None else {"actor": rule.actor}
            for label in rule.parts:
                query = _old(label, rule.actor is None)
                for (number,) in session.rows(query, kb=kb_id, before=before, **own):
                    found[number].add(label)
        return {number: tuple(sorted(found[number])) for number in sorted(found)}

    if not store.query(find):
        return Erased(None, None, "", 0, 0, 0)
    wanted = Wanted(None, (), {}, by_rule=find)
    return run_erasure(store, wanted, False, actor, reason or "rules of retention", archive)
