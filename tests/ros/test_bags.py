"""A bag is taken over with its times; rosbags writes it here, and no ROS is needed."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import kant_sql
from kant_sql.errors import InvalidArgumentError, SourceError
from kant_sql.ros.bags import Imported, import_bag

OWN = Path(__file__).parents[2] / "ros" / "kant_sql_msgs" / "msg"
# As rosbag2 records a service with introspection.
EVENT = """service_msgs/ServiceEventInfo info
plansys2_msgs/AffectParam_Request[<=1] request
plansys2_msgs/AffectParam_Response[<=1] response"""
PARTS = {
    "plansys2_msgs/msg/Param": "string name\nstring type\nstring[] sub_types",
    "plansys2_msgs/msg/AffectParam_Request": "plansys2_msgs/Param param",
    "plansys2_msgs/msg/AffectParam_Response": "bool success\nstring error_info",
    "plansys2_msgs/srv/AffectParam_Event": EVENT,
    "kant_sql_msgs/msg/Change": (OWN / "Change.msg").read_text(),
    "kant_sql_msgs/msg/Revision": (OWN / "Revision.msg").read_text(),
}
BEGUN = datetime(2026, 3, 2, 14, 3, tzinfo=UTC)


def _of_service(name: str) -> str:
    """Undo that rosbags takes each type for one of a message."""
    return name.replace("/srv/msg/", "/srv/")


class Bag:
    """Writes a bag."""

    def __init__(self, path: Path, plugin: StoragePlugin) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in PARTS.items():
            if name not in self.store.types:
                made = get_types_from_msg(text, name)
                self.store.register({_of_service(key): value for key, value in made.items()})
        self._writer = Writer(path, version=9, storage_plugin=plugin)
        self._writer.open()
        self._topics: dict[str, Any] = {}

    def make(self, kind: str, *fields: Any) -> Any:
        return self.store.types[kind](*fields)

    def write(self, second: float, topic: str, kind: str, message: Any) -> None:
        if topic not in self._topics:
            connection = self._writer.add_connection(topic, kind, typestore=self.store)
            self._topics[topic] = connection
        raw = self.store.serialize_cdr(message, kind)
        at = BEGUN + timedelta(seconds=second)
        self._writer.write(self._topics[topic], round(at.timestamp() * 1e9), raw)

    def request(self, second: float, name: str, type_: str, event: int = 1) -> None:
        param = self.make("plansys2_msgs/msg/Param", name, type_, [])
        request = self.make("plansys2_msgs/msg/AffectParam_Request", param)
        time = self.make("builtin_interfaces/msg/Time", 0, 0)
        client = np.zeros(16, dtype=np.uint8)
        info = self.make("service_msgs/msg/ServiceEventInfo", event, time, client, 0)
        kind = "plansys2_msgs/srv/AffectParam_Event"
        topic = "/rb1/problem_expert/add_problem_instance/_service_event"
        self.write(second, topic, kind, self.make(kind, info, [request], []))

    def revision(self, second: float, *changes: tuple[str, str, str]) -> None:
        made = [self.make("kant_sql_msgs/msg/Change", *change) for change in changes]
        time = self.make("builtin_interfaces/msg/Time", 0, 0)
        kind = "kant_sql_msgs/msg/Revision"
        message = self.make(kind, 1, time, "camera", "", "", "", made)
        self.write(second, "/kant_sql/changes", kind, message)

    def close(self) -> Path:
        self._writer.close()
        return Path(self._writer.path)


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name.lower())
def test_requests_and_revisions_are_taken_over_with_their_times(
    tmp_path: Path, plugin: StoragePlugin
) -> None:
    bag = Bag(tmp_path / "bag", plugin)
    bag.revision(0, ("+", "type", "robot"), ("+", "predicate", "(idle ?r - robot)"))
    bag.request(1.5, "rb1", "robot")
    # What the server answered, and what it was asked for wrongly.
    bag.request(1.6, "rb2", "robot", event=2)
    bag.request(1.7, "rb3", "scientific")
    bag.revision(2, ("+", "fact", "(idle rb1)"))
    bag.revision(3, ("-", "fact", "(idle rb1)"), ("-", "object", "rb1 - robot"))
    path = bag.close()
    with kant_sql.connect("sqlite://") as kb:
        assert import_bag(kb, path) == Imported(messages=5, revisions=4, refused=1)
        log = [each.revision for each in kb.changes()]
        assert [each.observed_at for each in log] == [
            BEGUN + timedelta(seconds=second) for second in (0, 1.5, 2, 3)
        ]
        assert [str(each) for each in kb.at(3).propositions.get_all()] == ["(idle rb1)"]
        assert kb.objects.get_all() == []
        assert import_bag(kb, path).revisions == 3
        assert kb.store.verify().is_intact


def test_a_bag_without_messages_of_the_node_is_refused(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    bag.write(0, "/chatter", "std_msgs/msg/String", bag.make("std_msgs/msg/String", "hello"))
    with kant_sql.connect("sqlite://") as kb:
        with pytest.raises(InvalidArgumentError, match="ros2 bag record"):
            import_bag(kb, bag.close())
        with pytest.raises(SourceError, match="nowhere"):
            import_bag(kb, tmp_path / "nowhere")
