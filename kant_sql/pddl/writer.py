"""Documents and nodes become PDDL text, in one canonical layout.

`str()` of a node is the same text. This is for documents that someone has made by hand: it refuses
what could not be read back.

The sections are in the order of the standard (Kovacs, Complete BNF description of PDDL 3.1, 2011).
Each declaration, fact and conjunct is on a line of its own. Lists of conjuncts are always written
as `(and ...)`, for not every parser reads `()`. Nothing is added to what a document says, but that
a document with types says `- object`, too: VAL refuses an untyped parameter there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from operator import attrgetter
from typing import Any

from ..dto.formulas import (
    ARITHMETIC,
    ASSIGNMENTS,
    COMPARISONS,
    MODALS,
    TIMES,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    IsViolated,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
    children,
    shown,
    variables_text,
    walk,
)
from ..dto.lexical import (
    RESERVED,
    ROOT_TYPE,
    check_name,
    decimal_text,
    fold,
    function_kind,
    is_requirement,
)
from ..errors import InvalidKnowledgeError, InvalidNameError
from .document import (
    ACTION,
    DURATIVE_ACTION,
    EVENT,
    PROCESS,
    Action,
    Domain,
    Function,
    FunctionValue,
    Predicate,
    Problem,
)

PREFERENCE, DEFINE = "preference", "define"
# A parenthesis behind these is read as a formula or a fluent of theirs, and not as a term.
_OPERATORS = {DEFINE, PREFERENCE, *MODALS, *ASSIGNMENTS}
_TIME_WORDS = {tuple(time.split()) for time in TIMES}


def node_text(node: Node, explicit: bool = False) -> str:
    """Write a node."""
    texts: list[str] = []
    stack: list[Node | None] = [node]
    while stack:
        part = stack.pop()
        if part is None:
            texts.append(")")
        elif (leaf := _LEAVES.get(type(part))) is not None:
            texts.append(f" {leaf(part)}")
        else:
            texts.append(f" ({_head(part, explicit)}")
            stack.append(None)
            stack.extend(reversed(children(part)))
    return "".join(texts)[1:]


def _number(node: Number) -> str:
    return decimal_text(node.value)


def check_types(names: Iterable[TypedName]) -> None:
    """Refuse a typed list that could not be read back."""
    for name in names:
        if not name.types:
            raise InvalidKnowledgeError(f"{name.name!r} has no type; give it 'object'")
        if not RESERVED["type"].isdisjoint(map(fold, name.types)):
            raise InvalidKnowledgeError(
                f"{name.name!r} is of a type called 'either', a reserved word; choose another name"
            )


def check_predicate(name: str) -> None:
    """Refuse a predicate's name that begins something else."""
    if fold(name) in RESERVED["predicate"]:
        check_name("predicate", name)


def check_word(what: str, word: str, allowed: Iterable[str]) -> None:
    """Refuse an operator that is none."""
    if word not in (choices := tuple(allowed)):
        raise InvalidKnowledgeError(f"{word!r} is no {what}; use one of {', '.join(choices)}")


def _atom(node: Atom) -> str:
    word = fold(node.predicate)
    check_predicate(node.predicate)
    match node.terms:
        case (Constant(name), Fluent()) if (word, fold(name)) in _TIME_WORDS:
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of the object '{name}' and a function's value is read as a"
                " time; rename the object"
            )
        case (Fluent(), *_) | (_, Fluent(), *_) if word == PREFERENCE or (
            word in _OPERATORS and isinstance(node.terms[0], Fluent)
        ):
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of a function's value is read as the operator; rename the"
                " predicate"
            )
    return node.predicate


def _fluent(node: Fluent) -> str:
    if node.terms and isinstance(node.terms[0], Fluent) and fold(node.function) == DEFINE:
        raise InvalidKnowledgeError(
            f"'{node.function}' of a function's value is read as a definition; rename the function"
        )
    return node.function


def _arithmetic(node: Arithmetic) -> str:
    check_word("arithmetic operator", node.operator, ARITHMETIC)
    if len(node.operands) < (1 if node.operator == "-" else 2):
        raise InvalidKnowledgeError(
            f"{node.operator!r} of {len(node.operands)} operands is no number; give it two"
        )
    return node.operator


def _comparison(node: Comparison) -> str:
    check_word("comparison", node.operator, COMPARISONS)
    return node.operator


def _assign(node: Assign) -> str:
    check_word("effect on a fluent", node.operator, ASSIGNMENTS)
    return node.operator


def _timed(node: Timed) -> str:
    check_word("time of a condition or an effect", node.time, TIMES)
    return node.time


def _quantifier(node: Forall | Exists, explicit: bool) -> str:
    word = "forall" if isinstance(node, Forall) else "exists"
    check_types(node.variables)
    return f"{word} ({variables_text(node.variables, explicit)})"


def _modal(node: Modal) -> str:
    check_word("modal operator", node.operator, MODALS)
    given = (len(node.numbers), len(node.formulas))
    if given != MODALS[node.operator]:
        numbers, formulas = MODALS[node.operator]
        raise InvalidKnowledgeError(
            f"{node.operator!r} takes {numbers} numbers and {formulas} formulas,"
            f" not {given[0]} and {given[1]}; give it these"
        )
    return node.operator


def _preference(node: Preference) -> str:
    return "preference" if node.name is None else f"preference {node.name}"


def _head(node: Node, explicit: bool) -> str:
    if isinstance(node, Forall | Exists):
        return _quantifier(node, explicit)
    head = _HEADS.get(type(node))
    if head is None:
        raise InvalidKnowledgeError(
            f"a {type(node).__name__} is no part of a formula; put it where the document has it"
        )
    return head(node)


_LEAVES: dict[type, Callable[[Any], str]] = {
    Variable: str,
    Constant: str,
    ContinuousTime: str,
    IsViolated: str,
    Number: _number,
}
_HEADS: dict[type, Callable[[Any], str]] = {
    Fluent: _fluent,
    Arithmetic: _arithmetic,
    Atom: _atom,
    Equal: lambda _: "=",
    Comparison: _comparison,
    Not: lambda _: "not",
    And: lambda _: "and",
    Or: lambda _: "or",
    Imply: lambda _: "imply",
    Timed: _timed,
    Preference: _preference,
    Modal: _modal,
    When: lambda _: "when",
    Assign: _assign,
}


WIDTH = 100
INDENT = 4
NUMBER = "number"


def typed_lines(names: Sequence[TypedName], explicit: bool) -> Iterator[str]:
    """Write a typed list of types, constants or objects: a line for each run of one type."""
    check_types(names)
    tail = len(names)
    if not explicit:
        tail = _untyped_tail([name.types == (ROOT_TYPE,) for name in names])
    for _, group in groupby(names[:tail], lambda name: name.types):
        members = list(group)
        yield from _wrapped([name.name for name in members], f"- {members[0].type_text}")
    yield from _wrapped([name.name for name in names[tail:]])


def skeleton(name: str, parameters: Sequence[TypedName], explicit: bool) -> str:
    """Write a predicate's or a function's declaration."""
    check_types(parameters)
    return f"({name} {variables_text(parameters, explicit)})" if parameters else f"({name})"


def function_lines(functions: Sequence[Function], explicit: bool) -> Iterator[str]:
    """Write the declarations of functions, one on each line."""
    tail = _untyped_tail([not function.types for function in functions])
    for position, function in enumerate(functions):
        text = skeleton(function.name, function.parameters, explicit)
        value = TypedName(function.name, function.types or (NUMBER,))
        check_types([value])
        if NUMBER in map(fold, function.types):
            raise InvalidKnowledgeError(
                f"function {function.name!r} is of a type called 'number', which is read as a"
                " number; choose another name for the type"
            )
        yield text if position >= tail else f"{text} - {value.type_text}"


def _untyped_tail(untyped: Sequence[bool]) -> int:
    tail = len(untyped)
    while tail and untyped[tail - 1]:
        tail -= 1
    return tail


def _wrapped(words: Sequence[str], *last: str) -> Iterator[str]:
    line: list[str] = []
    width = INDENT
    for word in (*words, *last):
        if line and width + len(word) > WIDTH:
            yield " ".join(line)
            line, width = [], INDENT
        line.append(word)
        width += len(word) + 1
    if line:
        yield " ".join(line)


_INNER = "    "
# Each fact's terms are constants by then, and there are many: this runs in C.
_NAME = attrgetter("name")


def write(document: Domain | Problem) -> str:
    """Write a document as PDDL.

    Args:
        document: a domain or a problem.

    Returns:
        The text, which reads back as an equal document, and ends with a newline.

    Raises:
        InvalidKnowledgeError: it says something that text could not carry.
    """
    if isinstance(document, Domain):
        return write_domain(document)
    if isinstance(document, Problem):
        return write_problem(document)
    raise InvalidKnowledgeError(
        f"what is written is a Domain or a Problem, not {type(document).__name__}"
    )


def write_domain(domain: Domain) -> str:
    """Write a domain as PDDL."""
    _check_names(domain)
    lines = [f"(define (domain {domain.name})", *_requirements(domain.requirements)]
    typed = bool(domain.types)
    lines += _section("types", typed_lines(domain.types, typed))
    lines += _section("constants", typed_lines(domain.constants, typed))
    lines += _section("predicates", [_predicate(part, typed) for part in domain.predicates])
    lines += _section("functions", function_lines(domain.functions, typed))
    lines += _constraints(domain.constraints, typed)
    lines += [_derived(rule, typed) for rule in domain.derived]
    for action in domain.actions:
        with _within(f"in {action.kind} {action.name}"):
            lines += _action(action, typed)
    return "\n".join([*lines, ")\n"])


def write_problem(
    problem: Problem, facts: Iterable[str] | None = None, values: Iterable[str] | None = None
) -> str:
    """Write a problem as PDDL."""
    _check_names(problem)
    lines = [f"(define (problem {problem.name})", f"  (:domain {problem.domain})"]
    lines += _requirements(problem.requirements)
    typed = any(name.types != (ROOT_TYPE,) for name in problem.objects)
    lines += _section("objects", typed_lines(problem.objects, typed))
    lines.append("  (:init")
    lines += [_INNER + fact for fact in (fact_texts(problem.facts) if facts is None else facts)]
    with _within("in :init"):
        lines += [_INNER + node_text(literal) for literal in problem.literals]
        values = map(_value, problem.values) if values is None else values
        lines += [_INNER + value for value in values]
        lines += [_INNER + _timed_text(timed) for timed in problem.timed]
    lines.append("  )")
    with _within("in :goal"):
        lines += _conjunction("  (:goal", "  ", problem.goal, typed, ")")
    lines += _constraints(problem.constraints, typed)
    if problem.metric is not None:
        with _within("in :metric"):
            check_word("optimization", problem.metric.optimization, ("minimize", "maximize"))
            expression = node_text(problem.metric.expression)
            lines.append(f"  (:metric {problem.metric.optimization} {expression})")
    return "\n".join([*lines, ")\n"])


def _check_names(document: Domain | Problem) -> None:
    """Refuse names that could not be read back; what refers to an element has its name."""
    roots: list[Node] = [*document.constraints]
    if isinstance(document, Domain):
        check_name("domain", document.name)
        kinds: list[tuple[str, Iterable[str]]] = [
            (kind, [element.name for element in elements])
            for kind, elements in (
                ("type", document.types),
                ("constant", document.constants),
                ("predicate", document.predicates),
                ("action", document.actions),
            )
        ]
        kinds += [(function_kind(f.parameters, f.types), [f.name]) for f in document.functions]
        for elements in (document.predicates, document.functions, document.actions):
            parameters = [element.parameters for element in elements]
            kinds += [("parameter", map(_NAME, each)) for each in parameters]
        for action in document.actions:
            parts = [*action.duration, *action.condition, *action.effect]
            roots += parts
            if action.kind == DURATIVE_ACTION:
                bound = [*action.parameters, *_variables(parts)]
                kinds.append(("variable of a durative action", map(_NAME, bound)))
        roots += document.derived
    else:
        _check_initial_state(document)
        check_name("problem", document.name)
        check_name("domain", document.domain)
        kinds = [("object", map(_NAME, document.objects))]
        roots += document.goal
    for kind, names in kinds:
        for name in names:
            check_name(kind, name)
    for variable in _variables(roots):
        check_name("variable", variable.name)
    for node in walk(*roots):
        if isinstance(node, Preference) and node.name is not None:
            check_name("preference", node.name)


def _variables(roots: Iterable[Node]) -> Iterator[TypedName]:
    for node in walk(*roots):
        yield from getattr(node, "variables", ())


def _check_initial_state(problem: Problem) -> None:
    """Refuse an initial state that contradicts itself: it would be read as another one."""
    facts = set(problem.facts) if problem.literals else set()
    for literal in problem.literals:
        if isinstance(literal, Not) and literal.formula in facts:
            raise InvalidKnowledgeError(
                f"in :init: {node_text(literal)} denies a fact that holds; leave out one of them"
            )
    values = dict(problem.values)
    if len(values) < len(problem.values):
        for fluent, value in problem.values:
            if values[fluent] != value:
                raise InvalidKnowledgeError(
                    f"in :init: {fluent} has two values; leave out one of them"
                )


def fact_texts(facts: Sequence[Atom]) -> list[str]:
    """Write what holds at first, in bulk."""
    for predicate in {fact.predicate for fact in facts}:
        check_predicate(predicate)
    if {type(term) for fact in facts for term in fact.terms} - {Constant}:
        wrong = next(fact for fact in facts if any(type(t) is not Constant for t in fact.terms))
        raise InvalidKnowledgeError(f"in :init: {shown(wrong)} is not ground; give it objects only")
    return [
        f"({fact.predicate} {' '.join(map(_NAME, fact.terms))})"
        if fact.terms
        else f"({fact.predicate})"
        for fact in facts
    ]


@contextmanager
def _within(where: str) -> Iterator[None]:
    try:
        yield
    except InvalidKnowledgeError as error:
        raise type(error)(f"{where}: {error}") from error


def _requirements(requirements: Sequence[str]) -> list[str]:
    for requirement in requirements:
        if not is_requirement(requirement):
            check_name("requirement", requirement.removeprefix(":"))
            raise InvalidNameError(f"{requirement!r} is no requirement; write it ':{requirement}'")
    return [f"  (:requirements {' '.join(requirements)})"] if requirements else []


def _section(keyword: str, lines: Iterable[str]) -> list[str]:
    inner = [_INNER + line for line in lines]
    return [f"  (:{keyword}", *inner, "  )"] if inner else []


def _predicate(predicate: Predicate, typed: bool) -> str:
    check_predicate(predicate.name)
    return skeleton(predicate.name, predicate.parameters, typed)


def _derived(rule: Derived, typed: bool) -> str:
    with _within(f"in :derived {rule.predicate}"):
        check_predicate(rule.predicate)
        head = skeleton(rule.predicate, rule.variables, typed)
        return f"  (:derived {head} {node_text(rule.formula, typed)})"


def _constraints(constraints: Sequence[Formula], typed: bool) -> list[str]:
    if not constraints:
        return []
    with _within("in :constraints"):
        return _conjunction("  (:constraints", "  ", constraints, typed, ")")


def _conjunction(
    head: str, indent: str, formulas: Sequence[Node], typed: bool, close: str = ""
) -> list[str]:
    if not formulas:
        return [f"{head} (and){close}"]
    inner = [f"{indent}  {node_text(formula, typed)}" for formula in formulas]
    return [f"{head} (and", *inner, f"{indent}){close}"]


def _action(action: Action, typed: bool) -> list[str]:
    check_word("kind of action", action.kind, (ACTION, DURATIVE_ACTION, PROCESS, EVENT))
    check_types(action.parameters)
    lines = [
        f"  (:{action.kind} {action.name}",
        f"{_INNER}:parameters ({variables_text(action.parameters, typed)})",
    ]
    condition = ":precondition"
    if action.kind == DURATIVE_ACTION:
        condition = ":condition"
        lines += _duration(action.duration)
    elif action.duration:
        raise InvalidKnowledgeError(f"only a durative action has a duration, not a {action.kind}")
    lines += _conjunction(_INNER + condition, _INNER, action.condition, typed)
    lines += _conjunction(f"{_INNER}:effect", _INNER, action.effect, typed)
    return [*lines, "  )"]


def _duration(constraints: Sequence[Formula]) -> list[str]:
    head = f"{_INNER}:duration"
    if len(constraints) == 1 and not isinstance(constraints[0], And):
        return [f"{head} {node_text(constraints[0])}"]
    return _conjunction(head, _INNER, constraints, typed=False)


def _value(value: FunctionValue) -> str:
    if not isinstance(value.value, Number | Constant):
        raise InvalidKnowledgeError(
            f"{shown(value.fluent)} is {shown(value.value)}, not a number or an object"
        )
    return f"(= {node_text(value.fluent)} {node_text(value.value)})"


def _timed_text(timed: TimedLiteral) -> str:
    effect = timed.effect
    if isinstance(effect, Assign):
        check_word("timed effect on a fluent", effect.operator, ("assign",))
        text = f"(= {node_text(effect.fluent)} {node_text(effect.value)})"
    else:
        text = node_text(effect)
    return f"(at {decimal_text(timed.time.value)} {text})"
