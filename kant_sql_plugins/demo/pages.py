"""The guided page of a world."""

from __future__ import annotations

from typing import NamedTuple

from jinja2 import ChoiceLoader, PackageLoader

from kant_sql.errors import UnknownNameError
from kant_sql.knowledge_base import KnowledgeBase, state_of
from kant_sql.web.registry import Pages
from kant_sql.web.rendering import environment, link

from .worlds import find

PAGES = Pages("Guide")
_templates = environment()
_templates.loader = ChoiceLoader([_templates.loader, PackageLoader(__package__)])  # type: ignore


class GuideStep(NamedTuple):
    """A question, the page with its answer and address, and the same at a prompt and in Python."""

    title: str
    text: str
    page: str
    address: str
    command: str
    python: str


class Guide(NamedTuple):
    """The guided page of a world: the story, and the steps."""

    name: str
    about: str
    steps: list[GuideStep]


@PAGES.page("/guide", "guide.html", rows=["steps"])
def guide(kb: KnowledgeBase) -> Guide:
    """Show the steps through the story of a demo."""
    name = state_of(kb).store.name
    world = find(name)
    if world is None:
        raise UnknownNameError(f"the knowledge base {name!r} is not of a demo")
    steps = [
        GuideStep(
            step.title,
            step.text,
            step.path[1:].capitalize(),
            link(step.path, kb=name, **step.query),
            f"kant-sql {step.command}",
            step.python,
        )
        for step in world.steps(kb)
    ]
    return Guide(world.name, world.about, steps)
