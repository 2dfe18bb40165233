"""The truth at a time, as known at a time: a list of sayings and plain changes, replayed.

A saying has an element, its content, a period, and its revision. A plain change has the content
from its revision on. The content of a fact is True or False; that of a fluent is its value, as
text, or None.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from random import Random
from typing import Any, NamedTuple

from kant_sql import KnowledgeBase

Content = bool | str | None
DOMAIN = """
(define (domain clocks) (:requirements :typing :fluents :object-fluents)
  (:types robot room) (:predicates (at ?r - robot ?p - room) (clean ?p - room) (open))
  (:functions (battery ?r - robot) - number (home ?r - robot) - room))
"""
OBJECTS = {"robot": ("r1", "r2"), "room": ("hall", "lab", "attic")}
FACTS = (
    *(f"(at {robot} {room})" for robot in OBJECTS["robot"] for room in OBJECTS["room"]),
    *(f"(clean {room})" for room in OBJECTS["room"]),
    "(open)",
)
FLUENTS = tuple(
    f"({function} {robot})" for function in ("battery", "home") for robot in OBJECTS["robot"]
)


class Saying(NamedTuple):
    """A statement about a period by a revision."""

    element: str
    content: Content
    valid_from: datetime
    valid_until: datetime
    since: int


class Plain(NamedTuple):
    """A content from a revision on."""

    element: str
    content: Content
    since: int


@dataclass
class Model:
    """All sayings and changes, and the times of the revisions, the first at 1."""

    sayings: list[Saying] = field(default_factory=list)
    plain: list[Plain] = field(default_factory=list)
    times: dict[int, datetime] = field(default_factory=dict)

    def truth(self, element: str, valid: datetime, known: int) -> Content:
        """Return the content of an element at a time, as known at a revision."""
        for one in reversed(self.sayings):
            is_known = one.element == element and one.since <= known
            if is_known and one.valid_from <= valid < one.valid_until:
                return one.content
        begun = (n for n, at in self.times.items() if at <= valid)
        return self.then(element, min(known, max(begun, default=0)))

    def then(self, element: str, revision: int) -> Content:
        """Return the content of an element at a revision, by plain changes."""
        for one in reversed(self.plain):
            if one.element == element and one.since <= revision:
                return one.content
        return False if element in FACTS else None

    def moments(self) -> list[datetime]:
        """Return every time of a possible change, and the times right beside it."""
        ends = {end for one in self.sayings for end in one[2:4]} | {*self.times.values()}
        beside = (timedelta(0), timedelta(microseconds=1), timedelta(microseconds=-1))
        return sorted({end + by for end in ends for by in beside})


class Writer:
    """Writes a random history through the library, and the same into a model."""

    def __init__(self, kb: KnowledgeBase, seed: int = 0) -> None:
        self.kb = kb
        self.model = Model()
        self.random = Random(seed)
        self.elements = [*FACTS, *FLUENTS]
        kb.load_domain(DOMAIN)
        kb.load_problem(
            "(define (problem p) (:domain clocks) (:objects "
            + " ".join(f"{' '.join(names)} - {kind}" for kind, names in OBJECTS.items())
            + ") (:init) (:goal (and)))"
        )
        self.note()

    def run(self, revisions: int) -> Model:
        """Write some revisions."""
        for _ in range(revisions):
            self.step()
        return self.model

    def step(self) -> None:
        """Write one revision: about now, about a period, or about the time from one on."""
        kind = self.random.choice(("plain", "plain", "closed", "closed", "open"))
        moments = [*self.model.times.values()]
        before = moments[0] - timedelta(seconds=2)
        picked = [
            before + (moments[-1] - before) * self.random.random()
            if self.random.random() < 0.5
            else self.random.choice([*moments, *(s.valid_from for s in self.model.sayings[-5:])])
            for _ in range(2)
        ]
        begin, end = min(picked), max(picked)
        elements = self.random.sample(self.elements, self.random.randint(1, 4))
        contents = {one: self.content(one) for one in elements}
        if kind == "plain":
            self.write(contents)
        elif kind == "open":
            self.write(contents, begin)
        elif begin < end:
            self.write(contents, begin, end)

    def write(
        self,
        contents: dict[str, Content],
        valid_from: datetime | None = None,
        valid_until: datetime | None = None,
        **given: Any,
    ) -> None:
        """Write the contents of some elements, in one revision."""
        with self.kb.transaction(valid_from=valid_from, valid_until=valid_until, **given):
            for element, content in contents.items():
                set_content(self.kb, element, content)
        if not self.note():
            return
        number = max(self.model.times)
        for element, content in contents.items():
            if valid_from is not None:
                until = valid_until or self.model.times[number]
                self.model.sayings.append(Saying(element, content, valid_from, until, number))
            if valid_until is None:
                self.model.plain.append(Plain(element, content, number))

    def content(self, element: str) -> Content:
        """Choose the content of an element."""
        if element in FACTS:
            return self.random.random() < 0.5
        if self.random.random() < 0.3:
            return None
        if element.startswith("(home"):
            return self.random.choice(OBJECTS["room"])
        return str(self.random.randint(0, 9))

    def note(self) -> bool:
        """Record the times of new revisions; return whether there is one."""
        known = max(self.model.times, default=0)
        new = {one.number: one.committed_at for one in self.kb.store.revisions(known)}
        self.model.times.update(new)
        return bool(new)


def set_content(kb: KnowledgeBase, element: str, content: Content) -> None:
    """Set the content of an element."""
    if element in FACTS:
        (kb.propositions.save if content else kb.propositions.delete)(element)
    elif content is None:
        kb.function_values.unset(element)
    else:
        number = isinstance(content, str) and content.isdecimal()
        kb.function_values.set(element, value=int(content) if number else str(content))
