"""The settings of PgBouncer in the guide are those of a PgBouncer that works."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import kant_sql
from tests.support.poolers import Pooler
from tests.support.servers import Server
from tests.support.worlds.robots import robot_at

GUIDE = Path(__file__).parents[2] / "docs" / "fleet.md"


def settings_of_the_guide() -> configparser.ConfigParser:
    [block] = re.findall(r"```ini\n(\[databases\].*?)```", GUIDE.read_text(), re.DOTALL)
    parser = configparser.ConfigParser()
    parser.read_string(block)
    return parser


def test_the_settings_of_the_guide_work(server: Server, direct: str) -> None:
    settings = settings_of_the_guide()
    assert settings["databases"]["fleet"] == "host=localhost port=5432"
    # Only where things are is another here.
    places = {"listen_addr", "listen_port", "auth_type", "auth_file"}
    kept = {key: value for key, value in settings["pgbouncer"].items() if key not in places}
    assert kept.keys() >= {"pool_mode", "default_pool_size", "max_client_conn"}
    pooler = Pooler(server, **kept)
    try:
        asked = {str(row[0]): row[1] for row in pooler.ask("SHOW CONFIG")}
        assert {key: asked[key] for key in kept} == kept
        with kant_sql.connect(pooler.url(direct), knowledge_base="tiago") as kb:
            kb.propositions.save(robot_at())
            assert kb.store.verify().is_intact
    finally:
        pooler.stop()
