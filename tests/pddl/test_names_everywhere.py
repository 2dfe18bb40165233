"""One rule for names: what text, DAOs and the writer take, and that all of it is read back.

Each example gives odd names to a few kinds of elements, in a document where each kind stands in
every position that the language has for it. KANT_SQL_TEST_EXAMPLES=5000 hunts for longer.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase, PddlError, PddlObjectDto, PddlTypeDto
from kant_sql.dto.formulas import Atom, Constant
from kant_sql.dto.lexical import fold, is_name, is_requirement
from kant_sql.errors import InvalidKnowledgeError, InvalidNameError
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Domain, Problem
from tests.support.parts import action_dto, function_dto, predicate_dto, type_dto
from tests.support.profile import PROFILE, hunting

pytestmark = pytest.mark.more

# What stands for a name, and the kind of name.
KINDS = {
    "Zdomain": "domain",
    "Zproblem": "problem",
    "Zrequirement": "requirement",
    "Ztype": "type",
    "Zconstant": "constant",
    "Zobject": "object",
    "Zidle": "predicate",
    "Zready": "predicate",
    "Znear": "predicate",
    "Zrate": "function",
    "Zfuel": "function of objects",
    "Zhome": "function of objects",
    "Zparameter": "parameter",
    "Zvariable": "variable",
    "Zwish": "preference",
    "Zmove": "action",
    "Zdrive": "durative-action",
    "Zflow": "process",
    "Zspill": "event",
}
DOMAIN = """
(define (domain Zdomain)
  (:requirements :adl :Zrequirement)
  (:types Ztype - base truck - Ztype base)
  (:constants Zconstant - Ztype other - (either Ztype base))
  (:predicates (Zidle) (Zready ?Zparameter - Ztype) (Znear ?Zparameter ?b - Ztype))
  (:functions (Zrate) (Zfuel ?Zparameter - Ztype) - number (Zhome ?Zparameter - Ztype) - Ztype)
  (:constraints (and (always (Znear Zconstant Zconstant)) (within 5 (Zready Zconstant))
    (forall (?Zvariable - Ztype) (sometime-after (Zready ?Zvariable) (Zidle)))
    (hold-during 1 2 (Zidle)) (at end (Znear Zconstant Zconstant))))
  (:derived (reached ?Zvariable - Ztype)
    (exists (?z - Ztype) (or (Znear ?Zvariable ?z) (Zready ?z) (Zidle))))
  (:action Zmove :parameters (?Zparameter - Ztype ?q - (either Ztype base))
    :precondition (and (Znear ?Zparameter Zconstant) (Zready Zconstant) (not (Zidle))
      (= ?Zparameter Zconstant) (= (Zhome ?Zparameter) Zconstant) (= (Zfuel ?Zparameter) 3)
      (= (Zrate) (Zfuel Zconstant)) (> (+ (Zrate) (* 2 (Zfuel ?Zparameter))) 1)
      (= Zconstant (Zhome Zconstant)) (preference Zwish (Zready ?Zparameter))
      (forall (?Zvariable - Ztype) (imply (Znear ?Zvariable ?Zparameter) (Zidle)))
      (exists (?Zvariable - (either Ztype base)) (= ?Zvariable Zconstant)))
    :effect (and (Znear ?Zparameter Zconstant) (not (Zready Zconstant)) (Zidle)
      (increase (Zfuel ?Zparameter) (Zrate)) (assign (Zrate) 2) (scale-up (Zrate) 2)
      (assign (Zhome ?Zparameter) Zconstant) (assign (Zhome Zconstant) (Zhome ?Zparameter))
      (when (Zready ?Zparameter) (and (Zidle) (not (Znear Zconstant Zconstant))))
      (forall (?Zvariable - Ztype) (when (Zidle) (Zready ?Zvariable)))))
  (:durative-action Zdrive :parameters (?Zparameter - Ztype)
    :duration (and (>= ?duration (Zfuel ?Zparameter)) (<= ?duration (Zrate)))
    :condition (and (at start (Znear ?Zparameter Zconstant)) (over all (Zready ?Zparameter))
      (at end (Zidle)) (preference Zwish (at start (Zidle)))
      (forall (?Zvariable - Ztype) (at start (Zready ?Zvariable))))
    :effect (and (at start (not (Zready ?Zparameter))) (at end (Znear Zconstant ?Zparameter))
      (at end (increase (Zfuel ?Zparameter) ?duration))
      (decrease (Zrate) (* #t (Zfuel Zconstant)))))
  (:process Zflow :parameters (?Zparameter - Ztype) :precondition (Zready ?Zparameter)
    :effect (and (increase (Zfuel ?Zparameter) (* #t (Zrate)))))
  (:event Zspill :parameters (?Zparameter - Ztype) :precondition (Zready ?Zparameter)
    :effect (and (Zidle))))
"""
PROBLEM = """
(define (problem Zproblem) (:domain Zdomain) (:requirements :Zrequirement)
  (:objects Zobject - Ztype o2 - (either Ztype base))
  (:init (Znear Zobject Zconstant) (Znear Zconstant Zobject) (Zready Zobject) (Zidle)
    (= (Zrate) 1.5) (= (Zfuel Zobject) 3) (= (Zhome Zobject) Zconstant)
    (= (Zhome Zconstant) Zobject)
    (not (Znear Zobject Zobject)) (not (Zready Zconstant)) (= Zobject Zobject)
    (at 5 (Znear Zobject Zobject)) (at 6 (not (Zready Zobject))) (at 6 (Zidle))
    (at 7 (= (Zfuel Zobject) 2)) (at 8 (= (Zhome Zobject) Zobject)))
  (:goal (and (Znear Zobject Zconstant) (Zready Zobject) (Zidle) (preference Zwish (Zidle))
    (preference (Zready Zobject)) (not (Znear Zconstant Zobject)) (= (Zhome Zobject) Zconstant)
    (= Zobject Zconstant) (< (Zfuel Zobject) (Zrate))
    (exists (?Zvariable - Ztype) (Znear ?Zvariable Zobject))
    (forall (?Zvariable - Ztype) (preference Zwish (Znear Zobject ?Zvariable)))))
  (:constraints (and (sometime (Znear Zobject Zconstant)) (at-most-once (Zidle))
    (always-within 5 (Zready Zobject) (Zidle)) (preference Zwish (always (Zready Zobject)))))
  (:metric minimize (+ (* 2 (is-violated Zwish)) (Zrate) (- (Zfuel Zobject)) (total-time))))
"""
SAFE = read_domain(DOMAIN)
SAFE_PROBLEM = read_problem(PROBLEM, domain=SAFE)
SAFE_TEXT, SAFE_PROBLEM_TEXT = write(SAFE), write(SAFE_PROBLEM)

IN_DOCUMENTS = ("domain", "problem", "requirement")
_PLAIN = """
at over start end all and or not imply forall exists when either object number preference always
sometime within at-most-once sometime-after hold-during hold-after always-within increase assign
scale-up define domain problem is-violated total-time total-cost duration minimize unknown oneof
probabilistic undefined init goal truck base - -- + * / < <= = >= > . 1 23 0 e E 1.5 #t #T # _ :
:action ? ?x a B K ' ; ( ) %
"""
_ODD = 'é ß \u212a \u017f 机 \u0301 \u3164 \u115f \ufe0f \u200b " \\'
WORDS = (*_PLAIN.split(), *_ODD.split(), " ")
NAMES = st.one_of(
    st.sampled_from(WORDS),
    st.sampled_from(WORDS).map(str.swapcase),
    st.lists(st.sampled_from(WORDS), min_size=1, max_size=4).map("".join),
    st.text(min_size=1, max_size=4),
)


class Renamed(NamedTuple):
    """The documents with other names, and what text would have them."""

    domain: Domain
    problem: Problem
    domain_text: str
    problem_text: str


def renamed(value: Any, names: dict[str, str]) -> Any:
    """A document, or a part of one, with other names."""
    if isinstance(value, str):
        key = value.removeprefix(":")
        return value.replace(key, names[key]) if key in names else value
    if isinstance(value, tuple):
        parts = [renamed(part, names) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(*(renamed(getattr(value, field.name), names) for field in fields(value)))
    return value


def in_text(text: str, names: dict[str, str]) -> str:
    for placeholder, name in names.items():
        text = text.replace(placeholder, name)
    return text


def make(names: dict[str, str]) -> Renamed:
    domain, problem = renamed(SAFE, names), renamed(SAFE_PROBLEM, names)
    return Renamed(domain, problem, in_text(SAFE_TEXT, names), in_text(SAFE_PROBLEM_TEXT, names))


def is_right(names: dict[str, str]) -> bool:
    """Whether the one rule lets the names pass."""
    for placeholder, name in names.items():
        kind = KINDS[placeholder]
        if kind in ("parameter", "variable") and fold(name) == "duration":
            # They are bound in a durative action, too, where that is its duration.
            return False
        if not (is_requirement(f":{name}") if kind == "requirement" else is_name(name, kind)):
            return False
    return True


def are_different(names: dict[str, str]) -> bool:
    """Whether no two elements of a kind have one name, and types are not built-in ones."""
    taken = {("type", each) for each in ("object", "number", "base", "truck")}
    taken |= {("object", "other"), ("object", "o2"), ("variable", "q"), ("variable", "z")}
    taken |= {("predicate", "reached"), ("variable", "b"), ("requirement", "adl")}
    groups = {"constant": "object", "parameter": "variable", "durative-action": "action"}
    groups |= {"function of objects": "function", "process": "action", "event": "action"}
    for placeholder, kind in KINDS.items():
        key = groups.get(kind, kind), fold(names.get(placeholder, placeholder))
        if key in taken:
            return False
        taken.add(key)
    return True


def save_parts(kb: KnowledgeBase, domain: Domain, problem: Problem) -> None:
    """Save documents by DAOs, in one revision."""
    with kb.transaction():
        save_domain(kb, domain)
        for thing in problem.objects:
            kb.objects.save(PddlObjectDto(type_dto(thing.types), thing.name))
        for fact in problem.facts:
            kb.propositions.save(proposition(kb, fact))
        for fluent, value in problem.values:
            objects = [str(term) for term in fluent.terms]
            held: Any = value.name if isinstance(value, Constant) else value.value
            kb.function_values.set(fluent.function, objects=objects, value=held)
        kb.pddl.initial_literals.save_all(problem.literals)
        kb.pddl.timed_initial_literals.save_all(problem.timed)
        kb.goals.save_all(problem.goal)
        kb.pddl.constraints.save_all(problem.constraints)
        assert problem.metric is not None
        kb.pddl.metric.set(problem.metric)


def save_domain(kb: KnowledgeBase, domain: Domain) -> None:
    for type_ in domain.types:
        kb.types.save(PddlTypeDto(type_.name, parent=type_dto(type_.types)))
    for constant in domain.constants:
        dto = PddlObjectDto(type_dto(constant.types), constant.name, is_constant=True)
        kb.objects.save(dto)
    for predicate in domain.predicates:
        kb.predicates.save(predicate_dto(predicate))
    for function in domain.functions:
        kb.functions.save(function_dto(function))
    kb.pddl.domain_constraints.save_all(domain.constraints)
    kb.pddl.derived_predicates.save_all(domain.derived)
    for action in domain.actions:
        dao: Any = {"process": kb.pddl.processes, "event": kb.pddl.events}.get(
            action.kind, kb.actions
        )
        dao.save(action_dto(action))


def proposition(kb: KnowledgeBase, fact: Atom) -> kant_sql.PddlPropositionDto:
    predicate = kb.predicates.get(fact.predicate)
    objects = [kb.objects.get(str(term)) for term in fact.terms]
    assert predicate is not None
    return kant_sql.PddlPropositionDto(predicate, [each for each in objects if each is not None])


def check_refused(names: dict[str, str]) -> None:
    made = make(names)
    # Titles and requirements are in documents alone.
    saved = {key: names[key] for key in names if KINDS[key] not in IN_DOCUMENTS}
    if not is_right(saved):
        with kant_sql.connect("sqlite://") as kb, pytest.raises(InvalidKnowledgeError):
            save_parts(kb, made.domain, made.problem)
    with pytest.raises(InvalidNameError):  # noqa: PT012
        write(made.domain)
        write(made.problem)
    with pytest.raises(PddlError):
        read_problem(made.problem_text, domain=read_domain(made.domain_text))


def check_taken(made: Renamed) -> None:
    domain = read_domain(made.domain_text)
    assert domain == made.domain
    assert read_domain(write(domain)) == domain
    assert read_problem(made.problem_text, domain=domain) == made.problem
    assert read_problem(write(made.problem), domain=domain) == made.problem
    with kant_sql.connect("sqlite://") as kb:
        kb.load_domain(made.domain_text)
        kb.load_problem(made.problem_text)
        check_held(kb)
        assert (kb.pddl.domain(), kb.pddl.problem()) == (made.domain, made.problem)
    with kant_sql.connect("sqlite://") as kb:
        save_parts(kb, made.domain, made.problem)
        check_held(kb)
        assert {*kb.pddl.domain().actions} == {*made.domain.actions}
        assert {*kb.pddl.domain().predicates} == {*made.domain.predicates}
        assert {*kb.pddl.problem().facts} == {*made.problem.facts}
        assert {*kb.pddl.problem().goal} == {*made.problem.goal}


def check_held(kb: KnowledgeBase) -> None:
    assert kb.store.verify().findings == ()
    domain = kb.pddl.domain()
    assert read_domain(kb.domain_pddl()) == domain
    assert read_problem(kb.problem_pddl(), domain=domain) == kb.pddl.problem()


def is_cut(name: str) -> bool:
    """Whether text has other words instead of the name."""
    return any(sign.isspace() or sign in "();" for sign in name)


def check(names: dict[str, str]) -> None:
    if is_right(names):
        check_taken(make(names))
    elif not any(map(is_cut, names.values())):
        check_refused(names)


@pytest.mark.parametrize("word", WORDS)
def test_a_word_names_elements_of_any_kind_or_is_refused(word: str) -> None:
    for placeholder in KINDS:
        if are_different({placeholder: word}) and not is_cut(word):
            is_right_here = is_right({placeholder: word})
            made = make({placeholder: word})
            try:
                domain = read_domain(made.domain_text)
                problem = read_problem(made.problem_text, domain=domain)
            except PddlError:
                assert not is_right_here, (placeholder, word)
            else:
                assert is_right_here, (placeholder, word)
                assert (domain, problem) == (made.domain, made.problem)


def test_what_is_taken_is_read_back_and_all_else_is_refused_everywhere() -> None:
    @hunting(PROFILE.texts)
    @given(st.dictionaries(st.sampled_from([*KINDS]), NAMES, min_size=1, max_size=4))
    @example({"Zfuel": "not"})
    @example({"Zhome": "forall"})
    @example({"Znear": ">="})
    @example({"Znear": "preference", "Zready": "within", "Zidle": "always"})
    @example({"Zparameter": "duration"})
    @example({"Zvariable": "Duration"})
    @example({"Zobject": "-b"})
    @example({"Zconstant": "5", "Ztype": "6"})
    @example({"Ztype": "\u115f"})
    @example({"Znear": "at", "Zobject": "start", "Zconstant": "end"})
    @example({"Zready": "unknown", "Zfuel": "at", "Zrate": "total-time"})
    def hold(names: dict[str, str]) -> None:
        assume(are_different(names))
        check(names)

    hold()
