"""What is written reads back as an equal document, and is written again as the same text."""

from __future__ import annotations

from decimal import Decimal

import pytest
from hypothesis import example, given

from kant_sql import PddlObjectDto, PddlTypeDto
from kant_sql.dto.formulas import Fluent, Number
from kant_sql.dto.lexical import MAX_DIGITS
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Domain, Function, FunctionValue, PddlWarning, Problem
from kant_sql.pddl.given import read_action, read_function, read_object, read_predicate, read_type
from kant_sql.pddl.symbols import SymbolTable
from tests.support.generators.documents import domains_and_problems
from tests.support.parts import action_dto, function_dto, predicate_dto, type_dto
from tests.support.profile import PROFILE, hunting

# As in the property test of the store: a number here hunts for longer.

Warnings = tuple[PddlWarning, ...]


def check(domain: Domain, problem: Problem, strict: bool) -> tuple[Warnings, Warnings]:
    text = write(domain)
    read = read_domain(text, strict=strict)
    assert read == domain
    assert write(read) == text
    text = write(problem)
    again = read_problem(text, domain=read, strict=strict)
    assert again == problem
    assert write(again) == text
    return read.warnings, again.warnings


@pytest.mark.parametrize(
    "digits", [f"-{'9' * MAX_DIGITS}", f"-{'9' * MAX_DIGITS}.{'1' * MAX_DIGITS}"]
)
def test_the_longest_numbers_round_trip(digits: str) -> None:
    number = Number(Decimal(digits))
    domain = Domain("d", (":numeric-fluents",), functions=(Function("n"),))
    check(domain, Problem("p", "d", values=(FunctionValue(Fluent("n"), number),)), strict=True)


@hunting(PROFILE.texts)
@given(domains_and_problems())
@example((Domain("d", (":strips",)), Problem("p", "d")))
def test_what_is_well_formed_round_trips_without_warning(documents: tuple[Domain, Problem]) -> None:
    domain, problem = documents
    check(domain, problem, strict=True)
    assert check(domain, problem, strict=False) == ((), ())


@pytest.mark.more
@hunting(PROFILE.texts)
@given(domains_and_problems(repeats=True))
def test_parameters_that_share_a_name_round_trip(documents: tuple[Domain, Problem]) -> None:
    check(*documents, strict=False)


@hunting(PROFILE.texts)
@given(domains_and_problems(repeats=True))
def test_the_text_of_an_element_reads_back_as_its_dto(documents: tuple[Domain, Problem]) -> None:
    domain, problem = documents
    for part in domain.types:
        type_ = PddlTypeDto(part.name, parent=type_dto(part.types))
        assert repr(read_type(str(type_))) == repr(type_)
        assert repr(read_type(part.name)) == repr(PddlTypeDto(part.name))
    for part in (*domain.constants, *problem.objects):
        object_ = PddlObjectDto(type_dto(part.types), part.name)
        assert repr(read_object(str(object_))) == repr(object_)
    for predicate in map(predicate_dto, domain.predicates):
        assert repr(read_predicate(str(predicate))) == repr(predicate)
    for function in map(function_dto, domain.functions):
        assert repr(read_function(str(function))) == repr(function)
    symbols = SymbolTable.of_domain(domain)
    for action in map(action_dto, domain.actions):
        again = read_action(str(action), symbols=symbols)
        assert (type(again), str(again), vars(again)) == (type(action), str(action), vars(action))
