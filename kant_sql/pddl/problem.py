"""Reading problems; a tight loop reads plain facts, the bulk of a large problem.

The loop accepts declared spellings of objects that fit. The general readers read all other elements
and report errors.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import Decimal
from operator import getitem
from typing import Final, TypedDict

from ..arguments import shown
from ..dto import formulas as f
from ..dto.lexical import either_text, fold, is_name
from .cursor import OBJECTS, Cursor, Diagnostics, Group, Section, hint
from .declarations import DeclarationReader, TypedNames
from .document import Domain, FunctionValue, Problem
from .forms import Form, check_sections, finish
from .formulas import CONSTRAINTS, PREFERENCES, FormulaReader
from .lexer import Blocks
from .symbols import ANY, Fit, Signatures, SymbolTable, Types

# The arity of predicates without a domain.
MAX_ARITY: Final = 32
_NO_NAME: Final = frozenset({"(", ")", "?", ""})
_PLAIN_NUMBER = re.compile(r"-?[0-9]{1,50}(\.[0-9]{1,50})?")


class NotPlainError(Exception):
    """A token that the tight loop cannot read."""


class _Fitting(dict[str, f.Constant]):
    """The objects that fit a parameter, by declared spelling; found on first use."""

    def __init__(self, symbols: SymbolTable, wanted: Types) -> None:
        super().__init__()
        self._symbols = symbols
        self._wanted = wanted

    def __missing__(self, token: str) -> f.Constant:
        if token[:1] in _NO_NAME:
            raise NotPlainError
        entity = self._symbols.object(token)
        if entity is None or self._symbols.fit(entity[1], self._wanted) is not Fit.YES:
            raise NotPlainError
        constant = entity[0]
        if not isinstance(constant, f.Constant) or constant.name != token:
            raise NotPlainError
        self[token] = constant
        return constant


class _Numbers(dict[str, f.Number]):
    """Numbers in standard spelling, by their text."""

    def __missing__(self, token: str) -> f.Number:
        if _PLAIN_NUMBER.fullmatch(token) is None:
            raise NotPlainError
        number = self[token] = f.Number(Decimal(token))
        return number


@dataclass(slots=True, eq=False)
class FactSignature:
    """A predicate or a function for the tight loop, with its facts or values."""

    name: str
    arity: int
    fitting: list[_Fitting]  # for each parameter, the objects that fit
    value: _Fitting | _Numbers  # for a function, its possible numbers or objects
    # The arguments of its facts, and the index of its value by arguments, in declared spelling.
    facts: set[tuple[str, ...]] = field(default_factory=set)
    values: dict[tuple[str, ...], int] = field(default_factory=dict)


class FactSignatures(dict[str, FactSignature | None]):
    """Predicates or functions, by spelling; None for other words."""

    def __init__(self, symbols: SymbolTable, named: Signatures) -> None:
        super().__init__()
        self._symbols = symbols
        self._named = named
        self._fitting: dict[Types, _Fitting] = {}
        self._numbers = _Numbers()
        self.update(dict.fromkeys(("=", "not")))

    def __missing__(self, word: str) -> FactSignature | None:
        signature = self._named.find(word)
        if signature is None:
            return None
        entry = self.get(signature.name)
        if entry is None:
            fitting = [self._fits(wanted) for wanted in signature.parameters or ()]
            value = self._fits(signature.types) if signature.types else self._numbers
            entry = FactSignature(signature.name, len(fitting), fitting, value)
            self[signature.name] = entry
        self[word] = entry
        return entry

    def _fits(self, wanted: Types) -> _Fitting:
        return self._fitting.setdefault(wanted, _Fitting(self._symbols, wanted))

    def slow(self, name: str, arity: int) -> FactSignature:
        """Return the signature of an atom or fluent that a general reader read."""
        entry = self[name]
        assert entry is not None
        if self._symbols.unknown_domain and entry.arity != arity <= MAX_ARITY:
            entry.arity, entry.fitting = arity, [self._fits(ANY)] * arity
        return entry


_FOREIGN: Final = {
    "oneof": "conformant planning",
    "unknown": "conformant planning",
    "or": "conformant planning",
    "probabilistic": "probabilistic planning",
}


_TokenIndex = tuple[Section, int]


class InitialState(TypedDict):
    """The parts of an initial state, by their names in `Problem`."""

    facts: tuple[f.Atom, ...]
    literals: tuple[f.Not | f.Equal, ...]
    values: tuple[FunctionValue, ...]
    timed: tuple[f.TimedLiteral, ...]


class InitialStateReader(FormulaReader):
    """A reader of an initial state of one or several sections."""

    def __init__(self, diagnostics: Diagnostics, section: Section, symbols: SymbolTable) -> None:
        super().__init__(diagnostics, section, symbols, section.keyword)
        self._facts: list[f.Atom] = []
        self._literals: dict[f.Not | f.Equal, _TokenIndex] = {}
        self._values: list[FunctionValue] = []
        self._replaced: set[int] = set()
        # The first token of each value, and the first value of each section.
        self._value_tokens: list[int] = []
        self._value_sections: list[tuple[int, Section]] = []
        self._timed: dict[str, f.TimedLiteral] = {}
        # The last one of each time and of what it changes.
        self._changes: dict[tuple[Decimal, f.Node], f.TimedLiteral] = {}
        self._predicates = FactSignatures(symbols, symbols.predicates)
        self._functions = FactSignatures(symbols, symbols.functions)

    def read(self, section: Section) -> None:
        """Read a section and its closing parenthesis."""
        self.open(section, section.keyword, [""])
        self._value_sections.append((len(self._values), section))
        self._blocks = Blocks(section.text.code, section.start, section.end)
        # The loop looks ahead as far as the longest fact.
        longest = max(
            MAX_ARITY, self.symbols.predicates.longest(), self.symbols.functions.longest()
        )
        self._ends = [""] * (longest + 6)
        self._count = 0
        self._next_block()
        self.at = 2
        self._elements()
        self.at += 1
        self.tokens[self._count :] = self._blocks.rest() + self._ends

    def one(self) -> InitialState:
        """Read one element."""
        self._lists = 0
        self._element()
        return self.state()

    def state(self) -> InitialState:
        """Return the parts of the initial state."""
        literals = [one for one, place in self._literals.items() if self._agrees(one, place)]
        values = self._values
        if self._replaced:
            values = [one for number, one in enumerate(values) if number not in self._replaced]
        return {
            "facts": tuple(self._facts),
            "literals": tuple(literals),
            "values": tuple(values),
            "timed": tuple(self._timed.values()),
        }

    def _agrees(self, literal: f.Not | f.Equal, place: _TokenIndex) -> bool:
        """Return whether a literal contradicts no fact; otherwise the fact holds, as in VAL."""
        if not isinstance(literal, f.Not) or not isinstance(literal.formula, f.Atom):
            return True
        atom = literal.formula
        entry = self._predicates.slow(atom.predicate, len(atom.terms))
        if tuple([str(term) for term in atom.terms]) not in entry.facts:
            return True
        section, index = place
        found = f"{literal} beside {atom}"
        read_as = f"left out: {atom} holds"
        self.diagnostics.deviate(section, index, found, "one of the two", read_as, section.keyword)
        return False

    def _next_block(self) -> bool:
        """Go to the next block, if there is one."""
        tokens = self._blocks.next()
        self.base += self._count
        self._count = len(tokens)
        self.tokens = tokens + self._ends
        self.at = 0
        return bool(tokens)

    def _elements(self) -> None:
        """Read elements up to the parenthesis that closes their list."""
        tokens, at = self.tokens, self.at
        predicates, append = self._predicates, self._facts.append
        self._lists = 0
        while tokens[at] != ")" or self._lists:
            entry = predicates[tokens[at + 1]]
            if entry is not None and tokens[at] == "(":
                end = at + 2 + entry.arity
                arguments = tuple(tokens[at + 2 : end])
                try:
                    terms = tuple(map(getitem, entry.fitting, arguments))
                except NotPlainError:
                    terms = None
                if terms is not None and tokens[end] == ")" and arguments not in entry.facts:
                    entry.facts.add(arguments)
                    append(f.trusted_atom(entry.name, terms))
                    at = end + 1
                    continue
            elif tokens[at + 1] == "=":
                end = self._plain_value(at)
                if end:
                    at = end
                    continue
            self.at = at
            if tokens[at] or not self._next_block():
                self._element()
            tokens, at = self.tokens, self.at
        self.at = at

    def _plain_value(self, at: int) -> int:
        """Read `(= (function object ...) number)` and return its end; 0 if it is something else."""
        tokens = self.tokens
        entry = self._functions[tokens[at + 3]]
        if entry is None or tokens[at + 2] != "(" or tokens[at] != "(":
            return 0
        end = at + 4 + entry.arity
        arguments = tuple(tokens[at + 4 : end])
        if tokens[end] != ")" or tokens[end + 2] != ")" or arguments in entry.values:
            return 0
        try:
            terms = tuple(map(getitem, entry.fitting, arguments))
            value = entry.value[tokens[end + 1]]
        except NotPlainError:
            return 0
        entry.values[arguments] = len(self._values)
        self._values.append(FunctionValue(f.Fluent(entry.name, terms), value))
        self._value_tokens.append(self.base + at)
        return end + 3

    def _element(self) -> None:
        """Read one element of the initial state, or the end of a nested list."""
        if self.tokens[self.at] == ")":
            self.at += 1
            self._lists -= 1
            return
        head = self.peek_head("a fact, which begins with '('", "a predicate").lower()
        if head == "=":
            self._equation()
        elif head == "not":
            start = self.at
            self._add_literal(self._negation(), start)
        elif head == "at" and self.is_number(2) and self.tokens[self.at + 3] == "(":
            self._timed_element()
        elif head == "and":
            self.deviate("facts without (and ...)", "read as a list")
            self.at += 2
            self._lists += 1
        elif head in _FOREIGN and self._is_foreign(head):
            self.fail("a fact", f"'({head}', which is of {_FOREIGN[head]}")
        else:
            self._fact()

    def _is_foreign(self, head: str) -> bool:
        """Return whether the next word is an operator, not a predicate of that name."""
        if self.symbols.predicates.find(head) is not None:
            return False
        takes_operands = self.tokens[self.at + 2] == "(" or self.is_number(2)
        return takes_operands or not self.symbols.unknown_domain

    def _fact(self) -> None:
        start = self.at
        atom = self._ground_atom()
        entry = self._predicates.slow(atom.predicate, len(atom.terms))
        key = tuple([str(term) for term in atom.terms])
        if key in entry.facts:
            self.deviate("each fact once", "left out", f"{atom} again", start)
            return
        entry.facts.add(key)
        self._facts.append(atom)

    def _ground_atom(self) -> f.Atom:
        name, start = self.peek_head("an atom", "a predicate"), self.at
        atom = self.atom(self.known(self.symbols.predicates, name))
        self._check_ground(atom.terms, start)
        return atom

    def _check_ground(self, terms: tuple[f.Term, ...], start: int) -> None:
        for term in terms:
            if not isinstance(term, f.Constant):
                self.fail("objects as arguments", f"the argument {shown(term)}", start)

    def _negation(self) -> f.Not:
        self.at += 2
        if self.tokens[self.at + 1] == "=":
            formula: f.Atom | f.Equal = self._equality()
        else:
            formula = self._ground_atom()
        self.expect(")", "')' after the atom that is negated")
        return f.Not(formula)

    def _equality(self) -> f.Equal:
        start = self.at
        found = self.comparison()
        if not isinstance(found, f.Equal):
            self.fail("two objects", shown(found), start)
        self._check_ground((found.left, found.right), start)
        return found

    def _equation(self) -> None:
        """Read `(= (function ...) value)`, or an equality of two objects."""
        first = self.tokens[self.at + 2]
        if first != "(" and (
            self.symbols.functions.find(first) is None or self.symbols.is_object(first)
        ):
            start = self.at
            self._add_literal(self._equality(), start)
            return
        start = self.at
        value = self._function_value()
        entry = self._functions.slow(value.fluent.function, len(value.fluent.terms))
        key = tuple([str(term) for term in value.fluent.terms])
        number = entry.values.setdefault(key, len(self._values))
        if number == len(self._values):
            self._values.append(value)
            self._value_tokens.append(self.base + start)
        elif self._values[number].value == value.value:
            self.deviate("each value once", "left out", f"the value of {value.fluent} again", start)
        else:
            self._replace_value(number, value, start)
            entry.values[key] = len(self._values) - 1

    def _replace_value(self, number: int, value: FunctionValue, start: int) -> None:
        """Replace an earlier value of a fluent, as VAL does."""
        first = self._values[number].value
        of = f"as the value of {value.fluent}"
        expected = f"one value, which was {first}"
        self.deviate(expected, "the last one holds", f"{value.value} {of}", start)
        section = next(one for least, one in reversed(self._value_sections) if least <= number)
        expected = f"one value, which is {value.value} further on"
        index = self._value_tokens[number]
        self.diagnostics.deviate(
            section, index, f"{first} {of}", expected, "the last one holds", section.keyword
        )
        self._values.append(value)
        self._value_tokens.append(self.base + start)
        self._replaced.add(number)

    def _function_value(self) -> FunctionValue:
        self.at += 2
        start = self.at
        signature, fluent = self.assigned_fluent()
        self._check_ground(fluent.terms, start)
        at = self.at
        value = self.assigned(signature)
        if not isinstance(value, f.Number | f.Constant):
            self.fail("a number" if not signature.types else "an object", shown(value), at)
        self.expect(")", "')' after the value")
        return FunctionValue(fluent, value)

    def _add_literal(self, literal: f.Not | f.Equal, start: int) -> None:
        if literal in self._literals:
            self.deviate("each literal once", "left out", f"{literal} again", self.at - 1)
        self._literals.setdefault(literal, (self.section, self.base + start))

    def _timed_element(self) -> None:
        start = self.at
        self.at += 2
        timed = f.TimedLiteral(self.time_span("at"), self._timed_effect())
        self.expect(")", "')' after the timed literal")
        text = str(timed)
        if text in self._timed:
            self.deviate("each timed literal once", "left out", f"{text} again", start)
        else:
            self._compare(timed, start)
        # By its text, as in a store: 5 and 5.0 are two spellings.
        self._timed[text] = timed

    def _compare(self, timed: f.TimedLiteral, start: int) -> None:
        """Warn if another one changes the same thing at the same time."""
        match timed.effect:
            case f.Assign(fluent=changed):
                read_as = "the last one holds"
            case f.Not(formula=changed) | changed:
                read_as = f"{changed} holds then"
        other = self._changes.setdefault((timed.time.value, changed), timed)
        if other.effect != timed.effect:
            self.deviate("one of the two", read_as, f"{timed} beside {other}", start)
            self._changes[timed.time.value, changed] = timed

    def _timed_effect(self) -> f.Atom | f.Not | f.Assign:
        head = self.tokens[self.at + 1].lower()
        if head == "=":
            value = self._function_value()
            return f.Assign("assign", value.fluent, value.value)
        if head != "not":
            return self._ground_atom()
        start = self.at
        found = self._negation()
        if isinstance(found.formula, f.Equal):
            self.fail("an atom that becomes false", shown(found), start)
        return found


_OPTIMIZATIONS = ("minimize", "maximize")


def metric_of(reader: FormulaReader) -> f.Metric:
    """Read a metric after its keyword."""
    reader.metric = True
    reader.at = 2
    word = reader.word("minimize or maximize")
    if word.lower() not in _OPTIMIZATIONS:
        reader.fail(f"minimize or maximize{hint(word, list(_OPTIMIZATIONS))}", at=2)
    found = f.Metric(word.lower(), reader.expression())
    reader.expect(")", "')' after the metric")
    return found


class ProblemReader:
    """A reader of one problem; without a domain, it skips the checks that need it."""

    def __init__(self, diagnostics: Diagnostics, form: Form, domain: Domain | None) -> None:
        self._diagnostics = diagnostics
        self._form = form
        self._domain = domain
        self._symbols = (
            SymbolTable.of_domain(domain) if domain else SymbolTable(unknown_domain=True)
        )

    def read(self) -> Problem:
        """Read the problem."""
        check_sections(self._diagnostics, self._form)
        domain = self._read_domain_name()
        requirements: list[str] = []
        for section in self._sections(":requirements"):
            reader = DeclarationReader(self._diagnostics, section, self._symbols)
            requirements += reader.requirements()
            finish(reader)
        objects = self._read_objects()
        state = self._read_initial_state()
        problem = Problem(
            name=self._form.name,
            domain=domain,
            requirements=tuple(dict.fromkeys(requirements)),
            objects=tuple(objects),
            **state,
            goal=self._read_goal(),
            constraints=self._read_conjuncts(":constraints", CONSTRAINTS | PREFERENCES),
            metric=self._read_metric(),
        )
        self._leave_out_length()
        return problem

    def _sections(self, keyword: str) -> list[Section]:
        return [section for section in self._form.sections if section.keyword == keyword]

    def _head(self) -> Cursor:
        return Cursor(self._diagnostics, self._form.head, self._form.nesting)

    def _read_domain_name(self) -> str:
        name = ""
        for section in self._sections(":domain"):
            cursor = Cursor(self._diagnostics, section, self._form.nesting)
            cursor.at = 2
            name = cursor.word("the name of the domain")
            if self._domain is not None and fold(name) != fold(self._domain.name):
                cursor.fail(f"the domain {self._domain.name}", f"the domain {name}", 2)
            if not is_name(name, "domain"):
                cursor.fail("the name of the domain", at=2)
            cursor.expect(")", "')' after the name of the domain")
            finish(cursor)
        if not name:
            self._head().fail("(:domain ...)", "a problem without a domain", 0)
        return self._domain.name if self._domain else name

    def _read_objects(self) -> list[f.TypedName]:
        table = TypedNames("object")
        constants = {fold(one.name): one for one in self._domain.constants} if self._domain else {}
        for section in self._sections(":objects"):
            reader = DeclarationReader(self._diagnostics, section, self._symbols)
            for group in reader.typed_list(OBJECTS):
                for at, name in enumerate(group.words, group.at):
                    constant = constants.get(fold(name)) if constants else None
                    if constant is not None:
                        self._check_constant(reader, name, group, at, constant)
                    elif table.add(reader, name, group, at) and fold(name) in self._symbols.types:
                        found = f"the object {name}, which is named like a type"
                        reader.deviate("names that differ", "kept apart", found, at)
            finish(reader)
        objects = table.resolve(self._symbols)
        for item in objects:
            self._symbols.add_object(item)
        return objects

    def _check_constant(
        self, reader: DeclarationReader, name: str, group: Group, at: int, constant: f.TypedName
    ) -> None:
        """Check that an object with the name of a constant has its type."""
        types = reader.resolve(self._symbols, group.types, group.types_at)
        if group.types and types != constant.types:
            expected = f"{constant.type_text}, as the domain's constant"
            reader.fail(expected, f"{name} of type {either_text(types)}", at)
        found = f"the constant '{name}' again"
        reader.deviate("objects that are not constants", "left out", found, at)

    def _read_initial_state(self) -> InitialState:
        sections = self._sections(":init")
        if not sections:
            self._head().deviate("(:init ...)", "read as (:init)", "no initial state", 0)
        reader = InitialStateReader(self._diagnostics, self._form.head, self._symbols)
        for section in sections:
            reader.read(section)
            finish(reader)
        return reader.state()

    def _read_goal(self) -> tuple[f.Formula, ...]:
        if not self._sections(":goal"):
            self._head().deviate("(:goal ...)", "read as (:goal (and))", "no goal", 0)
        return self._read_conjuncts(":goal", PREFERENCES)

    def _read_conjuncts(self, keyword: str, context: int) -> tuple[f.Formula, ...]:
        found: list[f.Formula] = []
        for section in self._sections(keyword):
            reader = FormulaReader(self._diagnostics, section, self._symbols, section.keyword)
            reader.at = 2
            if reader.is_empty() or reader.tokens[2] == ")":
                reader.deviate("'(and)'", "read so", f"'({section.keyword})'", 0)
            count = 0
            while reader.tokens[reader.at] != ")":
                count += 1
                if count == 2:
                    reader.deviate("one formula: (and ...)", "read as a conjunction")
                found += reader.conjuncts(context)
            reader.at += 1
            finish(reader)
        return tuple(found)

    def _read_metric(self) -> f.Metric | None:
        metric: f.Metric | None = None
        for section in self._sections(":metric"):
            reader = FormulaReader(self._diagnostics, section, self._symbols, section.keyword)
            found = metric_of(reader)
            if metric is not None and metric != found:
                reader.fail("one metric", f"another one, {shown(found)}", 0)
            metric = found
            finish(reader)
        return metric

    def _leave_out_length(self) -> None:
        for section in self._sections(":length"):
            cursor = Cursor(self._diagnostics, section, self._form.nesting)
            cursor.deviate("no (:length ...), which PDDL 2.1 deprecates", "left out", at=0)
            cursor.skip()
            finish(cursor)
