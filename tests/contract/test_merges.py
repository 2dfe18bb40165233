"""A merge writes what is new, however much was there, and keeps the order of what was there."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.documents import load as domain_loading
from kant_sql.knowledge.definitions import Item
from kant_sql.pddl import read_problem
from tests.support.archives import TABLES, Rows, rows_of
from tests.support.reading import last_changes, loaded
from tests.support.stores import Connect
from tests.support.worlds.depot import again, check_text

# The ids of both have as many digits.
FEW, MANY = 100, 400


def numbered(pattern: str, count: int) -> str:
    return " ".join(pattern.format(n) for n in range(count))


def domain(count: int) -> str:
    """A domain of a few declarations in which types, predicates or actions may be many."""
    return (
        "(define (domain d) (:requirements :strips) (:types t " + numbered("t{}", count) + ") "
        "(:predicates (p ?x - t) " + numbered("(p{})", 3) + ") (:functions (f ?x - t)) "
        "(:action a :parameters (?x - t) :precondition (p ?x) :effect (not (p ?x))))"
    )


def problem(objects: str, init: str = "", rest: str = "(:goal (and))", name: str = "q") -> str:
    return f"(define (problem {name}) (:domain d) (:objects {objects}) (:init {init}) {rest})"


def large(count: int) -> str:
    goals = numbered("(p o{})", count // 7)
    return problem(numbered("o{}", count) + " - t", "(p o1)", f"(:goal (and {goals} (not (p1))))")


O1 = "o1 - t"
# What is merged, and the greatest number of rows for it, beside those of the revision.
PROBLEMS: dict[str, tuple[str, int]] = {
    "a requirement": (problem(O1, rest="(:requirements :typing) (:goal (and))"), 2),
    "requirement and object": (problem("newer - t", rest="(:requirements :adl) (:goal (and))"), 5),
    "a fact": (problem(O1, "(p1)"), 2),
    "a fact of known objects": (problem("o2 o3 - t", "(p o2)"), 3),
    "other spellings": (problem(O1, "(p0)", name="Q").replace("domain d", "domain D"), 2),
    "an object": (problem("new - t", "(p new)"), 5),
    "a goal": (problem(O1, "", "(:goal (p2))"), 2),
    "each section": (
        problem(
            O1,
            "(= (f o1) 2) (not (p2)) (at 5 (p2))",
            "(:goal (not (p2))) (:constraints (always (p1))) (:metric minimize (f o1))",
        ),
        27,
    ),
}
DECLARED = """(:types new - t) (:constants c - t) (:predicates (p1) (newer) (new ?x - t))
  (:functions (new ?x - t)) (:action new :effect (p1)) (:derived (newer) (p1))
  (:constraints (always (p1)))"""
MERGES = {
    **PROBLEMS,
    "declarations": (f"(define (domain d) {DECLARED})", 35),
    "a requirement of the domain": ("(define (domain d) (:requirements :typing))", 3),
}


def merge(kb: KnowledgeBase, text: str) -> None:
    load = kb.load_problem if "(problem" in text else kb.load_domain
    assert load(text, mode="merge").revision == kb.revision


def written(before: Rows, after: Rows) -> tuple[int, int]:
    """Count the rows that a merge wrote beside those of the revision, and their characters."""
    count = characters = 0
    for table in TABLES:
        if table.name in ("revision", "head"):
            continue
        names = [column.name for column in table.columns if column.name != "kb_id"]
        for row in after[table.name] - before[table.name]:
            # A row that ends is no new one: its other columns stay.
            if "until" not in names or row[names.index("until")] is None:
                count += 1
                characters += sum(len(value) for value in row if isinstance(value, str))
    return count, characters


def merge_all(kb: KnowledgeBase, url: str, name: str, size: int) -> dict[str, tuple[int, int]]:
    """Merge one document after the other; give what each of them wrote."""
    with kb.transaction():
        loaded(kb, domain(size), large(size))
    found, before = {}, rows_of(url, name)
    for case, (text, _) in MERGES.items():
        merge(kb, text)
        after = rows_of(url, name)
        found[case], before = written(before, after), after
    assert again(kb).pddl.domain() == kb.pddl.domain()
    assert again(kb).pddl.problem() == kb.pddl.problem()
    check_text(kb)
    assert kb.store.verify().is_intact
    return found


def test_a_merge_writes_what_is_new(shared_url: str, connect: Connect) -> None:
    few, many = (
        merge_all(connect(shared_url, knowledge_base=name), shared_url, name, size)
        for name, size in (("robot few", FEW), ("robot many", MANY))
    )
    assert few == many
    for case, (rows, characters) in many.items():
        assert 0 < rows <= MERGES[case][1], (case, rows)
        assert characters < 1_000, case


@pytest.mark.parametrize("text", [text for text, _ in PROBLEMS.values()], ids=PROBLEMS)
def test_only_what_no_element_shows_changes_the_document(
    fresh_kb: KnowledgeBase, text: str
) -> None:
    loaded(fresh_kb, domain(3), large(21))
    merge(fresh_kb, text)
    documents = [line for line in last_changes(fresh_kb) if line.split()[1] == "document"]
    if ":requirements" not in text:
        assert documents == []
        return
    # What has the order of its elements is listed no more.
    (name,) = again(fresh_kb).pddl.problem().requirements
    old, new = sorted(documents, reverse=True)
    assert old.startswith("- document (define (problem q) (:domain d) (:goal ")
    assert new == f"+ document (define (problem q) (:domain d) (:requirement {name}))"


def test_a_merge_keeps_an_order_that_is_not_that_of_the_elements(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(domain(3))
    first = problem("a b c - t", "(p a)", "(:goal (and (p a) (p b) (not (p1))))")
    turned = problem("c a b - t", "(p a)", "(:goal (and (not (p1)) (p b) (p a)))")
    fresh_kb.load_problem(first)
    fresh_kb.load_problem(turned)
    before = fresh_kb.problem_pddl()
    rest = "(:requirements :adl) (:goal (and (p d)))"
    merge(fresh_kb, problem("d - t", "(p d)", rest))
    for kb in (fresh_kb, again(fresh_kb)):
        assert [part.name for part in kb.pddl.problem().objects] == ["c", "a", "b", "d"]
        goals = [str(goal) for goal in kb.pddl.problem().goal]
        assert goals == ["(not (p1))", "(p b)", "(p a)", "(p d)"]
        assert kb.pddl.problem().requirements == (":adl",)
        assert kb.at(3).problem_pddl() == before
        check_text(kb)
    assert fresh_kb.store.verify().is_intact


def test_a_merge_keeps_what_is_said_twice(fresh_kb: KnowledgeBase) -> None:
    loaded(fresh_kb, domain(3), problem(O1, "", "(:goal (and (p o1) (p1)))"))
    twice = "(:goal (and (preference x (p2)) (preference x (p2))))"
    merge(fresh_kb, problem(O1, "", twice))
    goals = [str(goal) for goal in again(fresh_kb).pddl.problem().goal]
    assert goals == ["(p o1)", "(p1)", *["(preference x (p2))"] * 2]
    assert fresh_kb.load_problem(problem(O1, "", twice), mode="merge").revision is None
    check_text(fresh_kb)


def test_a_type_above_all_that_an_older_version_listed_stays_listed(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def old_items(*given: Any) -> Iterator[Item]:
        yield from items(*given)
        yield Item("type", "object")

    items = domain_loading._items
    with monkeypatch.context() as patch:
        patch.setattr(domain_loading, "_items", old_items)
        fresh_kb.load_domain("(define (domain d) (:types b a) (:predicates (p ?x)))")
    assert [type_.name for type_ in fresh_kb.pddl.domain().types] == ["b", "a", "object"]
    merge(fresh_kb, "(define (domain d) (:requirements :adl) (:types c))")
    for kb in (fresh_kb, again(fresh_kb)):
        assert [type_.name for type_ in kb.pddl.domain().types] == ["b", "a", "object", "c"]
    merge(fresh_kb, "(define (domain d) (:requirements :strips))")
    assert fresh_kb.pddl.domain().requirements == (":adl", ":strips")


def test_merges_are_restored_and_replaced(fresh_kb: KnowledgeBase) -> None:
    loaded(fresh_kb, domain(3), large(21))
    texts = [fresh_kb.problem_pddl()]
    fresh_kb.objects.save(PddlObjectDto(PddlTypeDto("t"), "by_hand"))
    for text in (problem("new by_hand - t", "(p new)"), PROBLEMS["requirement and object"][0]):
        merge(fresh_kb, text)
        texts.append(fresh_kb.problem_pddl())
    names = [part.name for part in fresh_kb.pddl.problem().objects]
    assert names[-3:] == ["by_hand", "new", "newer"]
    fresh_kb.load_problem(problem(O1))
    for revision, text in ((2, texts[0]), (4, texts[1]), (5, texts[2])):
        fresh_kb.restore(revision)
        assert again(fresh_kb).problem_pddl() == fresh_kb.at(revision).problem_pddl() == text
    whole = fresh_kb.pddl.problem()
    # The same text, loaded in place of what was merged, holds the same.
    fresh_kb.load_problem(fresh_kb.problem_pddl())
    assert fresh_kb.pddl.problem() == whole == read_problem(texts[2], domain=fresh_kb.pddl.domain())
    assert fresh_kb.load_problem(texts[2]).revision is None
    assert fresh_kb.store.verify().is_intact


@pytest.mark.parametrize(
    "change",
    [
        "DELETE FROM document_item WHERE section = 'requirement'",
        "UPDATE document_item SET name = ':strips' WHERE section = 'requirement'",
        "UPDATE document_item SET position = 1 WHERE section = 'requirement'",
        "UPDATE document_version SET until = NULL WHERE until IS NOT NULL",
    ],
)
def test_verify_finds_a_changed_row_of_a_merge(
    connect: Connect, tmp_path: Path, change: str
) -> None:
    file = tmp_path / "store.db"
    kb = connect(f"sqlite:///{file}")
    kb.load_domain("(define (domain d) (:types t) (:predicates (p ?x - t)))")
    kb.load_problem(problem("a b - t"))
    merge(kb, problem("c - t", rest="(:requirements :adl) (:goal (and))"))
    assert kb.store.verify().is_intact
    with closing(sqlite3.connect(file)) as raw:
        # Whoever changes rows by hand can do away with what keeps them from it.
        raw.execute("DROP INDEX uq_document_version_live")
        raw.execute(f"{change} AND since < 4" if "until" in change else f"{change} AND since = 3")
        raw.commit()
    tables = {finding.table for finding in kb.store.verify().findings}
    assert any(table.startswith("document_") for table in tables if table)
