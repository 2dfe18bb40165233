"""A cluster that changes while writers are at work loses nothing that they were told is saved."""

from __future__ import annotations

from tests.plugins.citus.work import at_work, check_work, crash_a_worker, move_a_shard
from tests.support.citus import Cluster

WRITERS = 8


def test_a_shard_is_moved_below_eight_writers(cluster: Cluster, distributed_url: str) -> None:
    placement = (
        "SELECT nodeport FROM citus_shards WHERE table_name = 'head'::regclass "
        "AND shardid = get_shard_id_for_distribution_column('head', 1)"
    )
    before = cluster.run(placement, distributed_url)
    work = at_work(distributed_url, WRITERS, lambda: move_a_shard(cluster, distributed_url))
    assert cluster.run(placement, distributed_url) != before
    assert min(map(len, work.saved.values())) > 0
    assert not any(work.unsure.values())
    check_work(distributed_url, work)


def test_a_worker_crashes_below_eight_writers(cluster: Cluster, distributed_url: str) -> None:
    work = at_work(distributed_url, WRITERS, lambda: crash_a_worker(cluster, distributed_url, 1))
    assert min(map(len, work.saved.values())) > 0
    check_work(distributed_url, work)
