"""A clock that was ahead once dates later revisions, which is not to stay unnoticed."""

from __future__ import annotations

import logging
from datetime import UTC, datetime, timedelta

import pytest

from kant_sql import KnowledgeBase
from kant_sql.store import store
from tests.audit.story import Clock
from tests.support.statements import fact, fill

NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)


@pytest.fixture
def log(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.WARNING, "kant_sql.store")
    return caplog


@pytest.mark.parametrize(("behind", "warned"), [(59, False), (60, False), (61, True)])
def test_a_clock_more_than_a_minute_behind_is_warned_of(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture, behind: int, warned: bool
) -> None:
    with Clock().ruling() as clock:
        clock.moment = NOON
        fill(fresh_kb, 3)
        last = fresh_kb.revision
        clock.moment = NOON - timedelta(seconds=behind)
        fresh_kb.propositions.delete(fact(1))
    assert [record.levelno for record in log.records] == [logging.WARNING] * warned
    if warned:
        message = log.records[0].getMessage()
        assert "the clock says 2026-03-02T11:58:59+00:00" in message
        assert f"revision {last} is of 2026-03-02T12:00:00+00:00" in message
    assert fresh_kb.store.revisions()[-1].committed_at == NOON


def test_the_warning_comes_once_an_hour(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Clock().ruling() as clock:
        clock.moment = NOON
        fill(fresh_kb, 3)
        clock.moment = NOON - timedelta(days=1)
        for number in (1, 2):
            fresh_kb.propositions.delete(fact(number))
        assert len(log.records) == 1
        monkeypatch.setattr(store, "CLOCK_PATIENCE", 0.0)
        fresh_kb.propositions.save(fact(1))
    assert len(log.records) == 2
