"""When something was sensed is kept beside the time at which it was written."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest

from kant_sql import KnowledgeBase
from kant_sql.errors import InvalidMetadataError
from tests.support.chain import check_chain
from tests.support.reading import nothing_changes, present, undone
from tests.support.stores import Connect
from tests.support.worlds.depot import again
from tests.support.worlds.robots import RB1, WP2, robot_at

SEEN = datetime(2026, 1, 31, 9, 30, 15, 123456, tzinfo=UTC)


def observed(kb: KnowledgeBase) -> list[datetime | None]:
    return [revision.observed_at for revision in kb.store.revisions()]


@pytest.mark.parametrize(
    "moment",
    [
        SEEN,
        SEEN.astimezone(timezone(timedelta(hours=13, minutes=45))),
        datetime.now(UTC) + timedelta(days=365),
        datetime.min.replace(tzinfo=UTC),
        datetime.max.replace(tzinfo=UTC),
    ],
    ids=["utc", "another zone", "later than now", "first moment", "last moment"],
)
def test_it_is_kept_to_the_microsecond_in_utc(fresh_kb: KnowledgeBase, moment: datetime) -> None:
    with fresh_kb.transaction(observed_at=moment):
        fresh_kb.propositions.save(robot_at())
    (revision,) = again(fresh_kb).store.revisions()
    assert revision.observed_at == moment
    assert present(revision.observed_at).utcoffset() == timedelta(0)
    # The store's own clock goes on.
    assert abs(revision.committed_at - datetime.now(UTC)) < timedelta(minutes=5)


def test_late_data_is_visible_as_late(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction(observed_at=SEEN):
        fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    assert observed(fresh_kb) == [SEEN, None]
    assert [entry.revision.observed_at for entry in fresh_kb.log()] == [None, SEEN]
    assert present(fresh_kb.blame(robot_at())).since.observed_at == SEEN
    # It is not a time of the store's: states are found by when they were written.
    assert fresh_kb.at(SEEN).revision == 0


def test_a_nested_transaction_has_the_outer_one_s(fresh_kb: KnowledgeBase) -> None:
    other = SEEN + timedelta(hours=1)
    with fresh_kb.transaction(observed_at=SEEN), fresh_kb.transaction(observed_at=other):
        fresh_kb.propositions.save(robot_at())
    with fresh_kb.transaction():
        fresh_kb.propositions.save(robot_at(RB1, WP2))
        with fresh_kb.transaction(observed_at=other):
            fresh_kb.propositions.delete(robot_at())
        with undone(fresh_kb):
            fresh_kb.types.delete_all()
    assert observed(fresh_kb) == [SEEN, None]


@pytest.mark.parametrize(
    "moment",
    [
        datetime(2026, 1, 31),
        1_769_851_800,
        SEEN.date(),
        datetime.min.replace(tzinfo=timezone(timedelta(hours=14))),
        datetime.max.replace(tzinfo=timezone(timedelta(hours=-12))),
    ],
    ids=str,
)
def test_what_is_no_moment_is_refused(fresh_kb: KnowledgeBase, moment: Any) -> None:
    fresh_kb.propositions.save(robot_at())
    with nothing_changes(fresh_kb):
        with pytest.raises(InvalidMetadataError, match="observed_at"):
            fresh_kb.transaction(observed_at=moment).__enter__()
        with (
            fresh_kb.transaction(),
            pytest.raises(InvalidMetadataError),
            fresh_kb.transaction(observed_at=moment),
        ):
            fresh_kb.types.delete_all()


def test_the_hash_covers_it(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    with kb.transaction(observed_at=SEEN):
        kb.propositions.save(robot_at())
    kb.propositions.delete(robot_at())
    assert check_chain(shared_url)
