"""What a formula that stands on its own is, at one revision."""

from __future__ import annotations

import hashlib
from typing import NamedTuple

from .tree import Tree

DERIVED_PREDICATE, DOMAIN_CONSTRAINT = "derived", "domain constraint"
INITIAL, TIMED, GOAL, CONSTRAINT, METRIC = "initial", "timed", "goal", "constraint", "metric"
DOMAIN_SECTIONS = (DERIVED_PREDICATE, DOMAIN_CONSTRAINT)
PROBLEM_SECTIONS = (INITIAL, TIMED, GOAL, CONSTRAINT, METRIC)


class FormulaDefinition(NamedTuple):
    """A derived predicate's rule, a goal, a constraint, the metric ...

    Attributes:
        id: the identity's id.
        name: what interns it: the SHA-256 of section and text.
        section: the part of the domain or the problem that it stands in.
        tree: the formula.
        text: the canonical PDDL text.
    """

    id: int
    name: str
    section: str
    tree: Tree
    text: str


def formula_name(section: str, text: str) -> str:
    """Give what interns a formula.

    Args:
        section: the part of the domain or the problem that it stands in.
        text: its canonical PDDL text.

    Returns:
        The SHA-256 of both, a line feed between them, as hexadecimal digits.
    """
    return hashlib.sha256(f"{section}\n{text}".encode()).hexdigest()
