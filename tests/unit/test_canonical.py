"""The canonical form of a revision is RFC 8785, as the library for it writes the document."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta, timezone
from hashlib import sha256
from typing import Any

import pytest
import rfc8785
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.errors import InvalidMetadataError
from kant_sql.knowledge import canonical

Change = tuple[str, str, str]

# All text that a database can keep: no NUL, no half characters.
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
INTEGERS = st.integers(-(2**53) + 1, 2**53 - 1)
JSON = st.recursive(
    st.none()
    | st.booleans()
    | INTEGERS
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda values: st.lists(values, max_size=4) | st.dictionaries(TEXTS, values, max_size=4),
    max_leaves=12,
)
CHANGES = st.lists(
    st.tuples(
        st.sampled_from("+-"),
        st.sampled_from(["type", "object", "predicate", "action", "fact", "goal"]),
        TEXTS,
    ),
    max_size=8,
)
SEED = b"0123456789abcdef"
TIME = "2026-01-31T09:30:00.000000Z"
MOMENTS = st.datetimes(
    datetime(1, 1, 3), datetime(9999, 12, 30), timezones=st.just(timezone(timedelta(hours=5)))
)


def document(
    previous: str | None,
    name: str,
    number: int,
    metadata: canonical.Metadata,
    changes: list[Change],
    source: Any = None,
    form: int = canonical.FORM,
) -> bytes:
    """The whole document, by the library."""
    observed_at, step = metadata.observed_at, metadata.plan_step
    return rfc8785.dumps(
        {
            "observed_at": None if observed_at is None else canonical.time_text(observed_at),
            "plan_step": None if step is None else [*step],
            "form": form,
            "previous": previous,
            "knowledge_base": name,
            "number": number,
            "committed_at": TIME,
            "actor": metadata.actor,
            "reason": metadata.reason,
            "source": source,
            "changes": [list(change) for change in changes],
        }
    )


def _commitment(label: str, text: str | None) -> str | None:
    return None if text is None else canonical.commit_to(canonical.salt_of(SEED, label, text), text)


@given(
    previous=st.none() | st.just("ab" * 32),
    name=TEXTS,
    number=st.integers(1, 2**53 - 1),
    actor=st.none() | TEXTS,
    reason=st.none() | TEXTS,
    source=JSON,
    observed_at=st.none() | MOMENTS,
    plan_step=st.none() | st.tuples(st.integers(1, 2**53 - 1), st.integers(0, 2**31 - 1)),
    changes=CHANGES,
)
def test_a_revision_hashes_the_document_that_rfc_8785_writes(
    previous: str | None,
    name: str,
    number: int,
    actor: str | None,
    reason: str | None,
    source: object,
    observed_at: datetime | None,
    plan_step: tuple[int, int] | None,
    changes: list[Change],
) -> None:
    metadata = canonical.make_metadata(actor, reason, source, observed_at, plan_step)
    given_ = previous, name, number
    for form in (7, 1):
        expected = sha256(document(*given_, metadata, changes, source, form)).hexdigest()
        assert (
            canonical.revision_hash(*given_, TIME, metadata, iter(changes), None, form) == expected
        )
    sealed = canonical.Metadata(
        _commitment("actor", actor),
        _commitment("reason", reason),
        _commitment("source", metadata.source),
        *metadata[3:],
    )
    told = [(sign, kind, _commitment(sign + kind, text) or "") for sign, kind, text in changes]
    expected = sha256(document(*given_, sealed, told, sealed.source)).hexdigest()
    assert canonical.revision_hash(*given_, TIME, metadata, iter(changes), SEED) == expected
    said = sealed[:3]
    assert canonical.sealed_hash(*given_, TIME, metadata, said, told) == expected


@pytest.mark.parametrize("count", [0, 1, 999, 1_000, 1_001, 2_500])
def test_the_hash_does_not_depend_on_how_changes_are_batched(count: int) -> None:
    changes = [("+", "fact", f'(p "{number}\\') for number in range(count)]
    metadata = canonical.Metadata(None, None, None)
    expected = sha256(document(None, "kb", 1, metadata, changes, form=1)).hexdigest()
    assert canonical.revision_hash(None, "kb", 1, TIME, metadata, changes, None, 1) == expected
    told = [(sign, kind, _commitment(sign + kind, text) or "") for sign, kind, text in changes]
    expected = sha256(document(None, "kb", 1, metadata, told)).hexdigest()
    assert canonical.revision_hash(None, "kb", 1, TIME, metadata, changes, SEED) == expected


@given(JSON)
def test_a_source_is_kept_as_its_canonical_text(source: object) -> None:
    metadata = canonical.make_metadata(None, None, source)
    if source is None:
        assert metadata.source is None
    else:
        assert metadata.source is not None
        assert metadata.source.encode() == rfc8785.dumps(source)  # type: ignore[arg-type]
        # JSON knows only floating-point numbers: the text of a large one may have no point.
        assert json.loads(metadata.source, parse_int=float) == source


@pytest.mark.parametrize(
    "source",
    [
        *(float("nan"), float("inf"), -float("inf"), 2**53, -(2**53), 10**400, {1, 2}, b"bytes"),
        *(object(), datetime.now(UTC), 1j, {5: "a key that is not a string"}, {None: 1}),
        *({"a": {"b": [object()]}}, "\ud800", {"\udfff": 1}, ["\ud800"]),
    ],
    ids=lambda source: repr(source)[:20],
)
def test_a_source_that_is_not_json_is_refused(source: object) -> None:
    with pytest.raises(InvalidMetadataError, match="source is not a JSON document: "):
        canonical.make_metadata(None, None, source)


def test_a_source_that_contains_itself_is_refused() -> None:
    endless: list[object] = []
    endless.append(endless)
    with pytest.raises(InvalidMetadataError, match="source is not a JSON document: "):
        canonical.make_metadata(None, None, endless)


@pytest.mark.parametrize(
    "value", [5, "2026-01-31T09:30:00Z", datetime(2026, 1, 31), datetime(2026, 1, 31).date()]
)
def test_what_was_observed_has_a_time_with_its_zone(value: object) -> None:
    with pytest.raises(InvalidMetadataError, match="observed_at is a time with its zone"):
        canonical.make_metadata(None, None, None, value)  # type: ignore[arg-type]


def test_a_time_of_observation_that_utc_cannot_say_is_refused() -> None:
    with pytest.raises(InvalidMetadataError, match="outside the years 1 to 9999"):
        canonical.make_metadata(
            None, None, None, datetime.min.replace(tzinfo=timezone(timedelta(hours=1)))
        )


@pytest.mark.parametrize("value", [5, b"perception", ["perception"], True, "a\0b", "\ud800"])
def test_actor_and_reason_are_text_that_a_database_can_keep(value: object) -> None:
    with pytest.raises(InvalidMetadataError, match=r"^actor "):
        canonical.make_metadata(value, None, None)  # type: ignore[arg-type]
    with pytest.raises(InvalidMetadataError, match=r"^reason "):
        canonical.make_metadata(None, value, None)  # type: ignore[arg-type]


@given(st.datetimes(datetime(1, 1, 3), datetime(9999, 12, 30)), st.integers(-1439, 1439))
def test_a_moment_is_written_in_utc_with_six_digits_and_read_back(
    local: datetime, minutes_east: int
) -> None:
    moment = local.replace(tzinfo=timezone(timedelta(minutes=minutes_east)))
    text = canonical.time_text(moment)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", text)
    assert canonical.text_time(text) == moment
