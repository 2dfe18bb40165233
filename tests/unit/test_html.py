"""What notebooks show of values without a store: escaped, visible, bounded; lists stay lists."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Iterator
from datetime import UTC, datetime

import pytest

from kant_sql import Plan, PlanStep
from kant_sql.errors import ClosedError
from kant_sql.html import LENGTH, ROWS, Feed, Listing, cut, fields, guarded, table, visible
from kant_sql.html import lines as html_lines
from kant_sql.operations import Finding, Verification
from kant_sql.sql.changes import Change
from tests.support.notebooks import check_harmless
from tests.support.worlds.hostile import BIDI

SCRIPT = "</script><script>alert('1')</script><img/src=x onerror=\"alert(2)\">&lt;"
CHANGES = [Change("+", "fact", f"(robot_at rb1 wp{number})") for number in range(3)]


def test_text_is_escaped_wherever_it_is() -> None:
    made = table([{SCRIPT: SCRIPT}]) + fields({SCRIPT: (SCRIPT, SCRIPT)}) + html_lines(SCRIPT)
    check_harmless(made)
    assert made.count("&lt;/script&gt;") == 12


@pytest.mark.parametrize("character", "\x00\x1b\u202e\u2066\u200b\u200f\u061c\ufeff\u2028\ud800")
def test_what_controls_or_hides_text_is_written_out(character: str) -> None:
    made = visible(f"a{character}b")
    assert made == f"a\\u{ord(character):04x}b"
    check_harmless(fields({"name": f"a{character}b"}))


def test_other_text_is_as_it_is() -> None:
    assert visible("Küche שלום 厨房 👍 a&b") == "Küche שלום 厨房 👍 a&b"


def test_a_long_text_is_cut_and_says_so() -> None:
    assert cut("x" * 10_000) == f"{'x' * LENGTH}... (10,000 characters)"
    assert cut("x" * LENGTH) == "x" * LENGTH
    assert len(table([{"name": "<" * 10_000}])) < 2_000


def test_a_table_is_without_the_columns_that_nobody_filled() -> None:
    rows: list[dict[str, object]] = [
        {"one": 0, "other": None, "lines": ()},
        {"one": None, "other": None, "lines": ()},
    ]
    assert "one" in table(rows)
    assert "other" not in table(rows)
    assert "lines" not in table(rows)


def test_times_are_in_full() -> None:
    made = fields({"at": datetime(2026, 1, 31, 9, 30, 0, 1, tzinfo=UTC)})
    assert "2026-01-31 09:30:00.000001Z" in made


def test_a_listing_is_a_list() -> None:
    listing = Listing(CHANGES, "change")
    assert isinstance(listing, list)
    assert listing == CHANGES
    assert listing[1:] == CHANGES[1:]
    assert listing[0] is CHANGES[0]
    assert [*reversed(listing)] == CHANGES[::-1]
    assert [*listing] == CHANGES
    assert json.dumps(listing) == json.dumps(CHANGES)
    assert repr(listing) == repr(CHANGES)
    for again in (copy.copy(listing), copy.deepcopy(listing), pickle.loads(pickle.dumps(listing))):
        assert again == CHANGES
        assert again._repr_html_() == listing._repr_html_()


def test_a_listing_shows_its_first_items_and_how_many_there_are() -> None:
    few, many = Listing(CHANGES, "change"), Listing(CHANGES * 1_000, "change")
    assert "3 changes" in few._repr_html_()
    assert "(robot_at rb1 wp2)" in few._repr_html_()
    made = many._repr_html_()
    assert "3,000 changes" in made
    assert f"and {3_000 - ROWS:,} more" in made
    assert made.count("<tr>") == ROWS + 1
    assert "1 change<" in Listing(CHANGES[:1], "change")._repr_html_()
    assert Listing[Change]([], "change")._repr_html_().count("<table") == 0


def test_a_feed_reads_no_more_than_it_shows() -> None:
    read: list[int | None] = []

    def first(most: int | None) -> Iterator[Change]:
        read.append(most)
        return iter(CHANGES)

    Feed(first, None, noun="change")._repr_html_()
    assert read == [None, ROWS + 1]


def test_an_iterator_is_true_if_there_is_a_next_item() -> None:
    found = Feed(lambda most: iter([0, 1][:most]), None, noun="number")
    assert found
    assert [next(found), bool(found), *found] == [0, True, 1]
    assert not found
    many = Feed(lambda most: iter(range(20_000)), None, noun="number")
    taken = 0
    while many:
        taken += next(many) >= 0
    assert taken == 20_000


def test_an_error_of_the_library_is_shown_and_no_other_is_hidden() -> None:
    def fails(error: Exception) -> str:
        raise error

    made = guarded(lambda: fails(ClosedError(f"closed {SCRIPT}")))
    assert "closed" in made
    check_harmless(made)
    with pytest.raises(ZeroDivisionError):
        guarded(lambda: fails(ZeroDivisionError()))


def test_a_plan_shows_its_steps() -> None:
    steps = (PlanStep(None, "move", ("rb1", "<b>")), PlanStep(None, "wave"))
    made = Plan(steps, "by hand", "unknown")._repr_html_()
    assert "2 steps" in made
    assert "(move rb1 &lt;b&gt;)" in made


def test_a_verification_shows_its_verdict_and_its_findings() -> None:
    finding = Finding(3, "revision", f"the hash differs: {SCRIPT}{BIDI}")
    bad = Verification("tiago", 5, 9, (finding,) * 200)._repr_html_()
    assert "not intact" in bad
    assert "200 findings" in bad
    assert f"and {200 - ROWS} more" in bad
    check_harmless(bad)
    good = Verification("tiago", 5, 9, (), anchored=5)._repr_html_()
    assert "intact" in good
    assert "finding" not in good
