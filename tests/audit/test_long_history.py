"""A long history is exported in the memory that a short one takes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.support.processes.commands import child
from tests.support.servers import Server
from tests.support.stores import new_file_store
from tests.support.worlds.long_history import write_long_history

SHORT, LONG = 10_000, 70_000
# Megabytes. A row takes about 2 kB as Python objects, so that all of them would take 120 and more.
MORE = 50

EXPORT = """
import sys
from kant_sql.export import export_store, open_reader
from kant_sql_plugins.mcap import export_transitions

url, folder = sys.argv[1:]
rows = 0
for format, view in (("parquet", "change"), ("csv", "revision"), ("jsonl", "fact")):
    exported = export_store(url, to=f"{folder}/{format}", format=format, views=[view])
    rows += sum(file.rows for file in exported.files)
rows += sum(file.rows for file in export_transitions(url, to=f"{folder}/mcap").files)
with open_reader(url, view="fact") as reader:
    rows += sum(batch.num_rows for batch in reader)
with open("/proc/self/status") as status:
    (peak,) = (line.split()[1] for line in status if line.startswith("VmHWM"))
print(rows, int(peak) // 1000)
"""


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def stores(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[int, str]:
    """A short and a long history, on each dialect."""
    made = {}
    for revisions in (SHORT, LONG):
        if request.param == "sqlite":
            url = new_file_store(tmp_path_factory.mktemp("long") / "store.db")
        else:
            server: Server = request.getfixturevalue("server")
            url = server.new_store()
        write_long_history(url, revisions)
        made[revisions] = url
    return made


@pytest.mark.more
@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of memory from /proc")
def test_memory_is_flat(stores: dict[int, str], tmp_path: Path) -> None:
    rows, peaks = zip(
        *(exported(url, tmp_path / str(revisions)) for revisions, url in stores.items()),
        strict=True,
    )
    assert rows[1] / rows[0] == pytest.approx(LONG / SHORT, rel=0.01)
    assert peaks[1] - peaks[0] < MORE, peaks


def exported(url: str, folder: Path) -> tuple[int, int]:
    """Export in a process of its own: how many rows, and its peak of memory in megabytes."""
    done = child("-c", EXPORT, url, str(folder), program=[sys.executable], timeout=600)
    assert done.returncode == 0, done.stderr
    rows, peak = map(int, done.stdout.split())
    return rows, peak
