"""Building the problem that a store holds."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import and_, case, select

from ..backends import Query, Row, in_rows
from ..dao.fluent_reading import ALL
from ..dao.formula import read_formula, read_formulas
from ..dto.conditions import trusted_atom
from ..dto.formula import Atom, Constant, Equal, Fluent, Formula, Not, Number, TypedName
from ..dto.name import fold
from ..errors import each_readable
from ..knowledge.definitions import Definitions
from ..knowledge.document import PROBLEM
from ..knowledge.formula import CONSTRAINT, GOAL, INITIAL, METRIC, TIMED
from ..knowledge.loading import KB
from ..knowledge.past import ANY_FUNCTION, ANY_PREDICATE, held_then, then
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.rows import table_of
from ..knowledge.tree_reader import typed_name
from ..pddl.document import FunctionValue, Problem
from ..pddl.writer import write_problem
from ..tables import (
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)
from ..view import View
from .constants import constant_ids
from .domain_building import read_section
from .ordering import find_document, ordered


class Initial(NamedTuple):
    """What held at one moment, as rows; each row begins with its id.

    Attributes:
        facts: id, predicate, arguments and text of each fact; for text alone, id and text matter.
        goals: the same of each goal that is a ground atom.
        values: id, function, arguments, number and object of the value of each fluent; for text
            alone, id and text.
    """

    facts: list[Any]
    goals: list[Any]
    values: list[Any]


def _held(version: Any, any_owner: Any) -> tuple[tuple[bool, Any], ...]:
    """Give the condition of the present, and that of the past."""
    return (False, version.until.is_(None)), (True, and_(any_owner, held_then(version)))


def _propositions(held: Any, for_text: bool) -> Query:
    versions = select(PropositionVersionRow.proposition_id).where(
        PropositionVersionRow.kb_id == KB, held
    )
    arguments: Any = PropositionRow.arguments
    if for_text:
        # Goals are built all the same, for the document knows their order.
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


def _value_texts(held: Any) -> Query:
    version = FunctionValueVersionRow
    columns = version.function_value_id, version.text
    return Query(select(*columns).where(version.kb_id == KB, held))


_ID = itemgetter(0)
# By whether it is about the past, and whether for text alone.
_PROPOSITIONS = {
    (is_past, for_text): _propositions(held, for_text)
    for is_past, held in _held(PropositionVersionRow, ANY_PREDICATE)
    for for_text in (False, True)
}
_VALUE_TEXTS = {
    is_past: _value_texts(held) for is_past, held in _held(FunctionValueVersionRow, ANY_FUNCTION)
}


def read_initial(view: View, for_text: bool) -> Initial:
    """Read what held at one moment, in two statements.

    Args:
        view: the moment.
        for_text: whether only the texts are needed.

    Returns:
        What held, in the order in which each was first known.
    """
    if view.kb_id is None:
        return Initial([], [], [])
    is_past = view.at is not None
    past = {} if view.at is None else then(view.session, view.at)

    def rows(query: Query) -> list[Any]:
        return sorted(view.session.rows(query, kb=view.kb_id, **past), key=_ID)

    propositions = rows(_PROPOSITIONS[is_past, for_text])
    facts = [row for row in propositions if not row[4]]
    goals = [row for row in propositions if row[4]]
    return Initial(facts, goals, rows(_VALUE_TEXTS[is_past]) if for_text else ALL.rows(view))


class ProblemBuilder:
    """Builds a problem from definitions, and from what held."""

    def __init__(self, definitions: Definitions, initial: Initial) -> None:
        """Make it.

        Args:
            definitions: what is defined.
            initial: what held.
        """
        self._definitions = definitions
        self._initial = initial
        self._document = find_document(definitions, PROBLEM)
        self._constants: dict[int, Constant] = {}

    def build(self, default_name: str, domain: str, with_initial: bool = True) -> Problem:
        """Build the problem.

        Args:
            default_name: what it is called when none was loaded.
            domain: the domain's name.
            with_initial: whether facts and values are wanted, too.

        Returns:
            The problem.
        """
        document, definitions = self._document, self._definitions
        metrics = read_formulas(definitions, METRIC)
        return Problem(
            default_name if document is None else document.title,
            self._domain_name(domain),
            () if document is None else tuple(document.names("requirement")),
            tuple(self._objects()),
            self._facts() if with_initial else (),
            self._literals(),
            self._values() if with_initial else (),
            self._section(TIMED),
            tuple(self._goals()),
            self._section(CONSTRAINT),
            read_formula(definitions, metrics[0]) if metrics else None,  # type: ignore[arg-type]
        )

    def _domain_name(self, domain: str) -> str:
        """Spell the domain's name as the problem did, if the domain has it still."""
        said = None if self._document is None else self._document.domain
        return domain if said is None or fold(said) != fold(domain) else said

    def _literals(self) -> tuple[Not | Equal, ...]:
        """Give the initial literals, apart from those that facts of later revisions contradict."""
        literals = self._section(INITIAL)
        if not literals:
            return ()
        facts = {row[3] for row in self._initial.facts}
        return tuple(
            literal
            for literal in literals
            if isinstance(literal, Equal) or str(literal.formula) not in facts
        )

    def _section(self, section: str) -> tuple[Any, ...]:
        return read_section(self._definitions, self._document, section)

    def _objects(self) -> list[TypedName]:
        constants = constant_ids(self._definitions)
        objects = [each for each in self._definitions.objects if each.id not in constants]
        found = ordered(objects, lambda each: fold(each.name), self._document, "object")
        return [
            typed_name(self._definitions, ParameterDefinition(each.name, each.type_ids))
            for each in found
        ]

    def _facts(self) -> tuple[Atom, ...]:
        return tuple(each_readable("proposition", self._initial.facts, self._atom))

    def _values(self) -> tuple[FunctionValue, ...]:
        return tuple(each_readable("function_value", self._initial.values, self._value))

    def _value(self, row: Row) -> FunctionValue:
        _, function_id, arguments, number, object_id = row
        value: Number | Constant = (
            Number(Decimal(number)) if object_id is None else self._constant(object_id)
        )
        name = self._definitions.functions.live(function_id).name
        return FunctionValue(Fluent(name, self._terms(arguments)), value)

    def _goals(self) -> list[Formula]:
        atoms: list[tuple[str, Formula]] = each_readable(
            "proposition", self._initial.goals, lambda row: (row[3], self._atom(row))
        )
        formulas: list[tuple[str, Any]] = [
            (formula.name, read_formula(self._definitions, formula))
            for formula in read_formulas(self._definitions, GOAL)
        ]
        goals = ordered([*atoms, *formulas], lambda goal: goal[0], self._document, GOAL)
        return [goal for _, goal in goals]

    def _atom(self, row: Any) -> Atom:
        predicate = self._definitions.predicates.live(row[1])
        return trusted_atom(predicate.name, self._terms(row[2]))

    def _terms(self, arguments: str) -> tuple[Constant, ...]:
        return tuple([self._constant(int(id_)) for id_ in arguments.split()])

    def _constant(self, id_: int) -> Constant:
        constant = self._constants.get(id_)
        if constant is None:
            constant = Constant(self._definitions.objects.live(id_).name)
            self._constants[id_] = constant
        return constant


def build_problem(view: View, default_name: str, domain: str) -> Problem:
    """Build the problem of one moment.

    Args:
        view: the moment.
        default_name: what it is called when none was loaded.
        domain: the domain's name.

    Returns:
        The problem.
    """
    initial = read_initial(view, for_text=False)
    return ProblemBuilder(view.definitions, initial).build(default_name, domain)


def problem_text(view: View, default_name: str, domain: str) -> str:
    """Write the problem of one moment as PDDL, from the texts that the store has.

    Args:
        view: the moment.
        default_name: what it is called when none was loaded.
        domain: the domain's name.

    Returns:
        The text.
    """
    initial = read_initial(view, for_text=True)
    problem = ProblemBuilder(view.definitions, initial).build(default_name, domain, False)
    facts: Sequence[str] = [row[3] for row in initial.facts]
    return write_problem(problem, facts, [text for _, text in initial.values])
