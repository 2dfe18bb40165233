"""The changes of both sides of a merge since the branch began, and the effect of decisions."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from ..documents.carry import STATED, Key, is_same, key_of, mentions_of, name_in
from ..dto.lexical import fold
from ..errors import ConflictError, InvalidArgumentError, RuleViolatedError
from ..knowledge.definitions import DECLARED, KINDS, REFUSE, Definitions
from ..pddl.lexer import tokenize
from ..sql.changes import ASSERTED, ERASURE, RETRACTED, SAYING, Change, stream_changes
from ..sql.dialects.base import Session
from ..sql.rows import FACT, GOAL, VALUE
from .merge_sayings import MergeSaying, read_sayings
from .merged import OURS, THEIRS, Decision, MergeSide
from .revisions import Revision

ATOMS = {FACT, GOAL, VALUE}


@dataclass(eq=False, slots=True)
class Trace:
    """The changes of one element in a range of revisions."""

    name: str  # its name, as spelled
    first: int  # the first revision that changed it
    last: int = 0  # the last revision that changed it
    before: str | None = None  # its text before the range; None if it did not hold
    then: str | None = None  # its text at a revision within the range
    now: str | None = None  # its text after the range
    # The changes of revisions after that one.
    since: dict[int, str | None] = field(default_factory=dict)
    _asserted: int = 0

    def add(self, number: int, change: Change, split: int) -> None:
        """Add a change; within a revision, assertions come first."""
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
    """The changes of one side since the branch began."""

    traces: dict[Key, Trace]
    definitions: Definitions
    sayings: list[MergeSaying]  # sayings about periods
    pseudonyms: set[str]  # pseudonyms that erasures assigned


def read_side(
    session: Session, kb_id: int, definitions: Definitions, low: int, high: int, split: int
) -> SideChanges:
    """Read the changes of a range of revisions, in two statements."""
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
    """The two sides of a merge, and the result of decisions."""

    def __init__(self, base: int, merged: int, ours: SideChanges, theirs: SideChanges) -> None:
        """Compare the changes here since the base, and there since its last merge."""
        self._sides: dict[str, SideChanges] = {OURS: ours, THEIRS: theirs}
        # Definitions that others can mention, and definitions that only one side has.
        traces = (*ours.traces, *theirs.traces)
        self._mentioned = {key for key in traces if key[0] in DECLARED}
        texts = ((key, self.text(OURS, key), self.text(THEIRS, key)) for key in self._mentioned)
        self._deleted = {key for key, own, other in texts if (own is None) != (other is None)}
        # Changes to take over from the branch, and its sayings to take over.
        self.brought: set[Key] = set()
        self.said: list[MergeSaying] = []
        # Its sayings, with those that contradict them here.
        self.sayings: list[tuple[MergeSaying, MergeSaying | None]] = []
        # Elements in conflict, with the elements that use them, and their side.
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
        """Return the text of a changed element on one side."""
        own = self._sides[side].traces
        other = self._sides[THEIRS if side == OURS else OURS].traces
        return own[key].now if key in own else other[key].before

    def _agree(self, key: Key) -> bool:
        return is_same(key, self.text(OURS, key), self.text(THEIRS, key))

    @property
    def is_mixed(self) -> bool:
        """Whether a definition changed that the other side may rely on."""
        for key in self._mentioned:
            texts = {self.text(side, key) for side in self._sides}
            texts |= {one.traces[key].before for one in self._sides.values() if key in one.traces}
            if len(texts - {None}) > 1:
                return True
        return False

    def _find_used(self) -> None:
        """Find elements that one side deleted and the other uses, also because of a decision."""
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
        """Take over elements decided as `theirs`; undecided ones stay as they are here."""
        settled = {key: decided.get(key, OURS) for key in self.conflicts}
        found = settled
        while found:
            for key, side in found.items():
                (self.brought.add if side == THEIRS else self.brought.discard)(key)
            found = {}
            for key in self._deleted & settled.keys():
                side = self._owner(key)
                if not self._is_on(side, key):
                    # Elements that use it go with it.
                    users = [one for one in self._users(side, key) if self._is_on(side, one)]
                    if key in decided:
                        self._refuse_opposite(key, users, decided)
                    found |= dict.fromkeys(users, settled[key])
            settled |= found

    def read_by(self, error: RuleViolatedError) -> set[Key]:
        """Return the changes that only one side made to the knowledge that breaks a rule.

        This is the rule itself, if the side that saved it changed none of that knowledge.
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
        """Keep elements as one side has them."""
        (self.brought.update if decided == THEIRS else self.brought.difference_update)(keys)

    def broken_by(self, side: str, keys: Set[Key], revisions: Mapping[int, Revision]) -> MergeSide:
        """Describe the changes of one side that break a rule together with those of the other."""
        traces = self._sides[side].traces
        own = sorted((traces[key].last, key) for key in keys & traces.keys())
        said = [traces[key].now or f"(not {traces[key].name})" for _, key in own]
        text = f"(and {' '.join(said)})" if len(said) > 1 else next(iter(said), None)
        return MergeSide(text, revisions.get(own[-1][0]) if own else None)

    def _owner(self, key: Key) -> str:
        """Return the side that still has an element that the other has deleted."""
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
        """Return whether the result has an element as one side has it, and the other does not."""
        is_brought = key in self.brought
        return is_brought == (side == THEIRS) and self.text(side, key) is not None

    def _users(self, side: str, key: Key) -> list[Key]:
        """Return the changes of a side that mention an element that the other lacks."""
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
        """Return the new contents of the elements to take over."""
        return {key: self.text(THEIRS, key) for key in sorted(self.brought)}

    def changes(self) -> Iterator[Change]:
        """Yield the changes of the present state that the merge makes."""
        for key in self.brought:
            for sign, side in ((ASSERTED, THEIRS), (RETRACTED, OURS)):
                text = self.text(side, key)
                if text is not None:
                    yield Change(sign, key[0], text)
        yield from (Change(ASSERTED, SAYING, said.text) for said in self.said)

    @property
    def may_be_refused(self) -> bool:
        """Whether a store with these definitions may refuse the result."""
        rules = self._sides[OURS].definitions.elements("rule")
        is_ruled = any(rule.on_violation == REFUSE for rule in rules)
        return is_ruled or bool(self._shared) or any(kind not in ATOMS for kind, _ in self.brought)

    @property
    def _shared(self) -> set[str]:
        """The pseudonyms that both sides assigned."""
        return set.intersection(*(side.pseudonyms for side in self._sides.values()))

    def refuse_pseudonyms(self) -> None:
        """Refuse changes with a pseudonym that both sides assigned: it may mean two objects."""
        both = self._shared
        for change in self.changes() if both else ():
            if both & {*tokenize(change.text)}:
                remedy = "decide 'ours'" if change.kind == SAYING else "delete it in the branch"
                raise ConflictError(
                    f"{change.kind} {change.text} names an object that was erased in the branch; "
                    f"another may be called so here since an erasure: {remedy}"
                )

    def element(self, key: Key) -> str:
        """Return the name for decisions about an element."""
        trace = self._sides[THEIRS].traces.get(key) or self._sides[OURS].traces[key]
        return f"{key[0]} {trace.name}".strip()

    def numbers(self, side: str, broken: Iterable[Key]) -> set[int]:
        """Return the revisions in which a side changed conflicting or rule-breaking elements."""
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
        """Return the text of an element in the base."""
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
