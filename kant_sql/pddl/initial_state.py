"""The initial state: most of a large problem, so plain facts and values are read in a tight loop.

The loop knows objects in their declared spelling that fit; all else is left to the slow readers,
which know everything and say what is wrong.
"""

from __future__ import annotations

from operator import getitem
from typing import Final, NamedTuple

from ..dto.conditions import trusted_atom
from ..dto.formula import Assign, Atom, Constant, Equal, Fluent, Not, Number, Term, TimedLiteral
from ..dto.node import shown
from .cursor import Reading
from .document import FunctionValue
from .formulas import FormulaReader
from .plain_facts import MAX_ARITY, Entries, NotPlainError
from .section import Section
from .symbols import Symbols
from .tokens import Blocks

_FOREIGN: Final = {
    "oneof": "conformant planning",
    "unknown": "conformant planning",
    "or": "conformant planning",
    "probabilistic": "probabilistic planning",
}


_Place = tuple[Section, int]


class InitialState(NamedTuple):
    """What an initial state says.

    Attributes:
        facts: what holds.
        literals: negative literals and equality.
        values: what the fluents are.
        timed: timed initial literals and values.
    """

    facts: tuple[Atom, ...]
    literals: tuple[Not | Equal, ...]
    values: tuple[FunctionValue, ...]
    timed: tuple[TimedLiteral, ...]


class InitialStateReader(FormulaReader):
    """A reader of an initial state, which may be spread over several sections."""

    def __init__(self, reading: Reading, section: Section, symbols: Symbols) -> None:
        super().__init__(reading, section, symbols, section.keyword)
        self._facts: list[Atom] = []
        self._literals: dict[Not | Equal, _Place] = {}
        self._values: list[FunctionValue] = []
        self._replaced: set[int] = set()
        # The token that each value begins with, and the first value of each section.
        self._value_tokens: list[int] = []
        self._value_sections: list[tuple[int, Section]] = []
        self._timed: dict[TimedLiteral, None] = {}
        self._predicates = Entries(symbols, symbols.predicates)
        self._functions = Entries(symbols, symbols.functions)

    def first_tokens(self) -> list[str]:
        """Give the tokens to begin with.

        Returns:
            None but the end: the section is read in blocks.
        """
        return [""]

    def read(self, section: Section) -> None:
        """Read a section, up to behind the parenthesis that closes it.

        Args:
            section: the section.
        """
        self.open(section, section.keyword)
        self._value_sections.append((len(self._values), section))
        self._blocks = Blocks(section.text.code, section.start, section.end)
        # The loop looks as far ahead as the longest fact goes.
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

    def state(self) -> InitialState:
        """Give what was read.

        Returns:
            The initial state.

        Raises:
            PddlError: the reading is strict, and something is denied and asserted.
        """
        literals = tuple([one for one, place in self._literals.items() if self._agrees(one, place)])
        values = self._values
        if self._replaced:
            values = [one for number, one in enumerate(values) if number not in self._replaced]
        return InitialState(tuple(self._facts), literals, tuple(values), tuple(self._timed))

    def _agrees(self, literal: Not | Equal, place: _Place) -> bool:
        """Whether a literal denies no fact; of the two, the fact holds, as VAL has it."""
        if not isinstance(literal, Not) or not isinstance(literal.formula, Atom):
            return True
        atom = literal.formula
        entry = self._predicates.slow(atom.predicate, len(atom.terms))
        if tuple([str(term) for term in atom.terms]) not in entry.facts:
            return True
        section, index = place
        found = f"{literal} beside {atom}"
        read_as = f"left out: {atom} holds"
        self.reading.deviate(section, index, found, "one of the two", read_as, section.keyword)
        return False

    def _next_block(self) -> bool:
        """Go on to the next block, if there is one."""
        tokens = self._blocks.next()
        self.base += self._count
        self._count = len(tokens)
        self.tokens = tokens + self._ends
        self.at = 0
        return bool(tokens)

    def _elements(self) -> None:
        """Read facts and the like up to the parenthesis that closes their list."""
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
                    append(trusted_atom(entry.name, terms))
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
        """Read `(= (function object ...) number)`, and tell where it ends; 0 if it is not that."""
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
        self._values.append(FunctionValue(Fluent(entry.name, terms), value))
        self._value_tokens.append(self.base + at)
        return end + 3

    def _element(self) -> None:
        """Read one element of the initial state, whatever it is, or the end of a list within."""
        if self.tokens[self.at] == ")":
            self.at += 1
            self._lists -= 1
            return
        self.expect("(", "a fact, which begins with '('")
        head = self.word("a predicate").lower()
        self.at -= 2
        if head == "=":
            self._equation()
        elif head == "not":
            start = self.at
            self._add_literal(self._negation(), start)
        elif head == "at" and self._is_timed():
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
        """Whether the word that is next is an operator, and not a predicate of that name."""
        if self.symbols.predicates.find(head) is not None:
            return False
        self.at += 2
        takes_operands = self.tokens[self.at] == "(" or self.is_number()
        self.at -= 2
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

    def _ground_atom(self) -> Atom:
        self.expect("(", "an atom")
        name = self.word("a predicate")
        self.at -= 2
        start = self.at
        atom = self.atom(self.known(self.symbols.predicates, name))
        self._check_ground(atom.terms, start)
        return atom

    def _check_ground(self, terms: tuple[Term, ...], start: int) -> None:
        for term in terms:
            if not isinstance(term, Constant):
                self.fail("objects as arguments", f"the argument {shown(term)}", start)

    def _negation(self) -> Not:
        self.at += 2
        if self.tokens[self.at + 1] == "=":
            formula: Atom | Equal = self._equality()
        else:
            formula = self._ground_atom()
        self.expect(")", "')' after the atom that is negated")
        return Not(formula)

    def _equality(self) -> Equal:
        start = self.at
        found = self.comparison()
        if not isinstance(found, Equal):
            self.fail("two objects", shown(found), start)
        self._check_ground((found.left, found.right), start)
        return found

    def _equation(self) -> None:
        """Read `(= (function ...) value)`, or that two names denote one object."""
        first = self.tokens[self.at + 2]
        if first != "(" and (
            self.symbols.functions.find(first) is None or self.symbols.is_object(first)
        ):
            start = self.at
            self._add_literal(self._equality(), start)
            return
        start = self.at
        value = self._value()
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
        """Take another value instead of one that came before, as VAL does."""
        first = self._values[number].value
        of = f"as the value of {value.fluent}"
        self.deviate(
            f"one value, which was {first}", "the last one holds", f"{value.value} {of}", start
        )
        section = next(one for least, one in reversed(self._value_sections) if least <= number)
        expected = f"one value, which is {value.value} further on"
        index = self._value_tokens[number]
        self.reading.deviate(
            section, index, f"{first} {of}", expected, "the last one holds", section.keyword
        )
        self._values.append(value)
        self._value_tokens.append(self.base + start)
        self._replaced.add(number)

    def _value(self) -> FunctionValue:
        self.at += 2
        start = self.at
        if self.tokens[self.at] == "(":
            fluent = self.fluent()
        else:
            fluent = self.bare_fluent(self.tokens[self.at])
        self._check_ground(fluent.terms, start)
        signature = self.symbols.functions.find(fluent.function)
        assert signature is not None
        at = self.at
        value = self.assigned(signature)
        if not isinstance(value, Number | Constant):
            self.fail("a number" if not signature.types else "an object", shown(value), at)
        self.expect(")", "')' after the value")
        return FunctionValue(fluent, value)

    def _add_literal(self, literal: Not | Equal, start: int) -> None:
        if literal in self._literals:
            self.deviate("each literal once", "left out", f"{literal} again", self.at - 1)
        self._literals.setdefault(literal, (self.section, self.base + start))

    def _is_timed(self) -> bool:
        self.at += 2
        number = self.is_number() and self.tokens[self.at + 1] == "("
        self.at -= 2
        return number

    def _timed_element(self) -> None:
        start = self.at
        self.at += 2
        time = self.number_here()
        assert time is not None
        self.at += 1
        timed = TimedLiteral(time, self._timed_effect())
        self.expect(")", "')' after the timed literal")
        if timed in self._timed:
            self.deviate("each timed literal once", "left out", f"{timed} again", start)
        self._timed[timed] = None

    def _timed_effect(self) -> Atom | Not | Assign:
        head = self.tokens[self.at + 1].lower()
        if head == "=":
            value = self._value()
            return Assign("assign", value.fluent, value.value)
        if head == "not":
            return self._negation()
        return self._ground_atom()
