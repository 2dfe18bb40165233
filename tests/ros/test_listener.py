"""Following revisions, as far as it needs no ROS, and that nothing of ROS is imported unasked."""

from __future__ import annotations

from types import SimpleNamespace
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.ros import listener
from tests.support.processes.commands import PROGRAM, child

MOST = 3


class Node:
    """A node whose messages and answers come late, twice, or never."""

    def __init__(self, after: int) -> None:
        self.head = after
        self.told: list[int] = []
        self.asked: list[int] = []
        self.follower = listener.Follower(lambda one: self.told.append(one.number), self.ask, after)

    def ask(self, last: int) -> bool:
        self.asked.append(last)
        return True

    def message(self, number: int) -> None:
        self.follower.take([SimpleNamespace(number=number)])

    def answer(self) -> None:
        last, head = self.asked.pop(), self.head
        numbers = range(last + 1, min(last + MOST, head) + 1)
        found = [SimpleNamespace(number=each) for each in numbers]
        self.follower.take(found, head, is_answer=True)


@given(
    st.integers(0, 5),
    st.lists(st.tuples(st.sampled_from(["message", "answer", "lost", "look"]), st.integers(1, 9))),
)
def test_each_revision_is_delivered_once_and_in_order(
    after: int, events: list[tuple[str, int]]
) -> None:
    with mock.patch.object(listener, "PATIENCE", -1):
        node = Node(after)
        for event, number in events:
            node.head += number
            if event == "message":
                node.message(node.head - number // 2)
            elif event == "look":
                node.follower.look()
            elif node.asked and event == "answer":
                node.answer()
            else:
                node.asked.clear()
        node.head += 1
        node.message(node.head)
        while node.asked:
            node.answer()
    assert node.told == list(range(after + 1, node.head + 1))


def test_what_was_asked_lately_is_not_asked_again() -> None:
    node = Node(0)
    node.message(5)
    node.message(6)
    node.follower.look()
    assert node.asked == [0]
    node.head = 6
    node.answer()
    assert (node.told, node.asked) == ([1, 2, 3], [3])
    with mock.patch.object(listener, "PATIENCE", -1):
        node.follower.look()
    assert node.asked == [3, 3]


def test_a_revision_that_could_not_be_taken_comes_again() -> None:
    taken = mock.Mock(side_effect=[OSError("full"), None])
    follower = listener.Follower(taken, lambda last: False, 0)
    one = SimpleNamespace(number=1)
    with pytest.raises(OSError, match="full"):
        follower.take([one])
    follower.take([one, one])
    assert (follower.last, taken.call_args_list) == (1, [mock.call(one)] * 2)


def test_nothing_of_ros_is_imported_unless_asked_for() -> None:
    code = (
        "import sys, kant_sql, kant_sql.cli.main, kant_sql.cli.ros, kant_sql.ros.bags,"
        " kant_sql.ros.experts, kant_sql.ros.listener, kant_sql.ros.own, kant_sql.ros.paper,"
        " kant_sql.ros.node_trees\n"
        "print(sorted({name.partition('.')[0] for name in sys.modules} & {'rclpy', 'rosbags'"
        ", 'kant_msgs', 'kant_sql_msgs', 'plansys2_msgs', 'std_srvs', 'builtin_interfaces'}))"
    )
    assert child("-c", code, program=PROGRAM[:1]).stdout == "[]\n"


def test_a_node_without_ros_is_a_line_that_says_what_to_do() -> None:
    code = "import sys; sys.modules['rclpy'] = None; from kant_sql.cli.main import run; run()"
    done = child("-c", code, "ros", "sqlite://", program=PROGRAM[:1])
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("kant-sql: this needs rclpy, which comes with ROS 2")
    assert "source /opt/ros/jazzy/setup.bash" in done.stderr
