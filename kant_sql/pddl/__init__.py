"""PDDL text and what it says: read it, look at it as a document, write it."""

from __future__ import annotations

from .document import Action, Domain, Function, FunctionValue, PddlWarning, Predicate, Problem
from .reader import read, read_domain, read_problem
from .requirements import used_requirements
from .writer import write

__all__ = [
    "Action",
    "Domain",
    "Function",
    "FunctionValue",
    "PddlWarning",
    "Predicate",
    "Problem",
    "read",
    "read_domain",
    "read_problem",
    "used_requirements",
    "write",
]
