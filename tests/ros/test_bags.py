"""A bag is taken over with its times. It is written here as rosbag2 does it; no ROS is needed."""

from __future__ import annotations

import heapq
import json
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import kant_sql
from kant_sql.errors import InvalidArgumentError, StoreBusyError
from kant_sql.ros import bags
from kant_sql.ros.bags import Imported, import_bag
from kant_sql.ros.own import write_revision
from kant_sql_plugins.mcap import export_transitions
from tests.audit import story
from tests.support.processes.commands import run

OWN = Path(__file__).parents[2] / "ros" / "kant_sql_msgs" / "msg"
LINE = "=" * 80 + "\n"
REVISION = "kant_sql_msgs/msg/Revision"
PARAM = "string name\nstring type\nstring[] sub_types\n"
# The request and the response of a service, and what is behind them in a bag.
SERVICES = {
    "plansys2_msgs/srv/AffectParam": (
        "plansys2_msgs/Param param\n",
        "bool success\nstring error_info\n",
        f"\n{LINE}MSG: plansys2_msgs/Param\n{PARAM}",
    ),
    "std_srvs/srv/Empty": ("", "", ""),
}
ADD = "/problem_expert/add_problem_instance"
AFFECT, EMPTY = SERVICES
BEGUN = datetime(2026, 3, 2, 14, 3, tzinfo=UTC)


def later(second: float) -> datetime:
    return BEGUN + timedelta(seconds=second)


def nanoseconds(moment: datetime) -> int:
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def definition_of(kind: str) -> str:
    """What rosbag2 (jazzy) has in a bag for a type: of the events of a service, the service."""
    if kind == REVISION:
        change = (OWN / "Change.msg").read_text()
        return f"{(OWN / 'Revision.msg').read_text()}\n{LINE}MSG: kant_sql_msgs/Change\n{change}"
    service = kind.removesuffix("_Event")
    if service not in SERVICES:
        return ""
    request, response, others = SERVICES[service]
    return f"{LINE}SRV: {service}\n{request}---\n{response}{others}"


class Bag:
    """Writes a bag."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.add(REVISION, definition_of(REVISION))
        self.add("plansys2_msgs/msg/Param", PARAM)
        for service, (request, response, _) in SERVICES.items():
            for part, text in ("Request", request), ("Response", response):
                self.add(f"{service.replace('srv/', 'msg/')}_{part}", text)
            package, name = service.split("/srv/")
            text = "service_msgs/ServiceEventInfo info\n" + "".join(
                f"{package}/{name}_{part}[<=1] {part.lower()}\n" for part in ("Request", "Response")
            )
            self.add(f"{package}/msg/{name}_Event", text)
        self.rows: list[tuple[int, str, str, bytes]] = []
        self.definition_of = definition_of

    def add(self, name: str, text: str) -> None:
        made = get_types_from_msg(text, name)
        self.store.register({n: parts for n, parts in made.items() if n not in self.store.types})

    def make(self, kind: str, *fields: Any) -> Any:
        return self.store.types[kind](*fields)

    def write(self, moment: datetime, topic: str, kind: str, message: Any) -> None:
        name = kind.replace("/srv/", "/msg/")
        raw = bytes(self.store.serialize_cdr(message, name))
        self.rows.append((nanoseconds(moment), topic, kind, raw))

    def event(self, second: float, service: str, kind: str, number: int, **parts: Any) -> None:
        """Write what a server says of a call: that it has the request, or the response."""
        made = kind.replace("/srv/", "/msg/")
        time, client = self.make("builtin_interfaces/msg/Time", 0, 0), np.zeros(16, dtype=np.uint8)
        event = 1 if "Request" in parts else 2
        info = self.make("service_msgs/msg/ServiceEventInfo", event, time, client, number)
        lists = [
            [self.make(f"{made}_{part}", *parts[part])] if part in parts else []
            for part in ("Request", "Response")
        ]
        message = self.make(f"{made}_Event", info, *lists)
        self.write(later(second), f"{service}/_service_event", f"{kind}_Event", message)

    def add_instance(self, second: float, number: int, name: str) -> None:
        param = self.make("plansys2_msgs/msg/Param", name, "robot", [])
        self.event(second, ADD, AFFECT, number, Request=[param])

    def answer(self, second: float, number: int, error: str = "") -> None:
        self.event(second, ADD, AFFECT, number, Response=[not error, error])

    def revision(
        self, second: float, number: int, *changes: Any, ns: str = "", at: datetime | None = None
    ) -> None:
        since = nanoseconds(at or later(second))
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(since, 10**9))
        made = [self.make("kant_sql_msgs/msg/Change", *change) for change in changes]
        said = [number, stamp, "camera", "seen", '{"frame":1}', f"{ns}{number}", made]
        self.write(later(second), f"{ns}/kant_sql/changes", REVISION, self.make(REVISION, *said))

    def close(self, folder: Path, storage: str = "mcap") -> Path:
        """Write the messages to a file, or to a folder."""
        texts = {topic: (kind, self.definition_of(kind)) for _, topic, kind, _ in self.rows}
        if storage == "sqlite3":
            with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
                made = {
                    topic: writer.add_connection(topic, kind, msgdef=text, rihs01="RIHS01_0")
                    for topic, (kind, text) in texts.items()
                }
                for time, topic, _, raw in self.rows:
                    writer.write(made[topic], time, raw)
            with closing(sqlite3.connect(folder / "bag" / "bag.db3")) as file, file:
                file.execute(
                    "UPDATE message_definitions SET topic_type = replace(topic_type, '_Event', '')"
                )
                file.execute(
                    "UPDATE message_definitions SET encoding = 'unknown' WHERE"
                    " encoded_message_definition NOT LIKE '%MSG%'"
                )
            return folder / "bag"
        with (folder / "bag.mcap").open("wb") as target:
            out = McapWriter(target)
            out.start(profile="ros2")
            numbers = {}
            for topic, (kind, text) in texts.items():
                encoding = "unknown" if "SRV" in text and "MSG" not in text else "ros2msg"
                schema = out.register_schema(kind, encoding, text.encode())
                numbers[topic] = out.register_channel(topic, "cdr", schema)
            for time, topic, _, raw in self.rows:
                out.add_message(numbers[topic], time, raw, time)
            out.finish()  # type: ignore[no-untyped-call]
        return folder / "bag.mcap"


def told(kb: kant_sql.KnowledgeBase) -> list[tuple[datetime | None, list[str]]]:
    """What each revision says, and when that was."""
    return [
        (entry.revision.observed_at, [" ".join(change[::2]) for change in entry.changes])
        for entry in kb.changes()
    ]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_requests_that_were_answered_with_success_are_made_again(
    tmp_path: Path, storage: str, caplog: pytest.LogCaptureFixture
) -> None:
    bag = Bag()
    for number, name in enumerate(("rb1", "rb2", "rb3", "rb4")):
        bag.add_instance(number, number, name)
    bag.answer(4, 1)
    bag.answer(4.1, 0)
    bag.answer(4.2, 2, "the server has no robots")
    bag.event(5, "/delete_all_propositions", EMPTY, 9, Request=[0])
    bag.event(5.1, "/delete_all_propositions", EMPTY, 9, Response=[0])
    path = bag.close(tmp_path, storage)
    with kant_sql.connect("sqlite://") as kb:
        kb.types.save("robot")
        kb.predicates.save("(idle)")
        kb.propositions.save("(idle)")
        assert import_bag(kb, path) == Imported(messages=5, revisions=3, refused=2, known=0)
        assert told(kb)[3:] == [
            (later(1), ["+ rb2 - robot"]),
            (later(0), ["+ rb1 - robot"]),
            (later(5), ["- (idle)"]),
        ]
        made = next(kb.log(limit=1)).revision
        assert made.source == {
            "bag": path.name,
            "recorded": f"{'00' * 16} 9",
            "topic": "/delete_all_propositions/_service_event",
        }
        assert "the server has no robots" in caplog.text
        assert "before the answer" in caplog.text
        assert import_bag(kb, path)[1:] == (0, 1, 4)
        assert kb.store.verify().is_intact


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_revisions_have_what_all_wrote_and_are_taken_once(
    tmp_path: Path, storage: str, caplog: pytest.LogCaptureFixture
) -> None:
    bag = Bag()
    bag.add_instance(0, 0, "rb7")
    bag.answer(0.1, 0)
    types = ("+", "type", "robot"), ("+", "predicate", "(idle ?r - robot)")
    bag.revision(0.2, 1, *types, ("+", "object", "rb1 - robot"), at=later(-60))
    for second, number in (1.5, 2), (1.6, 2), (2, 4):
        bag.revision(second, number, ("+-"[number == 4], "fact", "(idle rb1)"))
    path = bag.close(tmp_path, storage)
    with kant_sql.connect("sqlite://") as kb:
        assert import_bag(kb, path) == Imported(messages=3, revisions=3, refused=0, known=0)
        assert [moment for moment, _ in told(kb)] == [later(-60), later(1.5), later(2)]
        revision = next(kb.log(limit=1)).revision
        assert (revision.actor, revision.reason) == ("camera", "seen")
        assert isinstance(revision.source, dict)
        assert revision.source["source"] == '{"frame":1}'
        assert "1 revisions before it are lost" in caplog.text
        assert import_bag(kb, path) == Imported(messages=3, revisions=0, refused=0, known=3)


def test_each_revision_of_a_story_is_made_again_as_it_was(tmp_path: Path) -> None:
    kinds = {"type", "object", "predicate", "function", "action", "fact", "value", "goal"}
    bag = Bag()
    made = SimpleNamespace(
        Change=lambda **fields: bag.make("kant_sql_msgs/msg/Change", *fields.values()),
        Revision=lambda **fields: SimpleNamespace(committed_at=SimpleNamespace(), **fields),
    )

    def changed(kb: kant_sql.KnowledgeBase) -> list[set[Any]]:
        found = [{each for each in entry.changes if each.kind in kinds} for entry in kb.changes()]
        return [each for each in found if each]

    with kant_sql.connect("sqlite://") as robot, kant_sql.connect("sqlite://") as kb:
        story.record(robot)
        for entry in robot.changes():
            message = write_revision(entry, made)
            stamp = message.committed_at
            fields = (
                message.number,
                bag.make("builtin_interfaces/msg/Time", stamp.sec, stamp.nanosec),
            )
            rest = message.actor, message.reason, message.source, message.hash, message.changes
            said = bag.make(REVISION, *fields, *rest)
            bag.write(entry.revision.committed_at, "/kant_sql/changes", REVISION, said)
        path = bag.close(tmp_path)
        assert import_bag(kb, path).refused == 0
        assert changed(kb) == changed(robot)
        whole = robot.revision
        assert import_bag(robot, path) == Imported(whole, revisions=0, refused=0, known=whole)


def test_one_of_several_robots_is_chosen(tmp_path: Path) -> None:
    bag = Bag()
    for number, ns in enumerate(("/rb1", "/rb2")):
        bag.revision(number, 1, ("+", "type", ns[1:]), ns=ns)
    path = str(bag.close(tmp_path))
    url = f"sqlite:///{tmp_path}/{{}}.db"
    refused = run("import", url.format("none"), path)
    assert refused.exit_code == 1
    assert "/rb1/kant_sql/changes and /rb2/kant_sql/changes" in refused.stderr
    assert not (tmp_path / "none.db").exists()
    words = "--namespace", "/rb2", "--kb", "rb2", "--actor", "me"
    made = run("import", url.format("rb2"), path, *words, "--json")
    assert json.loads(made.stdout) == {"messages": 1, "revisions": 1, "refused": 0, "known": 0}
    again = run("import", url.format("rb2"), path, *words)
    assert again.stdout == (f"{path}: 1 message, 0 revisions, 0 refused, 1 known from before\n")
    with kant_sql.connect(url.format("rb2"), knowledge_base="rb2") as kb:
        assert told(kb) == [(later(1), ["+ rb2"])]


def test_an_interrupted_import_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = Bag()
    bag.revision(0, 1, ("+", "predicate", "(idle)"))
    for number in range(2, 9):
        bag.revision(number, number, ("+-"[number % 2], "fact", "(idle)"))
    path = bag.close(tmp_path)
    with kant_sql.connect("sqlite://") as kb:
        real = bags._replay

        def replay(kb: kant_sql.KnowledgeBase, revision: Any) -> None:
            if revision.number == 5:
                raise StoreBusyError("busy")
            real(kb, revision)

        monkeypatch.setattr(bags, "_replay", replay)
        with pytest.raises(StoreBusyError):
            import_bag(kb, path)
        monkeypatch.undo()
        assert import_bag(kb, path) == Imported(messages=8, revisions=4, refused=0, known=4)
        assert [moment for moment, _ in told(kb)] == [later(0), *map(later, range(2, 9))]


def test_imports_at_the_same_time_make_each_revision_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = Bag()
    bag.revision(0, 1, ("+", "predicate", "(idle)"))
    for number in range(2, 9):
        bag.revision(number, number, ("+-"[number % 2], "fact", "(idle)"))
    path, replay, others = bag.close(tmp_path), bags._replay, list[Imported]()
    with kant_sql.connect(f"sqlite:///{tmp_path / 'store.db'}") as kb:
        read = bags._read

        def replaying(kb: kant_sql.KnowledgeBase, revision: Any) -> None:
            replay(kb, revision)
            monkeypatch.setattr(bags, "_replay", replay)

        def reading(*given: Any) -> Any:
            for said in read(*given):
                yield said
                if bags._replay is replay and not others:
                    others.append(Imported(0, 0, 0, 0))
                    others[0] = import_bag(kb, path)

        monkeypatch.setattr(bags, "_replay", replaying)
        monkeypatch.setattr(bags, "_read", reading)
        assert import_bag(kb, path) == Imported(messages=8, revisions=1, refused=0, known=8)
        assert others == [Imported(messages=8, revisions=7, refused=0, known=1)]
        assert kb.revision == 8


def test_an_import_counts_its_own_revisions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = Bag()
    bag.revision(0, 1, ("+", "predicate", "(idle)"))
    bag.revision(1, 2, ("+", "fact", "(idle)"))
    path, read = bag.close(tmp_path), bags._read
    with kant_sql.connect("sqlite://") as kb:

        def reading(*given: Any) -> Any:
            for said in read(*given):
                yield said
                kb.types.save(f"of-another-{kb.revision}")

        monkeypatch.setattr(bags, "_read", reading)
        assert import_bag(kb, path) == Imported(messages=2, revisions=2, refused=0, known=0)


def test_what_is_no_bag_of_the_node_is_refused(tmp_path: Path) -> None:
    bag = Bag()
    bag.write(BEGUN, "/chatter", "std_msgs/msg/String", bag.make("std_msgs/msg/String", "hello"))
    whole = bag.close(tmp_path)
    cut, old = tmp_path / "cut.mcap", tmp_path / "old.bag"
    cut.write_bytes(whole.read_bytes()[:-40])
    old.write_bytes(b"#ROSBAG V2.0\n")
    with kant_sql.connect("sqlite://") as kb:
        with pytest.raises(InvalidArgumentError, match="ros2 bag record"):
            import_bag(kb, whole)
        bag.rows = [(0, "/kant_sql/changes", REVISION, b"")]
        bag.definition_of = lambda kind: ""
        with pytest.raises(InvalidArgumentError, match="has no definition of kant_sql_msgs"):
            import_bag(kb, bag.close(tmp_path))
        metadata = Bag()
        metadata.event(0, ADD, AFFECT, 1)
        with pytest.raises(InvalidArgumentError, match="no call with its contents"):
            import_bag(kb, metadata.close(tmp_path))
        for path in cut, old, tmp_path, tmp_path / "nowhere":
            with pytest.raises(InvalidArgumentError, match=f"cannot read the bag {path}.*recover"):
                import_bag(kb, path)
        assert kb.revision == 0


def test_the_export_is_on_the_time_axis_of_the_bag(tmp_path: Path) -> None:
    bag = Bag()
    for second in range(6):
        text = bag.make("std_msgs/msg/String", "hello")
        bag.write(later(second), "/chatter", "std_msgs/msg/String", text)
    bag.revision(0.5, 1, ("+", "predicate", "(idle)"))
    for number in 2, 3, 4:
        bag.revision(number + 0.25, number, ("+-"[number % 2], "fact", "(idle)"))
    path, url = bag.close(tmp_path), f"sqlite:///{tmp_path}/flight.db"
    with kant_sql.connect(url) as kb:
        import_bag(kb, path)
    export_transitions(url, to=tmp_path / "out")
    exported = tmp_path / "out" / "knowledge_base=default" / "transitions.mcap"
    with path.open("rb") as robots, exported.open("rb") as ours:
        read = [make_reader(file).iter_messages() for file in (robots, ours)]
        merged = list(heapq.merge(*read, key=lambda found: found[2].log_time))
    idle = [found[2] for found in merged if found[1].topic == "/default/fact/idle"]
    times = [nanoseconds(later(second)) for second in (2.25, 3.25, 4.25)]
    assert [each.log_time for each in idle] == [each.publish_time for each in idle] == times
    topics = [found[1].topic for found in merged]
    assert topics == [
        *("/chatter", "/kant_sql/changes", "/chatter", "/chatter"),
        *("/kant_sql/changes", "/default/fact/idle", "/chatter") * 3,
    ]
