"""A disk without room: what does not fit is refused whole, and what was there stays."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import kant_sql
from kant_sql import PddlTypeDto
from kant_sql.errors import StoreFullError
from tests.support.chain import check_chain
from tests.support.processes.crashes import fill_disk
from tests.support.processes.workers import in_processes


def test_a_writer_without_room_raises_and_goes_on_when_there_is_room(file_url: str) -> None:
    ((done, last),) = in_processes((fill_disk, file_url))
    assert done > 0
    assert check_chain(file_url) == {"tiago": last}
    assert 2 * done + 1 < last <= 2 * done + 3


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 2 MB."""
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(tmp_path)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root mounts a disk")
    yield tmp_path
    subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)


def fill(disk: Path) -> None:
    with suppress(OSError), (disk / "other").open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))


def test_a_verification_without_room_gives_its_verdict(small_disk: Path) -> None:
    url = f"sqlite:///{small_disk / 'store.db'}"
    with kant_sql.connect(url) as kb:
        kb.types.save(PddlTypeDto("robot"))
        assert kb.store.verify(keep=True).is_kept
        kb.types.save(PddlTypeDto("wp"))
        fill(small_disk)
        # So little that the write-ahead log has room for it still.
        with suppress(StoreFullError):
            for number in range(100):
                kb.types.save(PddlTypeDto(f"t{number}"))
        done = kb.store.verify(keep=True)
        assert (done.is_intact, done.revisions, done.is_kept) == (True, kb.revision, False)
        assert "disk is full" in str(done.keep_error)
        (small_disk / "other").unlink()
        assert kb.store.verify(keep=True).is_kept
