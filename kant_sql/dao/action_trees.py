"""The three trees of an action: its duration, its condition and its effect."""

from __future__ import annotations

from collections.abc import Sequence

from ..dto.formula import And, Node
from ..errors import InvalidKnowledgeError
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree import Tree
from ..pddl.conjuncts import flatten
from ..pddl.document import DURATIVE_ACTION
from ..transaction import Transaction
from .term_writer import Place
from .tree_writer import TreeWriter

Trees = tuple[Tree, Tree, Tree]


def action_trees(
    transaction: Transaction,
    kind: str,
    name: str,
    parameters: Sequence[ParameterDefinition],
    duration: Sequence[Node],
    condition: Sequence[Node],
    effect: Sequence[Node],
) -> Trees:
    """Check what an action is made of, and make its trees.

    Args:
        transaction: the transaction.
        kind: `action`, `durative-action`, `process` or `event`.
        name: its name.
        parameters: its parameters.
        duration: the conjuncts of the constraints on the duration.
        condition: the conjuncts of its condition.
        effect: the conjuncts of its effect.

    Returns:
        Duration, condition and effect.

    Raises:
        InvalidKnowledgeError: a part is not well formed; the message says which and why.
    """
    durative = kind == DURATIVE_ACTION
    if duration and not durative:
        raise InvalidKnowledgeError(f"{kind} {name!r} has a duration; only a {DURATIVE_ACTION} has")

    def tree(section: str, formulas: Sequence[Node], place: Place) -> Tree:
        role = f"the {section} of {kind.rpartition('-')[2]} {name!r}"
        writer = TreeWriter(transaction, role, parameters, kind)
        own: list[Node] = []
        for formula in formulas:
            own += flatten(formula) if isinstance(formula, And) else (formula,)
        if place is not Place.DURATION:
            return writer.conjunction(own, place)
        if len(own) == 1:
            return writer.tree(own[0], place)
        return writer.conjunction(own, place) if own else ()

    return (
        tree("duration", duration, Place.DURATION),
        tree("condition", condition, Place.TIMED_CONDITION if durative else Place.CONDITION),
        tree("effect", effect, Place.TIMED_EFFECT if durative else Place.EFFECT),
    )
