"""`kant-sql unconfirmed`."""

from __future__ import annotations

import json

import pytest

import kant_sql
from tests.cli.test_acts import DOMAIN, PROBLEM
from tests.support.processes.commands import run


@pytest.fixture
def url(file_url: str) -> str:
    with kant_sql.connect(file_url, knowledge_base="home", actor="executive") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        kb.apply("(unlock front)")
        kb.apply("(unlock back)")
        with kb.transaction(actor="camera"):
            kb.propositions.confirm("(open front)")
    return file_url


def test_what_nobody_has_seen_and_what_was_wrong(url: str) -> None:
    out = run("unconfirmed", url).stdout.splitlines()
    assert out[0] == "fact (open back)"
    assert out[1].startswith("  asserted in revision 4  ")
    assert "    actor: executive" in out
    assert [line.split()[:2] for line in out[-2:]] == [["holds", "now"], ["effect", "of"]]
    assert run("unconfirmed", url, "--older-than", "3600").stdout == ""
    assert run("unconfirmed", url, "--contradicted").stdout == ""
    with kant_sql.connect(url, knowledge_base="home", actor="guard") as kb:
        kb.propositions.delete("(open back)")
    wrong = json.loads(run("unconfirmed", url, "--contradicted", "--json").stdout)
    assert (wrong["text"], wrong["until"]["actor"]) == ("(open back)", "guard")
    then = run("unconfirmed", url, "--at", "3").stdout
    assert then.startswith("fact (open front)\n")


def test_blame_says_who_confirmed(url: str) -> None:
    out = run("blame", url, "(open front)").stdout
    assert "  confirmed in revision 5  " in out
    assert out.endswith("    actor: camera\n")
