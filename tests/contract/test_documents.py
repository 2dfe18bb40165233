"""Loading whole documents and giving them back, on every backend."""

from __future__ import annotations

from pathlib import Path

import pytest

from kant_sql import InvalidKnowledgeError, KnowledgeBase, ReadOnlyError
from kant_sql.documents.exchange import Mode
from kant_sql.dto.formulas import And, Constant, Equal, Exists, Not, TypedName
from kant_sql.errors import ConflictError, PddlError, SourceMissingError
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import FunctionValue
from tests.support.reading import (
    documents,
    facts,
    last_changes,
    loaded,
    nothing_changes,
    rows,
    store_of,
    undone,
)
from tests.support.worlds.depot import (
    DOMAIN,
    HUB,
    IDLE,
    PROBLEM,
    T1,
    T2,
    TRUCK,
    T,
    again,
    at,
    check_text,
    fuel,
    load,
    number,
)


def domain(body: str, name: str = "depot") -> str:
    return f"(define (domain {name}) {body})"


def problem(init: str = "", goal: str = "(and)", more: str = "", objects: str = "") -> str:
    return (
        f"(define (problem monday) (:domain depot) (:objects t1 t2 - truck c1 - crane p1 p2 - place"
        f" {objects}) (:init {init}) (:goal {goal}) {more})"
    )


MODES: tuple[Mode, Mode] = ("replace", "merge")

# What a load says of itself.


def test_a_load_is_one_revision_or_none(fresh_kb: KnowledgeBase) -> None:
    loaded = fresh_kb.load_domain(DOMAIN)
    assert loaded == (1, read_domain(DOMAIN).warnings)
    assert [line for line in last_changes(fresh_kb) if " document " in line] == [
        "+ document (define (domain depot) (:constant hub) (:function fuel distance home "
        "total-cost) (:predicate at ready linked open idle reachable) "
        "(:type truck crane machine place))"
    ]
    assert fresh_kb.load_problem(PROBLEM).revision == 2
    for mode in MODES:
        assert fresh_kb.load_domain(DOMAIN, mode=mode).revision is None
        assert fresh_kb.load_problem(PROBLEM, mode=mode).revision is None
    assert fresh_kb.revision == 2
    with pytest.raises(InvalidKnowledgeError, match="the mode is 'add', expected"):
        fresh_kb.load_domain(DOMAIN, mode="add")  # type: ignore[arg-type]


def test_files_texts_and_warnings(fresh_kb: KnowledgeBase, tmp_path: Path) -> None:
    file = tmp_path / "domain.pddl"
    file.write_text(DOMAIN, encoding="utf-8")
    loaded = fresh_kb.load_domain(file)
    assert loaded == fresh_kb.load_domain(str(file))._replace(revision=1)
    untyped = "(define (problem p) (:domain depot) (:goal (idle)))"
    loaded = fresh_kb.load_problem(untyped)
    assert [str(warning) for warning in loaded.warnings]
    assert all(warning.source == "<string>" for warning in loaded.warnings)
    with nothing_changes(fresh_kb), pytest.raises(PddlError):
        fresh_kb.load_problem(untyped, strict=True)
    with pytest.raises(FileNotFoundError):
        fresh_kb.load_domain(tmp_path / "nothing.pddl")


def test_a_path_with_a_parenthesis_is_a_path(
    fresh_kb: KnowledgeBase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run (1)").mkdir()
    Path("run (1)/domain.pddl").write_text(DOMAIN, encoding="utf-8")
    assert fresh_kb.load_domain("run (1)/domain.pddl").revision == 1
    with pytest.raises(SourceMissingError, match=r"run \(1\)/problem"):
        fresh_kb.load_problem("run (1)/problem.pddl")


def test_a_problem_without_its_domain_says_what_to_do(fresh_kb: KnowledgeBase) -> None:
    text = "(define (problem p) (:domain depot) (:objects t1 - truck) (:init (idle t1)))"
    with nothing_changes(fresh_kb), pytest.raises(PddlError) as refused:
        fresh_kb.load_problem(text)
    assert (refused.value.line, refused.value.column) == (1, 52)
    assert str(refused.value).endswith(
        "no domain is loaded here: load the domain depot first, with load_domain()"
    )


def test_several_files_are_one_domain(fresh_kb: KnowledgeBase) -> None:
    types = domain("(:types truck - object)")
    predicates = domain("(:types truck - object) (:predicates (free ?t - truck))")
    act = domain(
        "(:predicates (free ?t - truck)) "
        "(:action stop :parameters (?t - truck) :precondition (and) :effect (free ?t))"
    )
    fresh_kb.load_domain(types, predicates, act)
    assert fresh_kb.revision == 1
    assert fresh_kb.pddl.domain() == read_domain(types, predicates, act)
    contradiction = domain("(:types truck - object) (:predicates (free))")
    with nothing_changes(fresh_kb), pytest.raises(PddlError):
        fresh_kb.load_domain(predicates, contradiction)


@pytest.mark.parametrize(
    "wrong",
    [
        "(define (domain depot) (:predicates (p ?x - nowhere)) (:action a :parameters (?x - ship)",
        "(define (domain depot) (:predicates (p)) (:action a :parameters () :effect (q)))",
        "(define (domain depot) (:types a - b b - a))",
        "(",
    ],
)
def test_what_cannot_be_read_leaves_nothing(depot_kb: KnowledgeBase, wrong: str) -> None:
    texts = documents(depot_kb)
    with nothing_changes(depot_kb), pytest.raises(PddlError) as caught:
        depot_kb.load_domain(wrong)
    assert str(caught.value).startswith("<string>:1:")
    with nothing_changes(depot_kb), pytest.raises(PddlError):
        depot_kb.load_problem("(define (problem q) (:domain other) (:goal (and)))")
    with nothing_changes(depot_kb), pytest.raises(PddlError):
        depot_kb.load_problem(problem("(at t1 c1)"))
    assert documents(depot_kb) == texts


def test_within_a_transaction_it_is_a_part_of_it(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction(reason="start"):
        assert fresh_kb.load_domain(DOMAIN).revision is None
        assert fresh_kb.load_problem(PROBLEM).revision is None
        fresh_kb.propositions.save("(at t2 p1)")
        assert set(fresh_kb.pddl.problem().facts) == {at(), at(T2)}
        with pytest.raises(PddlError):
            fresh_kb.load_problem(problem("(near t1 t2)"))
    assert fresh_kb.revision == 1
    assert facts(fresh_kb) == ["(at t1 p1)", "(at t2 p1)"]
    text = fresh_kb.problem_pddl()
    with undone(fresh_kb):
        fresh_kb.load_domain(domain("(:predicates (idle))"))
        assert fresh_kb.pddl.problem().facts == ()
    assert (fresh_kb.revision, fresh_kb.problem_pddl()) == (1, text)


def test_the_past_is_read_only(depot_kb: KnowledgeBase) -> None:
    past = depot_kb.at(1)
    for call in (past.load_domain, past.load_problem):
        with nothing_changes(depot_kb), pytest.raises(ReadOnlyError):
            call(DOMAIN if call == past.load_domain else PROBLEM)
    assert past.pddl.problem() == read_problem(PROBLEM, domain=read_domain(DOMAIN))


def test_past_documents_stay(fresh_kb: KnowledgeBase) -> None:
    texts = [documents(fresh_kb)]
    fresh_kb.load_domain(DOMAIN)
    texts.append(documents(fresh_kb))
    fresh_kb.load_problem(PROBLEM)
    texts.append(documents(fresh_kb))
    fresh_kb.load_problem(problem("(at t2 p2) (= (fuel t1) 1)", "(idle)"))
    texts.append(documents(fresh_kb))
    fresh_kb.load_domain(domain("(:predicates (idle))", "other"))
    texts.append(documents(fresh_kb))
    assert len({*texts}) == 5
    for reader in (fresh_kb, again(fresh_kb)):
        for revision, text in enumerate(texts):
            assert documents(reader.at(revision)) == text
            check_text(reader.at(revision))


def test_a_knowledge_base_without_documents_has_some(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.domain_pddl() == "(define (domain default)\n  (:requirements :strips)\n)\n"
    check_text(fresh_kb)
    fresh_kb.predicates.save("(at ?t - truck ?p - place)")
    fresh_kb.objects.save(["t1 - truck", "p1 - place"])
    fresh_kb.propositions.save("(at t1 p1)")
    assert fresh_kb.pddl.domain().requirements == (":strips", ":typing")
    assert fresh_kb.pddl.problem().facts == (at(),)
    check_text(fresh_kb)
    # Whatever the domain is called in a problem, it is this one.
    fresh_kb.load_problem(
        "(define (problem p) (:domain Depot) (:objects t2 - truck) (:init) (:goal (and)))"
    )
    assert fresh_kb.pddl.domain().name == "Depot"
    check_text(fresh_kb)


# mode="replace".


def test_replacing_a_problem_retracts_what_it_does_not_say(depot_kb: KnowledgeBase) -> None:
    first = problem(
        "(at t1 p1) (at t2 p2) (= (fuel t1) 2) (not (idle)) (at 5 (idle))",
        "(and (idle) (exists (?t - truck) (at ?t hub)))",
        "(:constraints (always (idle))) (:metric minimize (fuel t1))",
    )
    depot_kb.load_problem(first)
    assert depot_kb.pddl.problem() == read_problem(first, domain=depot_kb.pddl.domain())
    bare = (
        "(define (problem monday) (:domain depot) (:objects t2 - truck p2 - place) "
        "(:init (at t2 p2)) (:goal (and)))"
    )
    depot_kb.load_problem(bare)
    assert depot_kb.pddl.problem() == read_problem(bare, domain=depot_kb.pddl.domain())
    assert depot_kb.function_values.get_all() == []
    changes = last_changes(depot_kb)
    assert "- fact (at t1 p1)" in changes
    assert not [line for line in changes if "(at t2 p2)" in line]
    assert sorted({line.split()[1] for line in changes if line.startswith("-")}) == [
        *("constraint", "document", "fact", "goal", "initial", "metric", "object", "timed"),
        "value",
    ]
    # The domain is as it was, its constant too.
    assert depot_kb.pddl.domain() == read_domain(DOMAIN)


def test_replacing_a_domain_keeps_what_still_fits(depot_kb: KnowledgeBase) -> None:
    with depot_kb.transaction():
        depot_kb.goals.save_all([Not(IDLE), Exists((TRUCK,), at(T, HUB)), at(T2)])
        depot_kb.pddl.metric.set(None)
    before = depot_kb.revision
    wider = DOMAIN.replace("(idle)", "(idle ?m - machine)").replace("(fuel ?t - truck)", "(fuel)")
    depot_kb.load_domain(wider)
    assert depot_kb.pddl.domain() == read_domain(wider)
    problem_ = depot_kb.pddl.problem()
    assert problem_.facts == (at(),)
    assert problem_.goal == (at(T2), Exists((TRUCK,), at(T, HUB)))
    # What has another signature now takes its values and formulas along.
    assert [value.fluent.function for value in problem_.values] == ["home"]
    retracted = [line for line in last_changes(depot_kb) if line.startswith("-")]
    assert retracted == [
        "- function (fuel ?t - truck)",
        "- goal (not (idle))",
        "- predicate (idle)",
        "- value (= (fuel t1) 7.50)",
    ]
    check_text(depot_kb)
    # A fact that was not touched has one version all the time.
    count = "SELECT count(*) FROM proposition_version WHERE kb_id = :kb AND NOT until IS NULL"
    assert rows(depot_kb, count) == [(0,)]
    assert depot_kb.at(before).pddl.problem().goal == (
        at(T2),
        Not(IDLE),
        Exists((TRUCK,), at(T, HUB)),
    )


REPLACED = {
    "a type that is gone": ("truck crane - machine", "crane - machine", "unread"),
    "a predicate that is gone": ("(at ?t - truck ?p - place)", "", "facts"),
    "other parameters": ("(at ?t - truck ?p - place)", "(at ?p - place ?t - truck)", "facts"),
    "fewer parameters": ("(at ?t - truck ?p - place)", "(at ?t - truck)", "facts"),
    "a type that is not a subtype now": (
        "(at ?t - truck ?p - place)",
        "(at ?t - crane ?p - place)",
        "facts",
    ),
    "a function that is gone": ("(home ?t - truck) - place", "", "home"),
    "values of another type": ("(home ?t - truck) - place", "(home ?t - truck) - crane", "home"),
    "numbers instead of objects": ("(home ?t - truck) - place", "(home ?t - truck)", "home"),
    "objects instead of numbers": (
        "(fuel ?t - truck) (distance ?a ?b - place) - number",
        "(distance ?a ?b - place) - number (fuel ?t - truck) - place",
        "fuel",
    ),
    "a constant that is gone": ("(:constants hub - place)", "", "home"),
}


@pytest.mark.parametrize(("old", "new", "gone"), REPLACED.values(), ids=REPLACED)
def test_what_fits_no_more_goes_with_the_domain_that_is_replaced(
    depot_kb: KnowledgeBase, old: str, new: str, gone: str
) -> None:
    before = depot_kb.pddl.problem()
    changed = DOMAIN.replace(old, new)
    assert changed != DOMAIN
    if gone == "unread":
        changed = domain("(:types crane - machine machine place) (:predicates (idle))")
    depot_kb.load_domain(changed)
    assert depot_kb.pddl.domain() == read_domain(changed)
    check_text(depot_kb)
    problem_ = depot_kb.pddl.problem()
    left = {value.fluent.function for value in problem_.values}
    if gone == "unread":
        assert [part.name for part in problem_.objects] == ["c1", "p1", "p2"]
        assert (problem_.facts, left) == ((), set())
    elif gone == "facts":
        assert problem_.facts == ()
        assert left == {"fuel", "home"}
    else:
        assert problem_.facts == (at(),)
        assert left == {"fuel", "home"} - {gone}
    assert depot_kb.at(1).pddl.problem() == before
    loaded(depot_kb, DOMAIN, PROBLEM)
    assert depot_kb.pddl.problem() == before


def test_a_problem_follows_its_domain_to_another_name(depot_kb: KnowledgeBase) -> None:
    depot_kb.load_domain(DOMAIN.replace("(domain depot)", "(domain harbour)"))
    assert depot_kb.pddl.problem().domain == "harbour"
    check_text(depot_kb)


def test_an_action_may_become_an_event_and_a_constant_an_object(fresh_kb: KnowledgeBase) -> None:
    act = "(:action act :parameters () :precondition (at ?t hub) :effect (idle))"
    act = act.replace("()", "(?t - truck)")
    loaded(fresh_kb, DOMAIN.rstrip()[:-1] + act + ")", problem("(at t1 hub)"))
    event = DOMAIN.rstrip()[:-1] + act.replace(":action", ":event") + ")"
    fresh_kb.load_domain(event)
    assert fresh_kb.pddl.domain() == read_domain(event)
    # Without its constant a domain keeps nothing that mentions it.
    fresh_kb.load_domain(DOMAIN.replace("(:constants hub - place)", ""))
    fresh_kb.load_problem(problem("(at t1 hub)", objects="hub - place"))
    assert [part.name for part in fresh_kb.pddl.problem().objects][-1] == "hub"
    assert fresh_kb.pddl.domain().constants == ()
    fresh_kb.load_domain(event)
    assert [part.name for part in fresh_kb.pddl.domain().constants] == ["hub"]
    assert fresh_kb.pddl.problem().facts == (at(T1, HUB),)
    check_text(fresh_kb)


# mode="merge".


def test_merging_keeps_what_there_is(depot_kb: KnowledgeBase) -> None:
    more = domain(
        "(:requirements :strips) (:types ship - machine machine) (:predicates (sunk ?s - ship))"
    )
    depot_kb.load_domain(more, mode="merge")
    merged = depot_kb.pddl.domain()
    assert [type_.name for type_ in merged.types] == ["truck", "crane", "machine", "place", "ship"]
    assert [each.name for each in merged.predicates][-2:] == ["reachable", "sunk"]
    assert merged.functions == read_domain(DOMAIN).functions
    assert merged.requirements == (":strips",)
    depot_kb.load_problem(
        "(define (problem monday) (:domain depot) (:objects s1 - ship t1 - truck) "
        "(:init (sunk s1) (= (fuel t1) 7.5)) (:goal (not (idle))))",
        mode="merge",
    )
    problem_ = depot_kb.pddl.problem()
    assert [part.name for part in problem_.objects] == ["t1", "t2", "c1", "p1", "p2", "s1"]
    assert [str(fact_) for fact_ in problem_.facts] == ["(at t1 p1)", "(sunk s1)"]
    assert problem_.goal == (Not(IDLE),)
    assert len(problem_.values) == 2
    assert not [line for line in last_changes(depot_kb) if line.startswith("- fact")]
    check_text(depot_kb)


CONTRADICTIONS = {
    "another domain": ("(domain depot)", "(domain other)", "domain 'depot' is stored"),
    "another parent": ("machine place)", "machine - place place)", "type machine is stored"),
    "another constant": ("hub - place", "hub - crane", "hub - place) is stored"),
    "another predicate": ("(reachable ?p - place)", "(reachable)", "predicate (reachable ?p"),
    "another function": ("(fuel ?t - truck)", "(fuel)", "function (fuel ?t - truck) is stored"),
    "another value": ("- place\n              (total", "- crane (total", "function (home"),
    "another action": (":effect (idle)", ":effect (not (idle))", "action 'act' is stored"),
    "an event": (":action", ":event", "is a stored action"),
}
ACT = "(:action act :parameters () :precondition (and) :effect (idle))"


@pytest.mark.parametrize(("old", "new", "message"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_merging_a_contradiction_is_refused(
    fresh_kb: KnowledgeBase, old: str, new: str, message: str
) -> None:
    whole = DOMAIN.rstrip()[:-1] + ACT + ")"
    loaded(fresh_kb, whole, PROBLEM)
    changed = whole.replace(old, new)
    assert changed != whole
    texts = documents(fresh_kb)
    with nothing_changes(fresh_kb), pytest.raises(ConflictError) as caught:
        fresh_kb.load_domain(changed, mode="merge")
    assert message in str(caught.value)
    assert documents(fresh_kb) == texts


PROBLEM_CONTRADICTIONS: dict[str, tuple[str, str]] = {
    "another problem": (PROBLEM.replace("monday", "tuesday"), "problem 'monday' is stored"),
    "another object": (PROBLEM.replace("c1 - crane", "c1 - place"), "object c1 - crane is stored"),
    "another number": (
        PROBLEM.replace("7.50", "7.51"),
        "(= (fuel t1) 7.50) is stored, but the document has (= (fuel t1) 7.51)",
    ),
    "another object as a value": (PROBLEM.replace(") hub)", ") p1)"), "(= (home t1) hub) is"),
    "a fact that is denied": (
        PROBLEM.replace("(at t1 p1)", "(not (at t1 p1))"),
        "(at t1 p1) is stored, but the document has (not (at t1 p1))",
    ),
    "a fact that was denied": (
        PROBLEM.replace("(at t1 p1)", "(at t2 p2)"),
        "(not (at t2 p2)) is stored, but the document has (at t2 p2)",
    ),
    "another metric": (
        PROBLEM.rstrip()[:-1] + "(:metric maximize (total-cost)))",
        "(:metric minimize (total-cost)) is stored",
    ),
}


@pytest.mark.parametrize(
    ("text", "message"), PROBLEM_CONTRADICTIONS.values(), ids=PROBLEM_CONTRADICTIONS
)
def test_merging_a_problem_that_contradicts_is_refused(
    fresh_kb: KnowledgeBase, text: str, message: str
) -> None:
    first = PROBLEM.replace("(at t1 p1)", "(at t1 p1) (not (at t2 p2))")
    load(fresh_kb, first.rstrip()[:-1] + "(:metric minimize (total-cost)))")
    before = fresh_kb.problem_pddl()
    with nothing_changes(fresh_kb), pytest.raises(ConflictError) as caught:
        fresh_kb.load_problem(text, mode="merge")
    assert message in str(caught.value)
    assert fresh_kb.problem_pddl() == before


# What documents keep.


def test_the_order_of_declarations_is_that_of_the_last_load(depot_kb: KnowledgeBase) -> None:
    turned = DOMAIN.replace(
        "truck crane - machine machine place", "place machine - object crane truck - machine"
    ).replace("(idle) (reachable ?p - place)", "(reachable ?p - place) (idle)")
    assert [type_.name for type_ in read_domain(turned).types] == [
        *("place", "machine", "crane", "truck")
    ]
    assert depot_kb.load_domain(turned).revision == 2
    assert [line.split()[1] for line in last_changes(depot_kb)] == ["document", "document"]
    for reader in (depot_kb, again(depot_kb)):
        assert reader.pddl.domain() == read_domain(turned)
        assert reader.domain_pddl() == write(read_domain(turned))
    objects = PROBLEM.replace("t1 t2 - truck c1 - crane", "c1 - crane t2 t1 - truck")
    depot_kb.load_problem(objects)
    assert depot_kb.pddl.problem() == read_problem(objects, domain=depot_kb.pddl.domain())
    assert depot_kb.at(1).pddl.domain() == read_domain(DOMAIN)


def test_the_order_of_goals_is_kept(depot_kb: KnowledgeBase) -> None:
    goals = ["(idle)", "(not (at t1 p1))", "(at t2 p2)", "(or (idle))", "(at t1 p2)"]
    for order in (goals, goals[::-1], [*goals[2:], *goals[:2]]):
        depot_kb.load_problem(problem("(at t1 p1)", f"(and {' '.join(order)})"))
        assert [str(goal) for goal in depot_kb.pddl.problem().goal] == order
        assert [str(goal) for goal in again(depot_kb).pddl.problem().goal] == order
        literals = [str(goal) for goal in depot_kb.goals.get_propositions()]
        assert sorted(literals) == ["(at t1 p2)", "(at t2 p2)", "(idle)"]
    # Whoever adds one later adds it at the end.
    depot_kb.goals.save(Exists((TRUCK,), at(T, HUB)))
    depot_kb.goals.delete("(idle)")
    found = [str(goal) for goal in depot_kb.pddl.problem().goal]
    left = ["(at t2 p2)", "(or (idle))", "(at t1 p2)", "(not (at t1 p1))"]
    assert found == [*left, "(exists (?t - truck) (at ?t hub))"]
    check_text(depot_kb)


def test_goals_and_constraints_said_twice_are_kept(depot_kb: KnowledgeBase) -> None:
    twice = problem(
        "(at t1 p1)",
        "(and (idle) (not (idle)) (idle) (not (idle)))",
        "(:constraints (and (always (idle)) (always (idle))))",
    )
    depot_kb.load_problem(twice)
    assert depot_kb.pddl.problem() == read_problem(twice, domain=depot_kb.pddl.domain())
    assert len(depot_kb.pddl.problem().goal) == 4
    assert depot_kb.load_problem(depot_kb.problem_pddl()).revision is None


def test_timed_literals_that_differ_in_the_spelling_of_a_number_are_kept(
    depot_kb: KnowledgeBase,
) -> None:
    for time in ("5", "5.0"):
        depot_kb.pddl.timed_initial_literals.save(f"(at {time} (idle))")
    text = depot_kb.problem_pddl()
    assert write(read_problem(text, domain=depot_kb.pddl.domain(), strict=True)) == text


def test_spelling_is_the_first_one(depot_kb: KnowledgeBase) -> None:
    loud = PROBLEM.upper().replace("MONDAY", "Monday")
    depot_kb.load_problem(loud)
    problem_ = depot_kb.pddl.problem()
    assert (problem_.name, problem_.domain) == ("Monday", "depot")
    assert [part.name for part in problem_.objects] == ["t1", "t2", "c1", "p1", "p2"]
    assert problem_.facts == (at(),)
    # A name that was never known is kept as it is written.
    depot_kb.load_problem(problem("(at T3 P1)", objects="T3 - Truck"))
    assert depot_kb.pddl.problem().facts == (at(Constant("T3")),)
    check_text(depot_kb)


def test_parameters_that_share_a_name_are_kept(depot_kb: KnowledgeBase) -> None:
    linked = next(
        each for each in again(depot_kb).pddl.domain().predicates if each.name == "linked"
    )
    assert linked.parameters == (TypedName("x", ("place",)),) * 2
    renamed = DOMAIN.replace("(linked ?x ?x - place)", "(linked ?from ?to - place)")
    # That is not a contradiction, and so no reason to change what is kept.
    assert depot_kb.load_domain(renamed, mode="merge").revision is None
    assert depot_kb.load_domain(renamed).revision == 2
    assert depot_kb.pddl.domain() == read_domain(renamed)
    assert len(last_changes(depot_kb)) == 2


def test_numbers_are_exact(depot_kb: KnowledgeBase) -> None:
    for text in ("0.1", "7.50", "100000000000000000000000.000000000000000000001", "-3", "1e2"):
        depot_kb.load_problem(problem(f"(= (fuel t1) {text})"))
        (value,) = depot_kb.pddl.problem().values
        assert value == FunctionValue(fuel(), number(text))
    depot_kb.load_problem(problem("(= (fuel t1) 7.50)"))
    assert "(= (fuel t1) 7.50)" in depot_kb.problem_pddl()


def test_edits_through_daos_show_in_the_documents(depot_kb: KnowledgeBase) -> None:
    with depot_kb.transaction():
        depot_kb.types.save("ship - machine")
        depot_kb.predicates.save("(sunk ?s - ship)")
        depot_kb.objects.save("s1 - ship")
        depot_kb.propositions.save("(sunk s1)")
        depot_kb.propositions.delete("(at t1 p1)")
        depot_kb.function_values.increase("fuel", objects=["t1"], by=1)
        depot_kb.actions.save("(:action act :precondition (not (idle)) :effect (idle))")
    domain_, problem_ = depot_kb.pddl.domain(), depot_kb.pddl.problem()
    assert domain_.types[-1] == TypedName("ship", ("machine",))
    assert domain_.predicates[-1].name == "sunk"
    assert [action.name for action in domain_.actions] == ["act"]
    assert [str(fact_) for fact_ in problem_.facts] == ["(sunk s1)"]
    assert FunctionValue(fuel(), number("8.50")) in problem_.values
    check_text(depot_kb)


def test_a_fact_that_comes_to_hold_is_not_denied(depot_kb: KnowledgeBase) -> None:
    depot_kb.load_problem(problem("(not (at t1 p1)) (not (idle)) (= t1 t1)"))
    depot_kb.propositions.save("(at t1 p1)")
    problem_ = depot_kb.pddl.problem()
    assert problem_.facts == (at(),)
    assert problem_.literals == (Not(IDLE), Equal(T1, T1))
    check_text(depot_kb)


def test_requirements_are_kept_as_written_and_computed(fresh_kb: KnowledgeBase) -> None:
    written = DOMAIN.replace("(:types", "(:requirements :adl :typing :adl) (:types")
    loaded(fresh_kb, written, PROBLEM)
    assert fresh_kb.pddl.domain().requirements == (":adl", ":typing")
    assert {":strips", ":typing", ":object-fluents"} <= {*fresh_kb.pddl.requirements()}
    assert ":adl" not in fresh_kb.pddl.requirements()
    fresh_kb.goals.save(Exists((TRUCK,), at(T, HUB)))
    assert ":existential-preconditions" in fresh_kb.pddl.requirements()
    assert ":existential-preconditions" not in fresh_kb.at(2).pddl.requirements()


def test_a_document_within_a_transaction_is_what_it_has_changed(depot_kb: KnowledgeBase) -> None:
    with depot_kb.transaction():
        depot_kb.goals.save(And((at(T2), Not(IDLE))))
        assert depot_kb.pddl.problem().goal == (at(T2), Not(IDLE))
        assert "(at t2 p1)" in depot_kb.problem_pddl()
        if not store_of(depot_kb).backend.has_one_connection:
            assert again(depot_kb).pddl.problem().goal == ()
    assert depot_kb.pddl.problem().goal == (at(T2), Not(IDLE))
