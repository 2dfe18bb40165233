"""Builds documents from a store, in the order in which they were loaded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from decimal import Decimal
from operator import itemgetter
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import case, select

from ..dao.base import identify
from ..dao.formula import read_formula, read_formulas
from ..dao.function_value import ALL
from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import ConflictError, each_readable, reading_rows
from ..knowledge import definitions as d
from ..knowledge.canonical import with_text
from ..knowledge.formulas import action_of, typed_name
from ..knowledge.trees import ParameterDefinition
from ..pddl import used_requirements
from ..pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from ..pddl.writer import write_problem
from ..sql.dialects.base import Row
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, now_and_then
from ..sql.query import Query, in_rows
from ..sql.rows import ATOM_TABLES, KB, PROPOSITION, table_of
from ..sql.tables import FunctionValueVersionRow, PropositionRow, PropositionVersionRow
from ..store.snapshot import View
from ..store.transaction import Transaction


def constant_ids(definitions: d.Definitions) -> set[int]:
    """Find the objects that the domain must declare."""
    found = {object_.id for object_ in definitions.objects if object_.is_constant}
    trees = [tree for action in definitions.actions for tree in action.trees]
    trees += [each.tree for each in definitions.formulas if each.section in d.DOMAIN_SECTIONS]
    for tree in trees:
        for node in tree:
            for term in node.terms:
                if term.object_id is not None:
                    found.add(term.object_id)
    return found


REQUIREMENT = "requirement"
# The root type exists undeclared: only an item, from older versions, shows that a domain has it.
_ROOT_ITEM = d.Item("type", ROOT_TYPE)
_LIVE_ATOMS = ATOM_TABLES[PROPOSITION].live()
_GOALS = Query(
    select(PropositionRow.id, PropositionRow.text).where(
        PropositionRow.kb_id == KB, PropositionRow.is_goal, in_rows(PropositionRow.id, _LIVE_ATOMS)
    )
)

T = TypeVar("T")


def check_title(definitions: d.Definitions, name: str, title: str) -> None:
    """Refuse to merge a document into one of another title."""
    stored = definitions.documents.named(name)
    if stored is not None and fold(stored.title) != fold(title):
        raise ConflictError(
            f"{stored.name} {stored.title!r} is stored, but the document is {stored.name} "
            f"{title!r}; load it with mode='replace'"
        )


def domain_title(definitions: d.Definitions, default_name: str) -> str:
    """Find the name of the domain."""
    domain, problem = (definitions.documents.named(name) for name in (d.DOMAIN, d.PROBLEM))
    if domain is not None:
        return domain.title
    return default_name if problem is None or problem.domain is None else problem.domain


def ordered(
    things: Iterable[T],
    key: Callable[[T], str],
    document: d.DocumentDefinition | None,
    section: str,
) -> list[T]:
    """Sort elements in the order of a document."""
    by_key = {key(thing): thing for thing in things}
    names = () if document is None else document.names(section)
    return [by_key[name] for name in _placed(by_key, names)]


def _placed(known: Iterable[str], names: Iterable[str]) -> list[str]:
    """Return the listed known names, with repetitions, and then the others."""
    rest = dict.fromkeys(known)
    listed = [name for name in names if name in rest]
    for name in listed:
        rest.pop(name, None)
    return [*listed, *rest]


def put_document(
    transaction: Transaction,
    name: str,
    title: str,
    domain: str | None,
    items: Iterable[d.Item],
    replace: bool,
) -> None:
    """Store the title of a loaded document, and the order of its declarations.

    A merge writes nothing for new elements, which follow the others in the order of their first
    assertion. It writes a version only for items that no element shows, and that version lists only
    the sections whose order differs from that of the elements.
    """
    stored = transaction.definitions.documents.named(name)
    if stored is not None and not replace:
        added = _unshown(stored, list(items))
        if not added and fold(stored.domain or "") == fold(domain or ""):
            return
        # Titles differ only in spelling, and the first spelling stays.
        title = stored.title
        items = [*_needed(transaction, stored, added), *added]
    # The tables keep the order within a section; sections are in the order of their names.
    places = tuple(sorted(items, key=lambda item: item.section))
    identity = identify(transaction, "document", name)
    definition = d.DocumentDefinition(*identity, title, domain, places)
    transaction.define("document", with_text(transaction.definitions, definition))


def _unshown(stored: d.DocumentDefinition, items: list[d.Item]) -> list[d.Item]:
    """Find the new items that no element shows."""
    known, times = set(stored.items), Counter(items)
    return [
        item
        for item in items
        if item not in known and (item.section == REQUIREMENT or times[item] > 1)
    ]


def _needed(
    transaction: Transaction, stored: d.DocumentDefinition, added: list[d.Item]
) -> list[d.Item]:
    """Return the items of a document, without sections in the order of the elements."""
    sections: dict[str, list[d.Item]] = {}
    for item in stored.items:
        sections.setdefault(item.section, []).append(item)
    changed = {item.section for item in added} | {REQUIREMENT}
    needed: list[d.Item] = []
    for section, items in sections.items():
        is_needed = section in changed or _ROOT_ITEM in items
        if not is_needed:
            keys = _keys(transaction, section)
            is_needed = _placed(keys, [item.name for item in items]) != keys
        needed += items if is_needed else []
    return needed


def _keys(transaction: Transaction, section: str) -> list[str]:
    """Return the names under which a document has the elements of a section, oldest first."""
    definitions = transaction.definitions
    if section in ("constant", "object"):
        constants, is_constant = constant_ids(definitions), section == "constant"
        objects = definitions.objects
        return [fold(each.name) for each in objects if (each.id in constants) == is_constant]
    if section in ("type", "predicate", "function", "action"):
        names = (fold(each.name) for each in definitions.elements(section))
        return [name for name in names if d.Item(section, name) != _ROOT_ITEM]
    formulas = [each.name for each in definitions.formulas if each.section == section]
    if section != d.GOAL:
        return formulas
    # Goals that are atoms come first.
    transaction.flush()
    goals = transaction.session.rows(_GOALS, kb=transaction.kb_id)
    return [*(text for _, text in sorted(goals)), *formulas]


N = TypeVar("N", bound=d.Definition)


class _Builder:
    """Builds a document from definitions."""

    def __init__(self, definitions: d.Definitions, name: str) -> None:
        self._definitions = definitions
        self._document = definitions.documents.named(name)

    def _items(self, section: str) -> tuple[str, ...]:
        return () if self._document is None else tuple(self._document.names(section))

    def _named(self, section: str, definitions: Iterable[N]) -> list[N]:
        return ordered(definitions, lambda each: fold(each.name), self._document, section)

    def _section(self, section: str) -> tuple[Any, ...]:
        """Read the formulas of a section."""
        stored = read_formulas(self._definitions, section)
        found = ordered(stored, lambda each: each.name, self._document, section)
        return tuple(read_formula(self._definitions, each) for each in found)

    def _typed(self, name: str, type_ids: Sequence[int]) -> f.TypedName:
        return typed_name(self._definitions, ParameterDefinition(name, tuple(type_ids)))

    def _objects(self, section: str) -> tuple[f.TypedName, ...]:
        """Build the objects that the domain declares, or the others."""
        constants = constant_ids(self._definitions)
        is_domain = section == "constant"
        own = [each for each in self._definitions.objects if (each.id in constants) == is_domain]
        return tuple(self._typed(each.name, each.type_ids) for each in self._named(section, own))


class _DomainBuilder(_Builder):
    """Builds a domain."""

    def build(self, default_name: str) -> Domain:
        definitions = self._definitions
        domain = Domain(
            domain_title(definitions, default_name),
            self._items(REQUIREMENT),
            tuple(map(self._type, self._types())),
            self._objects("constant"),
            tuple(
                Predicate(each.name, self._parameters(each.parameters))
                for each in self._named("predicate", definitions.predicates)
            ),
            tuple(map(self._function, self._named("function", definitions.functions))),
            self._section(d.DOMAIN_CONSTRAINT),
            self._section(d.DERIVED_PREDICATE),
            tuple(map(self._action, self._named("action", definitions.actions))),
        )
        if self._document is not None:
            return domain
        # Without a loaded document, no requirements are declared.
        return replace(domain, requirements=used_requirements(domain))

    def _types(self) -> list[d.TypeDefinition]:
        # The root type exists undeclared, unless the domain declares it.
        has_root = ROOT_TYPE in self._items("type")
        types = self._definitions.types
        return self._named("type", [t for t in types if has_root or fold(t.name) != ROOT_TYPE])

    def _type(self, type_: d.TypeDefinition) -> f.TypedName:
        above = type_.parent_ids
        return self._typed(type_.name, above) if above else f.TypedName(type_.name)

    def _parameters(self, parameters: Iterable[ParameterDefinition]) -> tuple[f.TypedName, ...]:
        return tuple(typed_name(self._definitions, parameter) for parameter in parameters)

    def _function(self, function: d.FunctionDefinition) -> Function:
        types = self._typed("", function.type_ids).types
        return Function(function.name, self._parameters(function.parameters), types)

    def _action(self, action: d.ActionDefinition) -> Action:
        with reading_rows("action_version", f"action {action.id!r}"):
            return action_of(self._definitions, action)


def build_domain(definitions: d.Definitions, default_name: str) -> Domain:
    """Build the domain from its definitions."""
    return _DomainBuilder(definitions, d.DOMAIN).build(default_name)


class Initial(NamedTuple):
    """The state at one moment, as rows; each row begins with its id."""

    facts: list[Any]  # id, predicate, arguments (except for text alone) and text
    goals: list[Any]  # the same for goals that are ground atoms
    values: list[Any]  # id, function, arguments, number and object; for text alone, id and text


def _propositions(held: Any, for_text: bool) -> Query:
    versions = select(PropositionVersionRow.proposition_id).where(
        PropositionVersionRow.kb_id == KB, held
    )
    arguments: Any = PropositionRow.arguments
    if for_text:
        # Build goals even for text alone: the document determines their order.
        arguments = case((table_of(PropositionRow).c.is_goal, arguments))
    return Query(
        select(
            PropositionRow.id,
            PropositionRow.predicate_id,
            arguments,
            PropositionRow.text,
            PropositionRow.is_goal,
        ).where(PropositionRow.kb_id == KB, in_rows(PropositionRow.id, versions))
    )


_ID = itemgetter(0)
# Keyed by: for text alone, and about the past.
_PROPOSITIONS = {
    for_text: {
        is_past: _propositions(held, for_text)
        for is_past, held in now_and_then(PropositionVersionRow, ANY_PREDICATE)
    }
    for for_text in (False, True)
}
_VALUE_TEXTS = {
    is_past: Query(
        select(FunctionValueVersionRow.function_value_id, FunctionValueVersionRow.text).where(
            FunctionValueVersionRow.kb_id == KB, held
        )
    )
    for is_past, held in now_and_then(FunctionValueVersionRow, ANY_FUNCTION)
}


def read_initial(view: View, for_text: bool) -> Initial:
    """Read the state at one moment, in two statements."""
    if view.kb_id is None:
        return Initial([], [], [])
    propositions = sorted(view.rows(_PROPOSITIONS[for_text]), key=_ID)
    facts = [row for row in propositions if not row[4]]
    goals = [row for row in propositions if row[4]]
    values = sorted(view.rows(_VALUE_TEXTS), key=_ID) if for_text else ALL.rows(view)
    return Initial(facts, goals, values)


class _ProblemBuilder(_Builder):
    """Builds a problem from definitions and a state."""

    def __init__(self, definitions: d.Definitions, initial: Initial) -> None:
        super().__init__(definitions, d.PROBLEM)
        self._initial = initial
        self._constants: dict[int, f.Constant] = {}

    def build(self, default_name: str, domain: str, with_initial: bool = True) -> Problem:
        metrics = read_formulas(self._definitions, d.METRIC)
        return Problem(
            default_name if self._document is None else self._document.title,
            self._domain_name(domain),
            self._items(REQUIREMENT),
            self._objects("object"),
            self._facts() if with_initial else (),
            self._literals(),
            self._values() if with_initial else (),
            self._section(d.TIMED),
            tuple(self._goals()),
            self._section(d.CONSTRAINT),
            read_formula(self._definitions, metrics[0]) if metrics else None,  # type: ignore[arg-type]
        )

    def _domain_name(self, domain: str) -> str:
        """Return the domain's name as the problem spells it, unless it has changed."""
        own = None if self._document is None else self._document.domain
        return domain if own is None or fold(own) != fold(domain) else own

    def _literals(self) -> tuple[f.Not | f.Equal, ...]:
        """Return the initial literals that no later fact contradicts."""
        literals = self._section(d.INITIAL)
        facts = {row[3] for row in self._initial.facts} if literals else ()
        return tuple(
            literal
            for literal in literals
            if isinstance(literal, f.Equal) or str(literal.formula) not in facts
        )

    def _facts(self) -> tuple[f.Atom, ...]:
        return tuple(each_readable("proposition", self._initial.facts, self._atom))

    def _values(self) -> tuple[FunctionValue, ...]:
        return tuple(each_readable("function_value", self._initial.values, self._value))

    def _value(self, row: Row) -> FunctionValue:
        _, function_id, arguments, number, object_id = row
        value: f.Number | f.Constant = (
            f.Number(Decimal(number)) if object_id is None else self._constant(object_id)
        )
        name = self._definitions.functions.live(function_id).name
        return FunctionValue(f.Fluent(name, self._terms(arguments)), value)

    def _goals(self) -> list[f.Formula]:
        atoms: list[tuple[str, f.Formula]] = each_readable(
            "proposition", self._initial.goals, lambda row: (row[3], self._atom(row))
        )
        formulas: list[tuple[str, Any]] = [
            (formula.name, read_formula(self._definitions, formula))
            for formula in read_formulas(self._definitions, d.GOAL)
        ]
        goals = ordered([*atoms, *formulas], lambda goal: goal[0], self._document, d.GOAL)
        return [goal for _, goal in goals]

    def _atom(self, row: Any) -> f.Atom:
        predicate = self._definitions.predicates.live(row[1])
        return f.trusted_atom(predicate.name, self._terms(row[2]))

    def _terms(self, arguments: str) -> tuple[f.Constant, ...]:
        return tuple([self._constant(int(id_)) for id_ in arguments.split()])

    def _constant(self, id_: int) -> f.Constant:
        constant = self._constants.get(id_)
        if constant is None:
            constant = f.Constant(self._definitions.objects.live(id_).name)
            self._constants[id_] = constant
        return constant


def build_problem(view: View, default_name: str, domain: str) -> Problem:
    """Build the problem at one moment."""
    initial = read_initial(view, for_text=False)
    return _ProblemBuilder(view.definitions, initial).build(default_name, domain)


def problem_text(view: View, default_name: str, domain: str) -> str:
    """Write the problem at one moment as PDDL, from the stored texts."""
    initial = read_initial(view, for_text=True)
    problem = _ProblemBuilder(view.definitions, initial).build(default_name, domain, False)
    facts: Sequence[str] = [row[3] for row in initial.facts]
    return write_problem(problem, facts, [text for _, text in initial.values])
