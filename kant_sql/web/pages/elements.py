"""The pages of a fact or another element, of an object, and of definitions by their names."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import SequenceMatcher
from typing import Annotated

from fastapi import Query
from typing_extensions import TypedDict

from ...history.element_pages import (
    StepLine,
    VersionsPage,
    read_object_page,
    read_versions_page,
)
from ...history.state_parts import StateFilter, read_state
from ...json_documents import (
    ChangeDocument,
    RevisionDocument,
    VersionDocument,
    revision_document,
    version_document,
)
from ...knowledge_base import KnowledgeBase, state_of
from ..parameters import Before
from ..registry import Pages
from ..rendering import address_of

PAGES = Pages("elements")

VERSIONS, CHANGES, HELD = 50, 100, 50
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


class StepLineDocument(TypedDict):
    """A step of a recorded plan, with what became of it."""

    plan: int
    position: int
    text: str
    status: str | None


class ElementDocument(TypedDict):
    """A page of the history of an element, the newest version first.

    On the first page `latest` has the newest version of each kind: without `until`, it holds now.
    `archived`: what ended up to this revision is in an archive, 0 if there is none.
    """

    text: str
    latest: list[VersionDocument]
    versions: list[VersionDocument]
    before: int | None
    head: str | None
    objects: list[str]
    steps: list[StepLineDocument]
    archived: int


class InvolvedDocument(ChangeDocument):
    """A change of what names an object, and the revision that made it."""

    revision: RevisionDocument


class SinceDocument(TypedDict):
    """An element that holds, and the revision that asserted it."""

    kind: str
    text: str
    since: RevisionDocument


class ObjectDocument(TypedDict):
    """An object: its definitions over time, what holds of it, and all that involved it.

    `held` has the first of the elements that name it now; `is_cut` says whether there are more. The
    next page of `changes` has the parameter `before`.
    """

    name: str
    versions: list[VersionDocument]
    held: list[SinceDocument]
    is_cut: bool
    changes: list[InvolvedDocument]
    before: int | None
    searched: int | None
    steps: list[StepLineDocument]
    actions: list[str]
    archived: int


class DefinitionVersionDocument(VersionDocument):
    """A version of a definition; `difference` has the lines that differ from the one before.

    Each line begins with `+ `, `- ` or two spaces.
    """

    difference: list[str]


class DefinitionDocument(TypedDict):
    """A definition over time, the newest version first, and the steps of plans that used it."""

    kind: str
    name: str
    versions: list[DefinitionVersionDocument]
    before: int | None
    steps: list[StepLineDocument]
    archived: int


def _steps(steps: list[StepLine]) -> list[StepLineDocument]:
    return [
        {"plan": one.plan, "position": one.position, "text": one.text, "status": one.status}
        for one in steps
    ]


@PAGES.page("/fact", "fact.html", rows=["versions"])
def fact(kb: KnowledgeBase, text: FactText, before: Before = None) -> ElementDocument:
    """Show who asserted and retracted an element, when and why, and what is related to it."""
    found = read_versions_page(state_of(kb), text, before=before, limit=VERSIONS)
    return {
        "text": text,
        "latest": [version_document(version) for version in found.latest],
        "versions": [version_document(version) for version in found.versions],
        "before": found.before,
        "head": found.head,
        "objects": list(dict.fromkeys(found.objects)),
        "steps": _steps(found.steps),
        "archived": found.archived,
    }


@PAGES.page("/object", "object.html", rows=["changes"])
def object_(kb: KnowledgeBase, name: Name, before: Before = None) -> ObjectDocument:
    """Show everything that involves an object: now, and in the past, the newest first."""
    reader = state_of(kb)
    own = read_versions_page(reader, name, "object", limit=VERSIONS)
    found = read_object_page(reader, name, before, CHANGES)
    held = read_state(reader, None, StateFilter(object=name), limit=HELD)
    revisions = {number: revision_document(one) for number, one in found.revisions.items()}
    page = address_of("object", own.versions[0].text)
    return {
        "name": name if page is None else page.query["name"],
        "versions": [version_document(version) for version in own.versions],
        "held": [
            {
                "kind": one.kind,
                "text": one.text,
                "since": revision_document(held.revisions[one.since]),
            }
            for part in held.parts
            if part.kind != "object"
            for one in part.elements
        ],
        "is_cut": any(part.next is not None for part in held.parts),
        "changes": [
            {**change._asdict(), "revision": revisions[number]}  # type: ignore[typeddict-item]
            for number, change in found.involved.changes
        ],
        "before": found.involved.before,
        "searched": found.involved.searched,
        "steps": _steps(found.steps),
        "actions": found.constants,
        "archived": own.archived,
    }


@PAGES.page("/action", "definition.html", rows=["versions"])
def action(kb: KnowledgeBase, name: Name, before: Before = None) -> DefinitionDocument:
    """Show the definitions of an action, a process or an event over time, and its steps."""
    return _definition(kb, "action", name, before)


@PAGES.page("/predicate", "definition.html", rows=["versions"])
def predicate(kb: KnowledgeBase, name: Name, before: Before = None) -> DefinitionDocument:
    """Show the definitions of a predicate over time."""
    return _definition(kb, "predicate", name, before)


@PAGES.page("/function", "definition.html", rows=["versions"])
def function(kb: KnowledgeBase, name: Name, before: Before = None) -> DefinitionDocument:
    """Show the definitions of a function over time."""
    return _definition(kb, "function", name, before)


@PAGES.page("/type", "definition.html", rows=["versions"])
def type_(kb: KnowledgeBase, name: Name, before: Before = None) -> DefinitionDocument:
    """Show the definitions of a type over time."""
    return _definition(kb, "type", name, before)


def _definition(kb: KnowledgeBase, kind: str, name: str, before: int | None) -> DefinitionDocument:
    found = read_versions_page(state_of(kb), name, kind, before, VERSIONS)
    return {
        "kind": kind,
        "name": name,
        "versions": _compared(found),
        "before": found.before,
        "steps": _steps(found.steps),
        "archived": found.archived,
    }


def _compared(found: VersionsPage) -> list[DefinitionVersionDocument]:
    """Return versions, each with its difference to the one before."""
    texts = [version.text.expandtabs(2).split("\n") for version in found.versions]
    documents: list[DefinitionVersionDocument] = []
    for place, version in enumerate(found.versions):
        lines: list[str] = []
        older = texts[place + 1] if place + 1 < len(texts) else None
        if older is not None and max(len(older), len(texts[place])) <= MOST_LINES:
            lines = list(_difference(older, texts[place]))
        documents.append({**version_document(version), "difference": lines})
    return documents


def _difference(older: list[str], newer: list[str]) -> Iterator[str]:
    """Compare lines as wholes: to look for similar ones takes minutes where many differ."""
    for _, begin, end, first, last in SequenceMatcher(None, older, newer).get_opcodes():
        if older[begin:end] == newer[first:last]:
            yield from (f"  {line}" for line in newer[first:last])
        else:
            yield from (f"- {line}" for line in older[begin:end])
            yield from (f"+ {line}" for line in newer[first:last])
