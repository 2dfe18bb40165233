"""The parts of a demo: a world with a story, and the steps of its guided page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from kant_sql import KnowledgeBase

# Opens the knowledge base of a world for an actor.
Connect: TypeAlias = Callable[[str], KnowledgeBase]


class Step(NamedTuple):
    """A step of a guided page: a question, and three ways to its answer.

    Attributes:
        title: the question.
        text: the answer, and why it is interesting.
        path: the page with the answer.
        query: the parameters of the page, without the knowledge base.
        command: the words after `kant-sql`.
        python: an expression of the knowledge base `kb`.
    """

    title: str
    text: str
    path: str
    query: Mapping[str, object]
    command: str
    python: str


class World(NamedTuple):
    """A world of a demo.

    Attributes:
        name: its name, also the name of its knowledge base.
        line: its subject, in one line.
        about: its story.
        fill: writes its story to an empty knowledge base.
        steps: makes the steps of its page, with the times of the written story.
    """

    name: str
    line: str
    about: str
    fill: Callable[[Connect], None]
    steps: Callable[[KnowledgeBase], Sequence[Step]]
