"""Migration 0010 adds seeds: form 2 of hashes follows form 1, which stays what it was."""

from __future__ import annotations

import kant_sql
from tests.contract.test_hash import last_hash
from tests.migrations.stores import Make, refusal, rows_of, run_script, written
from tests.migrations.test_0008 import NAME, open_rounds
from tests.support.reading import findings
from tests.support.stores import Connect


def write_complete(url: str) -> None:
    """Create one of which nothing was moved to an archive: it is one."""
    written("archive")(url)
    run_script(url, "UPDATE head SET origin = NULL")
    kant_sql.upgrade(url, revision="0009")


def test_form_2_follows_form_1(make: Make, connect: Connect) -> None:
    url = make(write_complete)
    hashes = [(row["number"], row["hash"]) for row in rows_of(url)["revision"]]
    kant_sql.upgrade(url)
    kb = open_rounds(url, connect)
    assert last_hash(url, NAME) == kb.store.revisions()[-1].hash
    with kb.transaction(reason="a new form"):
        kb.propositions.delete_all()
    after = rows_of(url)["revision"]
    assert [(row["number"], row["hash"]) for row in after[:-1]] == hashes
    assert [(row["form"], row["seed"] and len(row["seed"])) for row in after[-2:]] == [
        (1, None),
        (2, 16),
    ]
    assert findings(url) == []
    assert "cannot verify revisions of form 2 (1)" in refusal(url, "0009")


def test_a_name_is_erased_from_form_1_too(make: Make, connect: Connect) -> None:
    """Its hashes are kept, as nobody can recompute them; the page says how to go on."""
    url = make(write_complete)
    kant_sql.upgrade(url)
    kb = open_rounds(url, connect)
    erased = kb.erase("rb1", reason="sold", form_1=True)
    assert erased.form_1 > 0
    assert last_hash(url, NAME) == kb.store.revisions()[-1].hash
    kb.close()
    assert findings(url) == []
