"""Recordings of the node as revisions, with the times of the recording.

A bag of ROS 2 (rosbag2) is read by `rosbags`, which needs no ROS.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import patch

from ..compat import DaoFactory
from ..errors import (
    InvalidArgumentError,
    KantSqlError,
    NotApplicableError,
    ReadOnlyError,
    ReplicaError,
    StoreError,
    needing,
)
from ..knowledge_base import KnowledgeBase, factory_of, state_of
from . import own, paper
from .experts import ProblemExpert

logger = logging.getLogger("kant_sql.ros")

_Key = tuple[str, str]  # the type of a topic, and the last word of its name
_Taker = Callable[[Any, Any], object]

_CHANGES = ("kant_sql_msgs/msg/Revision", "changes")
_EVENT = "/_service_event"
# Of service_msgs/msg/ServiceEventInfo: what the server says of a call.
_RECEIVED, _ANSWERED = 1, 2
# In a bag, a line before each definition but the first; a service has one, too.
_LINE = "=" * 80 + "\n"
_SERVICE = re.compile(rf"{_LINE}SRV: (.*)\n((?:.*\n)*?)---.*\n?")
# What a definition or a value is of: `rb1`, `move`, `(robot_at`, `(= (battery rb1)`.
_NAMED = re.compile(r"(?:\(:\S+ )?(\(= \(.*?\)|\S+)")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_RECORD = (
    "record the node's topic, such as: ros2 bag record /kant_sql/changes; or its services, when it "
    "runs with -p introspection:=true: ros2 bag record --all-services"
)
_REPAIR = (
    "of a recording that was cut off, give the .db3 file, or what `mcap recover` makes of the "
    ".mcap file; convert one of ROS 1 with rosbags-convert"
)


class Imported(NamedTuple):
    """The result of an import.

    Attributes:
        messages: the requests and revisions in the bag.
        revisions: the revisions that they made; known content makes none.
        refused: the number that the server or the knowledge base refused; the log says why.
        known: the number up to the last one that was imported before.
    """

    messages: int
    revisions: int
    refused: int
    known: int


class _Said(NamedTuple):
    """A revision or a request, by the id of the revision or of the call; its time is in ns."""

    topic: str
    key: _Key
    time: int
    id: str
    message: Any
    lost: int = 0  # revisions before it that were not recorded
    refusal: str = ""  # why it is omitted


def import_bag(kb: KnowledgeBase, path: str | Path, *, namespace: str | None = None) -> Imported:
    """Import a recording of a node: its revisions, or else the requests to its services.

    Revisions are the messages of `~/changes`, with the changes of every writer, except plans,
    derived predicates and constraints. If there are none, it imports the successful requests to
    KANT's services, to PlanSys2's problem expert and to `~/apply`, from service events.

    Each becomes one revision, with its time in the bag as `observed_at`; a revision from before the
    recording, which the node repeats for late listeners, keeps the time of its commit. Imported
    facts are valid from now on, or with `connect(..., clock="observed")` from their time on. The
    `source` has the bag, the message, and the writer's metadata. The import skips messages up to
    the last known one, so you can continue an interrupted import.

    Args:
        kb: the target knowledge base. It must already have the earlier knowledge of the node, such
            as its domain.
        path: the folder of the bag, or one of its files.
        namespace: the namespace of the node, such as `/rb1`, if the bag has several nodes.

    Raises:
        ExtraMissingError: `rosbags` is not installed.
        InvalidArgumentError: the bag cannot be read, has no such messages, or has messages of
            several nodes.
        StoreError: the knowledge base cannot be written; imported revisions stay.
    """
    path, takers, taken = Path(path), _takers(kb), _Taken(kb)
    known = taken.count(_read(path, takers, namespace))
    count = made = refused = 0
    for count, said in enumerate(_read(path, takers, namespace), start=1):
        if count <= known:
            continue
        at = _EPOCH + timedelta(microseconds=said.time // 1000)
        source = {"bag": path.name, "topic": said.topic, "recorded": said.id}
        actor, reason, of_writer = (
            getattr(said.message, name, "") or None for name in ("actor", "reason", "source")
        )
        if of_writer:
            source["source"] = of_writer
        if said.lost > 0:
            logger.warning("%s at %s: %d revisions before it are lost", said.topic, at, said.lost)
        try:
            if said.refusal:
                raise NotApplicableError(said.refusal)
            with taken.transaction(observed_at=at, source=source, actor=actor, reason=reason):
                if taken.has(said.id):
                    known = count
                else:
                    takers[said.key](said.message, SimpleNamespace())
            made += taken.is_changed
        except (StoreError, ReadOnlyError, ReplicaError):
            raise
        except KantSqlError as error:
            refused += 1
            logger.warning("%s at %s: %s", said.topic, at.isoformat(), error)
    if not count:
        raise InvalidArgumentError(f"{path} has no call with its contents; {_RECORD}")
    return Imported(count, made, refused, known)


class _Taken:
    """The messages that a knowledge base has, and the transactions that import others."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb = kb
        self._ids: set[object] = set()
        self._last = 0  # the last revision that is read, or made here
        self.is_changed = False  # whether the last transaction made a revision
        self._read()

    def _read(self) -> None:
        for revision in self._kb.store.revisions(self._last):
            source = revision.source
            recorded = str(source.get("recorded")) if isinstance(source, dict) else None
            self._ids |= {revision.hash, recorded}
            self._last = revision.number

    def count(self, messages: Iterable[_Said]) -> int:
        """Return the number of messages up to the last imported one."""
        found = (number for number, said in enumerate(messages, start=1) if said.id in self._ids)
        return max(found, default=0) if self._ids else 0

    @contextmanager
    def transaction(self, **said: Any) -> Iterator[None]:
        """Open a transaction; first read the revisions that others have made meanwhile."""
        with self._kb.transaction(**said):
            transaction = state_of(self._kb).store.current()
            assert transaction is not None
            if transaction.head.revision > self._last:
                self._read()
            yield
        self.is_changed = transaction.made is not None
        self._last = transaction.made or self._last

    def has(self, id_: str) -> bool:
        """Return whether a message is imported."""
        return id_ in self._ids


class _Kinds(str):
    """A package, in place of the module of its services: names the types of their events."""

    def __getattr__(self, name: str) -> str:
        return f"{self}/srv/{name}_Event"


def _takers(kb: KnowledgeBase) -> dict[_Key, _Taker]:
    """Return the functions that import messages, by the key of their topic."""
    made: Any = None  # the modules of messages: an import makes no messages
    empty: Any = _Kinds("std_srvs").Empty
    services = (
        *paper.services(DaoFactory.of(factory_of(kb)), made, _Kinds("kant_msgs"), empty),
        *ProblemExpert(kb, made).services(_Kinds("plansys2_msgs")),
        *own.services(kb, made, _Kinds("kant_sql_msgs")),
    )
    takers: dict[_Key, _Taker] = {_CHANGES: lambda message, _: _replay(kb, message)}
    for one in services:
        if not one.is_question:
            takers[one.kind, one.name.rpartition("/")[2]] = one.answer
    return takers


def _replay(kb: KnowledgeBase, revision: Any) -> None:
    """Repeat the changes of a revision."""
    daos: dict[str, Any] = {
        **{"type": kb.types, "object": kb.objects, "predicate": kb.predicates},
        **{"function": kb.functions, "action": kb.actions, "value": kb.function_values},
        **{"fact": kb.propositions, "goal": kb.goals},
    }
    saved = {_element(one) for one in revision.changes if one.sign == "+"}
    kinds = list(daos)
    # Dependencies are saved before their dependants, and deleted after them.
    for sign, chosen in (("-", kinds[:4:-1]), ("+", kinds), ("-", kinds[4::-1])):
        for kind in chosen:
            for one in revision.changes:
                if (one.sign, one.kind) != (sign, kind):
                    continue
                if sign == "+":
                    daos[kind].save(one.text)
                elif _element(one) not in saved:
                    daos[kind].delete(one.text)


def _element(change: Any) -> tuple[str, str]:
    """Return the element of a change: a definition or a fluent is replaced, a fact is not."""
    found = None if change.kind in ("fact", "goal") else _NAMED.match(change.text)
    return change.kind, change.text if found is None else found[1]


def _read(path: Path, keys: Collection[_Key], namespace: str | None) -> Iterator[_Said]:
    """Yield the messages of one node, in the order of the bag."""
    with needing("this needs rosbags; run: pip install 'kant-sql[bags]'"):
        from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
        from rosbags.rosbag2 import Reader, storage_mcap

    def definition(schema: Any) -> Any:
        return MessageDefinition(MessageDefinitionFormat.MSG, schema.data if schema else "")

    try:
        # rosbags refuses a service without messages, whose definition rosbag2 calls `unknown`.
        with patch.object(storage_mcap, "get_msgdef", definition), Reader(path) as reader:
            chosen = _choose(path, reader.connections, keys, namespace)
            store, kinds = _types(reader, chosen)
            messages = (
                (one, time, store.deserialize_cdr(raw, kinds[one.msgtype]))
                for one, time, raw in reader.messages(chosen)
            )
            if _key(chosen[0]) == _CHANGES:
                yield from _revisions(messages, reader.start_time)
            else:
                yield from _requests(messages)
    except KantSqlError:
        raise
    except Exception as error:
        # rosbags raises any error for a damaged file.
        said = str(error).rstrip(".")
        raise InvalidArgumentError(f"cannot read the bag {path}: {said}; {_REPAIR}") from error


def _key(connection: Any) -> _Key:
    return connection.msgtype, connection.topic.removesuffix(_EVENT).rpartition("/")[2]


def _choose(
    path: Path, connections: Iterable[Any], keys: Collection[_Key], namespace: str | None
) -> list[Any]:
    """Choose the connections of one node: that of its revisions, or those of its services."""
    prefix = "/" if namespace is None else f"/{namespace.strip('/')}/"
    found: dict[_Key, Any] = {}
    for one in connections:
        if one.msgcount and _key(one) in keys and one.topic.startswith(prefix):
            other = found.setdefault(_key(one), one).topic
            if other != one.topic:
                raise InvalidArgumentError(
                    f"{path} has several nodes: {other} and {one.topic}; choose a namespace"
                )
    if not found:
        raise InvalidArgumentError(
            f"{path} has no message of ~/changes and no call of a service below {prefix}; {_RECORD}"
        )
    return [found[_CHANGES]] if _CHANGES in found else list(found.values())


def _types(reader: Any, connections: Iterable[Any]) -> tuple[Any, dict[str, str]]:
    """Read the definitions in a bag; return the store of types, and the name of each there."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    files = getattr(reader.storage, "storages", [reader.storage])
    made = (each for file in files for each in getattr(file, "msgtypes", ()))
    texts = {each["name"]: each["msgdef"] for each in made}
    store, kinds = get_typestore(Stores.ROS2_JAZZY), {}
    for one in connections:
        text = one.msgdef.data or texts.get(one.msgtype.removesuffix("_Event"))
        if not text:
            raise InvalidArgumentError(
                f"{reader.path} has no definition of {one.msgtype}; record it with ROS 2 jazzy"
            )
        types = get_types_from_msg(_as_message(text), one.msgtype)
        kinds[one.msgtype] = next(iter(types))
        store.register({name: parts for name, parts in types.items() if name not in store.types})
    return store, kinds


def _as_message(text: str) -> str:
    """Write the definition of a service, which rosbag2 embeds, as that of its events."""
    found = _SERVICE.match(text)
    if found is None:
        return text
    service, request = found.groups()
    return (
        f"service_msgs/ServiceEventInfo info\n{service}_Request[<=1] request\n"
        f"{service}_Response[<=1] response\n{_LINE}MSG: {service}_Request\n{request}"
        f"{_LINE}MSG: {service}_Response\n{text[found.end() :]}"
    )


def _revisions(messages: Iterable[tuple[Any, int, Any]], begun: int) -> Iterator[_Said]:
    """Yield revisions, each once: a node that is activated again repeats the last one."""
    seen: set[str] = set()
    last = 0
    for connection, time, message in messages:
        if message.hash in seen:
            continue
        seen.add(message.hash)
        lost = message.number - last - 1
        last, stamp = message.number, message.committed_at
        made = stamp.sec * 10**9 + stamp.nanosec
        at = made if made < begun else time
        yield _Said(connection.topic, _CHANGES, at, message.hash, message, lost)


def _requests(messages: Iterable[tuple[Any, int, Any]]) -> Iterator[_Said]:
    """Yield requests when they are answered."""
    asked: dict[tuple[str, str], _Said] = {}
    for connection, time, message in messages:
        topic, info = connection.topic, message.info
        call = f"{bytes(info.client_gid).hex()} {info.sequence_number}"
        if info.event_type == _RECEIVED and message.request:
            asked[topic, call] = _Said(topic, _key(connection), time, call, message.request[0])
        elif info.event_type == _ANSWERED and (topic, call) in asked:
            said = asked.pop((topic, call))
            for response in message.response:
                if not getattr(response, "success", True):
                    why = getattr(response, "error_info", "")
                    said = said._replace(refusal=f"the server refused it: {why}".rstrip(": "))
            yield said
    for said in asked.values():
        yield said._replace(refusal="the recording ends before the answer")
