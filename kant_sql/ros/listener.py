"""Follow the revisions of a node: each once, in order, despite losses and restarts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

# Seconds between checks for missing revisions, and until a request counts as lost.
PERIOD, PATIENCE = 1.0, 5.0


class Follower:
    """Delivers revisions in order, and requests missing ones.

    Attributes:
        last: the number of the last delivered revision.
    """

    def __init__(self, deliver: Callable[[Any], object], ask: Callable[[int], bool], after: int):
        self.last = after
        self._deliver, self._ask = deliver, ask
        # The newest known revision; None until the node reports one.
        self._head: int | None = None
        self._asked = -PATIENCE
        # The threads of an executor may bring a message and an answer at the same time.
        self._lock = threading.RLock()

    def look(self) -> None:
        """Request missing revisions, unless that was done lately."""
        with self._lock:
            is_behind = self._head is None or self.last < self._head
            now = time.monotonic()
            if is_behind and now > self._asked + PATIENCE and self._ask(self.last):
                self._asked = now

    def take(self, revisions: Iterable[Any], head: int = 0, is_answer: bool = False) -> None:
        """Deliver the next of these revisions; `head` is the number of the newest one."""
        with self._lock:
            before = self.last
            for revision in revisions:
                head = max(head, revision.number)
                if revision.number == self.last + 1:
                    self._deliver(revision)
                    self.last += 1
            self._head = max(self._head or 0, head)
            if is_answer and self.last > before:
                self._asked = -PATIENCE
            self.look()


def follow(
    node: Any, deliver: Callable[[Any], object], *, after: int = 0, name: str = "kant_sql"
) -> Follower:
    """Call a function with each revision of a knowledge base, while the caller's node spins.

    Args:
        node: the caller's node.
        deliver: takes a `kant_sql_msgs/msg/Revision`; if it raises, it gets the same one again.
        after: the last processed revision, 0 for none: store the follower's `last`, and pass it
            here after a restart.
        name: the name of the node to follow, with its namespace.
    """
    from kant_sql_msgs.msg import Revision
    from kant_sql_msgs.srv import GetRevisions
    from rclpy.qos import DurabilityPolicy, QoSProfile

    client = node.create_client(GetRevisions, f"{name}/get_revisions")

    def ask(last: int) -> bool:
        if client.service_is_ready():
            client.call_async(GetRevisions.Request(after=last)).add_done_callback(answered)
        return bool(client.service_is_ready())

    def answered(future: Any) -> None:
        answer = future.result()
        if not answer.success:
            node.get_logger().error(f"{name}/get_revisions: {answer.error_info}")
        else:
            follower.take(answer.revisions, answer.head, is_answer=True)

    follower = Follower(deliver, ask, after)
    durable = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Revision, f"{name}/changes", lambda one: follower.take([one]), durable)
    node.create_timer(PERIOD, follower.look)
    return follower
