"""The nodes of conditions, effects, goals, constraints and metrics: immutable data.

Methods may recurse: reading, storing and asking refuse formulas nested more than `MAX_NESTING`
levels deep.

Each node is a construct of the language, with its name in the papers: PDDL 2.1 (Fox and Long,
2003), PDDL 2.2 (Edelkamp and Hoffmann, 2004), PDDL 3.0 (Gerevini and Long, 2005), PDDL 3.1
(Kovacs, 2011) and PDDL+ (Fox and Long, 2006). Nodes refer to predicates, functions and objects by
name. Nodes with the same content and spelling are equal. `str()` of a node is its PDDL text.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from decimal import Decimal
from itertools import chain, groupby
from typing import Any, Self, get_args, get_origin, get_type_hints

from ..arguments import Readable, expect, expect_tuple, items
from .lexical import ROOT_TYPE, check_number, decimal_text, either_text, with_article

# Three times the deepest formula of the planning competitions. Each database evaluates as many
# quantifiers: SQLite refuses expressions of 1,000 levels, and joins of 64 tables.
MAX_NESTING = 50
NESTING_REMEDY = (
    f"at most {MAX_NESTING} levels; name a part by a derived predicate, or give one (and ...), "
    "(or ...) or (+ ...) all of its operands"
)


class Checked:
    """Immutable data whose constructor checks each field by its annotation.

    A list is converted to a tuple. A wrong type raises `InvalidKnowledgeError`.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        kind = type(self)
        for name, wanted, is_tuple, role in _CHECKS.get(kind) or _checks(kind):
            value = getattr(self, name)
            if not is_tuple:
                if not isinstance(value, wanted):
                    expect(value, wanted, role)
                continue
            checked: tuple[object, ...] = expect_tuple(value, wanted, role)
            if checked is not value:
                object.__setattr__(self, name, checked)


class Node(Checked, Readable):
    """A node of a formula, an effect or an expression; copying returns the node itself."""

    __slots__ = ()

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __str__(self) -> str:
        return node_text(self, head)


class FormulaNode(Node):
    """A node that is a formula or an effect."""

    __slots__ = ()


def children(node: Node) -> tuple[Node, ...]:
    """Return the child nodes of a node."""
    found: list[Node] = []
    names: tuple[str, ...] = type(node).__slots__
    for name in names:
        value = getattr(node, name)
        if isinstance(value, Node):
            found.append(value)
        elif isinstance(value, tuple):
            found.extend(part for part in value if isinstance(part, Node))
    return tuple(found)


def head(node: Node, explicit: bool = False) -> str:
    """Return the text from the opening parenthesis of a node to its first child."""
    kind = type(node)
    word = _WORDS.get(kind)
    if word is not None:
        return word
    names: tuple[str, ...] = kind.__slots__
    first: Any = getattr(node, names[0])
    if names[0] == "variables":
        word = getattr(node, "operator", kind.__name__.lower())
        return f"{word} ({variables_text(first, explicit)})"
    if names[0] == "name":
        return "preference" if first is None else f"preference {first}"
    return str(first)


def node_text(node: Node, head_of: Callable[[Node], str]) -> str:
    """Write a node; `head_of` returns the head of each node in parentheses."""
    texts: list[str] = []
    stack: list[Node | None] = [node]
    while stack:
        part = stack.pop()
        if part is None:
            texts.append(")")
        elif type(part).__str__ is not Node.__str__:
            texts.append(f" {part}")
        else:
            texts.append(f" ({head_of(part)}")
            stack.append(None)
            stack.extend(reversed(children(part)))
    return "".join(texts)[1:]


def walk(*nodes: Node) -> Iterator[Node]:
    """Iterate over nodes and all their descendants, in preorder."""
    stack = list(reversed(nodes))
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(children(node)))


def mentions(kind: type[Node], *nodes: Node) -> bool:
    """Return whether nodes contain a node of a class."""
    return any(isinstance(node, kind) for node in walk(*nodes))


@dataclass(frozen=True, slots=True)
class TypedName(Checked):
    """A name with its type, in a list of parameters, objects or types.

    Attributes:
        name: the name; a variable's without its question mark.
        types: the names of its types: one, or several for `either`.
    """

    name: str
    types: tuple[str, ...] = (ROOT_TYPE,)

    @property
    def type_text(self) -> str:
        """The type as PDDL text: `robot`, or `(either robot human)`."""
        return either_text(self.types)


@dataclass(frozen=True, slots=True)
class Variable(Node):
    """A variable: a parameter, a variable of a quantifier, or `?duration`.

    Attributes:
        name: its name, without the question mark.
    """

    name: str

    def __str__(self) -> str:
        return f"?{self.name}"


@dataclass(frozen=True, slots=True)
class Constant(Node):
    """An object, by its name."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Fluent(Node):
    """A function applied to terms, with a number or an object (PDDL 3.1) as its value.

    Attributes:
        function: the function's name.
        terms: the terms, in order.
    """

    function: str
    terms: tuple[Term, ...] = ()


@dataclass(frozen=True, slots=True, init=False)
class Number(Node):
    """A number, exactly.

    Attributes:
        value: the number, finite and of at most `MAX_DIGITS` digits; an `int` is converted, and a
            `float` by its shortest representation.
    """

    value: Decimal

    def __init__(self, value: Decimal | int | float) -> None:
        object.__setattr__(self, "value", check_number(value, "the value of a Number"))

    def __str__(self) -> str:
        return decimal_text(self.value)


@dataclass(frozen=True, slots=True)
class ContinuousTime(Node):
    """The elapsed time, `#t`, in a continuous effect (PDDL 2.1, section 5.3)."""

    def __str__(self) -> str:
        return "#t"


@dataclass(frozen=True, slots=True)
class Arithmetic(Node):
    """An operation on numbers.

    Attributes:
        operator: `+`, `-`, `*` or `/`; `-` of one operand negates it.
        operands: the operands, in order.
    """

    operator: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class IsViolated(Node):
    """The number of violations of a preference, by name, in a metric (PDDL 3.0, section 3)."""

    preference: str

    def __str__(self) -> str:
        return f"(is-violated {self.preference})"


Term = Variable | Constant | Fluent
Expression = Number | Fluent | Variable | Arithmetic | ContinuousTime | IsViolated


def variables_text(variables: Iterable[TypedName], explicit: bool = False) -> str:
    """Write typed variables."""
    given = items(variables, TypedName, "the variables")
    typed = [TypedName(f"?{part.name}", part.types) for part in given]
    return " ".join(chain.from_iterable(typed_runs(typed, explicit)))


def skeleton_text(name: str, variables: Iterable[TypedName], explicit: bool = False) -> str:
    """Write a predicate or a function with its typed variables."""
    text = variables_text(variables, explicit)
    return f"({name} {text})" if text else f"({name})"


def typed_runs(names: Sequence[TypedName], explicit: bool) -> Iterator[list[str]]:
    """Yield the words of each run of one type in a typed list; `object` at its end is implicit."""
    end = len(names)
    if not explicit:
        end = typed_end([name.types != (ROOT_TYPE,) for name in names])
    for types, run in groupby(names[:end], lambda name: name.types):
        yield [*(name.name for name in run), f"- {either_text(types)}"]
    if end < len(names):
        yield [name.name for name in names[end:]]


def typed_end(typed: Sequence[bool]) -> int:
    """Return the end of the part of a list that needs types."""
    return max((position for position, is_typed in enumerate(typed, 1) if is_typed), default=0)


_new, _set = object.__new__, object.__setattr__


@dataclass(frozen=True, slots=True)
class Atom(FormulaNode):
    """A predicate applied to terms.

    Attributes:
        predicate: the predicate's name.
        terms: the terms, in order.
    """

    predicate: str
    terms: tuple[Term, ...] = ()


def trusted_atom(predicate: str, terms: tuple[Term, ...]) -> Atom:
    """Make an atom without checks: a document may have hundreds of thousands."""
    atom = _new(Atom)
    _set(atom, "predicate", predicate)
    _set(atom, "terms", terms)
    return atom


@dataclass(frozen=True, slots=True)
class Equal(FormulaNode):
    """Two terms that denote one object."""

    left: Term
    right: Term


@dataclass(frozen=True, slots=True)
class Comparison(FormulaNode):
    """A comparison of two numbers; also a constraint on a duration.

    Attributes:
        operator: `<`, `<=`, `=`, `>=` or `>`.
        left: the first number.
        right: the second number.
    """

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Not(FormulaNode):
    """A negation; as an effect, a delete."""

    formula: Formula


@dataclass(frozen=True, slots=True)
class And(FormulaNode):
    """A conjunction, in order."""

    formulas: tuple[Formula, ...] = ()


@dataclass(frozen=True, slots=True)
class Or(FormulaNode):
    """A disjunction, in order."""

    formulas: tuple[Formula, ...] = ()


@dataclass(frozen=True, slots=True)
class Imply(FormulaNode):
    """An implication.

    Attributes:
        condition: the antecedent.
        formula: the consequent.
    """

    condition: Formula
    formula: Formula


@dataclass(frozen=True, slots=True)
class Forall(FormulaNode):
    """A formula, or an effect, for all objects of the variables' types."""

    variables: tuple[TypedName, ...]
    formula: Formula


@dataclass(frozen=True, slots=True)
class Exists(FormulaNode):
    """A formula that holds for some objects of the variables' types."""

    variables: tuple[TypedName, ...]
    formula: Formula


@dataclass(frozen=True, slots=True)
class Count(FormulaNode):
    """A formula that holds for at most or exactly one object; only rules may have it.

    Attributes:
        variables: the counted variables; with several, combinations count.
        formula: the formula.
        operator: `at-most-one` or `exactly-one`.
    """

    variables: tuple[TypedName, ...]
    formula: Formula
    operator: str = "at-most-one"


@dataclass(frozen=True, slots=True)
class Timed(FormulaNode):
    """A condition or an effect at a time of a durative action; `at end` also in constraints.

    Attributes:
        time: `at start`, `over all` or `at end`.
        formula: the condition or the effect.
    """

    time: str
    formula: Formula


@dataclass(frozen=True, slots=True)
class Preference(FormulaNode):
    """A soft goal, precondition or constraint (PDDL 3.0, section 3).

    Attributes:
        name: its name, which need not be unique; None without one.
        formula: the preferred formula.
    """

    name: str | None
    formula: Formula


@dataclass(frozen=True, slots=True)
class Modal(FormulaNode):
    """A constraint on the trajectory (PDDL 3.0, section 2).

    Attributes:
        operator: `always`, `sometime`, `at-most-once`, `sometime-after`, `sometime-before`,
            `within`, `always-within`, `hold-during` or `hold-after`.
        numbers: its times, in the planner's units.
        formulas: its formulas.
    """

    operator: str
    numbers: tuple[Number, ...]
    formulas: tuple[Formula, ...]


@dataclass(frozen=True, slots=True)
class When(FormulaNode):
    """A conditional effect."""

    condition: Formula
    effect: Formula


@dataclass(frozen=True, slots=True)
class Assign(FormulaNode):
    """An effect on a fluent.

    Attributes:
        operator: `assign`, `increase`, `decrease`, `scale-up` or `scale-down`.
        fluent: the fluent.
        value: a numeric expression, or for an object fluent a term.
    """

    operator: str
    fluent: Fluent
    value: Expression | Term


@dataclass(frozen=True, slots=True)
class Derived(Node):
    """A rule for a derived predicate (PDDL 2.2, section 3.1).

    Attributes:
        predicate: the predicate's name.
        variables: the predicate's parameters, with the names and types of the rule.
        formula: the formula that implies it.
    """

    predicate: str
    variables: tuple[TypedName, ...]
    formula: Formula

    def __str__(self) -> str:
        return f"(:derived {skeleton_text(self.predicate, self.variables)} {self.formula})"


@dataclass(frozen=True, slots=True)
class TimedLiteral(Node):
    """A timed initial literal (PDDL 2.2, section 3.2), or a timed initial value.

    Attributes:
        time: its time, in the planner's units.
        effect: an `Atom`, `Not` of one, or an `Assign`, written `(= (fluent) value)`.
    """

    time: Number
    effect: Atom | Not | Assign

    def __str__(self) -> str:
        effect: object = self.effect
        if isinstance(effect, Assign) and effect.operator == ASSIGNMENTS[0]:
            effect = f"(= {effect.fluent} {effect.value})"
        return f"(at {self.time} {effect})"


@dataclass(frozen=True, slots=True)
class Metric(Node):
    """The measure of plans (PDDL 2.1, section 4.1).

    Attributes:
        optimization: `minimize` or `maximize`.
        expression: the measured quantity.
    """

    optimization: str
    expression: Expression

    def __str__(self) -> str:
        return f"(:metric {self.optimization} {self.expression})"


DURATION, TOTAL_TIME, TOTAL_COST = "duration", "total-time", "total-cost"
AT_START, OVER_ALL, AT_END = "at start", "over all", "at end"
TIMES = (AT_START, OVER_ALL, AT_END)
COMPARISONS = ("<", "<=", "=", ">=", ">")
# The same comparison with the sides exchanged.
MIRRORED = dict(zip(COMPARISONS, reversed(COMPARISONS), strict=True))
ARITHMETIC = ("+", "-", "*", "/")
COUNTS = ("at-most-one", "exactly-one")
ASSIGNMENTS = ("assign", "increase", "decrease", "scale-up", "scale-down")
# How many times and formulas each modal operator has.
MODALS = {
    "always": (0, 1),
    "sometime": (0, 1),
    "at-most-once": (0, 1),
    "sometime-after": (0, 2),
    "sometime-before": (0, 2),
    "within": (1, 1),
    "always-within": (1, 2),
    "hold-during": (2, 1),
    "hold-after": (1, 1),
}

# The fixed heads of nodes; most other nodes begin with their first field.
_WORDS: dict[type, str] = {
    Equal: "=",
    Not: "not",
    And: "and",
    Or: "or",
    Imply: "imply",
    When: "when",
}

Formula = (
    Atom
    | Equal
    | Comparison
    | Not
    | And
    | Or
    | Imply
    | Forall
    | Exists
    | Count
    | Timed
    | Preference
    | Modal
    | When
    | Assign
)

# A field of a class: its name, its classes, whether it is a tuple of these, and its role.
_Check = tuple[str, tuple[type, ...], bool, str]
_CHECKS: dict[type, list[_Check]] = {}


def _checks(kind: type) -> list[_Check]:
    """Compute and cache the checks of a class."""
    hints = get_type_hints(kind)
    # One class is faster to check than a union. The writer refuses nodes that a document cannot
    # contain, with their position.
    formula = FormulaNode if issubclass(kind, Node) else Node
    found = []
    for field in fields(kind):
        hint = hints[field.name]
        is_tuple = get_origin(hint) is tuple
        item = get_args(hint)[0] if is_tuple else hint
        classes = (formula,) if item == Formula else get_args(item) or (item,)
        role = f"the {field.name} of {with_article(kind.__name__)}"
        found.append((field.name, classes, is_tuple, role))
    _CHECKS[kind] = found
    return found
