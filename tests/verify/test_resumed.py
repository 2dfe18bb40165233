"""Verifications that continue an earlier one: what they find, what they keep, what they refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

import pytest

import kant_sql
from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    PddlTypeDto,
    StoreError,
    StoreUnreachableError,
    limited,
)
from kant_sql.errors import (
    ConnectionLostError,
    StatementTimeoutError,
    StoreFullError,
    TransactionOpenError,
)
from kant_sql.history.verify import verify as verifying
from kant_sql.history.verify.sides import in_order
from kant_sql.history.verify.verify import Kept, keep
from kant_sql.knowledge.canonical import time_text
from kant_sql.operations import knowledge_bases
from kant_sql.sql.dialects.base import Session
from tests.support.faults import be_impatient, change, held, on_file
from tests.support.profile import PROFILE
from tests.support.stores import Connect
from tests.support.worlds.missions import TOUR, begin
from tests.support.worlds.robots import RB1, WP2, navigation, robot_at, waypoint
from tests.verify.bare import Bare
from tests.verify.mutations import Mutation, mutations

# A revision of the story that much comes after.
MIDDLE = 9


def test_it_continues_where_the_last_one_ended(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(place=WP2))
    first = kb.store.verify(keep=True)
    assert (first.continued_from, first.continued_at, first.is_kept) == (None, None, True)
    for number in range(3):
        kb.objects.save(waypoint(number + 10))
    second = kb.store.verify(resume=True, keep=True)
    assert (second.continued_from, second.revisions, second.changes) == (2, 3, 3)
    assert second.is_intact
    assert second.complete_at == second.continued_at is not None
    third = kb.store.verify(resume=True)
    assert (third.continued_from, third.revisions, third.changes, third.is_kept) == (5, 0, 0, None)
    assert third.continued_at is not None
    assert second.continued_at is not None
    assert third.continued_at > second.continued_at == third.complete_at
    # Only who asks for it continues.
    assert (kb.store.verify().revisions, kb.store.verify().continued_from) == (5, None)


def test_what_is_kept_is_in_the_inventory(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    before = datetime.now(UTC)
    kb.store.verify(keep=True)
    [one] = knowledge_bases(shared_url)
    assert one.verified_revision == 1
    assert one.verified_at is not None
    assert one.verified_at == one.complete_at
    assert abs((one.verified_at - before).total_seconds()) < 60
    kb.objects.save(waypoint(3))
    kb.store.verify(resume=True, keep=True)
    [two] = knowledge_bases(shared_url)
    assert (two.verified_revision, two.complete_at) == (2, one.complete_at)
    assert two.verified_at is not None
    assert two.verified_at > one.verified_at


def test_an_empty_knowledge_base_has_nothing_to_keep(kb: KnowledgeBase) -> None:
    for _ in range(2):
        done = kb.store.verify(resume=True, keep=True)
        assert (done.is_intact, done.continued_from, done.is_kept) == (True, None, None)
    kb.types.save(PddlTypeDto("robot"))
    assert kb.store.verify(resume=True, keep=True).revisions == 1


def test_flags_are_flags(kb: KnowledgeBase) -> None:
    for name in ("resume", "keep"):
        wrong: Any = {name: 1}
        with pytest.raises(InvalidArgumentError, match=name):
            kb.store.verify(**wrong)


def rows_read(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> int:
    """Count the rows that a continued verification reads from tables."""
    found = 0
    stream, rows = Session.rows, type(_session(kb)).stream

    def count_rows(self: Session, *given: Any, **more: Any) -> Any:
        nonlocal found
        made = stream(self, *given, **more)
        found += len(made)
        return made

    def count_stream(self: Session, *given: Any, **more: Any) -> Iterator[Any]:
        nonlocal found
        for row in rows(self, *given, **more):
            found += 1
            yield row

    with monkeypatch.context() as patch:
        patch.setattr(Session, "rows", count_rows)
        patch.setattr(type(_session(kb)), "stream", count_stream)
        assert kb.store.verify(resume=True, structure=False).is_intact
    return found


def _session(kb: KnowledgeBase) -> Session:
    with kb.store.factory._store.backend.open_session() as session:  # type: ignore[attr-defined]
        found: Session = session
    return found


def test_what_it_reads_does_not_grow_with_the_history(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = []
    for size in (10, 300):
        for number in range(size):
            kb.propositions.save(robot_at(place=waypoint(1 + number % 2)))
            kb.propositions.delete(robot_at(place=waypoint(1 + number % 2)))
        kb.store.verify(keep=True)
        kb.propositions.save(robot_at(place=WP2))
        counts.append(rows_read(kb, monkeypatch))
        kb.propositions.delete(robot_at(place=WP2))
    assert counts[0] == counts[1] > 0


@pytest.mark.more
def test_statements_are_built_once(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.store.verify(keep=True)
    for _ in range(2):
        kb.store.verify(resume=True)
        built = in_order.cache_info().currsize
    assert in_order.cache_info().currsize == built
    before = in_order.cache_info().misses
    kb.store.verify(resume=True)
    assert in_order.cache_info().misses == before


# What is found, and what is not.


def rewrite(url: str, sql: str) -> None:
    change(url, f"UPDATE {sql}")


NEW = "proposition_version SET fork = 5 WHERE since = 3"
OLD = "proposition_version SET fork = 5 WHERE since = 1"


@pytest.fixture
def written(shared_url: str, connect: Connect) -> tuple[str, KnowledgeBase]:
    """A knowledge base that was verified up to revision 2, and has three."""
    kb = connect(shared_url, knowledge_base="tiago")
    for place in (1, 2):
        kb.propositions.save(robot_at(place=waypoint(place)))
    assert kb.store.verify(keep=True).is_kept
    kb.propositions.save(robot_at(place=waypoint(3)))
    return shared_url, kb


Written = tuple[str, KnowledgeBase]


def test_a_row_of_a_later_revision_is_found_and_nothing_is_kept(written: Written) -> None:
    url, kb = written
    rewrite(url, NEW)
    done = kb.store.verify(resume=True, keep=True)
    assert (done.is_intact, done.is_kept, done.continued_from) == (False, False, 2)
    assert done.findings[0].revision == 3
    # What was kept before is forgotten: the next one begins at revision 1.
    assert knowledge_bases(url)[0].verified_revision is None
    again = kb.store.verify(resume=True, keep=True)
    assert (again.is_intact, again.continued_from) == (False, None)


@pytest.mark.more
def test_a_row_of_an_earlier_revision_is_found_by_a_complete_one_alone(written: Written) -> None:
    url, kb = written
    rewrite(url, OLD)
    assert kb.store.verify(resume=True).is_intact
    assert not kb.store.verify(keep=True).is_intact
    # It is not forgotten again: nobody continues after it.
    assert not kb.store.verify(resume=True, keep=True).is_intact


def test_the_revision_that_was_kept_must_be_there_as_it_was(written: Written) -> None:
    url, kb = written
    rewrite(url, f"revision SET hash = '{'0' * 64}' WHERE number = 2")
    done = kb.store.verify(resume=True)
    assert done.continued_from is None
    assert any("has another hash than the verification of 2" in f.message for f in done.findings)


@pytest.mark.more
def test_a_history_that_was_cut_off_is_found(written: Written) -> None:
    url, kb = written
    second = kb.store.revisions()[1]
    kb.store.verify(resume=True, keep=True)
    change(
        url,
        "DELETE FROM proposition_version WHERE since = 3",
        "DELETE FROM object_version WHERE since = 3",
        "DELETE FROM revision WHERE number = 3",
        f"UPDATE head SET definition_revision = 2, revision = 2, hash = '{second.hash}',"
        f" committed_at = '{time_text(second.committed_at)}'",
    )
    assert kb.store.verify().is_intact
    done = kb.store.verify(resume=True)
    assert done.continued_from is None
    [finding] = done.findings
    assert finding.revision == 3
    assert "cut off: it ends at revision 2, and the verification of 2" in finding.message


def test_the_revision_before_the_kept_one_is_chained_to_it(written: Written) -> None:
    url, kb = written
    rewrite(url, f"revision SET hash = '{'0' * 64}' WHERE number = 1")
    assert kb.store.verify(resume=True).findings[0].revision == 2


def test_an_anchor_is_compared_before_and_after(written: Written) -> None:
    _, kb = written
    anchor = kb.store.anchor()
    kb.objects.save(waypoint(9))
    assert kb.store.verify(anchor, resume=True, keep=True).anchored == 3
    # Now the anchor is of an earlier revision than what was kept.
    assert kb.store.verify(anchor, resume=True).is_intact
    false = anchor._replace(heads=(anchor.heads[0]._replace(revision=2, hash="0" * 64),))
    for given in (kb.store.verify(false, resume=True), kb.store.verify(false)):
        assert "revision 2 has another hash than the anchor" in given.findings[0].message


def test_an_archive_begins_again_at_revision_1(kb: KnowledgeBase, file_url: str) -> None:
    for place in (1, 2):
        kb.propositions.save(robot_at(place=waypoint(place)))
        kb.propositions.delete(robot_at(place=waypoint(place)))
    kb.store.verify(keep=True)
    kb.store.archive(3, to=file_url)
    done = kb.store.verify(resume=True, keep=True)
    assert (done.is_intact, done.continued_from, done.revisions) == (True, None, 5)
    kb.objects.save(waypoint(9))
    done = kb.store.verify(resume=True, keep=True)
    assert (done.is_intact, done.continued_from, done.revisions) == (True, 5, 1)


@on_file
@pytest.mark.parametrize(
    "column", ["revision = 'x'", "revision = -1", "verified_at = 'x'", "hash = 7", "hash = x'00'"]
)
@pytest.mark.more
def test_what_cannot_have_been_kept_is_passed_over(written: Written, column: str) -> None:
    url, kb = written
    change(url, f"UPDATE verification SET {column}")
    done = kb.store.verify(resume=True)
    assert done.continued_from is None
    kb.store.verify(keep=True)


def test_later_plans_and_steps_are_checked(kb: KnowledgeBase) -> None:
    begin(kb)
    plan = kb.plans.record(TOUR)
    kb.store.verify(keep=True)
    kb.plans.set_status(plan.steps[0], status="running")
    done = kb.store.verify(resume=True, keep=True)
    assert (done.is_intact, done.revisions) == (True, 1)
    kb.plans.record(TOUR)
    assert kb.store.verify(resume=True).is_intact


def test_definitions_that_go_and_come_back_are_no_overlap(kb: KnowledgeBase) -> None:
    kb.actions.save(navigation())
    kb.actions.delete(navigation())
    kb.store.verify(keep=True)
    kb.actions.save(navigation())
    assert kb.store.verify(resume=True, keep=True).is_intact
    kb.actions.delete(navigation())
    kb.objects.save(RB1)
    kb.objects.delete(RB1)
    kb.objects.save(RB1)
    assert kb.store.verify(resume=True, keep=True).is_intact


# All mutations of the story.


def kept_at(bare: Bare, number: int) -> Kept:
    [(digest,)] = bare.run("SELECT hash FROM revision WHERE number = ?", number)
    return Kept(number, digest, datetime.now(UTC), None)


def test_the_story_is_intact_from_each_revision_on(full: Bare) -> None:
    with full.tampering():
        [(last,)] = full.run("SELECT max(number) FROM revision")
        [(archived,)] = full.run("SELECT max(revision) FROM archive")
        assert last > 20
        for number in range(archived + 1, last + 1):
            assert full.findings(kept=kept_at(full, number)) == []


def is_later(mutation: Mutation) -> bool:
    """Whether a row is of a version that began or ended after the middle, or changes one of it."""
    since = mutation.changes.get("since")
    if isinstance(since, int) and max(since, mutation.row["since"]) <= MIDDLE:
        # Of earlier revisions, whenever the version ended.
        return False
    numbers = [mutation.row.get(name) for name in ("since", "until", "number")]
    return any(isinstance(number, int) and number > MIDDLE for number in numbers)


@pytest.mark.more
def test_each_mutation_of_what_came_later_is_found(full: Bare) -> None:
    with full.tampering():
        kept = kept_at(full, MIDDLE)
        chosen = [each for each in mutations(full) if is_later(each)]
    assert len(chosen) > 150
    if full.session.placeholder != "?":
        chosen = chosen[:: PROFILE.rows_step]

    def is_missed(mutation: Mutation, *given: Kept) -> bool:
        with full.tampering():
            mutation.apply(full)
            return full.is_intact(*given)

    missed = [each for each in chosen if is_missed(each, kept) and not is_missed(each)]
    assert missed == []


# Who may not write, and two at once.


def test_who_may_only_read_verifies_and_keeps_nothing(shared_url: str, connect: Connect) -> None:
    connect(shared_url, knowledge_base="tiago").propositions.save(robot_at())
    with kant_sql.connect(shared_url, knowledge_base="tiago", read_only=True) as kb:
        done = kb.store.verify(resume=True, keep=True)
        assert (done.is_intact, done.is_kept) == (True, False)
        assert "read_only" in str(done.keep_error)
    rewrite(shared_url, "proposition_version SET fork = 5")
    with kant_sql.connect(shared_url, knowledge_base="tiago", read_only=True) as kb:
        done = kb.store.verify(resume=True, keep=True)
        assert (done.is_intact, done.is_kept) == (False, False)
        assert "read_only" in str(done.keep_error)


@on_file
def test_an_intact_one_is_told_though_another_writer_holds_the_store(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    be_impatient(monkeypatch)
    connect(shared_url, knowledge_base="tiago").propositions.save(robot_at())
    kb = connect(f"{shared_url}?timeout=0.1", knowledge_base="tiago")
    with held(shared_url):
        done = kb.store.verify(keep=True)
    assert (done.is_intact, done.revisions, done.is_kept) == (True, 1, False)
    assert "another process held the store" in str(done.keep_error)
    again = kb.store.verify(keep=True)
    assert (again.is_kept, again.keep_error) == (True, None)


NOT_KEPT = [
    *(StatementTimeoutError, ConnectionLostError, StoreFullError, StoreUnreachableError),
    TransactionOpenError,
]


@pytest.mark.parametrize("error", NOT_KEPT)
def test_what_prevents_keeping_takes_no_verdict_away(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, error: type[StoreError]
) -> None:
    kb.propositions.save(robot_at())

    def fail(*given: Any) -> None:
        raise error("a fault")

    monkeypatch.setattr(verifying, "keep", fail)
    monkeypatch.setattr(verifying, "forget", fail)
    done = kb.store.verify(keep=True)
    assert (done.is_intact, done.is_kept, done.keep_error) == (True, False, "a fault")


def test_no_limit_of_questions_concerns_what_is_kept(written: Written) -> None:
    url, kb = written
    store = kb.store.factory._store  # type: ignore[attr-defined]
    with limited() as limit:
        limit.cancel()
        keep(store, 1, 3, "0" * 64, None)
    assert knowledge_bases(url)[0].verified_revision == 3


@pytest.mark.more
def test_two_at_once_keep_the_later_end(written: Written, connect: Connect) -> None:
    url, kb = written
    before = kb.store.verify(resume=True)
    assert before.continued_from == 2
    others = [connect(url, knowledge_base="tiago") for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        done = list(pool.map(lambda one: one.store.verify(resume=True, keep=True), others))
    assert all(each.is_intact and each.is_kept for each in done)
    assert knowledge_bases(url)[0].verified_revision == 3
    change(url, "UPDATE verification SET revision = 3")
    # One that has seen less puts nothing back.
    store = kb.store.factory._store  # type: ignore[attr-defined]
    keep(store, 1, 2, "0" * 64, None)
    assert knowledge_bases(url)[0].verified_revision == 3


def test_a_writer_is_not_refused_meanwhile(written: Written) -> None:
    _, kb = written

    def work(done: int, whole: int) -> None:
        kb.objects.save(waypoint(50 + done))

    done: Callable[..., Any] = kb.store.verify
    verified = done(progress=work, keep=True, structure=False)
    assert verified.is_intact
    assert kb.store.verify(resume=True).continued_from == verified.revisions


@pytest.mark.parametrize("is_kept_before", [False, True])
@pytest.mark.parametrize("is_complete", [False, True])
def test_an_older_one_that_ends_later_does_not_hide_a_fault(
    shared_url: str, connect: Connect, is_kept_before: bool, is_complete: bool
) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    kb.propositions.save(robot_at())
    if is_kept_before:
        kb.store.verify(keep=True)
    kb.propositions.save(robot_at(place=WP2))
    found: list[Any] = []

    def find(done: int, whole: int) -> None:
        if not found:
            rewrite(shared_url, "proposition_version SET fork = fork + 1 WHERE since = 1")
            found.append(other.store.verify(keep=True))

    old = kb.store.verify(progress=find, resume=not is_complete, keep=True)
    assert not found[0].is_intact
    assert (old.is_intact, old.is_kept) == (True, False)
    assert "found a fault meanwhile" in str(old.keep_error)
    [listed] = knowledge_bases(shared_url)
    assert (listed.verified_revision, listed.verified_at, listed.complete_at) == (None, None, None)
    assert not kb.store.verify(resume=True, keep=True).is_intact
    # Once it is repaired, a complete one is kept again.
    rewrite(shared_url, "proposition_version SET fork = fork - 1 WHERE since = 1")
    repaired = kb.store.verify(resume=True, keep=True)
    assert (repaired.is_intact, repaired.is_kept, repaired.continued_from) == (True, True, None)
    assert kb.store.verify(resume=True).continued_from == 2
