"""What a fact led to is found by keys, whatever PostgreSQL knows of the tables.

A VACUUM counts the rows of a table, and leaves it without statistics until it is analyzed.
"""

from __future__ import annotations

from itertools import cycle, islice
from typing import Any

import psycopg
import pytest

import kant_sql
from tests.benchmarks.causing import ASKED, DOMAIN, PROBLEM, STEPS
from tests.contract.test_plans import keep_without_statistics
from tests.support.reading import loaded
from tests.support.servers import Server
from tests.support.statements import is_bracket, seen

ACTS = 1_000


def pages(url: str, fact: str) -> int:
    """Count the pages that the statements of a question read."""
    with kant_sql.connect(url, knowledge_base="robot") as kb:
        kb.consequences(fact)
        with seen() as statements:
            assert kb.consequences(fact).links
    found = 0
    with psycopg.connect(url) as connection:
        for one in statements:
            if not is_bracket(one.sql):
                query: Any = f"EXPLAIN (ANALYZE, BUFFERS, FORMAT JSON) {one.sql}"
                ((plan,),) = connection.execute(query, one.parameters).fetchall()
                found += plan[0]["Plan"]["Shared Hit Blocks"]
    return found


@pytest.mark.more
def test_what_a_fact_led_to_reads_about_as_much_without_statistics(server: Server) -> None:
    url = server.new_store()
    keep_without_statistics(url)
    with kant_sql.connect(url, knowledge_base="robot", actor="executive") as kb:
        loaded(kb, DOMAIN, PROBLEM)
        for step in islice(cycle(STEPS), ACTS):
            kb.apply(step)
    read = []
    for maintain in ("SELECT 1", "VACUUM", "VACUUM ANALYZE"):
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(maintain.encode())
        read.append([pages(url, fact) for fact in ASKED])
    *without, known = read
    for each in without:
        assert all(one <= 2 * two + 1_000 for one, two in zip(each, known, strict=True)), read
