"""Roles on PostgreSQL: an eraser erases as the owner can, and a writer cannot."""

from __future__ import annotations

from contextlib import closing

import psycopg
import pytest

import kant_sql
from kant_sql.errors import ReadOnlyStoreError
from tests.contract.test_erasure import NAME, fill
from tests.support.roles import contents, members, query
from tests.support.servers import Server
from tests.support.stores import Connect


@pytest.mark.parametrize("knowledge_base", [None, "tiago"])
def test_an_eraser_erases_as_the_owner_can(
    knowledge_base: str | None, server: Server, connect: Connect
) -> None:
    url = server.new_store()
    kb = fill(connect(url, knowledge_base="tiago", actor="camera"))
    with kb.transaction(valid_from="2026-01-31T09:00:00Z", valid_until="2026-01-31T10:00:00Z"):
        kb.propositions.save(f"(at {NAME} hall)")
        kb.function_values.set(f"(age {NAME})", value=79)
    anchor = kb.store.anchor()
    roles = kant_sql.operations.create_roles(url, knowledge_base=knowledge_base)
    with (
        members(url, roles) as own,
        closing(connect(own.eraser, knowledge_base="tiago", actor="clerk")) as eraser,
    ):
        erased = eraser.erase(NAME, reason="asked", also=["reason", "source"])
        # What took its place is replaced again, and the salts of that are destroyed.
        assert eraser.erase("erased-1", reason="asked").parts > 15
        eraser.propositions.save("(at bob hall)")
        eraser.propositions.delete("(at bob hall)")
        assert eraser.erase(revisions=[1], parts=["actor"], reason="asked").parts == 1
        found = eraser.store.verify(anchor=anchor)
    assert (found.findings, len(found.erasures)) == ((), 3)
    said = " ".join(map(str, contents(url).values()))
    assert f"{NAME}2" in said
    assert NAME not in said.replace(f"{NAME}2", "")
    ((version,),) = query(url, "SELECT current_setting('server_version_num')::integer")
    # Since that version, an eraser is granted to maintain the tables.
    assert len(erased.remaining) == (version < 170_000)
    for remaining in erased.remaining:
        assert "run VACUUM (FULL, ANALYZE) as the owner of the tables" in remaining


@pytest.mark.parametrize("role", ["writer", "reader"])
def test_others_are_refused(role: str, server: Server, connect: Connect) -> None:
    url = server.new_store()
    fill(connect(url, knowledge_base="tiago"))
    before = contents(url)
    with (
        members(url, kant_sql.operations.create_roles(url)) as own,
        closing(connect(getattr(own, role), knowledge_base="tiago")) as kb,
    ):
        with pytest.raises(ReadOnlyStoreError, match="permission denied for table"):
            kb.erase(NAME, reason="asked")
        with pytest.raises(ReadOnlyStoreError, match=r"permission denied|row-level security"):
            kb.erase(revisions=[4], parts=["reason"], reason="asked")
        with pytest.raises(ReadOnlyStoreError, match="permission denied for table"):
            kb.erasure_preview(NAME)
    assert contents(url) == before


def test_a_target_that_grants_no_erasing_is_named(server: Server, connect: Connect) -> None:
    """What was sent before stays; with the rights of an eraser the push goes on."""
    kb = fill(connect(server.new_store(), knowledge_base="tiago"))
    url = server.new_store()
    kb.store.push(url)
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    before = contents(url)
    with members(url, kant_sql.operations.create_roles(url)) as own:
        with pytest.raises(ReadOnlyStoreError, match="permission denied") as caught:
            kb.store.push(own.writer)
        assert url.rpartition("/")[2] in str(caught.value)
        assert contents(url) == before
        assert kb.store.push(url).revisions == 1
    with closing(connect(url, knowledge_base="tiago")) as replica:
        assert replica.objects.get(NAME) is None


@pytest.mark.parametrize(
    "attack",
    [
        "UPDATE proposition SET text = '(at bob hall)' WHERE text LIKE '(at erased-1 hall)'",
        "UPDATE object SET name = 'eve', key = 'eve' WHERE name = 'erased-1'",
        "UPDATE revision SET reason = 'other', seed = NULL WHERE number = 3",
        "UPDATE replacement SET salt = NULL, commitment = repeat('0', 64)",
    ],
)
@pytest.mark.more
def test_what_an_eraser_changes_without_an_erasure_is_found(
    attack: str, server: Server, connect: Connect
) -> None:
    url = server.new_store()
    kb = fill(connect(url, knowledge_base="tiago"))
    kb.erase(NAME, reason="asked")
    assert kb.store.verify().is_intact
    with (
        members(url, kant_sql.operations.create_roles(url)) as own,
        psycopg.connect(own.eraser) as eraser,
    ):
        assert eraser.execute(attack.encode()).rowcount > 0
    assert not kb.store.verify().is_intact
