"""The reader of problems."""

from __future__ import annotations

from ..dto.formula import Formula, Metric, TypedName
from ..dto.name import fold, is_name
from ..dto.node import shown
from .cursor import Cursor, Reading, hint
from .declarations import DeclarationReader
from .document import Domain, Problem
from .forms import PROBLEM_ORDER, Form, check_sections, finish
from .formulas import CONSTRAINTS, PREFERENCES, FormulaReader
from .initial_state import InitialState, InitialStateReader
from .section import Section
from .symbols import Symbols
from .tables import NameTable
from .typed_lists import Group

_OPTIMIZATIONS = ("minimize", "maximize")


class ProblemReader:
    """A reader of one problem.

    Args:
        reading: the call that reads.
        form: the problem's form.
        domain: its domain; None to read without the checks that need it.
    """

    def __init__(self, reading: Reading, form: Form, domain: Domain | None) -> None:
        self._reading = reading
        self._form = form
        self._domain = domain
        self._symbols = Symbols.of_domain(domain) if domain else Symbols(unknown_domain=True)

    def read(self) -> Problem:
        """Read the problem.

        Returns:
            The problem, without the warnings.
        """
        check_sections(self._reading, self._form, PROBLEM_ORDER, (), {":constants": ":objects"})
        domain = self._read_domain_name()
        requirements: list[str] = []
        for section in self._sections(":requirements"):
            reader = DeclarationReader(self._reading, section, self._symbols)
            requirements += reader.requirements()
            finish(reader)
        objects = self._read_objects()
        state = self._read_initial_state()
        problem = Problem(
            name=self._form.name,
            domain=domain,
            requirements=tuple(dict.fromkeys(requirements)),
            objects=tuple(objects),
            facts=state.facts,
            literals=state.literals,
            values=state.values,
            timed=state.timed,
            goal=self._read_goal(),
            constraints=self._read_constraints(),
            metric=self._read_metric(),
        )
        self._leave_out_length()
        return problem

    def _sections(self, keyword: str) -> list[Section]:
        return [section for section in self._form.sections if section.keyword == keyword]

    def _head(self) -> Cursor:
        return Cursor(self._reading, self._form.head, self._form.nesting)

    def _read_domain_name(self) -> str:
        name = ""
        for section in self._sections(":domain"):
            cursor = Cursor(self._reading, section, self._form.nesting)
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

    def _read_objects(self) -> list[TypedName]:
        table = NameTable("object")
        constants = {fold(one.name): one for one in self._domain.constants} if self._domain else {}
        for section in self._sections(":objects"):
            reader = DeclarationReader(self._reading, section, self._symbols)
            for group in reader.names():
                for at, name in enumerate(group.words, group.at):
                    constant = constants.get(fold(name)) if constants else None
                    if constant is not None:
                        self._check_constant(reader, name, group, at, constant)
                    elif table.add(reader, name, group, at) and self._names_type(name):
                        found = f"the object {name}, which is named like a type"
                        reader.deviate("names that differ", "kept apart", found, at)
            finish(reader)
        objects = table.resolve(self._symbols)
        for item in objects:
            self._symbols.add_object(item)
        return objects

    def _check_constant(
        self, reader: DeclarationReader, name: str, group: Group, at: int, constant: TypedName
    ) -> None:
        """Check that an object that is a constant already is of the same type."""
        types = reader.resolve(self._symbols, group.types, group.types_at)
        if group.types and types != constant.types:
            expected = f"{constant.type_text}, as the domain's constant"
            reader.fail(expected, f"{name} of type {TypedName('', types).type_text}", at)
        found = f"the constant '{name}' again"
        reader.deviate("objects that are no constants", "left out", found, at)

    def _names_type(self, name: str) -> bool:
        return fold(name) in self._symbols.types

    def _read_initial_state(self) -> InitialState:
        sections = self._sections(":init")
        if not sections:
            self._head().deviate("(:init ...)", "read as (:init)", "no initial state", 0)
        reader = InitialStateReader(self._reading, self._form.head, self._symbols)
        for section in sections:
            reader.read(section)
            finish(reader)
        return reader.state()

    def _read_goal(self) -> tuple[Formula, ...]:
        sections = self._sections(":goal")
        if not sections:
            self._head().deviate("(:goal ...)", "read as (:goal (and))", "no goal", 0)
        return self._read_conjuncts(sections, PREFERENCES)

    def _read_constraints(self) -> tuple[Formula, ...]:
        return self._read_conjuncts(self._sections(":constraints"), CONSTRAINTS | PREFERENCES)

    def _read_conjuncts(self, sections: list[Section], context: int) -> tuple[Formula, ...]:
        found: list[Formula] = []
        for section in sections:
            reader = FormulaReader(self._reading, section, self._symbols, section.keyword)
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

    def _read_metric(self) -> Metric | None:
        metric: Metric | None = None
        for section in self._sections(":metric"):
            reader = FormulaReader(self._reading, section, self._symbols, section.keyword)
            reader.metric = True
            reader.at = 2
            word = reader.word("minimize or maximize")
            if word.lower() not in _OPTIMIZATIONS:
                reader.fail(f"minimize or maximize{hint(word, list(_OPTIMIZATIONS))}", at=2)
            found = Metric(word.lower(), reader.expression())
            reader.expect(")", "')' after the metric")
            if metric is not None and metric != found:
                reader.fail("one metric", f"another one, {shown(found)}", 0)
            metric = found
            finish(reader)
        return metric

    def _leave_out_length(self) -> None:
        for section in self._sections(":length"):
            cursor = Cursor(self._reading, section, self._form.nesting)
            cursor.deviate("no (:length ...), which PDDL 2.1 deprecates", "left out", at=0)
            cursor.skip()
            finish(cursor)
