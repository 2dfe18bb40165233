"""What the domain or the problem is called, and in which order it says what it says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

DOMAIN, PROBLEM = "domain", "problem"


class Item(NamedTuple):
    """A place in a document.

    Attributes:
        section: the part of the document.
        name: the element's name; for a goal that is a ground atom, its text.
    """

    section: str
    name: str


class DocumentDefinition(NamedTuple):
    """The domain, or the problem.

    Attributes:
        id: the identity's id.
        name: `domain` or `problem`.
        title: what it is called.
        domain: the name of a problem's domain.
        items: its places, in order within each section.
        text: all of it on one line.
    """

    id: int
    name: str
    title: str
    domain: str | None
    items: tuple[Item, ...]
    text: str

    def names(self, section: str) -> Iterator[str]:
        """Give the names of one section, in order.

        Args:
            section: the section.

        Yields:
            The names.
        """
        return (item.name for item in self.items if item.section == section)


def document_text(name: str, title: str, domain: str | None, items: tuple[Item, ...]) -> str:
    """Write a document down on one line.

    Args:
        name: `domain` or `problem`.
        title: what it is called.
        domain: the name of a problem's domain.
        items: its places.

    Returns:
        The text, for example `(define (domain depot) (:action load) (:type truck hoist))`.
    """
    sections: dict[str, list[str]] = {}
    for item in items:
        sections.setdefault(item.section, []).append(item.name)
    parts = [f"(:{section} {' '.join(names)})" for section, names in sections.items()]
    of = [] if domain is None else [f"(:domain {domain})"]
    return f"(define {' '.join([f'({name} {title})', *of, *parts])})"
