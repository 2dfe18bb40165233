"""Reading texts from callers: one condition, constraint or step, or one declaration.

Each function refuses other texts, and undeclared names, with a `PddlError`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from decimal import Decimal
from typing import Any, NamedTuple, TypeVar

from typing_extensions import override

from ..arguments import expect
from ..dto import formulas as f
from ..dto.actions import CLASSES, DEFAULT_DURATION, PddlActionDto
from ..dto.elements import (
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from ..dto.lexical import fold, is_name
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from .cursor import END, OBJECTS, VARIABLES, Cursor, Diagnostics, Section, hint
from .declarations import ActionReader, DeclarationReader, RuleReader
from .document import DURATIVE_ACTION
from .forms import ACTIONS
from .formulas import CONSTRAINTS, EFFECT, NO_EFFECTS, PREFERENCES, RULES, FormulaReader
from .lexer import STRING, Text, tokenize
from .problem import InitialStateReader, metric_of
from .symbols import ANY, BoundVariable, Entity, SymbolTable, Types

N = TypeVar("N", bound=f.Node)


class ReadCondition(NamedTuple):
    """A formula, and its free variables, in the order of their first occurrence."""

    formula: f.Formula
    free: tuple[f.TypedName, ...]  # the free variables; `object` where nothing declares a type
    are_declared: bool  # whether a list of parameters declared the free variables


class ReadValue(NamedTuple):
    """A function applied to objects, and its value: a number, an object's name, or neither."""

    fluent: f.Fluent
    value: Decimal | str | None


class ConditionReader(FormulaReader):
    """A reader of formulas that stand alone; without parameters, unbound variables are free."""

    def __init__(
        self, symbols: SymbolTable, text: str | Text, nesting: str, parameters: str | None = None
    ) -> None:
        super().__init__(Diagnostics(strict=False), _section(text), symbols, nesting)
        _refuse_unclosed(self)
        self.free: dict[str, BoundVariable] = {}
        self._are_declared = parameters is not None
        if parameters is not None:
            for variable in _declared(symbols, parameters):
                bound = symbols.bound(f"?{variable.name}", variable.types)
                self.free[bound.key] = bound
                self.scope.bind(f"?{variable.name}", bound)

    def whole(self, context: int) -> f.Formula:
        """Read a formula up to the end of the text."""
        formula = f.And() if self.is_empty() else self.formula(context)
        if self.is_empty():
            self.at += 2
        if self.tokens[self.at]:
            self.fail("the end of the text: one formula, or (and ...) of several")
        return formula

    def fluent_or_formula(self) -> f.Node:
        """Read a formula, or a function applied to terms, up to the end of the text."""
        if self.tokens[self.at + 1] == "=" or self.tokens[self.at] != "(":
            return self.whole(0)
        fluent = self._fluent()
        _refuse_more(self, "one function")
        return fluent

    def _named_term(self) -> Entity:
        token = self.tokens[self.at]
        if token[:1] != "?" or self._are_declared or self.scope.find(token) is not None:
            return super()._named_term()
        if not is_name(token[1:], "variable"):
            self.fail("a variable")
        self.at += 1
        key = fold(token)
        if key not in self.free:
            self.free[key] = self.symbols.bound(token, ANY)
        return self.free[key].entity


def _section(text: str | Text, keyword: str = "") -> Section:
    whole = text if isinstance(text, Text) else Text(STRING, whole=text)
    return Section(whole, keyword, 0, len(whole.code))


def _refuse_unclosed(reader: Cursor) -> None:
    """Refuse a text that ends within parentheses; in a document, sections are closed by then."""
    if reader.tokens.count("(") > reader.tokens.count(")"):
        reader.fail("')'", at=reader.tokens.index(""))


def _declared(symbols: SymbolTable, parameters: str) -> tuple[f.TypedName, ...]:
    """Read a list of typed variables, with or without its parentheses."""
    text = parameters if parameters.lstrip().startswith("(") else f"({parameters})"
    reader = FormulaReader(Diagnostics(strict=False), _section(text), symbols, "the parameters")
    _refuse_unclosed(reader)
    reader.expect("(", "'(' before the parameters")
    found = reader.bind(reader.typed_list(VARIABLES))
    if reader.tokens[reader.at]:
        reader.fail("the end of the parameters")
    return found


def disjuncts(text: str) -> list[str]:
    """Return the parts of a disjunction, and of nested ones, as texts, with any names."""
    tokens = tokenize(Text(STRING, whole=text).code)
    parts: list[list[str]] = []
    # The depth of the part being read, below the disjunctions around it.
    depth, place = 0, 0
    while place < len(tokens):
        token = tokens[place]
        if not depth and [token, *map(str.lower, tokens[place + 1 : place + 2])] == ["(", "or"]:
            place += 1
        elif depth or token != ")":
            if not depth:
                parts.append([])
            parts[-1].append(token)
            depth += (token == "(") - (token == ")")
        place += 1
    return [" ".join(part) for part in parts]


def read_condition(
    text: str, *, symbols: SymbolTable, parameters: str | None = None
) -> ReadCondition:
    """Read a condition; `parameters` is PDDL text that declares its free variables."""
    expect(text, str, "the condition", InvalidArgumentError)
    if parameters is not None:
        expect(parameters, str, "the parameters", InvalidArgumentError)
    reader = ConditionReader(symbols, text, "the condition", parameters)
    formula = reader.whole(0)
    free = tuple(bound.declared for bound in reader.free.values())
    return ReadCondition(formula, free, parameters is not None)


def read_constraints(text: str, *, symbols: SymbolTable) -> f.Formula:
    """Read constraints on trajectories, with preferences, as in `(:constraints ...)`."""
    reader = ConditionReader(symbols, text, "the constraints", "()")
    return reader.whole(CONSTRAINTS | PREFERENCES)


def read_rules(text: str | Text, *, symbols: SymbolTable) -> tuple[f.Formula, ...]:
    """Read constraints on trajectories, one after the other.

    `(and ...)` and `(:constraints ...)` around them are optional; `:constraints` around one, as
    in a domain, may be repeated. `(at-most-one (?p - place) ...)` is a rule that always holds.
    """
    reader = ConditionReader(symbols, text, "the rules", "()")
    context = CONSTRAINTS | PREFERENCES | RULES
    found: list[f.Formula] = []
    while reader.tokens[reader.at]:
        if fold(reader.tokens[reader.at + 1]) != ":constraints":
            found.append(reader.formula(context))
            continue
        reader.at += 2
        while reader.tokens[reader.at] not in ("", ")"):
            found.append(reader.formula(context))
        reader.expect(")", "')' after the constraints")
    return tuple(found)


def read_fact(text: str, *, symbols: SymbolTable) -> f.Atom:
    """Read a ground atom whose terms are objects."""
    reader = ConditionReader(symbols, text, "the fact", "()")
    if reader.tokens[0] != "(":
        reader.fail("a fact such as (robot_at rb1 wp1)")
    head = reader.tokens[1]
    is_fact = head.lower() not in NO_EFFECTS or symbols.predicates.find(head) is not None
    formula = reader.whole(EFFECT) if is_fact else None
    if not isinstance(formula, f.Atom) or not all(
        isinstance(term, f.Constant) for term in formula.terms
    ):
        reader.fail("a fact such as (robot_at rb1 wp1)", f"'{text:.60}'", 0)
    return formula


def read_goal(text: str, *, symbols: SymbolTable) -> f.Formula:
    """Read a goal without free variables, with preferences, as in `(:goal ...)`."""
    return ConditionReader(symbols, text, "the goal", "()").whole(PREFERENCES)


def _refuse_more(reader: Cursor, read: str | None = None) -> None:
    """Refuse text after what was read."""
    if reader.tokens[reader.at]:
        reader.fail(f"the end of the text after {read or reader.nesting}")


def read_metric(text: str, *, symbols: SymbolTable) -> f.Metric:
    """Read a metric such as `(:metric minimize (total-time))`."""
    reader = FormulaReader(Diagnostics(strict=False), _section(text), symbols, "the metric")
    if reader.peek_head("a metric such as (:metric ...)", ":metric").lower() != ":metric":
        reader.fail(":metric", at=1)
    _refuse_unclosed(reader)
    metric = metric_of(reader)
    _refuse_more(reader)
    return metric


def read_derived(text: str, *, symbols: SymbolTable) -> f.Derived:
    """Read a rule such as `(:derived (reachable ?p - place) (connected dock ?p))`."""
    section = _section(text, "the rule")
    reader = RuleReader(Diagnostics(strict=False), section, symbols, "the rule")
    if reader.peek_head("a rule such as (:derived ...)", ":derived").lower() != ":derived":
        reader.fail(":derived", at=1)
    _refuse_unclosed(reader)
    rule = reader.rule(section)
    reader.nesting = "the rule"
    _refuse_more(reader)
    return rule


def _initial_reader(text: str, symbols: SymbolTable) -> InitialStateReader:
    section = _section(text, "the initial state")
    reader = InitialStateReader(Diagnostics(strict=False), section, symbols)
    _refuse_unclosed(reader)
    return reader


def _only(reader: InitialStateReader, found: tuple[N, ...], expected: str) -> N:
    """Return the only element of a part of an initial state."""
    if not found:
        reader.fail(expected, at=0)
    _refuse_more(reader)
    return found[0]


def read_initial_literal(text: str, *, symbols: SymbolTable) -> f.Not | f.Equal:
    """Read a literal of the initial state that is not a fact, such as `(not (open door1))`."""
    expected = "a literal such as (not (open door1)); kb.propositions takes facts"
    reader = _initial_reader(text, symbols)
    return _only(reader, reader.one()["literals"], expected)


def read_timed_literal(text: str, *, symbols: SymbolTable) -> f.TimedLiteral:
    """Read a timed initial literal such as `(at 10 (open door1))`."""
    expected = "a timed literal such as (at 10 (open door1))"
    reader = _initial_reader(text, symbols)
    return _only(reader, reader.one()["timed"], expected)


def read_value(text: str, *, symbols: SymbolTable) -> ReadValue:
    """Read the value of a fluent, such as `(= (battery rb1) 80)`, or a fluent alone."""
    reader = ConditionReader(symbols, text, "the function value", "()")
    match reader.fluent_or_formula():
        case f.Comparison("=", f.Fluent() as fluent, f.Number(value)):
            found = ReadValue(fluent, value)
        case f.Equal(f.Fluent() as fluent, f.Constant(name)):
            found = ReadValue(fluent, name)
        case f.Fluent() as fluent:
            found = ReadValue(fluent, None)
        case _:
            reader.fail("a value such as (= (battery rb1) 80)", f"'{text:.60}'", 0)
    if not all(isinstance(term, f.Constant) for term in found.fluent.terms):
        reader.fail("a function of objects, such as (battery rb1)", f"'{found.fluent}'", 0)
    return found


def read_step(
    text: str,
    *,
    symbols: SymbolTable,
    action: Callable[[str], str | None],  # returns the declared spelling of a name
    actions: Callable[[], Iterable[str]],
) -> tuple[str, tuple[str, ...]]:
    """Read a ground action such as `(move rb1 wp1 wp2)`, with or without its parentheses."""
    given = text if text.lstrip().startswith("(") else f"({text})"
    reader = FormulaReader(Diagnostics(strict=False), _section(given), symbols, "the step")
    _refuse_unclosed(reader)
    reader.expect("(", "'(' before the action")
    at = reader.at
    word = reader.word("the name of an action")
    found = action(word)
    if found is None:
        expected = f"an action that is declared{hint(word, [*actions()])}"
        reader.fail(expected, f"the action {reader.quoted(at)}", at)
    arguments = []
    while reader.tokens[reader.at] != ")":
        if reader.tokens[reader.at] in ("", "("):
            reader.fail("an object, or ')' after the arguments")
        arguments.append(str(reader.term()[0]))
    reader.at += 1
    _refuse_more(reader, "one step")
    return found, tuple(arguments)


class _ElementReader(DeclarationReader):
    """A reader of one declaration that stands alone; the end of the text closes it."""

    def __init__(self, text: str, kind: str, example: str) -> None:
        expect(text, str, f"the {kind}", InvalidArgumentError)
        symbols = SymbolTable(unknown_domain=True)
        super().__init__(Diagnostics(strict=False), _section(text), symbols)
        self._kind, self._one = kind, f"one {kind} such as {example}"
        self.at, self.nesting = 0, f"the {kind}"
        self._end = self.tokens.index("")
        _refuse_unclosed(self)
        self.tokens = [*self.tokens[: self._end], ")", *self.tokens[self._end :]]

    @override
    def quoted(self, index: int) -> str:
        return END if index == self._end else super().quoted(index)

    def refuse_rest(self, at: int) -> None:
        """Refuse a text that does not end at a token."""
        if at < self._end:
            self.fail(self._one, at=at)

    def name(self) -> tuple[str, Types]:
        """Read a name and its types."""
        if self.tokens[0] in ("(", ")"):
            self.fail(self._one)
        groups = self.typed_list(OBJECTS)
        self.refuse_rest(self.at - 1)
        words = groups[0].words if groups else []
        if len(words) != 1 or len(groups) > 1:
            self.fail(self._one, at=1 if len(words) > 1 else groups[1].at if words else 0)
        if not is_name(words[0], self._kind):
            self.refuse_name(words[0], self._kind, 0)
        types = groups[0].types
        return words[0], self.resolve(self.symbols, types, 1) if types else ()


def _type_dto(types: Types) -> PddlTypeDto:
    made = [PddlTypeDto(name) for name in types]
    return made[0] if len(made) == 1 else PddlEitherTypeDto(made)


def read_type(text: str) -> PddlTypeDto:
    """Read a type and its parent, such as `robot - vehicle`, or a type alone."""
    name, parents = _ElementReader(text, "type", "'robot - vehicle'").name()
    return PddlTypeDto(name, parent=_type_dto(parents) if parents else None)


def read_object(text: str) -> PddlObjectDto:
    """Read an object such as `rb1 - robot`; without a type it is an `object`."""
    name, types = _ElementReader(text, "object", "'rb1 - robot'").name()
    return PddlObjectDto(_type_dto(types or ANY), name)


def read_predicate(text: str) -> PddlPredicateDto:
    """Read a predicate such as `(robot_at ?r - robot ?p - place)`."""
    reader = _ElementReader(text, "predicate", "(robot_at ?r - robot ?p - place)")
    predicate, _ = reader.predicate()
    reader.refuse_rest(reader.at)
    return PddlPredicateDto(predicate.name, **_parameters(predicate.parameters))


def read_function(text: str) -> PddlFunctionDto:
    """Read a function such as `(battery ?r - robot) - number`; without a type it is a number."""
    reader = _ElementReader(text, "function", "(battery ?r - robot) - number")
    found = [*reader.functions()]
    reader.refuse_rest(reader.at - 1)
    reader.refuse_rest(found[1][1] - 1 if found[1:] else reader.at if found else -1)
    [(function, _)] = found
    value_types = [PddlTypeDto(name) for name in function.types]
    return PddlFunctionDto(
        function.name, value_types=value_types, **_parameters(function.parameters)
    )


def read_action(text: str, *, symbols: SymbolTable | None = None) -> PddlActionDto:
    """Read an action, a process or an event; without symbols, it may use any names."""
    expect(text, str, "the action", InvalidArgumentError)
    symbols = symbols or SymbolTable(unknown_domain=True)
    reader = ActionReader(Diagnostics(strict=False), _section(text), symbols, "the action")
    keyword = reader.peek_head("an action such as (:action ...)", "a keyword such as :action")
    if keyword.lower() not in ACTIONS:
        reader.fail(f"one of {', '.join(ACTIONS)}{hint(keyword, list(ACTIONS))}", at=1)
    _refuse_unclosed(reader)
    action, _ = reader.action(_section(text, keyword.lower()))
    _refuse_more(reader, "one action")
    dto = CLASSES.get(action.kind, PddlActionDto)(action.name)
    dto.parameters = [PddlObjectDto(_type_dto(each.types), each.name) for each in action.parameters]
    dto.conditions, dto.effects = list(action.condition), list(action.effect)
    dto.durative = action.kind == DURATIVE_ACTION
    dto.duration = list(action.duration) if dto.durative else DEFAULT_DURATION
    return dto


def _parameters(parameters: Iterable[f.TypedName]) -> dict[str, Any]:
    return {
        "types": [_type_dto(each.types) for each in parameters],
        "parameter_names": [each.name for each in parameters],
    }


def text_of(given: object) -> str:
    """Return the text of a condition given as text or as a node."""
    if isinstance(given, str):
        return given
    if isinstance(given, f.Node):
        return str(given)
    raise InvalidKnowledgeError(
        f"{type(given).__name__} is not a formula; give PDDL text such as '(robot_at ?r kitchen)', "
        "or a node"
    )
