"""In which order a document says things: as it was loaded, then what came later."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import TypeVar

from sqlalchemy import select

from ..backends import Query, in_rows
from ..dto.name import ROOT_TYPE, fold
from ..errors import ConflictError
from ..knowledge.definitions import Definitions
from ..knowledge.document import DOMAIN, PROBLEM, DocumentDefinition, Item, document_text
from ..knowledge.formula import GOAL
from ..knowledge.loading import KB
from ..tables import PropositionRow, PropositionVersionRow
from ..transaction import Transaction
from .constants import constant_ids

REQUIREMENT = "requirement"
# It is there without being said: only an item, as of older versions, shows that the domain says it.
_SAID_ROOT = Item("type", ROOT_TYPE)
_OPEN = select(PropositionVersionRow.proposition_id).where(
    PropositionVersionRow.kb_id == KB, PropositionVersionRow.until.is_(None)
)
_GOALS = Query(
    select(PropositionRow.id, PropositionRow.text).where(
        PropositionRow.kb_id == KB, PropositionRow.is_goal, in_rows(PropositionRow.id, _OPEN)
    )
)

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
    names = () if document is None else document.names(section)
    return [by_key[name] for name in _placed(by_key, names)]


def _placed(known: Iterable[str], names: Iterable[str]) -> list[str]:
    """Put the known names that are listed first, as often as they are, and then the others."""
    rest = dict.fromkeys(known)
    listed = [name for name in names if name in rest]
    for name in listed:
        rest.pop(name, None)
    return [*listed, *rest]


def put_document(
    transaction: Transaction,
    name: str,
    title: str,
    domain: str | None,
    items: Iterable[Item],
    replace: bool,
) -> None:
    """Store what a loaded document is called, and in which order it says what it says.

    A merge writes nothing for what it adds: new elements follow the others in the order in which
    they were first known. It writes a version only for what no element shows, and that version
    lists only the sections whose order differs from that of the elements.

    Args:
        transaction: the transaction, in which the document's elements are stored.
        name: `domain` or `problem`.
        title: what it is called.
        domain: the name of a problem's domain.
        items: its places, section by section.
        replace: whether only these count.
    """
    stored = find_document(transaction.definitions, name)
    if stored is not None and not replace:
        added = _unshown(stored, list(items))
        if not added and _is_same_domain(stored.domain, domain):
            return
        # Titles agree but for their spelling, and the first spelling stays.
        title = stored.title
        items = [*_needed(transaction, stored, added), *added]
    # The tables keep the order within a section; the sections' own order is that of their names.
    places = tuple(sorted(items, key=lambda item: item.section))
    id_ = stored.id if stored else transaction.intern("document", name)[0]
    text = document_text(name, title, domain, places)
    definition = DocumentDefinition(id_, name, title, domain, places, text)
    transaction.define("document", definition)


def _is_same_domain(stored: str | None, domain: str | None) -> bool:
    """Compare the names of a problem's domain; a domain has none."""
    return fold(stored or "") == fold(domain or "")


def _unshown(stored: DocumentDefinition, items: list[Item]) -> list[Item]:
    """Find the new items that the elements alone would not show."""
    known, times = set(stored.items), Counter(items)
    return [
        item
        for item in items
        if item not in known and (item.section == REQUIREMENT or times[item] > 1)
    ]


def _needed(transaction: Transaction, stored: DocumentDefinition, added: list[Item]) -> list[Item]:
    """Give the items of a document, without the sections that are in the order of the elements."""
    sections: dict[str, list[Item]] = {}
    for item in stored.items:
        sections.setdefault(item.section, []).append(item)
    changed = {item.section for item in added} | {REQUIREMENT}
    needed: list[Item] = []
    for section, items in sections.items():
        is_needed = section in changed or _SAID_ROOT in items
        if not is_needed:
            keys = _keys(transaction, section)
            is_needed = _placed(keys, [item.name for item in items]) != keys
        needed += items if is_needed else []
    return needed


def _keys(transaction: Transaction, section: str) -> list[str]:
    """Give the names under which a document has the elements of a section, oldest first."""
    definitions = transaction.definitions
    if section in ("constant", "object"):
        constants, is_constant = constant_ids(definitions), section == "constant"
        objects = definitions.objects
        return [fold(each.name) for each in objects if (each.id in constants) == is_constant]
    if section in ("type", "predicate", "function", "action"):
        names = (fold(each.name) for each in definitions.elements(section))
        return [name for name in names if Item(section, name) != _SAID_ROOT]
    formulas = [each.name for each in definitions.formulas if each.section == section]
    if section != GOAL:
        return formulas
    # Those that are atoms come first.
    transaction.flush()
    goals = transaction.session.rows(_GOALS, kb=transaction.kb_id)
    return [*(text for _, text in sorted(goals)), *formulas]
