"""Questions that a careless implementation answers wrongly, or not at all, on every backend."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from kant_sql import (
    InvalidArgumentError,
    InvalidKnowledgeError,
    KantSqlError,
    KnowledgeBase,
    NotApplicableError,
    PddlError,
    aio,
)
from tests.support.reading import loaded, rows, undone
from tests.support.stores import Connect

DOMAIN = """(define (domain yard) (:requirements :adl :fluents :derived-predicates)
  (:types robot wp - object kitchen - wp ghost - object)
  (:constants Dock - wp)
  (:predicates (at ?r - robot ?w - wp) (p ?x ?y) (done) (lamp ?w - wp)
    (six ?a ?b ?c ?d ?e ?f) (link ?x ?y - wp) (reach ?x ?y - wp) (docked ?x - wp)
    (cut-off ?x - wp))
  (:functions (level ?x - object) - number
    (place ?r - robot) - wp (next ?w - wp) - wp (boss ?r - robot) - robot)
  (:derived (reach ?x ?y - wp)
    (or (link ?x ?y) (exists (?z - wp) (and (reach ?x ?z) (reach ?z ?y)))))
  (:derived (docked ?x - wp) (or (= ?x Dock) (link Dock ?x)))
  (:derived (cut-off ?x - wp) (not (reach ?x a)))
  (:action swap :parameters (?x ?y - wp) :precondition (link ?x ?y)
    :effect (and (not (link ?x ?y)) (link ?y ?x)))
  (:action share :parameters (?x ?y - object) :precondition (p ?x ?y)
    :effect (scale-down (level ?x) (level ?y)))
  (:durative-action light :parameters (?w - wp) :duration (= ?duration 2)
    :condition (at start (not (lamp ?w)))
    :effect (and (at start (done)) (when (at end (done)) (at end (lamp ?w)))))
  (:action follow :parameters (?r - robot) :precondition (done)
    :effect (and (at ?r (place (boss ?r))) (assign (place ?r) (place (boss ?r))))))
"""
PROBLEM = """(define (problem one) (:domain yard)
  (:objects r1 r2 - robot b Ünïcödé 名前 x%s a:kb $1 - wp k - kitchen)
  (:init (at r1 a) (at r2 b) (p a a) (p a b) (p r1 r1) (p Ünïcödé 名前) (link a b) (link b k)
    (link k a) (six a b a b a b) (= (level a) 1) (= (level b) 2.5) (= (level r1) 0)
    (= (place r1) a) (= (next a) b) (= (boss r1) r2) (= (place r2) b))
  (:goal (and (at r1 b) (p b b) (lamp b))))
"""


@pytest.fixture
def yard(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    domain = DOMAIN.replace("Dock - wp", "a Dock - wp")
    with fresh_kb.transaction():
        return loaded(fresh_kb, domain, PROBLEM)


def test_an_empty_knowledge_base_has_a_logic(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.holds("(and)")
    assert not fresh_kb.holds("(or)")
    assert fresh_kb.holds("(forall (?x) (or))")
    assert not fresh_kb.holds("(exists (?x) (and))")
    assert list(fresh_kb.query("(and)")) == [()]
    assert list(fresh_kb.query("(or)")) == []
    assert list(fresh_kb.query("(= ?x ?y)")) == []
    assert len(fresh_kb.at(0).query("(and)")) == 1
    assert list(fresh_kb.at(0).query("(= ?x ?y)")) == []
    assert list(fresh_kb.applicable_actions()) == []
    assert fresh_kb.unsatisfied() == []
    with pytest.raises(PddlError, match="predicate 'p'"):
        fresh_kb.holds("(p)")


# What a condition says.

Rows = list[tuple[str, ...]]
ANSWERS: dict[str, tuple[str, Rows]] = {
    "a variable twice": ("(p ?x ?x)", [("a",), ("r1",)]),
    "another case": ("(P ?X A)", [("a",)]),
    "other letters": ("(p ÜNÏCÖDÉ ?x)", [("名前",)]),
    "a variable with a colon": ("(p ?a:kb b)", [("a",)]),
    "a hidden variable": ("(and (at r1 ?x) (exists (?X - wp) (at r2 ?X)))", [("a",)]),
    "hidden by another type": ("(and (exists (?x - robot) (at ?x b)) (link ?x b))", [("a",)]),
    "bound twice": ("(exists (?y) (p ?x ?y))", [("a",), ("r1",), ("Ünïcödé",)]),
    "no goal": ("(at r1 ?w)", [("a",)]),
    "equal to a constant": ("(= ?x DOCK)", [("Dock",)]),
    "equal through others": ("(and (= ?x ?y) (= ?y ?z) (= ?z r1))", [("r1", "r1", "r1")]),
    "six arguments": ("(six ?a ?b ?c ?d ?e ?f)", [("a", "b", "a", "b", "a", "b")]),
    "six arguments of two variables": ("(six ?a ?b ?a ?b ?a ?b)", [("a", "b")]),
    "a fluent's value": ("(= (place ?r) ?w)", [("r1", "a"), ("r2", "b")]),
    "fluents of fluents": ("(> (level (next (place ?r))) 2)", [("r1",)]),
    "a rule that joins itself": ("(reach a ?y)", [("a",), ("b",), ("k",)]),
    "a rule with a constant": ("(docked ?y)", [("Dock",)]),
    "the rule above a negation": (
        "(and (cut-off ?y) (not (= ?y Dock)) (not (p ?y ?y)) (exists (?z) (p ?y ?z)))",
        [("Ünïcödé",)],
    ),
    "only under a negation": ("(and (lamp b) (not (lamp ?w)))", []),
    "under a negation, of the other atom's type": (
        "(exists (?w - wp) (and (link a ?w) (not (at ?r ?w))))",
        [("r1",)],
    ),
    "no objects of the type": ("(not (exists (?g - ghost ?x) (and)))", [()]),
}


@pytest.mark.parametrize("name", ANSWERS)
@pytest.mark.more
def test_answers(yard: KnowledgeBase, name: str) -> None:
    condition, wanted = ANSWERS[name]
    answers = yard.query(condition)
    assert list(answers) == wanted
    assert len(answers) == len(wanted)
    assert list(yard.at(yard.revision).query(condition)) == wanted


DECLARED: dict[str, tuple[str, str, Rows]] = {
    "equal": ("(= ?x ?y)", "?x ?y - robot", [("r1", "r1"), ("r2", "r2")]),
    "equal of two types": ("(= ?x ?y)", "?x - robot ?y - wp", []),
    "unequal": ("(not (= ?x ?y))", "?x ?y - robot", [("r1", "r2"), ("r2", "r1")]),
    "unequal to itself": ("(not (= ?x ?x))", "?x - robot", []),
    "unused": ("(and)", "(?x - robot)", [("r1",), ("r2",)]),
    "unused without objects": ("(and)", "?x - ghost", []),
    "a subtype": ("(link ?x a)", "?x - kitchen", [("k",)]),
    "either": ("(p ?x ?y)", "?x - (either robot kitchen) ?y", [("r1", "r1")]),
    "any": ("(p ?x ?x)", "?x - object", [("a",), ("r1",)]),
}


@pytest.mark.parametrize("name", DECLARED)
def test_answers_with_declared_variables(yard: KnowledgeBase, name: str) -> None:
    condition, parameters, wanted = DECLARED[name]
    assert list(yard.query(condition, parameters=parameters)) == wanted


TRUTHS: dict[str, bool] = {
    "(= (next (place (boss (boss r1)))) b)": False,
    "(not (= (next (place (boss (boss r1)))) b))": True,
    "(= (next (place r1)) (place (boss r1)))": True,
    "(> (/ 1 (level r1)) 0)": False,
    "(not (> (/ 1 (level r1)) 0))": True,
    "(= (/ 0 0) (/ 0 0))": False,
    "(= (level k) (level k))": False,
    "(= (/ (level a) 4) 0.25)": True,
    "(= (/ 1 2) 0.5)": True,
    "(= (- (level b)) -2.5)": True,
    "(lamp b)": False,
    "(p x%s a:kb)": False,
    "(forall (?g - ghost) (done))": True,
    "(exists (?g - ghost) (and))": False,
}


@pytest.mark.parametrize("condition", TRUTHS)
def test_truths(yard: KnowledgeBase, condition: str) -> None:
    assert yard.holds(condition) is TRUTHS[condition]
    assert (yard.unsatisfied(condition) == []) is TRUTHS[condition]


# Size.


def test_a_thousand_atoms(yard: KnowledgeBase) -> None:
    assert yard.holds("(and " + "(link a b) " * 1_000 + ")")
    assert len(yard.query("(and " + "(p ?x ?y) " * 1_000 + ")")) == 4
    assert yard.holds("(and " + "(not (at r1 b)) (not (at r1 k)) " * 500 + ")")


def test_ten_thousand_ground_atoms(yard: KnowledgeBase) -> None:
    assert yard.holds("(and " + "(link a b) (not (link b a)) " * 5_000 + ")")
    assert not yard.holds("(or " + "(link b a) (not (link a b)) " * 5_000 + ")")


@pytest.mark.parametrize("levels", [2, 49])
def test_deep_formulas_that_become_flat(yard: KnowledgeBase, levels: int) -> None:
    assert yard.holds("(not " * levels + "(link a b)" + ")" * levels) is (levels == 2)
    assert not yard.holds("(and (done) " * levels + "(link a b)" + ")" * levels)
    assert yard.holds("(imply (link a b) " * levels + "(link a b)" + ")" * levels)


NESTED: dict[str, Callable[[int], str]] = {
    "junctions": lambda n: "(and (link a b) (or (done) " * n + "(link a b)" + "))" * n,
    "quantifiers": lambda n: (
        "(forall (?x - wp) (exists (?y - robot) (or (done) " * n + "(link a b)" + ")))" * n
    ),
    "negations of quantifiers": lambda n: (
        "".join(f"(exists (?x{i} - wp) (not " for i in range(2 * n + 1))
        + f"(link ?x{2 * n} ?x0)"
        + "))" * (2 * n + 1)
    ),
    "choices": lambda n: (
        "".join(f"(exists (?x{i} - wp) (or (done) (and (link a ?x{i}) " for i in range(n))
        + "(link a b)"
        + ")))" * n
    ),
    "numbers": lambda n: "(> " + "(- " * n + "(level b)" + ")" * n + " -9)",
}


# How often each is repeated in one that is as deep as formulas may be.
REPEATED = {"junctions": 24, "quantifiers": 16, "negations of quantifiers": 11, "choices": 16}


@pytest.mark.parametrize("levels", [2, 8, None])
@pytest.mark.parametrize("name", NESTED)
@pytest.mark.more
def test_nested_conditions(yard: KnowledgeBase, name: str, levels: int | None) -> None:
    """SQLite parses subqueries of some ten levels only: deeper ones become tables of their own."""
    condition = NESTED[name](REPEATED.get(name, 48) if levels is None else levels)
    assert yard.holds(condition)
    assert yard.at(yard.revision).holds(condition)


CHOICES = (
    "(or (q) (and (q) {}))",
    "(and (p ?y) (or (q) {}))",
    "(imply (p ?y) (and (q) {}))",
)
QUANTIFIED = ("(exists (?x{0}) (and (p ?x{0}) {1}))", "(forall (?x{0}) (or (p ?x{0}) {1}))")


@pytest.mark.parametrize(
    ("leaf", "quantifiers", "choices", "first"),
    [
        ("(d {})", 2, 3, 1),
        ("(d {})", 5, 8, 2),
        ("(> (m {}) 2)", 2, 6, 1),
        ("(> (+ (m {}) (/ (n) 3)) 2)", 2, 5, 1),
        ("(> (+ (+ (+ (m {}) (/ (n) 1)) (/ (n) 2)) (/ (n) 3)) 2)", 2, 3, 1),
    ],
)
def test_rules_types_and_numbers_within_choices(
    fresh_kb: KnowledgeBase, leaf: str, quantifiers: int, choices: int, first: int
) -> None:
    """What a type or a number takes of a parser's stack counts, too."""
    fresh_kb.load_domain("""(define (domain g) (:types a b c)
      (:predicates (p ?x) (q) (d ?x - (either a b)) (h ?x - (either a b)))
      (:functions (n) (m ?x))
      (:derived (d ?x - (either a b)) (or (and (p ?x) (not (q))) (and (h ?x) (> (m ?x) 1)))))""")
    fresh_kb.load_problem("""(define (problem one) (:domain g) (:objects o1 - a o2 - b o3 - c)
      (:init (p o1) (= (n) 1) (= (m o1) 2)) (:goal (and)))""")
    condition = leaf.format(f"?x{quantifiers - 1}")
    for number in range(choices):
        condition = CHOICES[(number + first) % 3].format(condition)
    for number in reversed(range(quantifiers)):
        condition = QUANTIFIED[(number + first) % 2].format(number, condition)
    for kb in (fresh_kb, fresh_kb.at(fresh_kb.revision)):
        assert list(kb.query(condition)) == list(kb.state().query(condition))
        assert kb.holds(condition) is kb.state().holds(condition)


def test_what_is_nested_too_deep_is_refused(yard: KnowledgeBase) -> None:
    for name, nested in NESTED.items():
        for times in (REPEATED.get(name, 48) + 1, 200):
            with pytest.raises(InvalidKnowledgeError, match="expected at most 50 levels; name a"):
                yard.holds(nested(times))


# Bindings.


def test_a_binding_names_one_variable(yard: KnowledgeBase) -> None:
    assert list(yard.query("(p ?a-b ?y)", a_b="a")) == [("a",), ("b",)]
    # A variable of just this name comes first.
    assert list(yard.query("(p ?a-b ?a_b)", a_b="b")) == [("a",)]
    assert yard.holds("(p a ?x)", x=yard.objects.get("b"))  # type: ignore[arg-type]
    assert yard.query("(p ?É ?x)", é="ünïcödé").to_dicts() == [{"x": "名前"}]


REFUSED: dict[str, tuple[type[KantSqlError], Callable[[KnowledgeBase], object]]] = {
    "two bindings": (InvalidArgumentError, lambda kb: kb.holds("(p a ?x)", x="b", X="b")),
    "no object": (InvalidArgumentError, lambda kb: kb.holds("(p a ?x)", x=None)),  # type: ignore[arg-type]
    "parameters that go on": (PddlError, lambda kb: kb.query("(p ?x b)", parameters="?x) (or")),
    "too few parameters": (PddlError, lambda kb: kb.query("(p ?x ?y)", parameters="?x")),
    "a time": (PddlError, lambda kb: kb.holds("(at start (done))")),
    "an effect": (PddlError, lambda kb: kb.holds("(when (done) (done))")),
    "a duration": (PddlError, lambda kb: kb.holds("(> ?duration 3)")),
    "hostile text": (PddlError, lambda kb: kb.holds("(p a b'); DROP TABLE proposition; --")),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals(yard: KnowledgeBase, name: str) -> None:
    error, ask = REFUSED[name]
    with pytest.raises(error):
        ask(yard)


@pytest.mark.parametrize("variable", ["a:kb", "a:at", "a%s", "select", "x-y", "é", "v0"])
def test_the_statement_has_any_variable_as_a_column(yard: KnowledgeBase, variable: str) -> None:
    answers = yard.query(f"(p ?{variable} b)")
    assert answers.columns == (variable,)
    sql = answers.sql
    assert f'"{variable}"' in sql
    assert rows(yard, sql.replace(":", "\\:")) == [("a",)]


# Steps.


def test_an_effect_without_a_value_is_refused(yard: KnowledgeBase) -> None:
    for step, reason in {
        "(share r1 r1)": "divides it by 0",
        "(share Ünïcödé 名前)": "no value",
    }.items():
        with pytest.raises(NotApplicableError, match=reason):
            yard.apply(step)
    revision = yard.revision
    with yard.transaction():
        yard.propositions.save("(done)")
        with pytest.raises(NotApplicableError, match="no value"):
            yard.apply("(follow r2)")
        assert not yard.holds("(at r2 a)")
        yard.apply("(follow r1)")
        assert yard.holds("(and (at r1 b) (= (place r1) b) (at r1 a))")
    assert yard.revision == revision + 1


def test_a_condition_at_the_end_of_an_effect_there(yard: KnowledgeBase) -> None:
    yard.end(yard.start("(light b)"))
    assert yard.holds("(lamp b)")
    yard.apply("(light k)")
    assert yard.holds("(lamp k)")


# At work.


@pytest.mark.more
def test_answers_are_of_one_state_while_others_write(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    with kb.transaction():
        loaded(kb, LINE, line(60))
    stop, failed = threading.Event(), []

    def write() -> None:
        own = connect(shared_url)
        try:
            for number in itertools.count():
                if stop.is_set():
                    return
                with own.transaction():
                    own.propositions.delete_all()
                    own.propositions.save_all([f"(link w{i} w{i + 1})" for i in range(59)])
                    own.propositions.save(f"(at w{number % 60})")
        except Exception as error:
            failed.append(error)

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    try:
        for _ in range(4):
            answers = kb.query("(at ?w)")
            assert len(list(iter(answers))) == len(answers) == 1
            assert len(kb.query("(reach w0 ?y)")) == 59
            assert len(kb.query("(even ?y)")) == 30
            assert sum(1 for _ in kb.applicable_actions("go")) == 1
            with contextlib.suppress(NotApplicableError):
                kb.apply(next(kb.applicable_actions("go")))
    finally:
        stop.set()
        for writer in writers:
            writer.join(60)
    assert failed == []


LINE = """(define (domain line) (:requirements :adl :derived-predicates) (:types wp)
  (:constants w0 w1 - wp)
  (:predicates (at ?w - wp) (link ?x ?y - wp) (reach ?x ?y - wp) (even ?x - wp) (odd ?x - wp))
  (:derived (reach ?x ?y - wp)
    (or (link ?x ?y) (exists (?z - wp) (and (link ?x ?z) (reach ?z ?y)))))
  (:derived (even ?x - wp) (or (= ?x w0) (exists (?y - wp) (and (odd ?y) (link ?y ?x)))))
  (:derived (odd ?x - wp) (exists (?y - wp) (and (even ?y) (link ?y ?x))))
  (:action go :parameters (?x - wp) :precondition (at ?x)
    :effect (and (not (at ?x)) (at w1))))
"""


def line(many: int) -> str:
    links = " ".join(f"(link w{n} w{n + 1})" for n in range(many - 1))
    objects = " ".join(f"w{n}" for n in range(2, many))
    return (
        f"(define (problem p) (:domain line) (:objects {objects} - wp) "
        f"(:init (at w0) {links}) (:goal (and)))"
    )


def test_stored_facts_of_predicates_that_derive_each_other_hold(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction():
        loaded(fresh_kb, LINE, line(5))
    fresh_kb.propositions.save("(odd w2)")
    odd = [("w1",), ("w2",), ("w3",), ("w4",)]
    assert list(fresh_kb.query("(odd ?x)")) == odd
    assert list(fresh_kb.query("(even ?x)")) == [("w0",), ("w2",), ("w3",), ("w4",)]
    assert list(fresh_kb.at(fresh_kb.revision).query("(odd ?x)")) == odd
    assert not fresh_kb.at(1).holds("(odd w2)")


def test_what_a_transaction_undoes_is_not_answered(yard: KnowledgeBase) -> None:
    with undone(yard):
        yard.propositions.save("(lamp b)")
        assert yard.holds("(lamp b)")
        unread, read = yard.query("(lamp ?w)"), yard.query("(lamp ?w)")
        assert len(read) == 1
        with undone(yard):
            yard.apply("(swap a b)")
            assert yard.holds("(reach b a)")
            assert not yard.holds("(reach a b)")
        assert yard.holds("(reach a b)")
    assert len(unread) == 0
    assert list(read) == [("b",)]
    assert not yard.holds("(lamp b)")


def test_the_rules_of_the_past_are_those_of_then(yard: KnowledgeBase) -> None:
    before = yard.revision
    [rule] = [r for r in yard.pddl.derived_predicates.get_all() if r.predicate == "docked"]
    yard.pddl.derived_predicates.delete(rule)
    assert not yard.holds("(docked Dock)")
    assert yard.at(before).holds("(docked Dock)")
    yard.objects.delete("k")
    with pytest.raises(PddlError, match="object 'k'"):
        yard.holds("(reach a k)")
    assert yard.at(before).holds("(reach a k)")
    assert ("k",) not in list(yard.query("(reach a ?w)"))


def test_a_store_that_is_opened_for_reading_answers(tmp_path: Path, connect: Connect) -> None:
    kb = connect(f"sqlite:///{tmp_path / 'store.db'}")
    with kb.transaction():
        loaded(kb, LINE, line(3))
    reader = connect(f"sqlite:///{tmp_path / 'store.db'}?mode=ro")
    assert reader.holds("(reach w0 w2)")
    assert reader.query("(even ?x)")[:] == [("w0",), ("w2",)]
    assert [str(step) for step in reader.applicable_actions()] == ["(go w0)"]
    assert reader.why_not("(go w1)")
    with pytest.raises(KantSqlError):
        reader.apply("(go w0)")
    assert kb.holds("(at w0)")


async def test_tasks_ask_and_act(shared_url: str) -> None:
    async def elsewhere() -> bool:
        async with await aio.connect(shared_url) as other:
            return await other.holds("(at w3)")

    async with await aio.connect(shared_url) as kb:
        async with kb.transaction():
            await kb.load_domain(LINE)
            await kb.load_problem(line(4))
        async with kb.transaction():
            await kb.propositions.save("(at w3)")
            assert await kb.holds("(at w3)")
            # Another task is not within the transaction.
            assert not await asyncio.create_task(elsewhere())
        assert len(await kb.query("(at ?w)")) == 2
        assert [str(step) async for step in kb.applicable_actions()] == ["(go w0)", "(go w3)"]
        await kb.apply("(go w3)")
        with pytest.raises(NotApplicableError):
            await kb.apply("(go w3)")
        assert await kb.why_not("(go w3)")


TEXTS = (
    "(and (at ?r a) (not (done)) (forall (?x - robot ?y - wp) (imply (at ?x ?y) (done))))",
    "(>= (+ (level ?x) (* 2 3) 4) (- 3))",
    "(= (place ?r) b)",
    "(exists (?x - (either robot wp)) (= ?x ?y))",
    "(preference p (done))",
    "(and (always (at r1 a)) (sometime-within 3.5 (done)) (hold-during 1 2 (done)))",
    "(swap a b)",
    "(= (level a) 80)",
)


def texts_cut_short() -> Iterator[str]:
    for text in TEXTS:
        tokens = text.replace("(", " ( ").replace(")", " ) ").split()
        for place in range(len(tokens)):
            yield " ".join(tokens[:place])
            yield " ".join(tokens[place:])
            yield " ".join([*tokens[:place], *tokens[place + 1 :]])


@pytest.mark.more
def test_a_text_that_is_cut_short_is_refused_as_pddl(yard: KnowledgeBase) -> None:
    calls: tuple[Callable[[str], object], ...] = (
        *(yard.query, yard.holds, yard.when, yard.pddl.check_rules, yard.why_not, yard.unsatisfied),
        *(yard.goals.delete, yard.pddl.constraints.delete, yard.propositions.delete, yard.blame),
        lambda text: yard.query("(at ?r ?w)", parameters=text),
    )
    for text in texts_cut_short():
        for call in calls:
            with contextlib.suppress(KantSqlError):
                call(text)
