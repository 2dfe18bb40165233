"""A counter kept as facts, which shows lost writes, and reads of half a revision.

`(value c n17)` says that the counter is at 17. `(copy c n17)` says the same, and each revision
changes both, so a state in which they differ belongs to no revision.
"""

from __future__ import annotations

from collections.abc import Iterable

import kant_sql

COUNTER = kant_sql.PddlTypeDto("counter")
NUMBER = kant_sql.PddlTypeDto("number")
THE_COUNTER = kant_sql.PddlObjectDto(COUNTER, "c")
VALUE = kant_sql.PddlPredicateDto("value", [COUNTER, NUMBER])
COPY = kant_sql.PddlPredicateDto("copy", [COUNTER, NUMBER])


def facts_of(number: int) -> list[kant_sql.PddlPropositionDto]:
    """Return the facts of a counter at a number."""
    at = kant_sql.PddlObjectDto(NUMBER, f"n{number}")
    return [
        kant_sql.PddlPropositionDto(predicate, [THE_COUNTER, at]) for predicate in (VALUE, COPY)
    ]


def start(kb: kant_sql.KnowledgeBase) -> None:
    """Begin to count, in one revision."""
    kb.propositions.save_all(facts_of(0))


def number_of(facts: Iterable[kant_sql.PddlPropositionDto]) -> int:
    """Return the counter's number by the facts of one predicate."""
    (fact,) = facts
    return int(fact.objects[1].name[1:])


def read(kb: kant_sql.KnowledgeBase) -> int:
    """Read the counter by one call, and check that the call saw one whole revision."""
    facts = kb.propositions.get_all()
    value = number_of(fact for fact in facts if fact.predicate.name == "value")
    copy = number_of(fact for fact in facts if fact.predicate.name == "copy")
    assert value == copy
    return value


def read_by_calls(kb: kant_sql.KnowledgeBase) -> int:
    """Read the counter by several calls on one revision, and check that they agree."""
    then = kb.at(kb.revision)
    value = number_of(then.propositions.get_by_predicate("value"))
    assert number_of(then.propositions.get_by_predicate("copy")) == value
    assert then.objects.get(f"n{value}") is not None
    assert read(then) == value
    return value


def move(kb: kant_sql.KnowledgeBase, value: int) -> None:
    """Advance the counter by one, within a transaction."""
    for fact in facts_of(value):
        assert kb.propositions.delete(fact)
    for fact in facts_of(value + 1):
        assert kb.propositions.insert(fact)


def increment(kb: kant_sql.KnowledgeBase, times: int) -> None:
    """Count, each time in a transaction that reads, and so keeps other writers out."""
    for _ in range(times):
        with kb.transaction(reason="count"):
            move(kb, read(kb))


def increment_expecting(kb: kant_sql.KnowledgeBase, times: int) -> None:
    """Count, each time expecting the revision that was read before."""
    for _ in range(times):
        while True:
            seen = kb.at(kb.revision)
            value = number_of(seen.propositions.get_by_predicate("value"))
            try:
                with kb.transaction(reason="count", expected_revision=seen.revision):
                    move(kb, value)
            except kant_sql.StaleRevisionError:
                continue
            break


WAYS_TO_COUNT = (increment, increment_expecting)
