"""What both sides of a merge have changed since the branch began, and what decisions make of it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from ..documents.carry import STATED, Key, is_same, key_of, mentions_of, name_in
from ..dto.lexical import fold
from ..errors import ConflictError, InvalidArgumentError, RuleViolatedError
from ..knowledge.definitions import DECLARED, KINDS, Definitions
from ..pddl.lexer import tokenize
from ..sql.changes import ASSERTED, ERASURE, RETRACTED, SAYING, Change, stream_changes
from ..sql.dialects.base import Session
from .merge_sayings import MergeSaying, read_sayings
from .merged import OURS, THEIRS, Decision, MergeSide
from .revisions import Revision


@dataclass(eq=False, slots=True)
class Trace:
    """What became of one element in a range of revisions."""

    name: str  # what it is called, as it is spelled
    first: int  # the first revision that changed it
    last: int = 0  # the last revision that changed it
    before: str | None = None  # its text before the range; None where it did not hold
    then: str | None = None  # its text at a revision within the range
    now: str | None = None  # its text after the range
    # What revisions after that one made of it.
    since: dict[int, str | None] = field(default_factory=dict)
    _asserted: int = 0

    def add(self, number: int, change: Change, split: int) -> None:
        """Add a change; within a revision, what it asserts comes first."""
        if change.sign == ASSERTED:
            self.now, self._asserted = change.text, number
        else:
            if number == self.first:
                self.before = change.text
            if number != self._asserted:
                self.now = None
        self.last = number
        if number <= split:
            self.then = self.now
        else:
            self.since[number] = self.now
            if self.first > split:
                self.then = self.before


class SideChanges(NamedTuple):
    """What one side has changed since the branch began."""

    traces: dict[Key, Trace]
    definitions: Definitions
    sayings: list[MergeSaying]  # what was said of periods
    pseudonyms: set[str]  # given out by erasures


def read_side(
    session: Session, kb_id: int, definitions: Definitions, low: int, high: int, split: int
) -> SideChanges:
    """Read what a range of revisions changed, in two statements."""
    traces: dict[Key, Trace] = {}
    pseudonyms = set[str]()
    for number, change in stream_changes(session, kb_id, low, high):
        if change.kind == ERASURE:
            _, _, said = change.text.partition(" :as ")
            pseudonyms.add(json.loads(said.partition(" :parts ")[0]))
        if change.kind in STATED:
            name = name_in(change.kind, change.text)
            key = change.kind, fold(name)
            if key not in traces:
                traces[key] = Trace(name, number)
            traces[key].add(number, change, split)
    return SideChanges(traces, definitions, read_sayings(session, kb_id, low, high), pseudonyms)


class MergeComparison:
    """The two sides of a merge, and what follows from decisions."""

    def __init__(self, base: int, merged: int, ours: SideChanges, theirs: SideChanges) -> None:
        """Compare what was changed here since the base, and there since it was merged last."""
        self._sides: dict[str, SideChanges] = {OURS: ours, THEIRS: theirs}
        # Definitions that others can mention, and those that only one side has.
        traces = (*ours.traces, *theirs.traces)
        self._mentioned = {key for key in traces if key[0] in DECLARED}
        texts = ((key, self.text(OURS, key), self.text(THEIRS, key)) for key in self._mentioned)
        self._deleted = {key for key, own, other in texts if (own is None) != (other is None)}
        # What is taken over from the branch, of what it has said of periods, too.
        self.brought: set[Key] = set()
        self.said: list[MergeSaying] = []
        # What it has said of periods, with what contradicts it here.
        self.sayings: list[tuple[MergeSaying, MergeSaying | None]] = []
        # What is in conflict, with those that use it, and on which side they are.
        self.conflicts: dict[Key, tuple[str, list[Key]]] = {}
        self._uses: dict[str, dict[Key, list[Key]]] = {}
        for key, trace in theirs.traces.items():
            if trace.last > merged and not self._agree(key):
                own = ours.traces.get(key)
                is_ours = own is not None and own.last > base
                if is_ours or not is_same(key, self.text(OURS, key), trace.then):
                    self.conflicts[key] = "", []
                else:
                    self.brought.add(key)
        self._find_used()

    def text(self, side: str, key: Key) -> str | None:
        """Return what a side says of an element that one of them has changed."""
        own = self._sides[side].traces
        other = self._sides[THEIRS if side == OURS else OURS].traces
        return own[key].now if key in own else other[key].before

    def _agree(self, key: Key) -> bool:
        return is_same(key, self.text(OURS, key), self.text(THEIRS, key))

    @property
    def is_mixed(self) -> bool:
        """Whether a definition has changed that the other side may rely on."""
        for key in self._mentioned:
            texts = {self.text(side, key) for side in self._sides}
            texts |= {one.traces[key].before for one in self._sides.values() if key in one.traces}
            if len(texts - {None}) > 1:
                return True
        return False

    def _find_used(self) -> None:
        """Find what one side has deleted and the other uses, also if a decision is that it does."""
        is_done = False
        while not is_done:
            is_done = True
            for key in self._deleted:
                side = self._owner(key)
                if self._is_on(side, key) and key not in self.conflicts:
                    continue
                users = [
                    each
                    for each in self._users(side, key)
                    if each in self.conflicts or self._is_on(side, each)
                ]
                if users and self.conflicts.get(key) != (side, users):
                    self.conflicts[key] = side, users
                    is_done = False
        self.brought -= self.conflicts.keys()

    def decide(self, decided: Mapping[Key, str]) -> None:
        """Take over what was decided so; what is open stays as it is here."""
        settled = {key: decided.get(key, OURS) for key in self.conflicts}
        found = settled
        while found:
            for key, side in found.items():
                (self.brought.add if side == THEIRS else self.brought.discard)(key)
            found = {}
            for key in self._deleted & settled.keys():
                side = self._owner(key)
                if not self._is_on(side, key):
                    # What uses it goes with it.
                    users = [one for one in self._users(side, key) if self._is_on(side, one)]
                    if key in decided:
                        self._refuse_opposite(key, users, decided)
                    found |= dict.fromkeys(users, settled[key])
            settled |= found

    def read_by(self, error: RuleViolatedError) -> set[Key]:
        """Return what one side has changed, unlike the other, of what breaks a rule.

        That is the rule itself, if the side that saved it changed nothing else of it.
        """
        reads = [(one[0], [one and fold(one) for one in one[1:]]) for one in error.reads]
        sides = [side.traces.keys() for side in self._sides.values()]
        changed = {key for own in sides for key in own - self.conflicts.keys()}
        found = {key for key in changed if any(_is_of(key, *each) for each in reads)}
        found = {key for key in found if not self._agree(key)}
        rule = ("rule", fold(error.rule))
        is_different = rule in changed and not self._agree(rule)
        if is_different and any(rule in own and not own & found for own in sides):
            found.add(rule)
        return found

    def keep(self, keys: Iterable[Key], decided: Decision | None) -> None:
        """Have elements as one side has them."""
        (self.brought.update if decided == THEIRS else self.brought.difference_update)(keys)

    def broken_by(self, side: str, keys: Set[Key], revisions: Mapping[int, Revision]) -> MergeSide:
        """Describe what one side did that breaks a rule with what the other one did."""
        traces = self._sides[side].traces
        own = sorted((traces[key].last, key) for key in keys & traces.keys())
        said = [traces[key].now or f"(not {traces[key].name})" for _, key in own]
        text = f"(and {' '.join(said)})" if len(said) > 1 else next(iter(said), None)
        return MergeSide(text, revisions.get(own[-1][0]) if own else None)

    def _owner(self, key: Key) -> str:
        """Return the side that has what the other has deleted."""
        return THEIRS if self.text(OURS, key) is None else OURS

    def _refuse_opposite(self, key: Key, users: Iterable[Key], decided: Mapping[Key, str]) -> None:
        for user in users:
            if decided.get(user, decided[key]) != decided[key]:
                raise InvalidArgumentError(
                    f"{self.element(key)!r} is decided as {decided[key]!r} and "
                    f"{self.element(user)!r}, which mentions it, as {decided[user]!r}: decide both "
                    "alike"
                )

    def _is_on(self, side: str, key: Key) -> bool:
        """Return whether the result has an element as a side has it, unlike the other."""
        is_brought = key in self.brought
        return is_brought == (side == THEIRS) and self.text(side, key) is not None

    def _users(self, side: str, key: Key) -> list[Key]:
        """Return what a side has changed that mentions something of which the other has nothing."""
        if side not in self._uses:
            traces, definitions, *_ = self._sides[side]
            kinds = ((kind, one) for kind in KINDS for one in definitions.elements(kind))
            known = {key_of(kind, one): one for kind, one in kinds}
            uses: dict[Key, list[Key]] = {}
            for user in traces:
                text = self.text(side, user)
                if text is not None and not self._agree(user):
                    mentioned = mentions_of(user, text, known.get(user), definitions)
                    for each in mentioned & self._deleted:
                        uses.setdefault(each, []).append(user)
            self._uses[side] = uses
        return self._uses[side].get(key, [])

    def wanted(self) -> dict[Key, str | None]:
        """Return what the elements are to say that are taken over."""
        return {key: self.text(THEIRS, key) for key in sorted(self.brought)}

    def changes(self) -> Iterator[Change]:
        """Yield what is taken over as changes of what is here."""
        for key in self.brought:
            for sign, side in ((ASSERTED, THEIRS), (RETRACTED, OURS)):
                text = self.text(side, key)
                if text is not None:
                    yield Change(sign, key[0], text)
        yield from (Change(ASSERTED, SAYING, said.text) for said in self.said)

    def refuse_pseudonyms(self) -> None:
        """Refuse what names somebody by what both erased somebody as: it may be two."""
        both = set.intersection(*(side.pseudonyms for side in self._sides.values()))
        for change in self.changes() if both else ():
            if both & {*tokenize(change.text)}:
                remedy = "decide 'ours'" if change.kind == SAYING else "delete it in the branch"
                raise ConflictError(
                    f"{change.kind} {change.text} names an object that was erased in the branch; "
                    f"another may be called so here since an erasure: {remedy}"
                )

    def element(self, key: Key) -> str:
        """Return what an element is decided by."""
        trace = self._sides[THEIRS].traces.get(key) or self._sides[OURS].traces[key]
        return f"{key[0]} {trace.name}".strip()

    def numbers(self, side: str, broken: Iterable[Key]) -> set[int]:
        """Return the revisions by which a side changed what is in conflict, or breaks rules."""
        traces, place = self._sides[side].traces, 0 if side == THEIRS else 1
        sayings = [pair[place] for pair in self.sayings if pair[1] is not None]
        said = {each.number for each in sayings if each is not None}
        return said | {traces[key].last for key in (*self.conflicts, *broken) if key in traces}

    def side(self, side: str, key: Key, revisions: Mapping[int, Revision]) -> MergeSide:
        """Describe one side of a conflict."""
        traces = self._sides[side].traces
        trace = traces.get(key)
        by, users = self.conflicts[key]
        used = [f"{one[0]} {traces[one].name}" for one in users] if by == side else []
        revision = None if trace is None else revisions.get(trace.last)
        return MergeSide(self.text(side, key), revision, tuple(sorted(used)))

    def base(self, key: Key) -> str | None:
        """Return what an element was in the base."""
        own = self._sides[THEIRS].traces.get(key)
        return self._sides[OURS].traces[key].before if own is None else own.then


def _is_of(key: Key, kind: str | None, words: Sequence[str | None]) -> bool:
    """Return whether a fact or a value has this name and these objects; None stands for any."""
    own = tokenize(key[1])[1:-1]
    return (
        key[0] == kind
        and len(own) == len(words)
        and all(word in (None, each) for word, each in zip(words, own, strict=True))
    )
