"""A disk without room: what does not fit is refused whole, and what was there stays."""

from __future__ import annotations

from pathlib import Path

from tests.support.chain import check_chain
from tests.support.processes.crashes import fill_disk
from tests.support.processes.workers import in_processes


def test_a_writer_without_room_raises_and_goes_on_when_there_is_room(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    ((done, last),) = in_processes((fill_disk, url))
    assert done > 0
    assert check_chain(url) == {"tiago": last}
    assert 2 * done + 1 < last <= 2 * done + 3
