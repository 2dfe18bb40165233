"""One converter from results to JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import pytest

from kant_sql.json_values import json_value


class Place(NamedTuple):
    """A result of the plain kind."""

    name: str
    distance: Decimal | None


@dataclass(frozen=True)
class Visit:
    """A result whose document differs from its fields."""

    _json_ = "id=number", "*place", "is_far", "seen_at"

    number: int
    place: Place
    seen_at: datetime
    secret: str

    @property
    def is_far(self) -> bool:
        """Whether it is far."""
        return True


@dataclass(frozen=True)
class Tour:
    """A result of results, with a private part."""

    visits: tuple[Visit, ...]
    source: object
    _read: object = field(repr=False)


SEEN = datetime(2026, 3, 2, 15, 3, tzinfo=timezone(timedelta(hours=1)))
VISIT = Visit(7, Place("hall", Decimal("1E+2")), SEEN.astimezone(UTC), "x")
DOCUMENT = {
    "id": 7,
    "name": "hall",
    "distance": "100",
    "is_far": True,
    "seen_at": "2026-03-02T14:03:00.000000Z",
}


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (VISIT, DOCUMENT),
        (
            Tour((VISIT,), {"sensor": [1, None, {"x": 0.5}]}, print),
            {"visits": [DOCUMENT], "source": {"sensor": [1, None, {"x": 0.5}]}},
        ),
        ({"at": [Place("lab", None)]}, {"at": [{"name": "lab", "distance": None}]}),
        (Path("/srv/a.db"), "/srv/a.db"),
        ("text", "text"),
        (None, None),
    ],
)
def test_a_result_is_a_document_of_its_fields(value: object, expected: object) -> None:
    found = json_value(value)
    assert found == expected
    if isinstance(expected, dict):
        assert isinstance(found, dict)
        assert list(found) == list(expected)


def test_what_is_no_result_is_refused() -> None:
    with pytest.raises(TypeError, match="a complex is neither a JSON value nor a result"):
        json_value([1j])
