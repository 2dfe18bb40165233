"""Canonical PDDL text of documents and nodes.

`str()` of a node gives the same text. The writer also refuses hand-made documents and nodes that
could not be read back.

Sections are in the order of the standard (Kovacs, Complete BNF description of PDDL 3.1, 2011). Each
declaration, fact and conjunct has its own line. Lists of conjuncts are always `(and ...)`, because
not every parser reads `()`. The text contains nothing that the document lacks, except `- object`
in a document with types: VAL refuses an untyped parameter there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from operator import attrgetter
from typing import Any

from ..arguments import expect, shown
from ..dto import formulas as f
from ..dto.lexical import (
    RESERVED,
    ROOT_TYPE,
    check_name,
    decimal_text,
    either_text,
    fold,
    function_kind,
    is_requirement,
)
from ..errors import InvalidKnowledgeError, InvalidNameError
from . import document as pddl

PREFERENCE, DEFINE = "preference", "define"
# After these words, a parenthesis begins a formula or a fluent, not a term.
_OPERATORS = {DEFINE, PREFERENCE, *f.MODALS, *f.ASSIGNMENTS}
_TIME_WORDS = {tuple(time.split()) for time in f.TIMES}


# Parts of documents that are not formulas.
_PARTS = (f.Derived, f.TimedLiteral, f.Metric)


def node_text(node: f.Node, explicit: bool = False) -> str:
    """Write a node."""
    if type(node) in _PARTS:
        raise InvalidKnowledgeError(
            f"a {type(node).__name__} is not part of a formula; put it where the document has it"
        )
    return f.node_text(node, _explicit_head if explicit else _head)


def _head(node: f.Node, explicit: bool = False) -> str:
    check = _CHECKS.get(type(node))
    if check is not None:
        check(node)
    return f.head(node, explicit)


_explicit_head = partial(_head, explicit=True)


def check_types(names: Iterable[f.TypedName]) -> None:
    """Refuse a typed list that would not read back."""
    for name in names:
        if not name.types:
            raise InvalidKnowledgeError(f"{name.name!r} has no type; give it 'object'")
        if not RESERVED["type"].isdisjoint(map(fold, name.types)):
            raise InvalidKnowledgeError(
                f"{name.name!r} is of a type called 'either', a reserved word; choose another name"
            )


def check_predicate(name: str) -> None:
    """Refuse a predicate with a reserved name."""
    if fold(name) in RESERVED["predicate"]:
        check_name("predicate", name)


def check_word(what: str, word: str, allowed: Collection[str]) -> None:
    """Refuse a word that is not one of some choices."""
    if word not in allowed:
        raise InvalidKnowledgeError(f"{word!r} is not {what}; use one of {', '.join(allowed)}")


def _check_atom(node: f.Atom) -> None:
    word = fold(node.predicate)
    check_predicate(node.predicate)
    match node.terms:
        case (f.Constant(name), f.Fluent()) if (word, fold(name)) in _TIME_WORDS:
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of the object '{name}' and a function's value is read as a"
                " time; rename the object"
            )
        case (f.Fluent(), *_) | (_, f.Fluent(), *_) if word == PREFERENCE or (
            word in _OPERATORS and isinstance(node.terms[0], f.Fluent)
        ):
            raise InvalidKnowledgeError(
                f"'{node.predicate}' of a function's value is read as the operator; rename the"
                " predicate"
            )


def _check_fluent(node: f.Fluent) -> None:
    if node.terms and isinstance(node.terms[0], f.Fluent) and fold(node.function) == DEFINE:
        raise InvalidKnowledgeError(
            f"'{node.function}' of a function's value is read as a definition; rename the function"
        )


def _check_arithmetic(node: f.Arithmetic) -> None:
    check_word("an arithmetic operator", node.operator, f.ARITHMETIC)
    if len(node.operands) < (1 if node.operator == "-" else 2):
        raise InvalidKnowledgeError(
            f"{node.operator!r} of {len(node.operands)} operands is not a number; give it two"
        )


def _check_modal(node: f.Modal) -> None:
    check_word("a modal operator", node.operator, f.MODALS)
    given = (len(node.numbers), len(node.formulas))
    numbers, formulas = f.MODALS[node.operator]
    if given != (numbers, formulas):
        raise InvalidKnowledgeError(
            f"{node.operator!r} takes {numbers} numbers and {formulas} formulas,"
            f" not {given[0]} and {given[1]}; give it these"
        )


_CHECKS: dict[type, Callable[[Any], None]] = {
    f.Atom: _check_atom,
    f.Fluent: _check_fluent,
    f.Arithmetic: _check_arithmetic,
    f.Modal: _check_modal,
    f.Comparison: lambda node: check_word("a comparison", node.operator, f.COMPARISONS),
    f.Assign: lambda node: check_word("an effect on a fluent", node.operator, f.ASSIGNMENTS),
    f.Timed: lambda node: check_word("a time of a condition or an effect", node.time, f.TIMES),
    f.Forall: lambda node: check_types(node.variables),
    f.Exists: lambda node: check_types(node.variables),
    f.Count: lambda node: check_types(node.variables),
}


WIDTH = 100
INDENT = 4
NUMBER = "number"


def typed_lines(names: Sequence[f.TypedName], explicit: bool) -> Iterator[str]:
    """Write a typed list of types, constants or objects: a line for each run of one type."""
    check_types(names)
    for run in f.typed_runs(names, explicit):
        yield from _wrapped(run)


def skeleton(name: str, parameters: Sequence[f.TypedName], explicit: bool) -> str:
    """Write a predicate's or a function's declaration."""
    check_types(parameters)
    return f.skeleton_text(name, parameters, explicit)


def function_lines(functions: Sequence[pddl.Function], explicit: bool) -> Iterator[str]:
    """Write the declarations of functions, one on each line."""
    end = f.typed_end([bool(function.types) for function in functions])
    for position, function in enumerate(functions):
        text = skeleton(function.name, function.parameters, explicit)
        types = function.types or (NUMBER,)
        check_types([f.TypedName(function.name, types)])
        if NUMBER in map(fold, function.types):
            raise InvalidKnowledgeError(
                f"function {function.name!r} is of a type called 'number', which is read as a"
                " number; choose another name for the type"
            )
        yield text if position >= end else f"{text} - {either_text(types)}"


def _wrapped(words: Iterable[str]) -> Iterator[str]:
    line: list[str] = []
    width = INDENT
    for word in words:
        if line and width + len(word) > WIDTH:
            yield " ".join(line)
            line, width = [], INDENT
        line.append(word)
        width += len(word) + 1
    if line:
        yield " ".join(line)


_INNER = "    "
# There may be many names: `attrgetter` runs in C.
_NAME = attrgetter("name")


def write(document: pddl.Domain | pddl.Problem) -> str:
    """Write a document as PDDL.

    Args:
        document: a domain or a problem.

    Returns:
        The text; it ends with a newline, and reads back as an equal document.

    Raises:
        InvalidKnowledgeError: PDDL text cannot express something in the document.
    """
    expect(document, (pddl.Domain, pddl.Problem), "the document to write")
    return write_domain(document) if isinstance(document, pddl.Domain) else write_problem(document)


def write_domain(domain: pddl.Domain) -> str:
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
    problem: pddl.Problem, facts: Iterable[str] | None = None, values: Iterable[str] | None = None
) -> str:
    """Write a problem as PDDL."""
    _check_initial_state(problem)
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
            check_word("an optimization", problem.metric.optimization, ("minimize", "maximize"))
            expression = node_text(problem.metric.expression)
            lines.append(f"  (:metric {problem.metric.optimization} {expression})")
    return "\n".join([*lines, ")\n"])


def _check_names(document: pddl.Domain | pddl.Problem) -> None:
    for kind, names in _names(document):
        for name in names:
            check_name(kind, name)


def _names(document: pddl.Domain | pddl.Problem) -> Iterator[tuple[str, Iterable[str]]]:
    """Yield the kind and the names of elements; references have the name of their element."""
    roots: list[f.Node] = [*document.constraints]
    if isinstance(document, pddl.Problem):
        yield "problem", [document.name]
        yield "domain", [document.domain]
        yield "object", map(_NAME, document.objects)
        roots += document.goal
    else:
        yield "domain", [document.name]
        yield "type", map(_NAME, document.types)
        yield "constant", map(_NAME, document.constants)
        yield "predicate", map(_NAME, document.predicates)
        yield "action", map(_NAME, document.actions)
        for function in document.functions:
            yield function_kind(function.parameters, function.types), [function.name]
        for elements in (document.predicates, document.functions, document.actions):
            for element in elements:
                yield "parameter", map(_NAME, element.parameters)
        for action in document.actions:
            parts = [*action.duration, *action.condition, *action.effect]
            roots += parts
            if action.kind == pddl.DURATIVE_ACTION:
                bound = [*action.parameters, *_variables(parts)]
                yield "variable of a durative action", map(_NAME, bound)
        roots += document.derived
    yield "variable", map(_NAME, _variables(roots))
    preferences = [node for node in f.walk(*roots) if isinstance(node, f.Preference)]
    yield "preference", [node.name for node in preferences if node.name is not None]


def _variables(roots: Iterable[f.Node]) -> Iterator[f.TypedName]:
    for node in f.walk(*roots):
        yield from getattr(node, "variables", ())


def _check_initial_state(problem: pddl.Problem) -> None:
    """Refuse an initial state that contradicts itself: it would read back as another one."""
    facts = set(problem.facts) if problem.literals else set()
    for literal in problem.literals:
        if isinstance(literal, f.Not) and literal.formula in facts:
            raise InvalidKnowledgeError(
                f"in :init: {node_text(literal)} denies a fact that holds; leave out one of them"
            )
    values = dict(problem.values)
    for fluent, value in problem.values if len(values) < len(problem.values) else ():
        if values[fluent] != value:
            raise InvalidKnowledgeError(f"in :init: {fluent} has two values; leave out one of them")


def fact_texts(facts: Sequence[f.Atom]) -> list[str]:
    """Write facts in bulk."""
    for predicate in {fact.predicate for fact in facts}:
        check_predicate(predicate)
    if {type(term) for fact in facts for term in fact.terms} - {f.Constant}:
        wrong = next(fact for fact in facts if any(type(t) is not f.Constant for t in fact.terms))
        raise InvalidKnowledgeError(f"in :init: {shown(wrong)} is not ground; give it objects only")
    return [f"({' '.join((fact.predicate, *map(_NAME, fact.terms)))})" for fact in facts]


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
            raise InvalidNameError(
                f"{requirement!r} is not a requirement; write it ':{requirement}'"
            )
    return [f"  (:requirements {' '.join(requirements)})"] if requirements else []


def _section(keyword: str, lines: Iterable[str]) -> list[str]:
    inner = [_INNER + line for line in lines]
    return [f"  (:{keyword}", *inner, "  )"] if inner else []


def _predicate(predicate: pddl.Predicate, typed: bool) -> str:
    check_predicate(predicate.name)
    return skeleton(predicate.name, predicate.parameters, typed)


def _derived(rule: f.Derived, typed: bool) -> str:
    with _within(f"in :derived {rule.predicate}"):
        check_predicate(rule.predicate)
        head = skeleton(rule.predicate, rule.variables, typed)
        return f"  (:derived {head} {node_text(rule.formula, typed)})"


def _constraints(constraints: Sequence[f.Formula], typed: bool) -> list[str]:
    if not constraints:
        return []
    with _within("in :constraints"):
        return _conjunction("  (:constraints", "  ", constraints, typed, ")")


def _conjunction(
    head: str, indent: str, formulas: Sequence[f.Node], typed: bool, close: str = ""
) -> list[str]:
    if not formulas:
        return [f"{head} (and){close}"]
    inner = [f"{indent}  {node_text(formula, typed)}" for formula in formulas]
    return [f"{head} (and", *inner, f"{indent}){close}"]


def _action(action: pddl.Action, typed: bool) -> list[str]:
    check_word("a kind of action", action.kind, pddl.ACTION_KINDS)
    check_types(action.parameters)
    lines = [
        f"  (:{action.kind} {action.name}",
        f"{_INNER}:parameters ({f.variables_text(action.parameters, typed)})",
    ]
    condition = ":precondition"
    if action.kind == pddl.DURATIVE_ACTION:
        condition = ":condition"
        lines += _duration(action.duration)
    elif action.duration:
        raise InvalidKnowledgeError(f"only a durative action has a duration, not a {action.kind}")
    lines += _conjunction(_INNER + condition, _INNER, action.condition, typed)
    lines += _conjunction(f"{_INNER}:effect", _INNER, action.effect, typed)
    return [*lines, "  )"]


def _duration(constraints: Sequence[f.Formula]) -> list[str]:
    head = f"{_INNER}:duration"
    if len(constraints) == 1 and not isinstance(constraints[0], f.And):
        return [f"{head} {node_text(constraints[0])}"]
    return _conjunction(head, _INNER, constraints, typed=False)


def _value(value: pddl.FunctionValue) -> str:
    return f"(= {node_text(value.fluent)} {node_text(value.value)})"


def _timed_text(timed: f.TimedLiteral) -> str:
    effect = timed.effect
    if isinstance(effect, f.Assign):
        check_word("a timed effect on a fluent", effect.operator, ("assign",))
        text = f"(= {node_text(effect.fluent)} {node_text(effect.value)})"
    else:
        text = node_text(effect)
    return f"(at {decimal_text(timed.time.value)} {text})"
