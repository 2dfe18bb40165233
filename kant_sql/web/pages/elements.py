"""The pages of elements: facts, objects, definitions by their names, and a search for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import partial
from typing import Annotated, Any, NamedTuple

from fastapi import Query

from ...errors import InvalidArgumentError, InvalidKnowledgeError, UnknownNameError
from ...history import element_pages
from ...history.plan_pages import StepLine
from ...history.revisions import Version
from ...knowledge_base import KnowledgeBase, state_of
from ...moment_text import parse_moment
from ...reasoning import CauseLinks
from ...sql.rows import FACT, VALUE
from ..cause_graph import draw_causes
from ..registry import Before, Pages
from ..rendering import link

PAGES = Pages("elements")

VERSIONS, CHANGES = 50, 100
# The number of consequences and origins of a fact, and their depth.
CAUSES, CAUSES_DEPTH = 20, 3
# A longer definition is not compared line by line.
MOST_LINES = 1_000

FactText = Annotated[
    str,
    Query(
        min_length=1,
        description="A fact, a goal or a fluent such as `(robot_at rb1 wp1)`, any other element in "
        "PDDL, or a name.",
    ),
]
Name = Annotated[str, Query(min_length=1, description="The name, in any case.")]


@dataclass(frozen=True)
class DefinitionVersion:
    """A version of a definition; `difference` has the lines that differ from the one before.

    Each line begins with `+ `, `- ` or two spaces.
    """

    _json_ = "*version", "difference"

    version: Version
    difference: list[str]


class DefinitionPage(NamedTuple):
    """A definition over time, the newest version first, and the steps of plans that used it."""

    kind: str
    name: str
    versions: list[DefinitionVersion]
    before: int | None
    steps: list[StepLine]
    archived: int


@dataclass(frozen=True)
class FactPage:
    """A page of versions, and the consequences and origins of a fact or a value."""

    _json_ = "*element", "consequences", "origins"

    element: element_pages.ElementPage
    consequences: CauseLinks | None
    origins: CauseLinks | None


def _drawn(page: FactPage, query: Mapping[str, Any]) -> str:
    """Draw the origins and the consequences of an element."""
    if page.origins is None or page.consequences is None:
        return ""
    return draw_causes(page.origins, page.consequences, partial(link, kb=query["kb"]))


@PAGES.page("/fact", "fact.html", rows=["versions"], draw=_drawn)
def fact(kb: KnowledgeBase, text: FactText, before: Before = None) -> FactPage:
    """Show who asserted and retracted an element, when and why, and related steps and causes.

    Derived facts, and elements that occur only in sayings, have no versions.
    """
    try:
        found = element_pages.read_element_page(state_of(kb), text, before=before, limit=VERSIONS)
    except UnknownNameError:
        page = None if before is not None else _without_versions(kb, text)
        if page is None:
            raise
        return page
    if before is not None or not {FACT, VALUE} & {one.kind for one in found.latest}:
        return FactPage(found, None, None)
    return FactPage(found, *_causes(kb, text))


def _causes(kb: KnowledgeBase, text: str) -> tuple[CauseLinks, CauseLinks]:
    links = {"depth": CAUSES_DEPTH, "limit": CAUSES}
    return kb.consequences(text, **links), kb.origins(text, **links)


def _without_versions(kb: KnowledgeBase, text: str) -> FactPage | None:
    """Show the causes of a derived fact or of an absence, or the sayings about an element."""
    page = element_pages.ElementPage(text, [], [], None, None, [], [], 0)
    with suppress(InvalidKnowledgeError):
        for literal in (text, f"(not {text})"):
            causes = _causes(kb, literal)
            if any(causes):
                return FactPage(page, *causes)
    lanes = kb.timeline(text=text, kinds=(FACT, VALUE), unchanged=True, clock="valid").lanes
    return FactPage(page, None, None) if any(lane.text == text for lane in lanes) else None


@PAGES.page("/object", "object.html", rows=["changes"])
def object_(kb: KnowledgeBase, name: Name, before: Before = None) -> element_pages.ObjectPage:
    """Show everything that involves an object: now, and in the past, the newest first."""
    return element_pages.read_object_page(state_of(kb), name, before, CHANGES)


def _add_definition_page(kind: str, name: str) -> None:
    def definition(kb: KnowledgeBase, name: Name, before: Before = None) -> DefinitionPage:
        found = element_pages.read_element_page(state_of(kb), name, kind, before, VERSIONS)
        versions = _compared(found)
        return DefinitionPage(kind, name, versions, found.before, found.steps, found.archived)

    definition.__name__ = kind
    definition.__doc__ = f"Show the definitions of {name} over time."
    PAGES.page(f"/{kind}", "definition.html", rows=["versions"])(definition)


for _kind, _name in (
    ("action", "an action, a process or an event"),
    ("predicate", "a predicate"),
    ("function", "a function"),
    ("type", "a type"),
):
    _add_definition_page(_kind, _name)


def _compared(found: element_pages.ElementPage) -> list[DefinitionVersion]:
    """Return versions, each with its difference to the one before."""
    texts = [version.text.expandtabs(2).split("\n") for version in found.versions]
    compared = []
    for place, version in enumerate(found.versions):
        lines: list[str] = []
        older = texts[place + 1] if place + 1 < len(texts) else None
        if older is not None and max(len(older), len(texts[place])) <= MOST_LINES:
            lines = list(_difference(older, texts[place]))
        compared.append(DefinitionVersion(version, lines))
    return compared


def _difference(older: list[str], newer: list[str]) -> Iterator[str]:
    """Compare lines as wholes: to look for similar ones takes minutes where many differ."""
    for _, begin, end, first, last in SequenceMatcher(None, older, newer).get_opcodes():
        if older[begin:end] == newer[first:last]:
            yield from (f"  {line}" for line in newer[first:last])
        else:
            yield from (f"- {line}" for line in older[begin:end])
            yield from (f"+ {line}" for line in newer[first:last])


SEARCH = Pages("search")

# Matches on a page.
MATCHES = 100

Sought = Annotated[
    str,
    Query(
        description="Part of a name or of a fact, a revision's number, or a time.",
        max_length=10_000,
    ),
]


class SearchPage(NamedTuple):
    """The matches; `revision` and `moment` if the text is a revision's number or a time.

    `matches` has exact names first, then names that begin with the text, then facts of the object
    of this name, then other matches. `is_cut`: there may be more.
    """

    q: str
    revision: int | None
    moment: str | None
    matches: list[element_pages.SearchMatch]
    is_cut: bool


@SEARCH.page("/search", "search.html", rows=["matches"])
def search(kb: KnowledgeBase, q: Sought = "") -> SearchPage:
    """Find objects, definitions, facts, values, actors or a revision by a part of a name."""
    text = q.strip()
    moment = None
    with suppress(InvalidArgumentError):
        moment = parse_moment(text) if text else None
    is_revision = isinstance(moment, int) and 0 < moment <= kb.revision
    matches, is_cut = element_pages.read_matches(state_of(kb), text, MATCHES)
    return SearchPage(
        q,
        moment if is_revision and isinstance(moment, int) else None,
        text if moment is not None and not isinstance(moment, int) else None,
        matches,
        is_cut,
    )
