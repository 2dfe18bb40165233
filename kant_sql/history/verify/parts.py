"""The parts of a revision whose seed an erasure destroyed.

Form 2 of the hash covers commitments. The table `commitment` keeps the commitment of erased parts;
for all others, it keeps the salt, which was derived from the seed before.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from json.encoder import encode_basestring
from typing import Any, NamedTuple

from sqlalchemy import select

from ...knowledge.canonical import SAID, Metadata, commit_to, salt_of
from ...sql.changes import in_range
from ...sql.dialects.base import Row
from ...sql.query import Query, in_list
from ...sql.rows import KB, table_of
from ...sql.tables import CommitmentRow

# Positions before the changes: actor, reason and source, and a whole revision of form 1.
SAID_AT = {label: -3 + index for index, label in enumerate(reversed(SAID))}
WHOLE, WHOLE_AT = "revision", -4


class Part(NamedTuple):
    """A row of `commitment`, without its knowledge base and its revision."""

    position: int
    sign: str
    kind: str
    owner_id: int
    place: int
    salt: bytes | None
    commitment: str | None
    erasure_id: int | None

    @property
    def key(self) -> tuple[Any, ...]:
        """The key that it shares with its change."""
        return self[1:5]

    def commit_to(self, text: str | None) -> str:
        """Return the commitment to the present text; the kept one if the text is erased."""
        salt, commitment, erasure_id = self[5:]
        if (salt is None) == (erasure_id is None) or (commitment is None) != (erasure_id is None):
            return ""
        if commitment is not None:
            return commitment if text is not None else ""
        return "" if text is None or salt is None else commit_to(salt, text)


_PART = table_of(CommitmentRow).c
_PARTS = select(_PART.number, *(_PART[name] for name in Part._fields)).where(_PART.kb_id == KB)
_IN_ORDER = _PART.number, _PART.position
READ_PARTS = Query(_PARTS.where(in_range(_PART.number)).order_by(*_IN_ORDER))
PARTS_OF = Query(_PARTS.where(in_list(_PART.number, "numbers")).order_by(*_IN_ORDER))


def kept_parts(seed: bytes, metadata: Metadata, changes: Iterable[Row]) -> list[Part]:
    """Derive the parts of a revision from its seed, all of them kept."""
    # `changes` has sign, kind, text, owner and place of each, in the order of the hash.
    said = [
        Part(SAID_AT[label], "", label, 0, 0, salt_of(seed, label, text), None, None)
        for label, text in zip(SAID, metadata[:3], strict=True)
        if text is not None
    ]
    return said + [
        Part(position, sign, kind, owner, place, salt_of(seed, sign + kind, text), None, None)
        for position, (sign, kind, text, owner, place) in enumerate(changes)
    ]


def whole_part(digest: str) -> Part:
    """Make the part that keeps the hash of a revision of form 1; it has no erasure's id yet."""
    return Part(WHOLE_AT, "", WHOLE, 0, 0, None, digest, 0)


# A pseudonym is this and a number.
PREFIX = "erased-"


def said_in_place(pseudonym: str, labels: Iterable[str]) -> dict[str, str]:
    """Return the replacements of actor, reason or source: the source is JSON."""
    return {
        label: encode_basestring(pseudonym) if label == "source" else pseudonym for label in labels
    }


def committed(
    parts: Sequence[Part], metadata: Metadata, changes: Iterable[Row], is_archived: bool
) -> tuple[list[str | None], list[tuple[str, str, str]]]:
    """Match parts with their texts; without a part, or with the wrong one, the result is empty.

    Returns the commitments to actor, reason and source, and sign, kind and commitment of changes.
    """
    # `changes` has sign, kind, text, owner and place of each; as `is_archived`, some may be in an
    # archive.
    said = {part.position: part for part in parts if part.position < 0}
    texts = {(sign, kind, *key): text for sign, kind, text, *key in changes}
    lines = []
    for place, part in enumerate(each for each in parts if each.position >= 0):
        text = texts.pop(part.key, None)
        if text is None and is_archived:
            if part.commitment is None:
                continue
            text = ""
        commitment = part.commit_to(text) if part.position == place else ""
        lines.append((part.sign, part.kind, commitment))
    own = []
    for label, text in zip(SAID, metadata[:3], strict=True):
        of_label = said.pop(SAID_AT[label], None)
        if of_label is None:
            own.append(None if text is None else "")
        else:
            is_own = of_label.key == ("", label, 0, 0)
            own.append(of_label.commit_to(text) if is_own else "")
    # Texts without a part, and parts without a text, must make the hash wrong.
    doubled = len(parts) - len({part.position for part in parts})
    rest = [("", "", "") for _ in (*texts, *said, *range(doubled))]
    return own, lines + rest
