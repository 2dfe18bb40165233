"""Which objects belong to the domain."""

from __future__ import annotations

from ..knowledge.definitions import Definitions
from ..knowledge.formula import DOMAIN_SECTIONS


def constant_ids(definitions: Definitions) -> set[int]:
    """Find the objects that the domain has to declare.

    Args:
        definitions: what is defined.

    Returns:
        The ids of its constants, and of all other objects that an action or a formula of the
        domain mentions: without them its text could not be read.
    """
    found = {object_.id for object_ in definitions.objects if object_.is_constant}
    trees = [tree for action in definitions.actions for tree in action.trees]
    trees += [each.tree for each in definitions.formulas if each.section in DOMAIN_SECTIONS]
    for tree in trees:
        for node in tree:
            for term in node.terms:
                if term.object_id is not None:
                    found.add(term.object_id)
    return found
