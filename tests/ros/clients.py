"""Clients of the node, each a process in the environment of ROS 2; they print what they know.

python -m tests.ros.clients NAME [ARGUMENT ...]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from itertools import count
from typing import Any

import rclpy
from kant_msgs import msg
from kant_msgs.srv import UpdatePddlProposition
from kant_sql_msgs.action import Execute, Perform
from kant_sql_msgs.srv import Query
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from kant_sql.ros.listener import follow

# Seconds after which a call is made again: its node was killed.
AGAIN, PATIENCE = 3, 60


class Caller:
    """A node that calls services until they answer."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node(f"client_{time.time_ns()}")
        self.executor = rclpy.executors.SingleThreadedExecutor()
        self.executor.add_node(self.node)
        # Ends a wait again and again, as a limit of each wait takes longer than what is waited for.
        self.node.create_timer(0.1, lambda: None)

    def spin(self, is_done: Callable[[], object], seconds: float = PATIENCE) -> bool:
        """Spin until something is so; return whether it is."""
        end = time.monotonic() + seconds
        while not is_done() and time.monotonic() < end:
            self.executor.spin_once()
        return bool(is_done())

    def __call__(self, client: Any, request: Any) -> Any:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            future = client.call_async(request)
            if self.spin(future.done, AGAIN):
                return future.result()
            client.remove_pending_request(future)
            client.wait_for_service(AGAIN)
        raise TimeoutError(client.srv_name)

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown()


def fact(robot: str, waypoint: str) -> UpdatePddlProposition.Request:
    """Make a request to save that a robot is at a waypoint."""
    request = UpdatePddlProposition.Request()
    kinds = [msg.PddlType(name="robot"), msg.PddlType(name="wp")]
    request.pddl_proposition = msg.PddlProposition(
        predicate=msg.PddlPredicate(name="robot_at", types=kinds),
        objects=[
            msg.PddlObject(type=kind, name=name)
            for kind, name in zip(kinds, (robot, waypoint), strict=True)
        ],
    )
    return request


def save(robot: str, most: str = "1000000") -> None:
    """Save facts one after the other, each until it is acknowledged, and say so of each."""
    caller = Caller()
    client = caller.node.create_client(UpdatePddlProposition, "update_proposition")
    for number in range(int(most)):
        while not caller(client, fact(robot, f"wp{number}")).success:
            time.sleep(0.05)
        print(number, flush=True)


def followed(after: str) -> None:
    """Print the numbers of the revisions after one."""
    caller = Caller()
    follow(caller.node, lambda one: print(one.number, flush=True), after=int(after))
    caller.spin(lambda: False, 3 * PATIENCE)


def ask(condition: str) -> None:
    """Save facts while a question that takes long is answered; print the number of each."""
    caller = Caller()
    client = caller.node.create_client(UpdatePddlProposition, "update_proposition")
    caller(client, fact("rb1", "start"))
    questions = caller.node.create_client(Query, "kant_sql/query")
    caller(questions, Query.Request(condition="(exists (?r - robot) (robot_at ?r start))"))
    future = questions.call_async(Query.Request(condition=condition, limit=1))
    for number in count():
        if future.done():
            break
        caller(client, fact("rb1", f"during{number}"))
        print(number, flush=True)
    assert future.result().holds


def skill(name: str) -> None:
    """Serve the steps of an action: to a ditch they fail, to a swamp they last until the end."""

    def do(handle: Any) -> Any:
        place = handle.request.arguments[-1]
        handle.publish_feedback(Perform.Feedback(text=f"heading for {place}"))
        while place == "swamp" and not handle.is_cancel_requested:
            time.sleep(0.02)
        if handle.is_cancel_requested:
            handle.canceled()
        elif place == "ditch":
            handle.abort()
            return Perform.Result(code="E4", text="it is deep")
        else:
            handle.succeed()
        return Perform.Result()

    rclpy.init()
    node = rclpy.create_node("skill")
    group, cancel = ReentrantCallbackGroup(), lambda _: CancelResponse.ACCEPT
    ActionServer(node, Perform, name, do, callback_group=group, cancel_callback=cancel)
    rclpy.spin(node, rclpy.executors.MultiThreadedExecutor(3))


def execute(plan: str, cancel_at: str = "") -> None:
    """Have a plan executed, and print what is said of it; cancel it at a text."""
    caller = Caller()
    client = ActionClient(caller.node, Execute, "kant_sql/execute")
    told: list[Any] = []

    def tell(message: Any) -> None:
        one = message.feedback
        told.append(one)
        print(one.execution, one.step, one.outcome, one.text, f"{one.progress:.2f}", flush=True)

    caller.spin(client.server_is_ready)
    sent = client.send_goal_async(Execute.Goal(plan=plan), tell)
    assert caller.spin(sent.done)
    result = sent.result().get_result_async()
    if cancel_at:
        assert caller.spin(lambda: any(cancel_at in one.text for one in told))
        sent.result().cancel_goal_async()
    assert caller.spin(result.done)
    found = result.result()
    said = found.result
    print(found.status, said.outcome, said.execution, said.code, said.text, sep="|", flush=True)


if __name__ == "__main__":
    {each.__name__: each for each in (save, followed, ask, skill, execute)}[sys.argv[1]](
        *sys.argv[2:]
    )
