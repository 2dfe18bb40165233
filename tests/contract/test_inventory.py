"""The knowledge bases of a store at a glance: heads, facts, goals."""

from __future__ import annotations

from contextlib import closing

import pytest

from kant_sql import QuestionCancelledError, SchemaMissingError, limited
from kant_sql.sql import inventory
from kant_sql.sql.inventory import Catalog
from tests.support.statements import count, fill
from tests.support.stores import Connect
from tests.support.worlds.robots import RB1, WP2, robot_at, waypoint


def test_it_says_who_changed_what_and_what_there_is(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(is_goal=True))
    with kb.transaction(actor="operator", reason="a new mission"):
        kb.propositions.save(robot_at(place=WP2, is_goal=True))
    connect(shared_url, knowledge_base="never written")
    with closing(Catalog(shared_url)) as catalog:
        [one], has_more = catalog.overview()
        assert not has_more
        assert (one.name, one.revision) == ("tiago", 3)
        assert (one.actor, one.reason) == ("operator", "a new mission")
        assert one.committed_at == kb.revisions()[-1].committed_at
        assert (one.facts, one.has_more_facts, one.goals, one.reached) == (1, False, 2, 1)
        assert catalog.find("tiago") == one
        assert catalog.find("never written") is None
        assert (catalog.has("tiago"), catalog.has("nobody")) == (True, False)
        assert catalog.total() == (1, 3)


def test_reached_is_unknown_where_counting_does_not_tell(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    kb.goals.save("(not (robot_at rb1 wp1))")
    with closing(Catalog(shared_url)) as catalog:
        assert [one.reached for one in catalog.overview()[0]] == [None]
    kb.goals.delete_all()
    with closing(Catalog(shared_url)) as catalog:
        assert [one.reached for one in catalog.overview()[0]] == [0]


def test_pages_go_through_all_and_can_be_searched(shared_url: str, connect: Connect) -> None:
    for number in range(7):
        connect(shared_url, knowledge_base=f"Robot %{number}").propositions.save(robot_at())
    with closing(Catalog(shared_url)) as catalog:
        names, after, has_more = [], None, True
        while has_more:
            page, has_more = catalog.overview(after=after, limit=3)
            names += [one.name for one in page]
            after = names[-1]
        assert names == [f"Robot %{number}" for number in range(7)]
        assert catalog.first_names(2) == names[:2]
        found, has_more = catalog.overview(part="robot %4")
        assert ([one.name for one in found], has_more) == (["Robot %4"], False)
        assert catalog.overview(part="x")[0] == []
        found, has_more = catalog.overview(part="%", limit=2, after="Robot %1")
        assert ([one.name for one in found], has_more) == (["Robot %2", "Robot %3"], True)


def test_counting_ends_at_a_limit(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save_all(robot_at(RB1, waypoint(number)) for number in range(30))
    monkeypatch.setattr(inventory, "COUNTED_TOGETHER", 20)
    monkeypatch.setattr(inventory, "COUNTED_EACH", 10)
    with closing(Catalog(shared_url)) as catalog:
        [one], _ = catalog.overview()
        assert (one.facts, one.has_more_facts) == (20, True)
        connect(shared_url, knowledge_base="other").propositions.save(robot_at())
        one, other = catalog.overview()[0]
        assert (one.facts, one.has_more_facts) == (10, True)
        assert (other.facts, other.has_more_facts) == (1, False)


@pytest.mark.parametrize("size", [1, 2_000])
def test_a_page_takes_a_statement_and_one_for_each_of_its_knowledge_bases(
    shared_url: str, connect: Connect, size: int
) -> None:
    for number in range(4):
        fill(connect(shared_url, knowledge_base=f"robot {number}"), size)
    with closing(Catalog(shared_url)) as catalog:
        assert count(lambda: catalog.overview(limit=3)) == 4
        assert count(lambda: catalog.find("robot 1")) == 2
        assert count(catalog.total) == 1


def test_it_obeys_limits_and_creates_nothing(shared_url: str, connect: Connect) -> None:
    with closing(Catalog(shared_url)) as catalog:
        with limited() as limit:
            limit.cancel()
            with pytest.raises(QuestionCancelledError):
                catalog.overview()
        assert catalog.overview() == ([], False)
        with limited() as limit:
            assert catalog.total() == (0, 0)
            limit.cancel()
        # It has the same connection.
        assert catalog.total() == (0, 0)
    with pytest.raises(SchemaMissingError):
        Catalog("sqlite:///none.db")
