"""The sayings of a branch about periods, compared with those about the same times here.

A revision has at most one saying about an element, with its own period.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from datetime import datetime
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

from sqlalchemy import select, union_all

from ..dao.function_value import FluentReferences
from ..dao.proposition import References
from ..documents.carry import Key, is_same
from ..dto.lexical import fold
from ..errors import ConflictError, InvalidKnowledgeError, UnknownNameError, few_of
from ..knowledge.canonical import time_text
from ..knowledge.sayings import Period, last_said
from ..sql.changes import SAYING, in_range
from ..sql.dialects.base import Session
from ..sql.query import Query, constant
from ..sql.rows import ATOM_TABLES, FACT, KB, PROPOSITION, VALUE, looked_up
from ..store.transaction import Transaction
from .merged import NAMED


class MergeSaying(NamedTuple):
    """A statement of a revision about a fact or fluent: about a period, or from its commit on."""

    number: int
    key: Key
    content: str | None  # the text of the fact or value; None: it did not hold
    text: str  # the text of the change; empty if the revision retracted it
    begin: datetime
    end: datetime

    @property
    def element(self) -> str:
        """The name for decisions about it."""
        return f"{SAYING} {self.text}"


_SAYINGS = Query(
    union_all(
        *(
            select(
                *own.sayings.c["since", "text", "valid_from", "valid_until"],
                constant(kind),
                looked_up(own.identity.c.text, own.identity.c.id, own.sayings.c[own.owner]),
            ).where(own.sayings.c.kb_id == KB, in_range(own.sayings.c.since))
            for kind, own in ((FACT, ATOM_TABLES[PROPOSITION]), (VALUE, ATOM_TABLES[VALUE]))
        )
    )
)


def read_sayings(session: Session, kb_id: int, low: int, high: int) -> list[MergeSaying]:
    """Read the sayings of a range of revisions, oldest first."""
    found = []
    for number, text, *ends, kind, name in session.rows(_SAYINGS, kb=kb_id, low=low, high=high):
        said, _, content = text.partition(" :from ")[0].partition(" ")
        held = content if said == "(:held" else None
        found.append(
            MergeSaying(number, (kind, fold(name)), held, text, *map(session.to_time, ends))
        )
    return sorted(found, key=attrgetter("number"))


def compare_sayings(
    theirs: Iterable[MergeSaying], ours: Iterable[MergeSaying], merges: Collection[int]
) -> Iterator[tuple[MergeSaying, MergeSaying | None]]:
    """Yield the sayings of a branch that are new here, each with a contradiction if there is one.

    Sayings that its merges wrote do not contradict; the last one that covers a time counts.
    """
    sides: defaultdict[Key, tuple[list[MergeSaying], list[MergeSaying]]] = defaultdict(
        lambda: ([], [])
    )
    for place, side in enumerate((theirs, ours)):
        for each in side:
            sides[each.key][place].append(each)
    for key, (said, here) in sides.items():
        for place, own in enumerate(said, 1):
            if any(each.begin <= own.begin and own.end <= each.end for each in said[place:]):
                # The branch itself has a later saying.
                continue
            beliefs = [each for _, each in last_said(own.begin, own.end, here)]
            known = [each for each in beliefs if each is not None]
            others = [each for each in known if not is_same(key, each.content, own.content)]
            against = [each for each in others if each.number not in merges]
            # Skip a saying that is here with just this period.
            if others or None in beliefs or any(each[4:] != own[4:] for each in known):
                yield own, max(against, key=attrgetter("number"), default=None)


def say_all(transaction: Transaction, sayings: Iterable[MergeSaying]) -> None:
    """Write the sayings of a branch; refuse those that do not fit here."""
    facts, fluents = References(transaction, are_goals=False), FluentReferences(transaction)
    found: list[tuple[Period, str, Any, str, Any]] = []
    wrong, now, first = [], transaction.head.clock, dict[Key, MergeSaying]()
    for one in sorted(sayings, key=attrgetter("number")):
        place, name = (Period(one.begin, one.end, False), one.key[0]), one.key[1]
        if first.setdefault(one.key, one) is not one:
            before = f"merge up to before it first, as in kb.merge(branch.at({one.number - 1}))"
            wrong.append(f"{one.element}: a revision has one saying about an element: {before}")
        elif one.end > now:
            wrong.append(f"{one.element}: it ends after the store's clock, {time_text(now)}")
        try:
            if one.key[0] == FACT:
                found.append((*place, *facts.resolve(name), one.content and True))
            elif one.content is not None:
                found.append((*place, *fluents.entry(one.content)))
            else:
                function, *objects = name[1:-1].split()
                found.append((*place, *fluents.resolve(function, objects)[1:], None))
        except (InvalidKnowledgeError, UnknownNameError) as error:
            wrong.append(f"{one.element}: {error}")
    if wrong:
        raise ConflictError(
            f"sayings of the branch cannot be taken over: {few_of(wrong, NAMED)}; "
            "nothing was written: decide each as 'ours', or remove the cause"
        )
    of_period = itemgetter(0, 1)
    for (period, kind), group in groupby(sorted(found, key=of_period), of_period):
        transaction.say_all(period, kind, {key: (text, value) for _, _, key, text, value in group})
