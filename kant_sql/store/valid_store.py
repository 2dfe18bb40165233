"""One knowledge base at a valid time, read-only."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from typing_extensions import override

from ..errors import ReadOnlyError
from ..sql.dialects.base import Session, WriterLock
from ..sql.valid_time import ValidTime
from .caches import DefinitionCache
from .snapshot import open_view
from .store import Store

T = TypeVar("T")

# A first question reads definitions, then answers. Only from the second one on is it worthwhile to
# list the sayings about the time.
FIRST_USES = 1


class ValidStore(Store):
    """Reads the state at a valid time, as known at a revision, on a store's connections."""

    def __init__(self, origin: Store, valid: ValidTime) -> None:
        vars(self).update(vars(origin))
        self.origin = origin
        self.valid = valid  # the time and the revision
        # Definitions differ from those of the same revision of the store.
        self._definitions = DefinitionCache()
        self._uses = 0  # since it is prepared

    @property
    @override
    def is_closed(self) -> bool:
        return self.origin.is_closed

    @override
    def described(self, at: int) -> str:
        return str(self.valid)

    @override
    def _take_session(self) -> Session:
        self.refuse_closed()
        return super()._take_session()

    @override
    def _outside(
        self, work: Callable[[Session], T], take: Callable[[], Session] | None = None
    ) -> T:
        def overlaid(session: Session) -> T:
            if self.valid.misfits is None:
                self._prepare(session)
            elif self.valid.said is None and self.valid.kb_id is not None:
                self._uses += 1
                if self._uses > FIRST_USES:
                    self.valid = self.valid.with_said(session)
            with session.overlaid(self.valid):
                return work(session)

        return super()._outside(overlaid, take)

    def _prepare(self, session: Session) -> None:
        """Find misfits; share the definitions of the revision unless some ended since."""
        valid, known = self.valid, self.origin._definitions
        valid.kb_id = self._find(session)
        if valid.kb_id is not None:
            view = open_view(session, valid.kb_id, known, valid.known, valid.oldest)
            if not valid.find_misfits(session, view.definitions):
                self._definitions.adopt(known, valid.known, view.definitions)

    @override
    def query_once(self, work: Callable[[Session, int | None], T]) -> T:
        return self.query(work)

    @override
    def queue_up(self) -> WriterLock | None:
        raise ReadOnlyError(
            f"this is knowledge base {self.name!r} as it was at {self.valid}: the past cannot be "
            "changed; give the period to kb.transaction(valid_from=, valid_until=)"
        )
