"""Reading domains."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

from ..dto.formulas import Derived, Formula, TypedName
from ..dto.lexical import ROOT_TYPE, fold, is_name
from .cursor import OBJECTS, Cursor, Diagnostics, Section
from .declarations import ActionReader, DeclarationReader, Declarations, RuleReader, TypedNames
from .document import Action, Domain, Function, Predicate
from .forms import ACTIONS, Form, check_sections, finish
from .formulas import CONSTRAINTS, PREFERENCES, FormulaReader
from .lexer import Text
from .requirements import used_requirements
from .symbols import ANY, SymbolTable, find_cycle


class DomainReader:
    """A reader of one domain of one or several forms."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self._diagnostics = diagnostics
        self._symbols = SymbolTable()
        self._symbols.grows = True
        self._requirements: dict[str, str] = {}
        self._types = TypedNames("type")
        self._constants = TypedNames("constant")
        self._predicates: Declarations[Predicate] = Declarations("predicate", _types_of)
        self._functions: Declarations[Function] = Declarations(
            "function", lambda function: (_types_of(function), function.types)
        )
        meaning = attrgetter("kind", "parameters", "duration", "condition", "effect")
        self._actions: Declarations[Action] = Declarations("action", meaning)
        self._derived: Declarations[Derived] = Declarations("rule", lambda rule: None)
        self._constraints: list[Formula] = []
        self._constrained: dict[Formula, Text] = {}

    def read(self, forms: list[Form]) -> Domain:
        """Read the domain."""
        sections = [section for form in forms for section in form.sections]
        self._check_forms(forms)
        self._declare(sections)
        for section in sections:
            reader = _STRUCTURES.get(section.keyword)
            if reader is not None:
                reader(self, section)
                section.forget()
        symbols = self._symbols
        domain = Domain(
            name=forms[0].name,
            requirements=tuple(self._requirements.values()),
            # The declared types, followed by types that are only used.
            types=tuple(
                TypedName(name, symbols.parents.get(name, ANY))
                for name in symbols.types.values()
                if name != ROOT_TYPE
            ),
            constants=tuple(self._constants.resolve(symbols)),
            predicates=self._predicates.elements(),
            functions=self._all_functions(),
            constraints=tuple(self._constraints),
            derived=self._derived.elements(),
            actions=self._actions.elements(),
        )
        self._check_requirements(forms, domain)
        return domain

    def _check_forms(self, forms: list[Form]) -> None:
        for form in forms:
            check_sections(self._diagnostics, form)
            if fold(form.name) != fold(forms[0].name):
                cursor = Cursor(self._diagnostics, form.head)
                cursor.fail(f"{forms[0].name}, as in {forms[0].head.text.name}", at=4)

    def _declare(self, sections: list[Section]) -> None:
        """Read all declarations, which may follow their uses."""
        for keyword, declare in _DECLARATIONS:
            for section in sections:
                if section.keyword == keyword:
                    reader = DeclarationReader(self._diagnostics, section, self._symbols)
                    declare(self, reader)
                    finish(reader)
            if keyword == ":types":
                self._resolve_types()
            if keyword == ":constants":
                for constant in self._constants.resolve(self._symbols):
                    self._symbols.add_object(constant)
        for section in sections:
            if section.keyword == ":derived":
                self._declare_derived(section)

    def _read_requirements(self, reader: DeclarationReader) -> None:
        for requirement in reader.requirements():
            self._requirements.setdefault(fold(requirement), requirement)

    def _read_types(self, reader: DeclarationReader) -> None:
        for group in reader.typed_list(OBJECTS):
            for at, name in enumerate(group.words, group.at):
                if not is_name(name, "type"):
                    reader.refuse_name(name, "type", at)
                if fold(name) != ROOT_TYPE:
                    self._types.add(reader, name, group, at)
                    continue
                if any(fold(above) != ROOT_TYPE for above in group.types):
                    reader.fail("no type above object", f"object under {group.types[0]}", at)
                reader.deviate("no declaration of object", "left out", at=at)

    def _resolve_types(self) -> None:
        symbols = self._symbols
        symbols.types.update({fold(name): name for name in self._types.names()})
        symbols.add_types(self._types.resolve(symbols))
        name = find_cycle(symbols.parents)
        if name is not None:
            self._types.refuse(name, "no cycle of types", f"the type {name} above itself")

    def _read_constants(self, reader: DeclarationReader) -> None:
        for group in reader.typed_list(OBJECTS):
            for at, name in enumerate(group.words, group.at):
                if self._constants.add(reader, name, group, at) and name in self._types:
                    _clash(reader, "constant", "type", name, at)

    def _read_predicates(self, reader: DeclarationReader) -> None:
        for predicate, at in reader.predicates():
            self._add_predicate(reader, predicate, at)

    def _add_predicate(self, cursor: Cursor, predicate: Predicate, at: int) -> None:
        if self._predicates.add(cursor, predicate.name, predicate, at):
            self._symbols.predicates.declare(predicate)
            if predicate.name in self._types:
                _clash(cursor, "predicate", "type", predicate.name, at)

    def _read_functions(self, reader: DeclarationReader) -> None:
        for function, at in reader.functions():
            if self._functions.add(reader, function.name, function, at):
                self._symbols.functions.declare(function)
                if function.name in self._predicates:
                    _clash(reader, "function", "predicate", function.name, at)

    def _declare_derived(self, section: Section) -> None:
        if section.tokens[2] == "(" and self._symbols.predicates.find(section.tokens[3]) is None:
            reader = RuleReader(self._diagnostics, section, self._symbols, section.keyword)
            predicate = reader.head(section)
            found = f"the predicate '{predicate.name}'"
            reader.deviate("its declaration in :predicates", "declared so", found, 3)
            self._add_predicate(reader, predicate, 3)

    def _read_action(self, section: Section) -> None:
        reader = ActionReader(self._diagnostics, section, self._symbols)
        action, at = reader.action(section)
        finish(reader)
        if self._actions.add(reader, action.name, action, at) and action.name in self._predicates:
            _clash(reader, "action", "predicate", action.name, at)

    def _read_derived(self, section: Section) -> None:
        reader = RuleReader(self._diagnostics, section, self._symbols)
        rule = reader.rule(section)
        # Words are faster to compare than nodes.
        words = " ".join(reader.tokens[: reader.at])
        finish(reader)
        self._derived.add(reader, words, rule, 3)

    def _read_constraints(self, section: Section) -> None:
        reader = FormulaReader(self._diagnostics, section, self._symbols, section.keyword)
        reader.at = 2
        for formula in reader.conjuncts(CONSTRAINTS | PREFERENCES):
            # Preferences may repeat within a file; other files repeat formulas of the first.
            if self._constrained.setdefault(formula, section.text) is section.text:
                self._constraints.append(formula)
        reader.expect(")", "')' after the constraints")
        finish(reader)

    def _all_functions(self) -> tuple[Function, ...]:
        """Return the declared functions, and `total-cost` if it is used undeclared."""
        declared = self._functions.elements()
        used = self._symbols.functions.names()
        return declared + tuple([Function(name) for name in used if name not in self._functions])

    def _check_requirements(self, forms: list[Form], domain: Domain) -> None:
        if self._requirements:
            return
        used = [one for one in used_requirements(domain) if one != ":strips"]
        if used:
            cursor = Cursor(self._diagnostics, forms[0].head)
            expected = f"(:requirements {' '.join(used)})"
            cursor.deviate(expected, "taken for required", "no requirements", 0)


def _types_of(element: Predicate | Function) -> tuple[tuple[str, ...], ...]:
    return tuple([parameter.types for parameter in element.parameters])


def _clash(cursor: Cursor, kind: str, other: str, name: str, at: int) -> None:
    """Warn about elements of two kinds with one name."""
    found = f"the {kind} {name}, which is named like a {other}"
    cursor.deviate("names that differ", "kept apart by what they are", found, at)


_DECLARATIONS: tuple[tuple[str, Callable[[DomainReader, DeclarationReader], None]], ...] = (
    (":requirements", DomainReader._read_requirements),
    (":types", DomainReader._read_types),
    (":constants", DomainReader._read_constants),
    (":predicates", DomainReader._read_predicates),
    (":functions", DomainReader._read_functions),
)
_STRUCTURES: dict[str, Callable[[DomainReader, Section], None]] = {
    ":constraints": DomainReader._read_constraints,
    ":derived": DomainReader._read_derived,
    **dict.fromkeys(ACTIONS, DomainReader._read_action),
}
