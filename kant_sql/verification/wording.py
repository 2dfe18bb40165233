"""What the rows behind a text must be, so that the text can be read in one way only.

A name with a space in it would make one of two: the text of a fact about an object `rb1 wp1` is
that of one about `rb1` and `wp1`. The library writes no such name: where one is, it was put there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation

from ..dto.number import decimal_text
from ..errors import InvalidKnowledgeError
from ..knowledge.document import DocumentDefinition
from ..knowledge.formula import DOMAIN_SECTIONS, GOAL, PROBLEM_SECTIONS, FormulaDefinition
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree import PREDICATE

# What separates the words of a text is in none of them.
_WORD = r"[^\s()?]+"
_IS_WORD = re.compile(_WORD).fullmatch
_IS_ITEM = re.compile(rf"{_WORD}|\({_WORD}( {_WORD})*\)").fullmatch
_IS_REQUIREMENT = re.compile(r":[^\s()]+").fullmatch
_FORMULA_SECTIONS = frozenset((*DOMAIN_SECTIONS, *PROBLEM_SECTIONS))
_ELEMENTS = ("requirement", "type", "constant", "predicate", "function", "action", "object")
_DOCUMENT_SECTIONS = _FORMULA_SECTIONS.union(_ELEMENTS)


def is_word(text: str) -> bool:
    """Tell whether a text is one word: what is a name is one.

    Args:
        text: the text.

    Returns:
        Whether it is.
    """
    return _IS_WORD(text) is not None


def is_decimal(text: str | None) -> bool:
    """Tell whether a text is a number as the library writes numbers.

    Args:
        text: the text.

    Returns:
        Whether it is.
    """
    try:
        return text is not None and decimal_text(Decimal(text)) == text
    except (InvalidOperation, InvalidKnowledgeError):
        return False


def is_end(until: object, since: int) -> bool:
    """Tell whether something can end there.

    Args:
        until: where it ends, which on SQLite may be infinite, beyond all revisions.
        since: where it begins.

    Returns:
        Whether it can.
    """
    return isinstance(until, int) and until > since


def parameter_fault(parameters: tuple[ParameterDefinition, ...]) -> str | None:
    """Find a parameter that its text would not show as one.

    Args:
        parameters: the parameters.

    Returns:
        What is wrong; None when nothing is.
    """
    wrong = next((each.name for each in parameters if not is_word(each.name)), None)
    return None if wrong is None else f"no parameter can be called {wrong!r}"


def formula_fault(formula: FormulaDefinition) -> str | None:
    """Find what would make a formula look like something else in what a revision changed.

    Args:
        formula: the formula.

    Returns:
        What is wrong; None when nothing is.
    """
    if formula.section not in _FORMULA_SECTIONS:
        return f"there is no section {formula.section!r}"
    root = formula.tree[0]
    is_atom = root.operator == PREDICATE and all(term.object_id is not None for term in root.terms)
    if formula.section == GOAL and is_atom:
        return "a goal that is a ground atom is a proposition"
    return None


def document_fault(document: DocumentDefinition) -> str | None:
    """Find what a document's text would not show as what it is.

    Args:
        document: the document.

    Returns:
        What is wrong; None when nothing is.
    """
    return next(_document_faults(document), None)


def _document_faults(document: DocumentDefinition) -> Iterator[str]:
    for name in (document.title, document.domain):
        if name is not None and not is_word(name):
            yield f"no {document.name} can be called {name!r}"
    for section, name in document.items:
        if section not in _DOCUMENT_SECTIONS:
            yield f"there is no section {section!r}"
        # Older versions took a requirement with a question mark: it is one word all the same.
        if (_IS_REQUIREMENT if section == "requirement" else _IS_ITEM)(name) is None:
            yield f"{name!r} is no item of it"
