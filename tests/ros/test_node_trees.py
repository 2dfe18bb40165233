"""The trees of PlanSys2's messages say what the formulas say, in both directions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import reduce
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import Domain
from kant_sql.pddl.formulas import EFFECT
from kant_sql.pddl.given import ConditionReader
from kant_sql.pddl.symbols import SymbolTable
from kant_sql.ros.node_trees import Messages, Scope, read_node, read_tree, write_tree
from tests.ros import messages
from tests.ros.messages import Node, Param
from tests.support.generators.documents import domains
from tests.support.profile import PROFILE, hunting

MADE = Messages(messages, {"robot_at": [("robot",), ("wp",)]}, {"wp": ["dock"]})
ANY_DOMAIN = SymbolTable(unknown_domain=True)


def parsed(text: str) -> Any:
    """Split PDDL text into nested lists of words."""
    stack: list[list[Any]] = [[]]
    for token in re.findall(r"[()]|[^\s()]+", text):
        if token == "(":
            stack.append([])
        elif token == ")":
            last = stack.pop()
            stack[-1].append(last)
        else:
            stack[-1].append(token)
    [[formula]] = stack
    return formula


def numbered(words: list[str], scope: Scope) -> tuple[list[str], Scope]:
    """Give variables their numbers, and each its own type."""
    runs = re.findall(r"((?:\?\S+ ?)+)(?:- (\S+))?", " ".join(words))
    types = [(word, type_name or "object") for run, type_name in runs for word in run.split()]
    numbers = [f"?{len(scope) + at}" for at in range(len(types))]
    typed = [part for at, (_, name) in zip(numbers, types, strict=True) for part in (at, "-", name)]
    return typed, (
        *scope,
        *((fold(word), at) for (word, _), at in zip(types, numbers, strict=True)),
    )


def normal(part: Any, scope: Scope) -> Any:
    """Say a formula by what a tree can hold, with its variables as a tree names them."""
    if isinstance(part, str):
        is_number = re.fullmatch(r"-?[0-9.]+", part)
        return str(f.Number(float(part))) if is_number else dict(scope).get(fold(part), part)
    head, *rest = part
    if head == "imply":
        return normal(["or", ["not", rest[0]], rest[1]], scope)
    if head == "forall":
        return normal(["not", ["exists", rest[0], ["not", rest[1]]]], scope)
    if head == "exists":
        typed, scope = numbered(rest[0], scope)
        return [head, typed, normal(rest[1], scope)]
    if head in f.ARITHMETIC and len(rest) != 2:
        first, *others = [normal(each, scope) for each in (rest if rest[1:] else ["0", *rest])]
        return reduce(lambda left, right: [head, left, right], others, first)
    return [head, *(normal(each, scope) for each in rest)]


def formulas_of(domain: Domain) -> Iterator[tuple[f.Formula, tuple[f.TypedName, ...], bool]]:
    """Yield formulas without times, their parameters, and whether they are effects."""
    yield from ((each.formula, each.variables, False) for each in domain.derived)
    for action in domain.actions:
        for each in (*action.condition, *action.effect):
            formula = each.formula if isinstance(each, f.Timed) else each
            yield formula, action.parameters, each in action.effect


def is_held(part: f.Node, is_effect: bool) -> bool:
    """Whether PlanSys2's messages have a form for a formula, as their interface file says."""
    if isinstance(part, f.Forall | f.Exists):
        return not is_effect and all(len(each.types) == 1 for each in part.variables)
    if isinstance(part, f.Atom | f.Fluent):
        return not any(isinstance(each, f.Fluent) for each in part.terms)
    refused = (f.Preference, f.Modal, f.When, f.Timed, f.ContinuousTime)
    return not isinstance(part, refused) and part != f.Variable("duration")


def read(text: str, symbols: SymbolTable = ANY_DOMAIN, *given: str, context: int = 0) -> f.Formula:
    return ConditionReader(symbols, text, "the tree", *given).whole(context)


@hunting(PROFILE.texts)
@given(domains())
def test_what_a_tree_can_hold_is_read_as_it_was_written(domain: Domain) -> None:
    symbols = SymbolTable.of_domain(domain)
    for formula, parameters, is_effect in formulas_of(domain):
        scope = tuple((fold(each.name), f"?{at}") for at, each in enumerate(parameters))
        if not all(is_held(part, is_effect) for part in f.walk(formula)):
            with pytest.raises(InvalidKnowledgeError, match="no form in PlanSys2"):
                write_tree(formula, MADE, scope, is_effect=is_effect)
            continue
        nodes = write_tree(formula, MADE, scope, is_effect=is_effect)
        words = parsed(read_tree(nodes))
        assert words == normal(parsed(str(formula)), tuple((f"?{key}", at) for key, at in scope))
        assert [node.node_id for node in nodes] == list(range(len(nodes)))
        declared = " ".join(f"?{at} - {each.type_text}" for at, each in enumerate(parameters))
        found = read(read_tree(nodes), symbols, declared, context=EFFECT * is_effect)
        assert normal(parsed(str(found)), tuple((at, at) for _, at in scope)) == words


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("(imply (a) (b))", "(or (not (a)) (b))"),
        ("(forall (?x - wp) (p ?x))", "(not (exists (?0 - wp) (not (p ?0))))"),
        # The inner variable hides the outer one, and counts on.
        (
            "(exists (?x) (exists (?X) (exists (?y) (p ?x ?y))))",
            "(exists (?0 - object) (exists (?1 - object) (exists (?2 - object) (p ?1 ?2))))",
        ),
        ("(< (+ 1 2.50 (f)) (- (f)))", "(< (+ (+ 1.0 2.5) (f)) (- 0.0 (f)))"),
    ],
)
def test_a_tree_is_written_by_what_a_formula_means(text: str, tree: str) -> None:
    assert read_tree(write_tree(read(text), MADE)) == tree


def test_parameters_have_the_types_that_are_declared() -> None:
    formula = read("(exists (?p - wp) (and (robot_at ?r ?p) (= ?r ?p)))")
    exists, _, at, _, equal, _ = write_tree(formula, MADE, (("r", "rb1"),))
    assert exists.parameters == [Param("?1", "wp", ["dock"])]
    assert at.parameters == [Param("rb1", "robot"), Param("?1", "wp")]
    assert (equal.name, equal.parameters) == ("rb1", [Param("rb1")])
    assert MADE.make_param("?0", ("wp", "robot"), True).sub_types == ["wp", "robot", "dock"]


def test_what_plansys2_makes_of_texts_is_read() -> None:
    typed = Node(12, children=[1], parameters=[Param("?x"), Param("-"), Param("robot")])
    nodes = [typed, Node(3, 13, children=[2]), Node(5, name="idle", parameters=[Param("?x")])]
    assert read_tree(nodes) == "(exists (?x - robot) (not (idle ?x)))"
    assert read_tree([]) == "(and)"
    # PlanSys2's details of a predicate leave the type of the node out.
    assert read_node(Node(name="idle", parameters=[Param("rb1")])) == "(idle rb1)"
    assert read_node(Node(5, name="idle)")) == "(idle)"


LEAF = Node(5, name="p")


@pytest.mark.parametrize(
    ("nodes", "problem"),
    [
        ([Node(5, name="a) (b")], "node 0 of the tree: 'a\\) \\(b' cannot name"),
        ([Node(5, name="and")], "node 0 .* reserved"),
        ([Node(1, children=[1]), Node(5, name="p", parameters=[Param("")])], "node 1 .* empty"),
        ([Node(5, name="p", parameters=[Param("?a b")])], "node 0 of the tree: 'a b'"),
        ([Node(12, children=[1], parameters=[Param("?x", "a)")]), LEAF], "node 0 of the tree: 'a"),
        ([Node(9, value=float("nan"))], "node 0 of the tree: .*finite"),
        ([Node(1, children=[1, 1]), LEAF], "node 1 .* two parents"),
        ([Node(3, children=[1]), Node(3, children=[0])], "node 0 .* two parents"),
        ([Node(3, children=[1]), LEAF, LEAF], "node 2 .* no parent"),
        ([Node(1, children=[1]), Node(5, name="p", children=[2]), LEAF], "node 1 .* 1 children"),
        ([Node(7, 22, children=[1, 2]), LEAF, LEAF], r"node 0 .* operators \(22, 0\)"),
        ([Node(4, name="move")], "node 0 .* type 4"),
    ],
)
def test_what_is_no_tree_is_refused(nodes: list[Node], problem: str) -> None:
    with pytest.raises(InvalidKnowledgeError, match=problem):
        read_tree(nodes)


GOOD, BAD = ("p", "?x", "f", "home"), ("", "?", "-", "and", "=", "a) (b", "5", "?y z", "(", ";x")
WORDS = st.sampled_from(GOOD * 8 + BAD)
PARAMS = st.lists(st.builds(Param, WORDS, st.sampled_from(["", "t", "a)"])), max_size=2)
INNER = (1, 2, 3, 7, 8, 12)
NODES = st.builds(
    Node,
    st.sampled_from((*INNER, *range(14))),
    st.integers(12, 22),
    st.integers(21, 27),
    children=st.integers(-20, 7).map(lambda child: [child] if child > -2 else []),
    name=WORDS,
    parameters=PARAMS,
    value=st.floats(),
)


@hunting(PROFILE.names)
@given(st.lists(st.tuples(NODES, st.integers(0, 9)), max_size=7))
def test_any_nodes_are_read_or_refused(drawn: list[tuple[Node, int]]) -> None:
    nodes = [node for node, _ in drawn]
    for at, (_, choice) in enumerate(drawn):
        if parents := [node for node in nodes[:at] if node.node_type in INNER]:
            parents[choice % len(parents)].children.append(at)
    try:
        words = parsed(read_tree(nodes))
        written = write_tree(read(read_tree(nodes)), MADE)
    except InvalidKnowledgeError:
        return
    assert normal(parsed(read_tree(written)), ()) == normal(words, ())


def test_a_sum_of_any_length_is_written() -> None:
    numbers = tuple(f.Number(number) for number in range(3_000))
    nodes = write_tree(f.Comparison("<", f.Arithmetic("+", numbers), f.Number(1)), MADE)
    assert len(nodes) == 2 + 2 * 3_000 - 1
    with pytest.raises(InvalidKnowledgeError, match="levels"):
        read(read_tree(nodes))
    for part in (f.Number(10**399), f.Variable("duration")):
        with pytest.raises(InvalidKnowledgeError, match="no form"):
            write_tree(f.Comparison("<", f.Number(1), part), MADE)
