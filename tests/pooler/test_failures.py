"""Through a pooler: servers that are killed, forks, and stores that are not there."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import kant_sql
from kant_sql.errors import SchemaMissingError
from kant_sql.sql.dialects import base as retry
from tests.support.chain import check_chain
from tests.support.poolers import Pooler
from tests.support.processes import forks
from tests.support.processes.crashes import go_on
from tests.support.processes.workers import PATIENCE, in_processes
from tests.support.servers import MortalServer, Server
from tests.support.stores import Connect


def test_clients_survive_a_killed_server_and_do_everything_once(
    mortal_server: MortalServer, mortal_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)
    pooler = Pooler(mortal_server, default_pool_size="4", server_login_retry="1")

    try:
        kb = connect(pooler.url(mortal_url), knowledge_base="tiago")
        revisions = go_on(kb, mortal_server.crash)
        kb.close()
    finally:
        pooler.stop()
    assert check_chain(mortal_url) == {"tiago": revisions}


@pytest.mark.parametrize(
    "scenario",
    [
        forks.both_sides_go_on,
        forks.children_close_first,
        forks.within_a_transaction,
        forks.out_of_a_transaction,
    ],
)
def test_an_open_knowledge_base_survives_a_fork(
    wide: str, direct: str, scenario: Callable[[str], None]
) -> None:
    in_processes((scenario, wide))
    check_chain(direct)


@pytest.mark.parametrize("read_only", [False, True])
def test_a_database_without_tables_is_refused_and_served_later(
    server: Server, narrow_pooler: Pooler, connect: Connect, read_only: bool
) -> None:
    direct = server.new_database()
    url = narrow_pooler.url(direct)
    for _ in range(3):
        with pytest.raises(SchemaMissingError, match="kant-sql db upgrade"):
            connect(url, read_only=read_only)
    kant_sql.upgrade(url)
    assert connect(url, read_only=read_only).revision == 0
    server.drop_database(direct)
