"""What processes do that open a store; each function is run in a new process."""

from __future__ import annotations

import os

import pytest

import kant_sql
import kant_sql.backends.sqlite
from kant_sql import KantSqlError, ReadOnlyStoreError
from tests.worlds import robot_at, waypoint

NOBODY = 65534


def connect_and_write(url: str, number: int, name: str = "tiago") -> int:
    """Open a store, which may have to be created, and write once; give the revision."""
    with kant_sql.connect(url, knowledge_base=name) as kb:
        assert kb.propositions.insert(robot_at(place=waypoint(number)))
        mine = f"(robot_at rb1 wp{number})"
        for entry in kb.log():
            if any(change.text == mine for change in entry.changes):
                return entry.revision.number
        raise AssertionError(f"{mine} is not in the log")


def upgrade_and_write(url: str, number: int) -> int:
    """Create the tables of a store, if need be, and write once; give the revision."""
    kant_sql.upgrade(url)
    return connect_and_write(url, number)


def _give_up_rights() -> None:
    """Become a user whom permissions bind."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def read_but_not_write(url: str) -> None:
    """Read a store with one fact in it, and be refused to write."""
    _give_up_rights()
    with kant_sql.connect(url) as kb:
        assert kb.propositions.get_all() == [robot_at()]
        with pytest.raises(ReadOnlyStoreError, match="cannot be written"):
            kb.propositions.save(robot_at(is_goal=True))
        assert kb.propositions.get_all() == [robot_at()]


def refused(url: str, error: type[KantSqlError]) -> str:
    """Be refused to open a store; give what the error says."""
    _give_up_rights()
    with pytest.raises(error) as caught:
        kant_sql.connect(url)
    return str(caught.value)
