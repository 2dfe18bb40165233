"""What readers refuse: with the place, what was found, what was expected, and what it is in."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

import kant_sql
from kant_sql import errors
from kant_sql.dto.formulas import MAX_NESTING
from kant_sql.pddl import Domain, Problem, read, read_domain, read_problem, write
from kant_sql.pddl.given import read_action, read_function, read_object, read_predicate, read_type
from kant_sql.pddl.symbols import SymbolTable

HEAD = """(define (domain d) (:requirements :adl :fluents)
(:types a b - t t) (:constants k - a)
(:predicates (p ?x - a) (q ?x ?y) (r))
(:functions (f ?x - a) (g) - number (loc ?x - a) - b)
"""
DOMAIN = read_domain(f"{HEAD})")


def action(body: str) -> str:
    return f"{HEAD}(:action move :parameters (?x - a ?y - b ?z - t)\n{body}))"


def durative(body: str) -> str:
    return f"{HEAD}(:durative-action move :parameters (?x - a)\n{body}))"


def problem(body: str) -> str:
    return f"(define (problem s) (:domain d) (:objects o - a n - b)\n{body})"


def parse(text: str) -> object:
    return read_problem(text, domain=DOMAIN) if "(problem" in text else read_domain(text)


def refusal(text: str) -> errors.PddlError:
    with pytest.raises(errors.PddlError) as refused:
        parse(text)
    return refused.value


def test_the_parts_of_an_error(tmp_path: Path) -> None:
    path = tmp_path / "domain.pddl"
    path.write_text(action(":effect (and (r)\n  (pp ?x))"))
    with pytest.raises(errors.InvalidKnowledgeError) as refused:
        read_domain(path)
    error = refused.value
    assert isinstance(error, errors.PddlError)
    assert (error.source, error.line, error.column) == (str(path), 7, 4)
    assert error.found == "the predicate 'pp'"
    assert error.expected == "a predicate that is declared (did you mean p?)"
    assert error.nesting == "action move, :effect"
    assert str(error) == (
        f"{path}:7:4: in action move, :effect: found the predicate 'pp', "
        "expected a predicate that is declared (did you mean p?)"
    )


def test_that_no_predicate_is_declared_is_said() -> None:
    with kant_sql.connect("sqlite://") as kb:
        with pytest.raises(
            errors.PddlError, match=r"a predicate that is declared \(none is"
        ) as told:
            kb.holds("(docked)")
        assert told.value.found == "the predicate 'docked'"
        with pytest.raises(errors.PddlError, match=r"declared \(did you mean not\?\)"):
            kb.holds("(nott (docked))")


@pytest.mark.parametrize(
    "error",
    [
        errors.PddlError("<string>", 1, 2, "'x'", "'y'", "action move"),
        errors.DependantsError("it is used", ["(at rb1)"]),
        errors.DivergedError("they differ", 3, "aa", "bb"),
        errors.NoPlanError("none was found", "timeout"),
        errors.NotApplicableError("it cannot be applied", [1]),
        errors.SourceMissingError(2, "No such file", "domain.pddl"),
        errors.StaleRevisionError("it moved on", 3, 4),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_goes_to_another_process_as_it_is(error: errors.KantSqlError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


@pytest.mark.parametrize(
    ("body", "column", "found", "expected"),
    [
        (":precondition (and (p ?w))", 23, "the variable '?w'", "a variable that is bound here"),
        (":precondition (p kk)", 18, "the object 'kk'", "declared (did you mean k?)"),
        (":precondition (p x)", 18, "the object 'x'", "an object, or the variable ?x"),
        (":precondition (q ?x)", 20, "1", "2 arguments of q"),
        (":precondition (q)", 17, "0", "2 arguments of q"),
        (":precondition (p ?x ?x)", 21, "'?x'", "')' after the 1 argument of p"),
        (":precondition (p (loc ?x) ?x)", 18, "(loc ?x) of type b", "a as argument 1 of p"),
        (":precondition (r) :precondition (r)", 19, "':precondition'", "this one is there already"),
        (":precondition (p ?y)", 18, "?y of type b", "a as argument 1 of p"),
        (":precondition (g)", 16, "the predicate 'g'", "a formula, but g is a function"),
        (":precondition (p (g))", 18, "the number (g ...)", "a term"),
        (":precondition (q ?x 3)", 21, "the object '3'", "an object that is declared"),
        (":precondition (> (loc ?x) 3)", 18, "(loc ...), which is an object", "a number"),
        (":precondition (= (g) ?x)", 22, "'?x'", "a number"),
        (":precondition (= (g) inf)", 22, "'inf'", "a number"),
        (":precondition (< (g))", 21, "')'", "a number"),
        (":precondition (> (g) 1e999)", 22, "'1e999'", "a number of at most 400 digits"),
        (":precondition (> (+ 1) 1)", 22, "1", "two operands of +"),
        (":precondition (> (h) 1)", 19, "the function 'h'", "a function that is declared"),
        (":precondition (not (r) (r))", 24, "'(r'", "')' after the formula that is negated"),
        (":precondition (imply (r))", 25, "')'", "a formula, which begins with '('"),
        (":precondition r", 15, "'r'", "a formula, which begins with '('"),
        (":precondition ((r))", 16, "'(r'", "a predicate or an operator"),
        (":precondition (forall ?v (r))", 23, "'?v'", "'(' before the variables"),
        (":precondition (forall (v) (r))", 24, "'v'", "a variable, which begins with '?'"),
        (":precondition (forall (?v ?V) (r))", 27, "the variable '?V' again", "each variable once"),
        (":precondition (forall (?v - ) (r))", 29, "')'", "a type"),
        (":precondition (forall (?v - (either)) (r))", 36, "')'", "a type"),
        (":precondition (or (preference n (r)))", 19, "'(preference'", "a formula; a preference"),
        (":precondition (always (r))", 15, "'(always'", "a formula; constraints belong to"),
        (":precondition (at start (r))", 15, "(at start ...)", "a formula without a time"),
        (":precondition (at end r)", 16, "the predicate 'at'", "a predicate that is declared"),
        (":effect (or (r) (r))", 9, "'(or'", "an effect"),
        (":effect (not (not (r)))", 14, "'(not'", "an atom that is deleted"),
        (":effect (at end (r))", 9, "'(at'", "an effect without a time"),
        (":effect (increase (g) (* #t 1))", 26, "'#t' outside of a process", "a number"),
        (":effect (increase (loc ?x) 1)", 19, "(loc ...), which is an object", "a number"),
        (":effect (assign (loc ?x) ?x)", 26, "?x of type a", "b as the value of loc"),
        (":effect (increase (g) ?duration)", 23, "'?duration'", "a number"),
        (":precondtion (r)", 1, "':precondtion'", "(did you mean :precondition?)"),
        (":effect (r) :effect (r)", 13, "':effect'", "each part of an action once"),
        (":duration (= ?duration 1)", 1, "':duration'", "a part of an action"),
    ],
)
def test_actions(body: str, column: int, found: str, expected: str) -> None:
    error = refusal(action(body))
    assert (error.line, error.column) == (6, column), str(error)
    assert error.found.startswith(found)
    assert expected in error.expected
    assert error.nesting.startswith("action move")


@pytest.mark.parametrize(
    ("body", "column", "expected"),
    [
        (":condition (r)", 12, "(at start ...), (over all ...) or (at end ...)"),
        (":condition (= (g) 1)", 12, "(at start ...), (over all ...) or (at end ...)"),
        (":condition (at start (at end (r)))", 22, "a formula without a time"),
        (":effect (r)", 9, "(at start ...), (at end ...) or a continuous effect with #t"),
        (":effect (not (r))", 9, "(at start ...), (at end ...) or a continuous effect with #t"),
        (":effect (increase (g) 1)", 9, "(at start ...), (at end ...) or a continuous effect"),
        (":effect (over all (r))", 9, "(at start ...), (at end ...) or a continuous effect"),
        (":duration (> 5 4)", 11, "a comparison with ?duration"),
        (":duration 5", 11, "a duration, such as (= ?duration 5)"),
        (":duration (not (= ?duration 5))", 11, "(= ?duration ...), (<= ?duration ...) or"),
    ],
)
def test_durative_actions(body: str, column: int, expected: str) -> None:
    error = refusal(durative(body))
    assert (error.line, error.column) == (6, column), str(error)
    assert error.expected.startswith(expected)


@pytest.mark.parametrize(
    ("body", "column", "expected"),
    [
        ("(:types u - v v - w w - u x - u)", 11, "no cycle of types"),
        ("(:types u - u)", 11, "no cycle of types"),
        ("(:requirements :strips :?x)", 24, "a requirement such as :typing"),
        ("(:requirements :)", 16, "a requirement such as :typing"),
        ("(:requirements a'b)", 16, "a requirement such as :typing"),
        ("(:types either)", 9, "the word is reserved in PDDL"),
        ("(:types object - a)", 9, "no type above object"),
        ("(:types it's)", 9, 'it has "\'" (APOSTROPHE) at position 2'),
        ("(:predicates (not ?x))", 15, "the word is reserved in PDDL"),
        (f"(:predicates ({'p' * 256}))", 15, "it has 256 characters, 255 at most"),
        ("(:predicates (p ?x))", 15, "one predicate of that name"),
        ("(:predicates (s ?x - it's))", 22, "a type"),
        ("(:predicates (s ?x - ?y))", 22, "a type"),
        ("(:predicates r)", 14, "a predicate such as (near ?a ?b)"),
        ("(:predicates (:private (x)))", 15, "a predicate"),
        ("(:functions (g) - a)", 14, "one function of that name"),
        ("(:functions g)", 13, "a function such as (distance ?a ?b)"),
        ("(:derived (p ?x ?y) (r))", 12, "1, as p is declared"),
        ("(:derived (p ?x - b) (r))", 14, "a, as the predicate is declared"),
        ("(:derived p (r))", 11, "a predicate with its variables"),
        ("(:constraints (r))", 15, "a constraint such as (always ...)"),
        ("(:constraints (within (r)))", 23, "a number from 0 on, the time of within"),
        ("(:constraints (within -1 (r)))", 23, "a number from 0 on, the time of within"),
        (
            "(:constraints (hold-during 5 1 (r)))",
            30,
            "the end of hold-during, not before its begin",
        ),
        ("(:action e :parameters ()) (:action E :parameters (?v))", 37, "one action of that name"),
        ("(:timeless (r))", 1, "a section of a domain"),
        ("(:prdicates (r))", 1, "a section of a domain (did you mean :predicates?)"),
        ("(:init (r))", 1, "a section of a domain"),
        ("(r)", 1, "a section such as (:action ...), or ')' that closes the definition"),
        ("r", 1, "a section such as (:action ...), or ')' that closes the definition"),
        (
            "(r) (:predicates)",
            1,
            "a section such as (:action ...), or ')' that closes the definition",
        ),
    ],
)
def test_domains(body: str, column: int, expected: str) -> None:
    error = refusal(f"{HEAD}{body})")
    assert (error.line, error.column) == (5, column), str(error)
    assert error.expected.endswith(expected)


@pytest.mark.parametrize(
    ("body", "column", "found", "expected"),
    [
        ("(:init (p n))", 11, "n of type b", "a as argument 1 of p"),
        ("(:init (p o o))", 13, "'o'", "')' after the 1 argument of p"),
        ("(:init (p))", 10, "0", "1 argument of p"),
        ("(:init (pp o))", 9, "the predicate 'pp'", "declared (did you mean p?)"),
        ("(:init (p oo))", 11, "the object 'oo'", "declared (did you mean o?)"),
        ("(:init (p ?x))", 11, "the variable '?x'", "a variable that is bound here"),
        ("(:init (q o (loc o)))", 8, "the argument (loc o)", "objects as arguments"),
        ("(:init r)", 8, "'r'", "a fact, which begins with '('"),
        ("(:init ((r)))", 9, "'(r'", "a predicate"),
        ("(:init (= (g) o))", 15, "'o'", "a number"),
        ("(:init (= (loc o) 1))", 19, "'1'", "an object: values of loc are of type b"),
        ("(:init (= (loc o) o))", 19, "o of type a", "b as the value of loc"),
        ("(:init (= (f o) (+ 1 2)))", 17, "(+ 1 2)", "a number"),
        ("(:init (oneof (r) (p o)))", 8, "'(oneof', which is of conformant", "a fact"),
        ("(:init (at -1 (r)))", 12, "'-1'", "a number from 0 on, the time of at"),
        ("(:init (at 3 (or (r))))", 15, "the predicate 'or'", "declared (did you mean r?)"),
        ("(:objects z - c)", 15, "the type 'c'", "a type that is declared"),
        ("(:objects k - b)", 11, "k of type b", "a, as the domain's constant"),
        ("(:goal (p o) (p n))", 17, "n of type b", "a as argument 1 of p"),
        ("(:goal r)", 8, "'r'", "a formula, which begins with '('"),
        ("(:metric minimise (g))", 10, "'minimise'", "(did you mean minimize?)"),
        ("(:metric minimize (g) (g))", 23, "'(g'", "')' after the metric"),
        ("(:action a)", 1, "'(:action'", "a section of a problem"),
        ("(:domain e)", 10, "the domain e", "the domain d"),
    ],
)
def test_problems(body: str, column: int, found: str, expected: str) -> None:
    error = refusal(problem(body))
    assert (error.line, error.column) == (2, column), str(error)
    assert error.found.startswith(found)
    assert error.expected.endswith(expected)


@pytest.mark.parametrize(
    ("text", "place", "found", "expected"),
    [
        ("", (1, 1), "the end of the text", "(define"),
        ("; (define (domain d))", (1, 22), "the end of the text", "(define"),
        ("a (define (domain d))", (1, 1), "'a'", "(define"),
        ("(defin (domain d))", (1, 1), "'(defin'", "(define"),
        ("(define", (1, 1), "'(define'", "(define (domain ...)"),
        ("(define (plan d))", (1, 10), "'plan'", "domain or problem"),
        ("(define (domain))", (1, 16), "')'", "the name of the domain"),
        ("(define (domain d e))", (1, 19), "'e'", "')' after the name of the domain"),
        ("(define (domain (d)))", (1, 17), "'(d'", "the name of the domain"),
        ("(define (domain d", (1, 18), "the end of the text", "')' that closes the definition"),
        ("(define (domain d) e)", (1, 20), "'e'", "a section such as"),
        (
            "(define (domain d)\n(:predicates (r)\n(:action a))",
            (3, 1),
            "'(:action'",
            "')' that closes (:predicates of line 2",
        ),
        (
            "(define (domain d) (:predicates (r)))\n(:action a))",
            (2, 1),
            "'(:action' outside of a definition",
            "(define",
        ),
        (
            "(define (domain d)\n(:predicates (r) ; )\n",
            (2, 17),
            "the end of the text",
            "')' that closes (:predicates of line 2",
        ),
        ("(define (domain d) (:predicates (r))) r", (1, 39), "'r'", "(define"),
        (problem("(:init)").replace("problem s", "domain s"), (1, 20), "'(:domain'", "a section"),
        ("(define (problem s) (:init))", (1, 1), "a problem without a domain", "(:domain ...)"),
    ],
)
def test_forms(text: str, place: tuple[int, int], found: str, expected: str) -> None:
    error = refusal(text)
    assert (error.line, error.column) == place, str(error)
    assert error.found.startswith(found)
    assert error.expected.startswith(expected)


@pytest.mark.parametrize(
    "body",
    [
        *('(:init (p "a"))', "(:init (p ?x))", "(:init (= (= a) 3))", "(:init (= (not a) 3))"),
        *("(:init (it's))", "(:objects a - it's)", "(:metric minimize (is-violated it's))"),
        "(:goal (p ?x))",
    ],
)
def test_what_is_no_name_is_refused_without_the_domain_too(body: str) -> None:
    with pytest.raises(errors.PddlError):
        read_problem(f"(define (problem s) (:domain d) {body})")


def test_a_domain_is_no_problem() -> None:
    with pytest.raises(errors.PddlError, match="1:10: found 'domain', expected problem"):
        read_problem(f"{HEAD})")
    with pytest.raises(errors.PddlError, match="expected one problem"):
        read_problem(problem("(:init)") * 2)


def test_two_domains_in_one_source_must_agree() -> None:
    with pytest.raises(errors.PddlError, match="found 'e', expected d, as in <string>"):
        read_domain("(define (domain d)) (define (domain e))")


def test_reading_needs_a_source() -> None:
    with pytest.raises(TypeError):
        read_domain()


@pytest.mark.parametrize(
    ("before", "opening", "inner", "behind"),
    [
        (":precondition ", "(imply (r) ", "(p (", "))"),
        (":effect ", "(not ", "(r)", ""),
        (":precondition (= (g) ", "(- ", "1 2 3 x", ")"),
        (":precondition (p ", "(g ", "1", ")"),
    ],
)
def test_what_is_wrong_with_deep_formulas(
    before: str, opening: str, inner: str, behind: str
) -> None:
    levels = 100_000
    error = refusal(action(f"{before}{opening * levels}{inner}{')' * levels}{behind}"))
    assert len(str(error)) < 500


@pytest.mark.parametrize(
    ("before", "opening", "inner", "behind", "levels"),
    [
        (":precondition ", "(not ", "(r)", "", MAX_NESTING - 1),
        # The outermost conjunction is a list of formulas.
        (":precondition ", "(and ", "(r)", "", MAX_NESTING),
        (":precondition ", "(exists (?v) ", "(r)", "", MAX_NESTING - 1),
        (":effect ", "(and ", "(r)", "", MAX_NESTING),
        (":effect ", "(when (r) ", "(r)", "", MAX_NESTING - 1),
        (":precondition (= (g) ", "(- ", "1", ")", MAX_NESTING - 1),
        (":precondition (= (g) ", "(- ", "(g)", ")", MAX_NESTING - 2),
        (":precondition (> (g) ", "(+ 1 ", "(* 1 (g))", ")", MAX_NESTING - 3),
    ],
)
def test_nesting_has_a_limit(
    before: str, opening: str, inner: str, behind: str, levels: int
) -> None:
    text = action(f"{before}{opening * levels}{inner}{')' * levels}{behind}")
    domain = read_domain(text)
    assert domain == read_domain(text)
    assert read_domain(write(domain)) == domain
    for more in (levels + 1, 5_000):
        error = refusal(action(f"{before}{opening * more}{inner}{')' * more}{behind}"))
        assert error.found == f"a formula {MAX_NESTING + 1} levels deep"
        assert error.expected.startswith(f"at most {MAX_NESTING} levels; name a part by a derived")


def test_operands_that_are_read_from_the_left_are_levels() -> None:
    assert len(read_domain(action(f":precondition (= (g) (-{' 1' * (MAX_NESTING)}))")).actions) == 1
    error = refusal(action(f":precondition (= (g) (-{' 1' * (MAX_NESTING + 1)}))"))
    assert error.found == f"a formula {MAX_NESTING + 1} levels deep"


def test_types_within_each_other_have_no_limit() -> None:
    text = f":precondition (exists (?v - {'(either ' * 5_000}a{')' * 5_000}) (r))"
    assert str(read_domain(action(text)).actions[0].condition[0]) == "(exists (?v - a) (r))"


def test_nested_terms() -> None:
    head = HEAD.replace("(loc ?x - a) - b", "(next ?x - a) - a")

    def text(levels: int) -> str:
        term = "(next " * levels + "k" + ")" * levels
        return f"{head}(:action a :parameters () :precondition (p {term})))"

    formula = read_domain(text(MAX_NESTING - 1)).actions[0].condition[0]
    assert str(formula).count("(next") == MAX_NESTING - 1
    assert "levels deep" in refusal(text(100_000)).found


def test_a_variable_hides_that_of_its_name_as_far_as_its_formula_goes() -> None:
    inner = "(exists (?v - a) (and (p ?V) (forall (?V - b) (q ?v ?V)) (p ?V)))"
    text = f":precondition (forall (?V - b) (and (q ?v ?V) {inner} (q ?v ?V)))"
    inner = "(exists (?v - a) (and (p ?v) (forall (?V - b) (q ?V ?V)) (p ?v)))"
    found = read_domain(action(text)).actions[0].condition[0]
    assert str(found) == f"(forall (?V - b) (and (q ?V ?V) {inner} (q ?V ?V)))"
    for wrong in ("(p ?v)))", "(p ?V)))"):
        error = refusal(action(text.replace("(q ?v ?V)))", wrong)))
        assert error.found == "?V of type b"


HOSTILE = """
import resource, sys, time
sys.path.insert(0, {root!r})
from kant_sql.errors import PddlError
from kant_sql.pddl import read_domain, read_problem
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
text = {text}
start = time.process_time()
try:
    {reader}(text)
except PddlError as error:
    print(str(error)[:200])
assert time.process_time() - start < 10
"""


@pytest.mark.more
@pytest.mark.parametrize(
    ("reader", "text", "found"),
    [
        ("read_domain", "'(' * 100_000_000", "found '(', expected (define"),
        ("read_domain", "'(define (domain d)' + '(' * 100_000_000", "expected 100000001 more"),
        ("read_problem", "'(define (problem d) (:init ' + '(' * 10**8", "expected 100000002 more"),
        ("read_domain", "'(define (domain d))' + ')' * 100_000_000", "')' that closes nothing"),
        ("read_domain", "'(define (domain d' + 'd' * 10**8 + '))'", "found 'ddddd"),
        ("read_domain", "'(define (domain d) ; ' + '(' * 10**8", "found the end of the text"),
        (
            "read_problem",
            "'(define (problem d) (:domain e) (:init ' + '()' * 10**7 + '))'",
            "found ')', expected a predicate",
        ),
    ],
)
def test_hostile_texts_are_refused_in_bounded_time_and_memory(
    reader: str, text: str, found: str
) -> None:
    root = os.fspath(Path(__file__).parents[2])
    program = HOSTILE.format(root=root, text=text, reader=reader)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert found in done.stdout


def test_any_prefix_and_any_token_left_out_is_read_or_refused() -> None:
    text = action(
        ":precondition (and (p ?x) (not (r)) (forall (?v - (either a b)) (q ?v ?x)) (= (g) 1.5))"
        " :effect (and (when (r) (p ?x)) (increase (g) (+ 1 (f ?x))))"
    )
    state = problem(
        "(:init (r) (= (g) 2) (at 3 (r))) (:goal (and (r) (preference n (r))))"
        "(:metric minimize (is-violated n))"
    )
    for whole in (text, state):
        words = whole.replace("(", " ( ").replace(")", " ) ").split()
        variants = [whole[:end] for end in range(0, len(whole), 3)]
        variants += [" ".join(words[:at] + words[at + 1 :]) for at in range(len(words))]
        variants += [" ".join([*words[:at], "(", *words[at:]]) for at in range(len(words))]
        variants += [" ".join([*words[:at], ")", *words[at:]]) for at in range(len(words))]
        variants += [" ".join([*words[:at], "-", *words[at:]]) for at in range(len(words))]
        with kant_sql.connect("sqlite://") as kb:
            kb.load_domain(f"{HEAD})")
            for variant in variants:
                before = kb.revision
                with suppress(errors.PddlError):
                    [document] = read(variant + " ")
                    load(kb, document)
                if kb.revision == before:
                    continue
                # What was taken is always read back.
                domain = read_domain(kb.domain_pddl())
                assert domain == kb.pddl.domain()
                assert read_problem(kb.problem_pddl(), domain=domain) == kb.pddl.problem()
            assert kb.store.verify().findings == ()


def load(kb: kant_sql.KnowledgeBase, document: Domain | Problem) -> None:
    """Load what was read, if it fits, into a store that may hold others."""
    if isinstance(document, Domain):
        kb.load_domain(write(document))
    else:
        kb.load_problem(write(document))


A_TYPE = "one type such as 'robot - vehicle'"
RESERVED = "another name for a type: the word is reserved in PDDL"
A_NAME = "another name for an object: PDDL text reads it as a number"
AN_OBJECT = "one object such as 'rb1 - robot'"
A_PREDICATE = "one predicate such as (robot_at ?r - robot ?p - place)"
A_FUNCTION = "one function such as (battery ?r - robot) - number"
END = "the end of the text"
read_move = partial(read_action, symbols=SymbolTable.of_domain(DOMAIN))


@pytest.mark.parametrize(
    ("reads", "text", "column", "found", "expected"),
    [
        (read_type, "", 1, END, A_TYPE),
        (read_type, "a - b c", 7, "'c'", A_TYPE),
        (read_type, "a b - c", 3, "'b'", A_TYPE),
        (read_type, "- b", 1, "'-'", A_TYPE),
        (read_type, "(a)", 1, "'(a'", A_TYPE),
        (read_type, "a) ", 2, "')'", A_TYPE),
        (read_type, "a -", 4, END, "a type"),
        (read_type, "a - (either b", 14, END, "')'"),
        (read_type, "either", 1, "'either'", RESERVED),
        (read_object, "rb1 rb2 - robot", 5, "'rb2'", AN_OBJECT),
        (read_object, "5 - robot", 1, "'5'", A_NAME),
        (read_object, "rb1 - 5", 7, "'5'", "a type"),
        (read_predicate, "near", 1, "'near'", "a predicate such as (near ?a ?b)"),
        (read_predicate, "(near ?a) (far ?a)", 11, "'(far'", A_PREDICATE),
        (read_predicate, "(near ?a))", 10, "')'", A_PREDICATE),
        (read_predicate, "(near a)", 7, "'a'", "a variable, which begins with '?'"),
        (read_predicate, "(near ?a", 9, END, "')'"),
        (read_function, "", 1, END, A_FUNCTION),
        (read_function, "(fuel) (load)", 8, "'(load'", A_FUNCTION),
        (read_function, "(fuel) - number (load)", 17, "'(load'", A_FUNCTION),
        (read_function, "(fuel) -", 9, END, "a type"),
        (read_move, "move", 1, "'move'", "an action such as (:action ...)"),
        (
            read_move,
            "(:actoin move)",
            2,
            "':actoin'",
            "one of :action, :durative-action, :process, :event (did you mean :action?)",
        ),
        (
            read_move,
            "(:action move :parameters () :effect (rr))",
            39,
            "the predicate 'rr'",
            "a predicate that is declared (did you mean r?)",
        ),
        (
            read_move,
            "(:action move :parameters (?x - aa))",
            33,
            "the type 'aa'",
            "a type that is declared (did you mean a?)",
        ),
        (
            read_move,
            "(:action move :parameters ()) (r)",
            31,
            "'(r'",
            "the end of the text after one action",
        ),
        (read_move, "(:action move :parameters (", 28, END, "')'"),
    ],
)
def test_elements_that_stand_alone(
    reads: Callable[[str], object], text: str, column: int, found: str, expected: str
) -> None:
    with pytest.raises(errors.PddlError) as refused:
        reads(text)
    error = refused.value
    assert (error.column, error.found, error.expected) == (column, found, expected)
