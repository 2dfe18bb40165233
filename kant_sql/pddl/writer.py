"""Documents become PDDL text, in one canonical layout.

The sections are in the order of the standard (Kovacs, Complete BNF description of PDDL 3.1, 2011).
Each declaration, fact and conjunct is on a line of its own. Lists of conjuncts are always written
as `(and ...)`, for not every parser reads `()`. Nothing is added to what a document says, but that
a document with types says `- object`, too: VAL refuses an untyped parameter there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter

from ..dto.formula import (
    And,
    Assign,
    Atom,
    Constant,
    Derived,
    Formula,
    Node,
    Not,
    Number,
    Preference,
    TimedLiteral,
    TypedName,
    variables_text,
)
from ..dto.name import ROOT_TYPE, check_name, function_kind, is_requirement
from ..dto.node import shown, walk
from ..dto.number import decimal_text
from ..errors import InvalidKnowledgeError, InvalidNameError
from .declaration_text import function_lines, skeleton, typed_lines
from .document import (
    ACTION,
    DURATIVE_ACTION,
    EVENT,
    PROCESS,
    Action,
    Domain,
    FunctionValue,
    Predicate,
    Problem,
)
from .node_text import check_predicate, check_types, check_word, node_text

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
    """Write a domain as PDDL.

    Args:
        domain: the domain.

    Returns:
        The text.

    Raises:
        InvalidKnowledgeError: it says something that text could not carry.
    """
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
    """Write a problem as PDDL.

    Args:
        problem: the problem.
        facts: the texts of what holds at first, instead of the problem's own facts.
        values: the texts of the fluents' values, instead of the problem's own values.

    Returns:
        The text.

    Raises:
        InvalidKnowledgeError: it says something that text could not carry.
    """
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
        lines += [_INNER + _timed(timed) for timed in problem.timed]
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
    """Write what holds at first, in bulk.

    Args:
        facts: ground atoms.

    Returns:
        Their texts, in their order.

    Raises:
        InvalidKnowledgeError: one is not ground, or its predicate's name is reserved.
    """
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


def _timed(timed: TimedLiteral) -> str:
    effect = timed.effect
    if isinstance(effect, Assign):
        check_word("timed effect on a fluent", effect.operator, ("assign",))
        text = f"(= {node_text(effect.fluent)} {node_text(effect.value)})"
    else:
        text = node_text(effect)
    return f"(at {decimal_text(timed.time.value)} {text})"
