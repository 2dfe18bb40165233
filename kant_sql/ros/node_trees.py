"""Formulas as the node trees of PlanSys2's messages, in both directions.

A tree is a list of nodes that refer to their children by position, the root first. It is converted
to PDDL text, which the library's reader checks against the domain. There is no node for `imply` and
`forall`, which become equivalent trees (PDDL 2.1, section 2: `(or (not a) b)`, `(not (exists ...
(not a)))`), and none for an operation on more than two numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial, reduce
from math import isfinite
from typing import Any, NamedTuple, Protocol

from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, check_name, either_text, fold
from ..errors import InvalidKnowledgeError

# As plansys2_msgs/msg/Node numbers types of nodes, and operators in three of its fields.
PREDICATE, FUNCTION, EXPRESSION, MODIFIER, NUMBER, CONSTANT, PARAMETER, EXISTS = range(5, 13)
_EXPRESSIONS = ("=", ">=", ">", "<=", "<", "*", "/", "+", "-")
_WORDS = {
    **{(number, 0, 0): word for number, word in enumerate(("and", "or", "not"), 1)},
    **{(EXPRESSION, number, 0): word for number, word in enumerate(_EXPRESSIONS, 13)},
    **{(MODIFIER, 0, number): word for number, word in enumerate(f.ASSIGNMENTS, 22)},
}
_NUMBERS = {word: numbers for numbers, word in _WORDS.items()}
# Folded names of variables in scope, each with its name in the tree.
Scope = tuple[tuple[str, str], ...]


class NodeMessage(Protocol):
    """`plansys2_msgs/msg/Node`: a node of a tree; its parameters are `Param` messages."""

    node_type: int
    expression_type: int
    modifier_type: int
    node_id: int
    children: Any
    name: str
    parameters: Any
    value: float


class Messages(NamedTuple):
    """The classes and names for making messages.

    Attributes:
        made: `plansys2_msgs.msg`, which has the classes of messages.
        signature: the types of each parameter of a predicate or a function, by its folded name.
        subtypes: the names of the types below a type, by its folded name.
    """

    made: Any
    signature: Mapping[str, Sequence[tuple[str, ...]]]
    subtypes: Mapping[str, Sequence[str]]

    def make_param(self, name: str, types: tuple[str, ...] = ("",), all_types: bool = False) -> Any:
        """Make a parameter; with `all_types`, with the types of an `either` and their subtypes."""
        below = [each for one in types for each in self.subtypes.get(fold(one), ())]
        sub_types = [*(types if types[1:] else ()), *below] if all_types else []
        return self.made.Param(name=name, type=either_text(types), sub_types=sub_types)


def read_tree(nodes: Sequence[NodeMessage]) -> str:
    """Read a condition or an effect from the nodes of a tree; an empty tree is `(and)`.

    Args:
        nodes: the nodes, the root first. `negate` of a node is ignored: a negation is a node.

    Returns:
        PDDL text, for example for `kb.goals.save` or `kb.holds`, which check it.

    Raises:
        InvalidKnowledgeError: the nodes are not a tree, or PDDL text cannot express one of them.
    """
    words: list[str] = []
    unread = dict(enumerate(nodes))
    todo: list[int | str] = [0] if nodes else [" (and)"]
    while todo:
        part = todo.pop()
        if isinstance(part, str):
            words.append(part)
            continue
        try:
            opening, closing = _parentheses(unread.pop(part, None))
        except InvalidKnowledgeError as error:
            raise InvalidKnowledgeError(f"node {part} of the tree: {error}") from error
        words.append(f" {opening}")
        todo += [closing, *reversed(nodes[part].children)]
    if unread:
        raise InvalidKnowledgeError(f"node {min(unread)} of the tree: it has no parent")
    return "".join(words)[1:]


def read_node(node: NodeMessage) -> str:
    """Read a predicate or a function with its arguments from one node, as PDDL text.

    Raises:
        InvalidKnowledgeError: PDDL text cannot express a name.
    """
    terms = [_term(each.name) for each in node.parameters]
    # PlanSys2's clients send `(idle)` with the name `idle)`.
    name = node.name if terms else node.name.removesuffix(")")
    check_name("function" if node.node_type == FUNCTION else "predicate", name)
    return f"({' '.join([name, *terms])})"


def _parentheses(node: NodeMessage | None) -> tuple[str, str]:
    """Return the text of a node before and after its children."""
    if node is None:
        raise InvalidKnowledgeError("there is none, or it has two parents")
    kind, count = node.node_type, len(node.children)
    operators = node.expression_type * (kind == EXPRESSION), node.modifier_type * (kind == MODIFIER)
    word = f"exists ({_variables(node)})" if kind == EXISTS else _WORDS.get((kind, *operators))
    if word is not None:
        return f"({word}", ")"
    if kind in (PREDICATE, FUNCTION) and not count:
        return read_node(node), ""
    if kind == NUMBER and not count:
        return str(f.Number(node.value)), ""
    if kind in (CONSTANT, PARAMETER) and not count:
        return _term(node.parameters[0].name if len(node.parameters) else node.name), ""
    raise InvalidKnowledgeError(f"type {kind}, operators {operators}, {count} children: no formula")


def _term(name: str) -> str:
    check_name("variable" if name[:1] == "?" else "object", name.removeprefix("?"))
    return name


def _variables(node: NodeMessage) -> str:
    """Return typed variables; PlanSys2 leaves types out, or has `-` and the type as variables."""
    names = [each.name if each.name == "-" else _term(each.name) for each in node.parameters]
    types = [_term(each.type or ROOT_TYPE) for each in node.parameters]
    return " ".join(names if "-" in names else map(" - ".join, zip(names, types, strict=True)))


def write_tree(
    formula: f.Formula, messages: Messages, names: Scope = (), *, is_effect: bool = False
) -> list[NodeMessage]:
    """Write a condition or an effect as the nodes of a tree, in preorder.

    Args:
        formula: the formula, without times of a durative action.
        messages: how messages are made.
        names: the free variables, with `?0` and so on, or an object's name. Variables of
            quantifiers are numbered after them; others keep their names.
        is_effect: whether it is an effect, where a `forall` has no other form.

    Raises:
        InvalidKnowledgeError: a part that no tree can hold: a preference, a constraint, `either`, a
            conditional or universal effect, a function as an argument, `?duration`, `#t`, 1e400.
    """
    nodes: list[NodeMessage] = []
    todo: list[tuple[f.Node, Scope, Any]] = [(formula, names, [])]
    while todo:
        part, scope, siblings = todo.pop()
        part = _plain(part, is_effect)
        siblings.append(len(nodes))
        node = messages.made.Node(node_id=len(nodes))
        nodes.append(node)
        if isinstance(part, f.Exists):
            variables = enumerate(part.variables, len(scope))
            scope += tuple([(fold(each.name), f"?{number}") for number, each in variables])
        _describe(node, part, messages, dict(scope))
        if not isinstance(part, f.Atom | f.Fluent):
            todo += [(each, scope, node.children) for each in reversed(f.children(part))]
    return nodes


def _plain(part: f.Node, is_effect: bool) -> f.Node:
    """Rewrite a part into forms that a tree has; operations on numbers nest from the left."""
    match part:
        case f.Imply(condition, formula):
            return f.Or((f.Not(condition), formula))
        case f.Forall(variables, formula) if not is_effect:
            return f.Not(f.Exists(variables, f.Not(formula)))
        case f.Arithmetic(operator, (first, *others)) if len(others) != 1:
            others, first = (others, first) if others else ([first], f.Number(0))
            return reduce(lambda left, right: f.Arithmetic(operator, (left, right)), others, first)
    return part


def _describe(node: Any, part: f.Node, messages: Messages, names: Mapping[str, str]) -> None:
    """Fill in the fields of a node."""
    match part:
        case f.Atom(name, terms) | f.Fluent(name, terms):
            node.node_type, node.name = PREDICATE if isinstance(part, f.Atom) else FUNCTION, name
            types = [*messages.signature.get(fold(name), ()), *[("",)] * len(terms)]
            shown = (_shown(term, names) for term in terms)
            node.parameters = list(map(messages.make_param, shown, types))
        case f.Variable():
            node.node_type, node.name = PARAMETER, _shown(part, names)
            node.parameters = [messages.make_param(node.name)]
        case f.Constant(name):
            node.node_type, node.name = CONSTANT, name
        case f.Number(value) if isfinite(value):
            node.node_type, node.value = NUMBER, float(value)
        case f.Exists(variables) if all(len(each.types) == 1 for each in variables):
            node.node_type = EXISTS
            make = partial(messages.make_param, all_types=True)
            node.parameters = [make(names[fold(each.name)], each.types) for each in variables]
        case f.And() | f.Or() | f.Not() | f.Comparison() | f.Equal() | f.Arithmetic() | f.Assign():
            node.node_type, node.expression_type, node.modifier_type = _NUMBERS[f.head(part)]
        case _:
            raise _refused(part)


def _shown(term: f.Term, names: Mapping[str, str]) -> str:
    key = fold(term.name) if isinstance(term, f.Variable) else ""
    if isinstance(term, f.Fluent) or (key == f.DURATION and key not in names):
        raise _refused(term)
    return names.get(key, str(term))


def _refused(part: f.Node) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(f"{part} has no form in PlanSys2's messages; ask for PDDL text")
