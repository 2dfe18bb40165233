"""What the rows of an expression tree must be, so that its text leaves out nothing of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from math import inf

from ..dto.formula import ARITHMETIC, ASSIGNMENTS, COMPARISONS, MODALS, TIMES
from ..dto.name import fold
from ..knowledge import tree as kinds
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree import Node, Term, Tree
from .wording import is_decimal, is_word, parameter_fault

_BINDERS = (kinds.FORALL, kinds.EXISTS, kinds.DERIVED)
_LEAVES = (kinds.PREDICATE, kinds.FUNCTION, kinds.NUMBER, kinds.VARIABLE, kinds.TIME)
_NUMBERS = (kinds.NUMBER, kinds.AT)
_DURATION = "?duration"
# There, the text of each assignment is that of an equality.
_AT_A_TIME = (kinds.PREDICATE, kinds.NOT, ASSIGNMENTS[0])
# How many parts a node has: at least, and at most.
_PARTS: dict[str, tuple[float, float]] = {
    **dict.fromkeys((*_LEAVES, kinds.IS_VIOLATED, "total-time"), (0, 0)),
    **dict.fromkeys(COMPARISONS, (2, 2)),
    **dict.fromkeys(ARITHMETIC, (2, inf)),
    "-": (1, 2),
    "/": (2, 2),
    **dict.fromkeys(ASSIGNMENTS, (2, 2)),
    **dict.fromkeys(TIMES, (1, 1)),
    **{operator: (sum(counts),) * 2 for operator, counts in MODALS.items()},
    **dict.fromkeys((kinds.AND, kinds.OR), (0, inf)),
    **dict.fromkeys((kinds.NOT, kinds.FORALL, kinds.EXISTS, kinds.PREFERENCE, kinds.AT), (1, 1)),
    **dict.fromkeys((kinds.IMPLY, kinds.WHEN, kinds.DERIVED), (2, 2)),
    **dict.fromkeys(kinds.OPTIMIZATIONS, (1, 1)),
}


class _Shape:
    """One tree, with what is above and below each of its nodes."""

    def __init__(
        self,
        tree: Tree,
        parameters: Sequence[ParameterDefinition],
        object_functions: Collection[int],
    ) -> None:
        self._tree = tree
        self._parameters = parameters
        self._object_functions = object_functions
        self._below = kinds.children(tree)
        # The nodes that bind each name around the present node, innermost last.
        self._binders: dict[str, list[int]] = {}

    def faults(self) -> Iterator[str]:
        """Give what is wrong, as far as it goes: the next may rest on what came before."""
        fault = self._order()
        if fault is not None:
            yield fault
            return
        path: list[Node] = []
        for node in self._tree:
            while path and path[-1].position != node.parent:
                for variable in path.pop().variables:
                    self._binders[fold(variable.name)].pop()
            faults = (self._columns(node), self._terms(node), self._parts(node))
            yield from (f"node {node.position}: {each}" for each in faults if each is not None)
            for variable in node.variables:
                self._binders.setdefault(fold(variable.name), []).append(node.position)
            path.append(node)

    def _order(self) -> str | None:
        """Preorder: from 0 without a gap, each below one that is not complete yet."""
        path: list[int] = []
        for position, node in enumerate(self._tree):
            if node.position != position:
                return f"there is no node {position}"
            while path and path[-1] != node.parent:
                path.pop()
            if (position == 0) != (node.parent is None) or (position > 0 and not path):
                return f"node {position} does not stand below node {node.parent}"
            path.append(position)
        return None

    def _columns(self, node: Node) -> str | None:
        operator, value = node.operator, node.value
        if operator not in _PARTS:
            return f"there is no operator {operator!r}"
        if (node.predicate_id is not None) != (operator == kinds.PREDICATE):
            return f"{operator} and predicate_id {node.predicate_id} do not go together"
        if (node.function_id is not None) != (operator == kinds.FUNCTION):
            return f"{operator} and function_id {node.function_id} do not go together"
        if node.variables and operator not in _BINDERS:
            return f"{operator} binds no variables"
        if operator in _NUMBERS:
            return None if is_decimal(value) else f"{value!r} is no number"
        if operator == kinds.VARIABLE:
            return None if value is not None and fold(value) == _DURATION else "it is no ?duration"
        if operator == kinds.IS_VIOLATED:
            return None if value and is_word(value) else f"{value!r} is no preference"
        if value is not None and operator != kinds.PREFERENCE:
            return f"{operator} has no value"
        if value is not None and not is_word(value):
            return f"no preference can be called {value!r}"
        return parameter_fault(node.variables)

    def _parts(self, node: Node) -> str | None:
        values = {term.child for term in node.terms}
        parts = [each for each in self._below.get(node.position, ()) if each.position not in values]
        least, most = _PARTS[node.operator]
        given = len(parts)
        if node.terms and node.operator in ("=", *ASSIGNMENTS):
            given += len(node.terms)
        if not least <= given <= most:
            return f"{node.operator} has {given} parts"
        if node.operator == kinds.AT and parts[0].operator not in _AT_A_TIME:
            return f"{parts[0].operator} happens at no time"
        if node.operator == kinds.DERIVED:
            count = len(node.variables)
            head = tuple(Term(quantifier=0, variable=each) for each in range(count))
            return None if parts[0].terms == head else "its head is not what it binds"
        if node.operator in COMPARISONS and not node.terms:
            wrong = any(self._is_object(part) for part in parts)
            return "it compares objects as numbers" if wrong else None
        if node.operator in ASSIGNMENTS and self._is_object(parts[0]) != bool(node.terms):
            return "it assigns an object as a number, or a number as an object"
        return None

    def _is_object(self, node: Node) -> bool:
        return node.function_id in self._object_functions

    def _terms(self, node: Node) -> str | None:
        allowed = (
            inf
            if node.operator in (kinds.PREDICATE, kinds.FUNCTION)
            else 2
            if node.operator == kinds.EQUAL
            else 1
            if node.operator in ASSIGNMENTS
            else 0
        )
        if len(node.terms) > allowed or (node.operator == kinds.EQUAL and len(node.terms) == 1):
            return f"{node.operator} has {len(node.terms)} terms"
        below = {each.position: each for each in self._below.get(node.position, ())}
        last = -1
        for number, term in enumerate(node.terms):
            if term.child is not None:
                child = below.get(term.child)
                if child is None or child.operator != kinds.FUNCTION or term.child <= last:
                    return f"term {number} is the value of node {term.child}, which is not its own"
                if not self._is_object(child):
                    return f"term {number} is a number"
                last = term.child
            if not self._is_bound(term):
                return f"term {number} is not what its name means there"
        return None

    def _is_bound(self, term: Term) -> bool:
        """Tell whether a term is one of the four, and the innermost variable of its name."""
        given = (term.parameter, term.object_id, term.variable, term.child)
        if sum(each is not None for each in given) != 1:
            return False
        if (term.quantifier is None) != (term.variable is None):
            return False
        if term.parameter is not None:
            if not 0 <= term.parameter < len(self._parameters):
                return False
            return self._binder(self._parameters[term.parameter].name) is None
        if term.quantifier is None or term.variable is None:
            return True
        if not 0 <= term.quantifier < len(self._tree):
            return False
        bound = self._tree[term.quantifier].variables
        if not 0 <= term.variable < len(bound):
            return False
        return self._binder(bound[term.variable].name) == term.quantifier

    def _binder(self, name: str) -> int | None:
        """Find the innermost node around the present one that binds a name."""
        binders = self._binders.get(fold(name))
        return binders[-1] if binders else None


def tree_fault(
    tree: Tree, parameters: Sequence[ParameterDefinition], object_functions: Collection[int]
) -> str | None:
    """Find what is wrong with the rows of a tree.

    Args:
        tree: the tree.
        parameters: the parameters of the element that it belongs to.
        object_functions: the functions whose values are objects.

    Returns:
        What is wrong first; None when nothing is.
    """
    return next(_Shape(tree, parameters, object_functions).faults(), None)
