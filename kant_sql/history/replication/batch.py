"""One batch of revisions: copied, checked against its hashes, and committed with the head."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial

from sqlalchemy import bindparam

from ...errors import StoreIntegrityError, reading_rows
from ...knowledge.canonical import text_time, time_text
from ...sql.changes import FEW, few_change_rows
from ...sql.dialects.base import Backend, Row, Session
from ...sql.query import integer
from ...store.head import MOVED, Head, set_head
from ..verify.chain import Link, Step, stream_chain
from .copy import Copied, Copy, CopyRange, Stores
from .erasures import Followed
from .target import HeadState, ReplicationSide

logger = logging.getLogger("kant_sql.history")

# Versions per transaction, as far as whole revisions allow.
ROWS = 20_000
FIRST_REVISIONS = 50


class Batches:
    """The batches of one call: counts their versions, and chooses the size of the next one."""

    def __init__(self) -> None:
        self.versions = 0
        self.erasures = 0
        self._revisions = FIRST_REVISIONS

    def following(self, here: HeadState, head: Head, upto: int, may_return: bool) -> CopyRange:
        """Return the next revisions after a target's head, up to one of the source."""
        # A replica gets an erasure only as a whole.
        high = min(upto, max(head.revision + self._revisions, here.erased))
        redefined = here.definition_revision > head.revision
        return CopyRange(head.revision + 1, high, may_return, redefined, here.erased)

    def add(self, copied: Copied) -> None:
        """Count the versions of a batch, and adapt the size of the next one."""
        self.versions += copied.rows
        self.erasures += copied.erasures
        if copied.rows < ROWS // 2:
            self._revisions *= 2
        elif copied.rows > ROWS:
            self._revisions = max(1, self._revisions * ROWS // copied.rows)


def wipe(backend: Backend) -> tuple[str, ...]:
    """Remove bytes of texts that a target erased; return where some may remain."""
    remaining = backend.wipe()
    for place in remaining:
        logger.warning("%s: bytes of what was erased may remain in %s", backend.label, place)
    return remaining


_MOVE = set_head(
    **MOVED,
    origin=bindparam("label"),
    origin_revision=integer("last"),
    origin_committed_at=bindparam("last_time"),
    heard_at=bindparam("now"),
)


def copy_batch(
    stores: Stores, source: ReplicationSide, here: HeadState, head: Head, bounds: CopyRange
) -> Copied:
    """Copy some revisions into a locked target, check their hashes there, and commit."""
    # A batch with a wrong hash raises, and writes nothing. `here` is the source's head.
    name = source.name
    place = f"{_several(bounds)} of knowledge base {name!r} of {stores.source.backend.label}"
    followed = Followed(stores, name, bounds)
    with _naming_both(stores, name, bounds), reading_rows("revision", place):
        followed.erase()
        copied = Copy(stores, bounds).run()
    with reading_rows("revision", place):
        last = _check(stores, name, head, bounds, copied)
        followed.check()
    _, _, target, target_kb = stores
    # A promoted replica must not give out an id of the origin again.
    given_out = here.next_id if bounds.high == here.revision else 0
    next_id = max(head.next_id, copied.largest_id + 1, given_out)
    definitions = max(head.definition_revision, copied.definition_revision)
    with _naming_both(stores, name, bounds):
        move(target, target_kb, source, here, head, last, definitions, next_id)
        target.commit(target_kb)
    return copied._replace(erasures=len(followed.ids))


@contextmanager
def _naming_both(stores: Stores, name: str, bounds: CopyRange) -> Iterator[None]:
    """Name both stores if rows are refused: a constraint does not show which were altered."""
    try:
        yield
    except StoreIntegrityError as error:
        labels = stores.source.backend.label, stores.target.backend.label
        here, there = (
            f"'kant-sql verify {label} --kb {shlex.quote(str(name))}'" for label in labels
        )
        raise StoreIntegrityError(
            f"{_several(bounds)} of knowledge base {name!r} cannot be copied from {labels[0]} to "
            f"{labels[1]}, and nothing of these was written: {error}. One of the stores was "
            f"changed by hand: {here} and {there} show which; restore that one from a copy"
        ) from error


def move(
    target: Session,
    kb_id: int,
    source: ReplicationSide,
    here: HeadState,
    head: Head,
    last: Link | None,
    definition_revision: int,
    next_id: int,
) -> None:
    """Move the head of a replica and the state of its origin; without `last`, only the latter."""
    number, digest = (head.revision, head.hash) if last is None else (last.number, last.hash)
    at = head.committed_at if last is None else text_time(last.committed_at)
    moments = (at, here.committed_at, head.clock)
    time, last_time, now = (
        None if moment is None else target.from_time(moment, time_text(moment))
        for moment in moments
    )
    target.run(
        _MOVE,
        kb=kb_id,
        number=number,
        definitions=definition_revision,
        next=next_id,
        digest=digest,
        time=time,
        label=source.backend.label,
        last=here.revision,
        last_time=last_time,
        now=now,
    )


def _check(stores: Stores, name: str, head: Head, bounds: CopyRange, copied: Copied) -> Link:
    """Recompute the hashes of copied revisions, from the target; return the last revision."""
    previous = head.hash
    earliest = "" if head.committed_at is None else time_text(head.committed_at)
    expected, last, wrong = bounds.low, None, partial(_wrong, stores, name, bounds)
    for step in _steps(stores, bounds, copied):
        link = step.link
        if link is None or link.number != expected or link.number > bounds.high:
            raise wrong(expected, "is missing")
        if link.fault is not None:
            raise wrong(expected, f"cannot be read: {link.fault}")
        if not link.is_readable or link.committed_at < earliest:
            raise wrong(expected, "has an invalid time, or one that goes back")
        digest = link.digest(name, previous, step.changes)
        if digest != link.hash:
            what = f"has the hash {link.hash}, and its contents have {digest}"
            raise wrong(expected, what)
        previous, earliest, expected, last = link.hash, link.committed_at, expected + 1, link
    if last is None or last.number != bounds.high:
        raise wrong(expected, "is missing")
    return last


def _steps(stores: Stores, bounds: CopyRange, copied: Copied) -> Iterable[Step]:
    _, _, target, target_kb = stores
    low, high = bounds.low, bounds.high
    changes: Iterable[Row] | None = None
    if copied.rows <= FEW // 2:
        # Sorting them here takes less time than in the database.
        changes = few_change_rows(target, target_kb, low, high, bounds.redefined)
    return stream_chain(target, target_kb, low, high, changes)


def _several(bounds: CopyRange) -> str:
    low, high = bounds.low, bounds.high
    return f"revisions {low} to {high}" if high > low else f"revision {low}"


def _wrong(
    stores: Stores, name: str, bounds: CopyRange, number: int, what: str
) -> StoreIntegrityError:
    source, target = stores.source.backend.label, stores.target.backend.label
    return StoreIntegrityError(
        f"{source}: revision {number} of knowledge base {name!r} {what}; nothing of "
        f"{_several(bounds)} was written to {target}: 'kant-sql verify' shows what was altered; "
        f"restore {source} from a copy"
    )
