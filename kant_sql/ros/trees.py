"""Formulas as the node trees of PlanSys2's messages, in both directions.

A tree is a list of nodes in preorder that refer to their children by position. A message of
`plansys2_msgs` says what a node can be; it has no `imply` and no `forall`, which are written by
what they mean (PDDL 2.1, section 2: `(or (not a) b)`, `(not (exists ... (not a)))`), and no
operation on more than two numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple, Protocol

from ..dto.formulas import (
    ARITHMETIC,
    ASSIGNMENTS,
    COMPARISONS,
    MAX_NESTING,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    Equal,
    Exists,
    Expression,
    Fluent,
    Forall,
    Formula,
    Imply,
    Node,
    Not,
    Number,
    Or,
    Term,
    TypedName,
    Variable,
)
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidKnowledgeError

AND, OR, NOT, PREDICATE, FUNCTION, EXPRESSION, MODIFIER = 1, 2, 3, 5, 6, 7, 8
NUMBER, CONSTANT, PARAMETER, EXISTS = 9, 10, 11, 12
# The numbers that plansys2_msgs/msg/Node gives to operators.
_OPERATORS = dict(
    zip((*COMPARISONS, *ARITHMETIC), (17, 16, 13, 14, 15, 20, 21, 18, 19), strict=True)
)
_OPERATOR = {number: operator for operator, number in _OPERATORS.items()}
_MODIFIERS = dict(zip(ASSIGNMENTS, range(22, 27), strict=True))
_MODIFIER = {number: operator for operator, number in _MODIFIERS.items()}


class ParamMessage(Protocol):
    """`plansys2_msgs/msg/Param`: a name, its type, and the types below that."""

    name: str
    type: str
    sub_types: Any


class NodeMessage(Protocol):
    """`plansys2_msgs/msg/Node`: a node of a tree."""

    node_type: int
    expression_type: int
    modifier_type: int
    node_id: int
    children: Any
    name: str
    parameters: Any
    value: float
    negate: bool


class Messages(NamedTuple):
    """How messages are made.

    Attributes:
        node: makes an empty `plansys2_msgs/msg/Node`.
        param: makes an empty `plansys2_msgs/msg/Param`.
        signature: the types of the parameters of a predicate or a function, by its folded name.
        subtypes: the names of the types below a type, by its folded name.
    """

    node: Callable[[], NodeMessage]
    param: Callable[[], ParamMessage]
    signature: Mapping[str, Sequence[str]]
    subtypes: Mapping[str, Sequence[str]]

    def make_param(self, name: str, type_name: str = "", *, all_types: bool = False) -> Any:
        """Make a parameter; with `all_types`, with the types below its own."""
        made = self.param()
        made.name, made.type = name, type_name
        if all_types:
            made.sub_types = list(self.subtypes.get(fold(type_name), ()))
        return made


def read_tree(nodes: Sequence[NodeMessage]) -> Formula:
    """Read a condition or an effect from the nodes of a tree; an empty tree is `(and)`.

    Args:
        nodes: the nodes, the root first. `negate` of a node is ignored: a negation is a node.

    Raises:
        InvalidKnowledgeError: the nodes are not a tree of a formula; with the node's position.
    """
    return _Reader(nodes).formula(0) if nodes else And()


def read_node(node: NodeMessage) -> Atom | Fluent:
    """Read a predicate or a function with its arguments from one node.

    Raises:
        InvalidKnowledgeError: it is neither.
    """
    found = _Reader([node]).read(0, 1)
    if not isinstance(found, Atom | Fluent):
        raise InvalidKnowledgeError(f"the node is {found}, expected a predicate or a function")
    return found


class _Reader:
    """Reads nodes of a tree, each once."""

    def __init__(self, nodes: Sequence[NodeMessage]) -> None:
        self._nodes = nodes
        self._seen: set[int] = set()

    def formula(self, position: int, depth: int = 1) -> Formula:
        """Read the formula that begins with a node."""
        found = self.read(position, depth)
        if isinstance(found, Atom | Equal | Comparison | Not | And | Or | Exists | Assign):
            return found
        raise self._wrong(position, f"{found} stands where a formula is expected")

    def read(self, position: int, depth: int) -> Node:
        """Read whatever begins with a node."""
        # A node that is met twice would make a cycle, or a formula that grows exponentially.
        if not 0 <= position < len(self._nodes) or position in self._seen:
            raise self._wrong(position, "there is no such node, or it has two parents")
        if depth > MAX_NESTING:
            raise self._wrong(position, f"it is more than {MAX_NESTING} levels deep")
        self._seen.add(position)
        node = self._nodes[position]
        if node.node_type in (PREDICATE, FUNCTION):
            terms = tuple(_term(each.name) for each in node.parameters)
            return (Atom if node.node_type == PREDICATE else Fluent)(node.name, terms)
        if node.node_type == NUMBER:
            return Number(node.value)
        if node.node_type == CONSTANT:
            return Constant(node.name)
        if node.node_type == PARAMETER and node.parameters:
            return _term(node.parameters[0].name)
        return self._inner(position, node, depth + 1)

    def _inner(self, position: int, node: NodeMessage, depth: int) -> Node:
        kind, children = node.node_type, list(node.children)
        if kind == AND:
            return And(tuple(self.formula(child, depth) for child in children))
        if kind == OR:
            return Or(tuple(self.formula(child, depth) for child in children))
        if kind in (NOT, EXISTS):
            if len(children) != 1:
                raise self._wrong(position, f"it has {len(children)} parts, expected one")
            formula = self.formula(children[0], depth)
            return Not(formula) if kind == NOT else Exists(_variables(node), formula)
        if kind not in (EXPRESSION, MODIFIER) or len(children) != 2:
            raise self._wrong(position, f"type {kind} with {len(children)} parts is no formula")
        left, right = (self.read(child, depth) for child in children)
        if kind == MODIFIER:
            return Assign(self._word(position, _MODIFIER, node.modifier_type), left, right)  # type: ignore[arg-type]
        operator = self._word(position, _OPERATOR, node.expression_type)
        if operator in ARITHMETIC:
            return Arithmetic(operator, (left, right))  # type: ignore[arg-type]
        if operator == "=" and any(isinstance(each, Constant | Variable) for each in (left, right)):
            return Equal(left, right)  # type: ignore[arg-type]
        return Comparison(operator, left, right)  # type: ignore[arg-type]

    def _word(self, position: int, words: Mapping[int, str], number: int) -> str:
        if number not in words:
            raise self._wrong(position, f"{number} is no operator")
        return words[number]

    def _wrong(self, position: int, problem: str) -> InvalidKnowledgeError:
        return InvalidKnowledgeError(f"node {position} of the tree: {problem}")


def _term(name: str) -> Term:
    return Variable(name[1:]) if name.startswith("?") else Constant(name)


def _variables(node: NodeMessage) -> tuple[TypedName, ...]:
    # PlanSys2 leaves the type of a quantified variable out: it means all objects.
    return tuple(
        TypedName(each.name.removeprefix("?"), (each.type or ROOT_TYPE,))
        for each in node.parameters
    )


def write_tree(
    formula: Formula, messages: Messages, names: Mapping[str, str] | None = None
) -> list[NodeMessage]:
    """Write a condition or an effect as the nodes of a tree.

    Args:
        formula: the formula, without times of a durative action.
        messages: how messages are made.
        names: what to write for a free variable, by its folded name: `?0`, or an object's name.
            Variables of quantifiers are numbered after them; others keep their names.

    Returns:
        The nodes, in preorder.

    Raises:
        InvalidKnowledgeError: the formula has a part that no tree can hold: a preference, a
            conditional effect, a constraint, a function's value as an argument, or `either`.
    """
    writer = _Writer(messages)
    writer.write(formula, dict(names or {}))
    return writer.nodes


def write_node(part: Atom | Fluent, messages: Messages, value: float = 0.0) -> NodeMessage:
    """Write one fact, or one function with its arguments and its value, as a node."""
    (node,) = write_tree(part, messages)  # type: ignore[arg-type]
    node.value = value
    return node


class _Writer:
    """Writes nodes of one tree."""

    def __init__(self, messages: Messages) -> None:
        self._messages = messages
        self.nodes: list[NodeMessage] = []

    def write(self, part: Node, names: Mapping[str, str]) -> int:
        """Write a part, and return the position of its node."""
        part = _plain(part)
        node = self._messages.node()
        node.node_id = len(self.nodes)
        self.nodes.append(node)
        if isinstance(part, Exists):
            names = {**names, **_numbered(part.variables, len(names))}
            node.parameters = [self._quantified(each, names) for each in part.variables]
        self._describe(node, part, names)
        node.children = [self.write(child, names) for child in _parts(part)]
        return node.node_id

    def _quantified(self, variable: TypedName, names: Mapping[str, str]) -> ParamMessage:
        if len(variable.types) > 1:
            raise _refused(f"?{variable.name} - {variable.type_text}")
        type_name = variable.types[0]
        shown = "" if fold(type_name) == ROOT_TYPE else type_name
        made: ParamMessage = self._messages.make_param(
            names[fold(variable.name)], shown, all_types=True
        )
        return made

    def _describe(self, node: NodeMessage, part: Node, names: Mapping[str, str]) -> None:
        """Fill in what a node says of itself."""
        node.node_type = _KINDS.get(type(part)) or _refuse(part)
        if isinstance(part, Atom | Fluent):
            node.name = part.predicate if isinstance(part, Atom) else part.function
            types = self._messages.signature.get(fold(node.name), ())
            node.parameters = [
                self._messages.make_param(_name(term, names), type_name)  # type: ignore[arg-type]
                for term, type_name in zip_longest(
                    part.terms, types[: len(part.terms)], fillvalue=""
                )
            ]
        elif isinstance(part, Number):
            node.value = float(part.value)
        elif isinstance(part, Constant):
            node.name = part.name
        elif isinstance(part, Variable):
            node.parameters = [self._messages.make_param(_name(part, names))]
        elif isinstance(part, Assign):
            node.modifier_type = _MODIFIERS[part.operator]
        elif isinstance(part, Comparison | Arithmetic):
            node.expression_type = _OPERATORS[part.operator]
        elif isinstance(part, Equal):
            node.expression_type = _OPERATORS["="]


_KINDS: dict[type[Node], int] = {
    And: AND,
    Or: OR,
    Not: NOT,
    Exists: EXISTS,
    Atom: PREDICATE,
    Fluent: FUNCTION,
    Number: NUMBER,
    Constant: CONSTANT,
    Variable: PARAMETER,
    Comparison: EXPRESSION,
    Equal: EXPRESSION,
    Arithmetic: EXPRESSION,
    Assign: MODIFIER,
}


def _plain(part: Node) -> Node:
    """Say a part by what a tree can hold."""
    if isinstance(part, Imply):
        return Or((Not(part.condition), part.formula))
    if isinstance(part, Forall):
        return Not(Exists(part.variables, Not(part.formula)))
    if isinstance(part, Arithmetic) and len(part.operands) != 2:
        return _binary(part)
    return part


def _binary(part: Arithmetic) -> Expression:
    """Nest an operation on one number, or on more than two, from the left."""
    operands: Iterable[Expression] = part.operands
    first, *others = (Number(0), *operands) if len(part.operands) == 1 else operands
    for other in others:
        first = Arithmetic(part.operator, (first, other))
    return first


def _parts(part: Node) -> tuple[Node, ...]:
    if isinstance(part, And | Or):
        return part.formulas
    if isinstance(part, Not | Exists):
        return (part.formula,)
    if isinstance(part, Comparison | Equal):
        return (part.left, part.right)
    if isinstance(part, Arithmetic):
        return part.operands
    return (part.fluent, part.value) if isinstance(part, Assign) else ()


def _numbered(variables: Iterable[TypedName], first: int) -> dict[str, str]:
    return {fold(each.name): f"?{first + index}" for index, each in enumerate(variables)}


def _name(term: Term, names: Mapping[str, str]) -> str:
    if isinstance(term, Fluent):
        _refuse(term)
    if isinstance(term, Constant):
        return term.name
    assert isinstance(term, Variable)
    return names.get(fold(term.name), f"?{term.name}")


def _refuse(part: Node) -> int:
    raise _refused(str(part))


def _refused(text: str) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(
        f"{text} has no form in PlanSys2's messages; ask for the domain or the problem as PDDL text"
    )
