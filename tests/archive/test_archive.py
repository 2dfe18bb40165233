"""An archive is what the knowledge base was, and the store keeps what is later."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.errors import ArchivedError, ConflictError, PddlError
from kant_sql.history.archive import archive as archiving
from kant_sql.sql.catalog import written_names
from tests.support.archives import (
    IDENTITIES,
    count,
    intact,
    rows_of,
    states,
    target_url,
    versions_after,
    versions_of,
    versions_upto,
)
from tests.support.profile import PROFILE
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1, WP1, WP2, robot_at
from tests.support.worlds.story import write_whole_story

# Which of the states are read: those that the three archives are cut at among them.
EACH = 1 if PROFILE.is_whole else 3


def test_the_archive_is_what_the_store_was_and_the_store_keeps_the_rest(
    shared_url: str, any_archive_url: str, connect: Connect
) -> None:
    write_whole_story(shared_url)
    kb = connect(shared_url, knowledge_base="tiago")
    head, before = kb.revision, rows_of(shared_url)
    then = states(kb, range(head + 1))
    for upto in (6, head // 2, head - 2):
        done = kb.store.archive(upto + 1, to=any_archive_url)
        assert (done.upto, done.revision) == (upto, kb.revision)
        there, here = rows_of(any_archive_url), rows_of(shared_url)
        assert versions_of(there) == versions_upto(before, upto)
        assert versions_of(here) == versions_after(before, upto)
        for table in IDENTITIES:
            assert there[table] <= before[table]
        with kant_sql.connect(any_archive_url, knowledge_base="tiago") as archive:
            assert archive.revision == upto
            moved = range(upto, -1, -EACH)
            assert states(archive, moved) == {r: then[r] for r in moved}
            assert archive.store.revisions() == kb.store.revisions(limit=upto)
        kept = range(upto, head + 1, EACH)
        assert states(kb, kept) == {r: then[r] for r in kept}
        for url in (shared_url, any_archive_url):
            intact(url)


def test_all_rows_of_the_archive_are_those_of_the_store(
    file_url: str, archive_url: str, connect: Connect
) -> None:
    write_whole_story(file_url)
    kb = connect(file_url, knowledge_base="tiago")
    before, head = rows_of(file_url), kb.revision
    kb.objects.save(PddlObjectDto(PddlTypeDto("truck"), "later"))
    kb.store.archive(head + 1, to=archive_url)
    there = rows_of(archive_url)
    del there["head"], before["head"]
    assert there == before


@pytest.mark.every_backend
def test_a_tiny_number_is_the_same_on_another_database(
    shared_url: str, any_archive_url: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.objects.save(RB1)
    kb.functions.save("(battery ?r - robot)")
    kb.function_values.set("(battery rb1)", value=Decimal("-1e-400"))
    kb.function_values.set("(battery rb1)", value=1)
    kb.types.save("truck")
    moved = {"function_value_version": 1}
    assert kb.store.archive(kb.revision, to=any_archive_url).versions == moved


@pytest.mark.every_backend
def test_acts_stay_as_they_are(shared_url: str, any_archive_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    at = datetime(2026, 1, 31, 9, 30, tzinfo=UTC)
    made = kb.executions.report("dock", outcome="running", started_at=at)
    kb.executions.report(made, outcome="failed", code="E4", ended_at=at)
    kb.objects.save(RB1)
    kb.objects.delete(RB1)
    before = [*kb.executions.get_all()]
    assert kb.store.archive(4, to=any_archive_url).upto == 3
    kb.objects.save(RB1)
    assert set(kb.store.archive(5, to=any_archive_url).versions) == {"object_version"}
    assert [*kb.executions.get_all()] == before
    assert kb.store.verify().is_intact
    with connect(any_archive_url, knowledge_base="tiago") as archive:
        assert [*archive.executions.get_all()] == before
        assert archive.store.verify().is_intact


def test_what_was_believed_before_a_correction_may_be_archived(
    file_url: str, archive_url: str, connect: Connect
) -> None:
    kb = connect(file_url, knowledge_base="tiago", actor="robot")
    kb.load_domain("(define (domain d) (:predicates (open) (lit) (wet)))")
    kb.propositions.save(["(open)", "(lit)"])
    then = datetime.now(UTC)
    kb.propositions.delete_all(["(open)", "(lit)"])
    kb.propositions.save("(wet)")
    with kb.transaction(valid_from=then - timedelta(hours=1), valid_until=then):
        kb.propositions.save(["(open)", "(wet)"])
        kb.propositions.delete("(lit)")
    upto = kb.store.archive(kb.revision, to=archive_url).upto
    kb.propositions.delete("(wet)")
    with kb.transaction(valid_from=datetime.now(UTC) - timedelta(microseconds=1)):
        kb.propositions.save("(wet)")
    found = [(one.text, one.believed, one.said.content) for one in kb.corrections(since=upto)]
    seen = [(text, believed.content, said) for text, believed, said in found]
    # Whether they were believed before then is known where the versions are.
    assert seen == [
        ("(wet)", "not held", "held"),
        ("(open)", "not held", "held"),
        ("(open)", "archived", "held"),
        ("(lit)", "archived", "not held"),
        ("(wet)", "not held", "held"),
        ("(wet)", "archived", "held"),
    ]
    assert all(believed.revision is None for _, believed, _ in found[1:])


def test_what_is_archived_is_refused_with_the_place_where_it_is(
    kb: KnowledgeBase, archive_url: str
) -> None:
    count(kb, 6)
    assert kb.store.archive(5, to=archive_url).upto == 4
    for revision in (1, 3):
        with pytest.raises(ArchivedError, match="archive"):
            kb.at(revision)
    assert counter.read(kb.at(4)) == 3
    assert counter.read(kb) == 5
    assert kb.revision == 7
    assert [revision.number for revision in kb.store.revisions()] == [1, 2, 3, 4, 5, 6, 7]


def test_before_the_first_revision_there_was_nothing_to_archive(
    kb: KnowledgeBase, archive_url: str
) -> None:
    count(kb, 6)
    changes = kb.diff(0, kb.revision)
    assert kb.store.archive(5, to=archive_url).upto == 4
    assert kb.at(0).objects.get_all() == []
    assert [each for each in kb.diff(0, kb.revision) if each.kind != "archive"] == changes
    with pytest.raises(ArchivedError, match="archive"):
        list(kb.log())
    kb.restore(0)
    assert kb.diff(0, kb.revision) == []
    assert kb.store.verify().is_intact


def test_who_has_read_the_beginning_reads_the_later_past_all_the_same(
    kb: KnowledgeBase, archive_url: str
) -> None:
    count(kb, 6)
    kb.store.archive(5, to=archive_url)
    kb.types.save("later")
    assert kb.at(0).objects.get_all() == []
    assert counter.read(kb.at(4)) == 3


def test_what_was_said_of_the_time_before_it_may_be_of_what_was_moved(
    kb: KnowledgeBase, archive_url: str
) -> None:
    now = datetime.now(UTC)
    times = [now - timedelta(hours=hours) for hours in (3, 2, 1)]
    count(kb, 2)
    kb.predicates.save("(tidy ?room - room)")
    kb.objects.save("attic - room")
    with kb.transaction(valid_from=times[0], valid_until=times[2]):
        kb.propositions.save("(tidy attic)")
    assert kb.at(valid=times[1]).holds("(tidy attic)")
    opened = kb.at(valid=times[1])
    kb.objects.delete("attic")
    kb.predicates.save("(tidy ?room - (either room counter))", cascade=True)
    count(kb, 2)
    kb.store.archive(kb.revision, to=archive_url)
    rule = "(forall (?room - room) (always (not (tidy ?room))))"
    for ask in (
        lambda: kb.at(valid=times[1]),
        opened.propositions.get_all,
        lambda: kb.when("(tidy ?room)", clock="valid", since=times[0], until=times[1]),
        lambda: kb.pddl.check_rules(rule, clock="valid", since=times[0], until=times[1]),
        lambda: kb.diff(times[1], times[2], clock="valid"),
    ):
        with pytest.raises(ArchivedError, match="archive"):
            ask()
    assert kb.at(valid="now").propositions.get_all() == kb.propositions.get_all()


def test_periods_of_a_name_that_only_the_archive_has_are_asked_there(
    kb: KnowledgeBase, archive_url: str
) -> None:
    kb.predicates.save("(tidy)")
    kb.propositions.save("(tidy)")
    kb.propositions.delete("(tidy)")
    kb.predicates.delete("tidy")
    counter.start(kb)
    counter.increment(kb, 2)
    kb.store.archive(kb.revision, to=archive_url)
    for condition in ("(tidy)", "(not (tidy))"):
        with pytest.raises(ArchivedError, match="archive"):
            kb.when(condition, since=1)
        with pytest.raises(PddlError, match="tidy"):
            kb.when(condition, since=kb.revision)


def test_counting_changes_nothing_and_creates_nothing(
    counted: KnowledgeBase, tmp_path: Path
) -> None:
    done = counted.store.archive(5, to=target_url(tmp_path), dry_run=True)
    assert done.versions == {"proposition_version": 6}
    assert (done.upto, done.revision, counted.revision) == (4, None, 6)
    assert not (tmp_path / "archive.db").exists()
    assert counted.at(1).propositions.get_all()


def test_a_time_means_what_ended_before_it(counted: KnowledgeBase, tmp_path: Path) -> None:
    third = counted.store.revisions(after=2, limit=1)[0].committed_at
    url = target_url(tmp_path)
    assert counted.store.archive(third, to=url, dry_run=True).upto == 2
    assert counted.store.archive(third + timedelta(microseconds=1), to=url, dry_run=True).upto == 3
    first = datetime.min.replace(tzinfo=UTC)
    assert counted.store.archive(first, to=url, dry_run=True).upto == 0


@pytest.mark.parametrize("before", [0, 1, 2])
def test_where_nothing_ended_there_is_nothing_to_move(
    file_kb: KnowledgeBase, tmp_path: Path, before: int
) -> None:
    count(file_kb, 3)
    done = file_kb.store.archive(before, to=target_url(tmp_path))
    assert (done.versions, done.revision, file_kb.revision) == ({}, None, 3)
    assert not (tmp_path / "archive.db").exists()


def test_an_unused_knowledge_base_has_nothing_to_move(
    file_kb: KnowledgeBase, tmp_path: Path
) -> None:
    assert file_kb.store.archive(0, to=target_url(tmp_path)).revision is None


def test_moving_again_moves_nothing(counted: KnowledgeBase, archive_url: str) -> None:
    counted.store.archive(5, to=archive_url)
    for before in (5, 4, 1):
        assert counted.store.archive(before, to=archive_url).revision is None
    assert counted.revision == 7


def test_the_revision_says_who_archived_and_why(counted: KnowledgeBase, archive_url: str) -> None:
    counted.store.archive(5, to=archive_url, reason="retention of 90 days", actor="cron")
    entry = next(counted.log())
    assert (entry.revision.actor, entry.revision.reason) == ("cron", "retention of 90 days")
    (change,) = entry.changes
    assert (change.sign, change.kind) == ("+", "archive")
    assert ":upto 4 " in change.text


def test_verification_says_what_is_where(counted: KnowledgeBase, archive_url: str) -> None:
    assert counted.store.archive(5, to=archive_url).revision == 7
    verification = counted.store.verify()
    assert verification.is_intact
    (said,) = verification.archives
    place = f"that ended up to revision 4 moved to {archive_url} in revision 7: verify that"
    assert place in said


def test_progress_is_told(counted: KnowledgeBase, archive_url: str) -> None:
    told: list[tuple[int, int]] = []
    counted.store.archive(5, to=archive_url, progress=lambda done, all_: told.append((done, all_)))
    assert told[-1] == (4, 4)


def test_an_archive_holds_knowledge_bases_side_by_side(
    file_url: str, archive_url: str, connect: Connect
) -> None:
    for number, name in enumerate(("first", "second", "third")):
        kb = connect(file_url, knowledge_base=name)
        count(kb, 5 + number)
    for name in ("third", "first"):
        connect(file_url, knowledge_base=name).store.archive(5, to=archive_url)
    assert set(written_names(archive_url)) == {"first", "third"}
    assert counter.read(connect(archive_url, knowledge_base="third").at(2)) == 1
    assert connect(file_url, knowledge_base="second").revision == 6


def test_atoms_of_objects_that_are_gone_go_and_come_back(
    shared_url: str, any_archive_url: str, connect: Connect
) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    kb.propositions.save_all([robot_at(), robot_at(place=WP2)])
    # This process knows the proposition, and that it does not hold.
    assert kb.propositions.delete(robot_at(place=WP2))
    assert kb.objects.delete(WP2)
    kb.propositions.delete(robot_at())
    other.store.archive(4, to=any_archive_url)
    rows = rows_of(shared_url)
    assert sum(rows["proposition"].values()) == 1
    assert sum(rows["proposition_argument"].values()) == 2
    kb.propositions.save(robot_at(place=WP2))
    kb.propositions.save(robot_at())
    assert [str(fact) for fact in kb.propositions.get_all()] == [
        "(robot_at rb1 wp1)",
        "(robot_at rb1 wp2)",
    ]
    kb.propositions.delete_all()
    kb.objects.save(WP1)
    other.store.archive(kb.revision, to=any_archive_url)
    with connect(any_archive_url, knowledge_base="tiago") as archive:
        assert len(archive.at(1).propositions.get_all()) == 2
        assert len(archive.at(7).propositions.get_all()) == 2
        assert sum(rows_of(any_archive_url)["proposition"].values()) == 2
    for url in (shared_url, any_archive_url):
        intact(url)


def test_much_leaves_in_several_revisions(
    file_kb: KnowledgeBase, file_url: str, archive_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archiving, "AT_ONCE", 5)
    count(file_kb, 21)
    before, then = rows_of(file_url), states(file_kb, range(22))
    done = file_kb.store.archive(21, to=archive_url)
    records = rows_of(file_url)["archive"]
    assert len(records) == 7
    assert (done.versions, done.revision) == ({"proposition_version": 2 * 19}, 21 + 7)
    assert versions_of(rows_of(file_url)) == versions_after(before, 20)
    assert versions_of(rows_of(archive_url)) == versions_upto(before, 20)
    with kant_sql.connect(archive_url, knowledge_base="tiago") as archive:
        assert states(archive, range(21)) == {r: then[r] for r in range(21)}
    intact(file_url)
    intact(archive_url)


def test_who_has_cached_what_ended_learns_of_it_all_the_same(
    shared_url: str, archive_url: str, connect: Connect
) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    kb.propositions.save_all([robot_at(), robot_at(place=WP2)])
    assert len(other.objects.get_all()) == 3
    assert other.at(1).objects.get("wp2") == WP2
    kb.propositions.delete(robot_at(place=WP2))
    kb.objects.delete(WP2)
    kb.objects.save(PddlObjectDto(RB1.type, "rb2"))
    kb.objects.save(PddlObjectDto(RB1.type, "rb3"))
    kb.store.archive(5, to=archive_url)
    assert [dto.name for dto in other.objects.get_all()] == ["rb1", "wp1", "rb2", "rb3"]
    assert [dto.name for dto in other.at(4).objects.get_all()] == ["rb1", "wp1", "rb2"]
    with pytest.raises(ConflictError):
        other.propositions.save(robot_at(place=PddlObjectDto(RB1.type, "wp1")))
    assert other.objects.insert(WP2)
