"""Live events: one watching thread per knowledge base notifies all readers of new revisions.

Readers get only the last revision, at most twice a second, so many readers and a busy writer do not
burden each other.
"""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from datetime import datetime
from functools import partial
from typing import Annotated, NamedTuple

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import StreamingResponse

from ..errors import KantSqlError, StoreBusyError, UnknownRevisionError
from ..json_values import json_value
from ..knowledge_base import KnowledgeBase
from .registry import KbName
from .rendering import shorten
from .stores import OpenStore, answer

# Seconds between two events of one knowledge base.
PAUSE = 0.5
# Seconds between reads of all heads, for the home page.
LOOK_EVERY = 1.0
# Seconds that a thread waits for a revision, and pauses after a failure.
WATCH_FOR, RECOVER = 5.0, 1.0
# Seconds between signs of life to a reader.
HEARTBEAT = 15.0
# Seconds that a thread continues after the last reader has left: most open another page.
LINGER = 10.0
# Milliseconds until a browser connects again.
RETRY = 2_000
THREAD = "kant_sql live"
MOST_READERS, MOST_WATCHED = 500, 32


logger = logging.getLogger("kant_sql.web")


class LiveEvent(NamedTuple):
    """The last revision of a knowledge base; of the home page, how many all have together."""

    knowledge_base: str | None
    revision: int
    committed_at: datetime | None
    actor: str | None
    reason: str | None
    message: str


class LiveFeed:
    """The events for the readers of one knowledge base. All but `tell` is for the event loop."""

    def __init__(self) -> None:
        self.readers = 0
        self.is_over = threading.Event()  # set when nobody reads any more
        self._loop = asyncio.get_running_loop()
        self._last: LiveEvent | None = None
        self._changed = asyncio.Event()

    def tell(self, event: LiveEvent) -> None:
        """Notify all readers; the watching thread calls this."""
        # After the end of the loop nobody reads.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._tell, event)

    def _tell(self, event: LiveEvent) -> None:
        self._last = event
        self.wake()

    def wake(self) -> None:
        """Wake all readers."""
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def following(self, seen: int | None, seconds: float) -> LiveEvent | None:
        """Wait for a revision after the last seen one; return None after a timeout."""
        if self._news(seen) is None:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), seconds)
        return self._news(seen)

    def _news(self, seen: int | None) -> LiveEvent | None:
        last = self._last
        return None if last is None or last.revision == seen else last


class LiveHub:
    """The feeds of a store. All but `close` is for the event loop."""

    def __init__(self, store: OpenStore) -> None:
        self._store = store
        self._feeds: dict[str | None, LiveFeed] = {}
        self._readers = 0
        self.is_closed = False

    def admit(self, name: str | None) -> None:
        """Raise if there are too many readers."""
        is_new = name not in self._feeds
        if self._readers >= MOST_READERS or (is_new and len(self._feeds) > MOST_WATCHED):
            raise StoreBusyError("too many readers follow live changes; reload the page instead")

    def join(self, name: str | None) -> LiveFeed:
        """Become a reader of a knowledge base, or of the home page."""
        feed = self._feeds.get(name)
        if feed is None:
            feed = self._feeds[name] = LiveFeed()
            watch = watch_store if name is None else watch_knowledge_base
            arguments = (self._store, feed, name)
            threading.Thread(target=watch, args=arguments, name=THREAD, daemon=True).start()
        feed.readers += 1
        self._readers += 1
        return feed

    def leave(self, name: str | None, feed: LiveFeed) -> None:
        """Read no more; the thread ends when nobody comes back soon."""
        feed.readers -= 1
        self._readers -= 1
        if not feed.readers:
            asyncio.get_running_loop().call_later(LINGER, self._end, name, feed)

    def _end(self, name: str | None, feed: LiveFeed) -> None:
        if not feed.readers and self._feeds.get(name) is feed:
            del self._feeds[name]
            feed.is_over.set()

    def close(self) -> None:
        """End all streams and threads."""
        self.is_closed = True
        for feed in self._feeds.values():
            feed.is_over.set()
            feed.wake()


def watch_knowledge_base(store: OpenStore, feed: LiveFeed, name: str) -> None:
    """Send each new revision until nobody reads; outages of the store are survived."""
    seen: int | None = None
    while not feed.is_over.is_set():
        try:
            with store.knowledge_base(name) as kb:
                while not feed.is_over.is_set():
                    seen = _watch(kb, name, feed, seen)
        except UnknownRevisionError:
            # The store was put back to an earlier state.
            seen = None
        except KantSqlError:
            feed.is_over.wait(RECOVER)
        except Exception as error:
            logger.error("following %r failed, trying again", name, exc_info=error)
            feed.is_over.wait(RECOVER)


def _watch(kb: KnowledgeBase, name: str, feed: LiveFeed, seen: int | None) -> int:
    head = kb.revision if seen is None else kb.watch(seen, timeout=WATCH_FOR)
    if head is None:
        assert seen is not None
        return seen
    feed.tell(_event(kb, name, head))
    # Revisions written meanwhile come with the next event.
    feed.is_over.wait(PAUSE)
    return head


def _event(kb: KnowledgeBase, name: str, head: int) -> LiveEvent:
    revision = next(iter(kb.store.revisions(head - 1, limit=1)), None) if head else None
    if revision is None:
        return LiveEvent(name, head, None, None, None, f"Revision {head}")
    who = "" if revision.actor is None else f" by {shorten(revision.actor, 60)}"
    why = "" if revision.reason is None else f": {shorten(revision.reason, 120)}"
    said = revision.committed_at, revision.actor, revision.reason
    return LiveEvent(name, head, *said, f"Revision {head}{who}{why}")


def watch_store(store: OpenStore, feed: LiveFeed, _: None) -> None:
    """Send an event for each new revision of any knowledge base, until nobody reads."""
    seen = None
    while not feed.is_over.is_set():
        with suppress(KantSqlError):
            count, revisions = store.read_catalog(lambda catalog: catalog.total())
            if revisions != seen:
                kbs = "1 knowledge base" if count == 1 else f"{count:,} knowledge bases"
                message = f"{kbs}, {revisions:,} revisions"
                feed.tell(LiveEvent(None, revisions, None, None, None, message))
                seen = revisions
        feed.is_over.wait(LOOK_EVERY)


live = APIRouter()

AfterRevision = Annotated[
    int | None,
    Query(ge=0, description="The revision that the reader has; newer ones are sent at once."),
]
LastEvent = Annotated[str | None, Header(alias="Last-Event-ID")]


@live.get("/live", include_in_schema=False)
@live.get(
    "/api/live",
    tags=["live"],
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}}},
)
async def events(
    request: Request,
    kb_name: KbName = None,
    after: AfterRevision = None,
    last_event_id: LastEvent = None,
) -> StreamingResponse:
    """Follow a knowledge base, or without `kb` all: server-sent events.

    Each event `revision` has the number of the last revision as its id, and a document with
    `knowledge_base`, `revision`, `committed_at`, `actor`, `reason` and `message` as its data.
    One event may cover several revisions. To reconnect without a gap, send the last id in the
    header `Last-Event-ID`. The stream ends when its token is revoked.
    """
    store: OpenStore = request.app.state.store
    hub: LiveHub = request.app.state.live
    if kb_name is not None:
        await answer(request, lambda: store.require(kb_name))
    seen = after
    if last_event_id is not None and last_event_id.isascii() and last_event_id.isdigit():
        # As many digits as revisions have: a longer one is not a number to Python, either.
        seen = int(last_event_id[:20])
    hub.admit(kb_name)
    return StreamingResponse(
        _stream(hub, kb_name, seen, partial(request.app.state.accepts, request.scope)),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _stream(
    hub: LiveHub, name: str | None, seen: int | None, is_accepted: Callable[[], bool]
) -> AsyncIterator[str]:
    if hub.is_closed:
        return  # Nobody would end the thread.
    # Not before: of a reader who leaves at once, this never begins.
    feed = hub.join(name)
    try:
        yield f"retry: {RETRY}\n\n"
        while not hub.is_closed:
            event = await feed.following(seen, HEARTBEAT)
            if not is_accepted():
                break
            if event is not None:
                seen, data = event.revision, json.dumps(json_value(event))
                yield f"id: {seen}\nevent: revision\ndata: {data}\n\n"
            elif not hub.is_closed:
                yield ": nothing new\n\n"
    finally:
        hub.leave(name, feed)
