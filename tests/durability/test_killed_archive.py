"""`kill -9` of who archives, at any moment: nothing is lost, nothing is there twice."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.history.replication import batch as replicating
from tests.support import archives
from tests.support.processes.crashes import die_after
from tests.support.processes.workers import dies
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import robot_at, waypoint

pytestmark = pytest.mark.more

COUNTED, BULK = 30, 20
# So many statements are enough for several steps, and for all that comes behind the last.
MOST = 200


def live(kb: KnowledgeBase) -> int:
    """Give a knowledge base a history; give the revision that it is archived up to."""
    counter.start(kb)
    for number in range(COUNTED):
        counter.increment(kb, 1)
        if number % 10 == 0:
            kb.propositions.save_all(
                robot_at(place=waypoint(BULK * number + n)) for n in range(BULK)
            )
        if number % 10 == 5:
            for n in range(BULK // 2):
                kb.objects.delete(waypoint(BULK * (number - 5) + n))
    return kb.revision - COUNTED // 3


def archive_and_die(here: str, there: str, before: int, statements: int) -> None:
    """Archive in small steps, and be killed behind so many statements."""
    die_after(statements)
    replicating.ROWS, replicating.FIRST_REVISIONS = 30, 2
    with kant_sql.connect(here, knowledge_base="tiago") as kb:
        kb.store.archive(before, to=there)


def check(here: str, there: str, before: archives.Rows, upto: int) -> bool:
    """Check the store and its archive after a kill; tell whether all of it was done."""
    left, moved = (
        archives.versions_of(archives.rows_of(here)),
        archives.versions_of(archives.rows_of(there)),
    )
    is_done = left != archives.versions_of(before)
    if is_done:
        assert left == archives.versions_after(before, upto)
        assert moved == archives.versions_upto(before, upto)
    else:
        with kant_sql.connect(there, knowledge_base="tiago") as archive:
            at = archive.revision
        assert at <= upto
        assert moved == archives.versions_upto(before, at)
    return is_done


def test_a_killed_archive_is_gone_on_with(
    shared_url: str, tmp_path: Path, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    upto = live(kb)
    head, before = kb.revision, archives.rows_of(shared_url)
    then = archives.states(kb, range(head + 1))
    there, kills, is_done = archives.target_url(tmp_path), 0, False
    kant_sql.upgrade(there)
    while not is_done:
        # The first one never reaches the end, so that there is always one to be gone on with.
        statements = random.randrange(MOST if kills else MOST // 10)
        kills += dies(archive_and_die, shared_url, there, upto + 1, statements)
        is_done = check(shared_url, there, before, upto)
    assert kills > 0
    assert kb.store.archive(upto + 1, to=there).revision is None
    assert kb.revision == head + 1
    with kant_sql.connect(there, knowledge_base="tiago") as archive:
        assert archives.states(archive, range(upto + 1)) == {r: then[r] for r in range(upto + 1)}
    assert archives.states(kb, range(upto, head + 1)) == {r: then[r] for r in range(upto, head + 1)}
    archives.intact(shared_url)
    archives.intact(there)
