"""In which order a document says things: as it was loaded, then what came later."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from ..dto.name import fold
from ..errors import ConflictError
from ..knowledge.definitions import Definitions
from ..knowledge.document import DOMAIN, PROBLEM, DocumentDefinition, Item, document_text
from ..transaction import Transaction

T = TypeVar("T")


def find_document(definitions: Definitions, name: str) -> DocumentDefinition | None:
    """Find what is known of a document.

    Args:
        definitions: what is defined.
        name: `domain` or `problem`.

    Returns:
        The document; None when none was loaded.
    """
    return definitions.documents.named(name)


def check_title(stored: DocumentDefinition, title: str) -> None:
    """Refuse to merge a document into one that is called something else.

    Args:
        stored: the document that is stored.
        title: what the other one is called.

    Raises:
        ConflictError: it is another name.
    """
    if fold(stored.title) != fold(title):
        raise ConflictError(
            f"{stored.name} {stored.title!r} is stored, but the document is {stored.name} "
            f"{title!r}; load it with mode='replace'"
        )


def domain_title(definitions: Definitions, default_name: str) -> str:
    """Find what the domain is called.

    Args:
        definitions: what is defined.
        default_name: what it is called when no document says so.

    Returns:
        Its name: the one that it was loaded with, or else the one that the problem gives it.
    """
    domain, problem = (find_document(definitions, name) for name in (DOMAIN, PROBLEM))
    if domain is not None:
        return domain.title
    return default_name if problem is None or problem.domain is None else problem.domain


def ordered(
    things: Iterable[T],
    key: Callable[[T], str],
    document: DocumentDefinition | None,
    section: str,
) -> list[T]:
    """Put things in the order of a document.

    Args:
        things: the things that there are, in the order in which each was first known.
        key: gives the name under which the document has a thing.
        document: the document, if there is one.
        section: its section.

    Returns:
        The things: those that the document names, as often as it does, and then the others.
    """
    by_key = {key(thing): thing for thing in things}
    names = [] if document is None else [name for name in document.names(section) if name in by_key]
    rest = dict.fromkeys(by_key)
    for name in names:
        rest.pop(name, None)
    return [by_key[name] for name in (*names, *rest)]


def put_document(
    transaction: Transaction, name: str, title: str, domain: str | None, items: Iterable[Item]
) -> None:
    """Let a document be called, and ordered, as it was loaded.

    Args:
        transaction: the transaction.
        name: `domain` or `problem`.
        title: what it is called.
        domain: the name of a problem's domain.
        items: its places, section by section.
    """
    # The tables keep the order within a section; the sections' own order is that of their names.
    places = tuple(sorted(items, key=lambda item: item.section))
    stored = find_document(transaction.definitions, name)
    id_ = stored.id if stored else transaction.intern("document", name)[0]
    text = document_text(name, title, domain, places)
    definition = DocumentDefinition(id_, name, title, domain, places, text)
    transaction.define("document", definition)


def merged(stored: DocumentDefinition | None, items: Iterable[Item], replace: bool) -> list[Item]:
    """Put what a document said before ahead of what it says now.

    Args:
        stored: the document before, if there was one.
        items: the places now.
        replace: whether only these count.

    Returns:
        The places.
    """
    now = list(items)
    if stored is None or replace:
        return now
    known = set(stored.items)
    return [*stored.items, *(item for item in now if item not in known)]
