"""The canonical form of a revision, and its hash. `docs/hash.md` specifies it.

The form is one JSON document as RFC 8785 (JSON Canonicalization Scheme) writes it, so that anyone
can recompute a hash from the tables in any language.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from hashlib import sha256
from json.encoder import encode_basestring
from typing import NamedTuple

import rfc8785

from .arguments import shown
from .errors import InvalidMetadataError

# What new revisions are hashed as; form 1 has neither `observed_at` nor `plan_step`.
FORM = 2
_BATCH = 1_000


class Metadata(NamedTuple):
    """What a writer says of its revision.

    Attributes:
        actor: the component that writes.
        reason: why.
        source: a JSON document in canonical form, or None.
        observed_at: when what it says was sensed, in UTC.
        plan_step: the step that is running: the id of its plan, and its position.
    """

    actor: str | None
    reason: str | None
    source: str | None
    observed_at: datetime | None = None
    plan_step: tuple[int, int] | None = None


def time_text(moment: datetime) -> str:
    """Write a moment the way that SQLite stores it and that the hash covers.

    Args:
        moment: an aware time.

    Returns:
        ISO 8601 in UTC with microseconds, for example `2026-01-31T09:30:00.000000Z`; texts sort
        as the moments do.
    """
    return moment.astimezone(UTC).isoformat(timespec="microseconds")[:26] + "Z"


def make_metadata(
    actor: str | None,
    reason: str | None,
    source: object | None,
    observed_at: datetime | None = None,
    plan_step: tuple[int, int] | None = None,
) -> Metadata:
    """Check what a writer says of its revision, and bring it into canonical form.

    Args:
        actor: the component that writes.
        reason: why.
        source: anything that JSON can say: what sensor, what plan step.
        observed_at: when what it says was sensed, with its zone.
        plan_step: the step that is running: the id of its plan, and its position.

    Returns:
        The metadata.

    Raises:
        InvalidMetadataError: actor or reason is no text that a database can keep, source is not
            JSON, as RFC 8785 restricts it (integers up to 2**53, no NaN), or the time has no zone.
    """
    own = (_observed(observed_at), plan_step)
    for name, value in (("actor", actor), ("reason", reason)):
        if value is None:
            continue
        if not isinstance(value, str):
            raise InvalidMetadataError(f"{name} is a string or None, not {shown(value)}")
        if "\0" in value or any("\ud800" <= character <= "\udfff" for character in value):
            raise InvalidMetadataError(f"{name} {shown(value)} has a NUL or half a character")
    if source is None:
        return Metadata(actor, reason, None, *own)
    try:
        text = rfc8785.dumps(source).decode()  # type: ignore[arg-type]
    except (rfc8785.CanonicalizationError, UnicodeError, RecursionError, TypeError) as error:
        raise InvalidMetadataError(f"source is not a JSON document: {error}") from error
    return Metadata(actor, reason, text, *own)


def _observed(moment: datetime | None) -> datetime | None:
    if moment is None:
        return None
    if not isinstance(moment, datetime) or moment.utcoffset() is None:
        raise InvalidMetadataError(
            f"observed_at is a time with its zone, not {shown(moment)}; give it one, as UTC"
        )
    try:
        return moment.astimezone(UTC)
    except OverflowError as error:
        raise InvalidMetadataError(
            f"observed_at {moment.isoformat()} lies outside the years 1 to 9999 in UTC"
        ) from error


def revision_hash(
    previous: str | None,
    knowledge_base: str,
    number: int,
    committed_at: str,
    metadata: Metadata,
    changes: Iterable[tuple[str, str, str]],
    form: int = FORM,
) -> str:
    """Hash a revision, chained to the one before. Memory does not grow with the changes.

    Args:
        previous: the hash of the revision before; None for the first.
        knowledge_base: the knowledge base's name.
        number: the revision's number.
        committed_at: its time in UTC, `2026-01-31T09:30:00.000000Z`.
        metadata: who, why and from what.
        changes: sign, kind and text of each change, sorted by code points.
        form: 1, or 2, which says more.

    Returns:
        The SHA-256 of the canonical document, 64 hexadecimal digits.
    """
    digest = sha256(f'{{"actor":{_json(metadata.actor)},"changes":['.encode())
    separator = ""
    batch: list[str] = []
    for sign, kind, text in changes:
        batch.append(f'["{sign}","{kind}",{encode_basestring(text)}]')
        if len(batch) == _BATCH:
            digest.update((separator + ",".join(batch)).encode())
            separator = ","
            batch.clear()
    if batch:
        digest.update((separator + ",".join(batch)).encode())
    more = "" if form == 1 else _more(metadata)
    digest.update(
        f'],"committed_at":"{committed_at}","form":{form},'
        f'"knowledge_base":{_json(knowledge_base)},"number":{number},{more}'
        f'"previous":{_json(previous)},"reason":{_json(metadata.reason)},'
        f'"source":{metadata.source or "null"}}}'.encode()
    )
    return digest.hexdigest()


def _more(metadata: Metadata) -> str:
    observed_at = None if metadata.observed_at is None else time_text(metadata.observed_at)
    step = "null" if metadata.plan_step is None else "[{},{}]".format(*metadata.plan_step)
    return f'"observed_at":{_json(observed_at)},"plan_step":{step},'


def _json(text: str | None) -> str:
    return "null" if text is None else encode_basestring(text)
