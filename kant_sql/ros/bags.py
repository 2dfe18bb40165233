"""Recordings of the node as revisions: what was said to it, with the times of the recording.

A bag of ROS 2 (rosbag2) is read by `rosbags`, which needs no ROS.
"""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from ..compat import DaoFactory
from ..errors import ExtraMissingError, InvalidArgumentError, KantSqlError, SourceError
from ..knowledge_base import KnowledgeBase, factory_of
from .experts import ProblemExpert
from .paper import services as paper_services

logger = logging.getLogger(__name__)

EVENT = "/_service_event"
# service_msgs/msg/ServiceEventInfo: the server has received a request.
RECEIVED = 1
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Imported(NamedTuple):
    """What was read of a bag.

    Attributes:
        messages: the messages that said something.
        revisions: the revisions that they made; what was known already makes none.
        refused: the messages that could not be taken over; the log says why.
    """

    messages: int
    revisions: int
    refused: int


def import_bag(kb: KnowledgeBase, path: str | Path) -> Imported:
    """Take over a recording of requests to the node's services, and of its changes.

    A request is what a service event of `kant_msgs` or of PlanSys2's problem expert holds, or a
    message of `~/changes`. Each is one revision, with its time in the bag as `observed_at`.

    Args:
        kb: the knowledge base that is written.
        path: the folder of the bag, or its MCAP file.

    Raises:
        ExtraMissingError: `rosbags` is not installed.
        SourceError: the bag cannot be read.
        InvalidArgumentError: it has none of these messages.
    """
    answers = _answers(kb)
    before = kb.revision
    count = refused = 0
    for said in _read(Path(path), set(answers)):
        count += 1
        at = _EPOCH + timedelta(microseconds=said.time // 1000)
        source = {"bag": str(path), "topic": said.topic}
        try:
            with kb.transaction(observed_at=at, source=source):
                answers[said.name](said.message, SimpleNamespace())
        except KantSqlError as error:
            refused += 1
            logger.warning("%s at %s: %s", said.topic, at.isoformat(), error)
    if not count:
        raise InvalidArgumentError(
            f"{path} has no request to a service of the node and no message of ~/changes; record "
            "with service introspection, for example: ros2 bag record --service --all"
        )
    return Imported(count, kb.revision - before, refused)


class _Said(NamedTuple):
    """A message: its topic, what it is for, its time in nanoseconds, and its content."""

    topic: str
    name: str
    time: int
    message: Any


def _answers(kb: KnowledgeBase) -> dict[str, Callable[[Any, Any], None]]:
    """Return what takes over a message, by the name of its service, or by its type."""
    made = _Anything()
    paper = paper_services(DaoFactory.of(factory_of(kb)), made, made, SimpleNamespace)
    services = [*paper, *ProblemExpert(kb, made).services(made)]
    reads = ("get_", "exist_", "is_")
    answers = {
        each.name: each.answer
        for each in services
        if not each.name.rpartition("/")[2].startswith(reads)
    }
    return {**answers, "Revision": lambda message, _: _replay(kb, message)}


class _Anything:
    """Stands for the modules of messages, of which an import makes none."""

    def __getattr__(self, name: str) -> Callable[..., object]:
        return SimpleNamespace


def _replay(kb: KnowledgeBase, revision: Any) -> None:
    """Write the changes of a revision again; plans and documents stay behind."""
    daos: dict[str, Any] = {
        "type": kb.types,
        "object": kb.objects,
        "predicate": kb.predicates,
        "function": kb.functions,
        "action": kb.actions,
        "fact": kb.propositions,
        "value": kb.function_values,
        "goal": kb.goals,
    }
    order = list(daos)
    changes = [each for each in revision.changes if each.kind in daos]
    # What others are built on is saved before them, and deleted after them.
    for change in sorted(changes, key=lambda one: order.index(one.kind)):
        if change.sign == "+":
            daos[change.kind].save(change.text)
    for change in sorted(changes, key=lambda one: -order.index(one.kind)):
        if change.sign == "-":
            daos[change.kind].delete(change.text)


def _read(path: Path, names: set[str]) -> Iterator[_Said]:
    """Yield the messages of a bag that are for one of these names, in their order."""
    try:
        from rosbags.rosbag2 import Reader, ReaderError
    except ImportError as error:
        raise ExtraMissingError("this needs rosbags; run: pip install 'kant-sql[bags]'") from error
    try:
        with Reader(path) as reader:
            wanted = {one.topic: _name(one.topic, one.msgtype, names) for one in reader.connections}
            chosen = [one for one in reader.connections if wanted[one.topic]]
            store = _types(chosen)
            for connection, time, raw in reader.messages(chosen) if chosen else ():
                message = store.deserialize_cdr(raw, connection.msgtype)
                for part in _requests(connection.topic, message):
                    yield _Said(connection.topic, wanted[connection.topic] or "", time, part)
    except (ReaderError, OSError) as error:
        raise SourceError(errno.EINVAL, f"is no bag of ROS 2: {error}", str(path)) from error


def _types(connections: list[Any]) -> Any:
    """Read the types of messages from the definitions in a bag."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for connection in connections:
        text = connection.msgdef.data
        is_msg = connection.msgdef.format.name == "MSG"
        made = get_types_from_msg(text, connection.msgtype) if is_msg else get_types_from_idl(text)
        # rosbags takes each type for one of a message, and those of services are not.
        own = {name.replace("/srv/msg/", "/srv/"): parts for name, parts in made.items()}
        store.register({name: parts for name, parts in own.items() if name not in store.types})
    return store


def _name(topic: str, kind: str, names: set[str]) -> str | None:
    """Return which of the names a topic is for; namespaces come before it."""
    if kind == "kant_sql_msgs/msg/Revision":
        return "Revision"
    service = topic.removesuffix(EVENT)
    found = [one for one in names if service.endswith(f"/{one}")]
    return found[0] if found and service != topic else None


def _requests(topic: str, message: Any) -> list[Any]:
    if not topic.endswith(EVENT):
        return [message]
    return list(message.request) if message.info.event_type == RECEIVED else []
