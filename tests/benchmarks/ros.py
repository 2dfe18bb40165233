"""Saving a fact through the node of ROS 2, compared with saving it in the caller's process.

    python -m tests.benchmarks.ros [--facts N] [--backend NAME]

Needs the environment of ROS 2 (source its setup.bash), with `kant_msgs`. An empty call of a service
that does nothing, in a node of its own, shows what ROS takes. Each has a store of its own.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import kant_sql
from kant_sql import KnowledgeBase
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.support.worlds.robots import RB1, robot_at, waypoint

FACTS = 400
ECHO = """
import rclpy
from std_srvs.srv import Empty
rclpy.init()
node = rclpy.create_node("echo")
node.create_service(Empty, "echo", lambda request, response: response)
rclpy.spin(node)
"""


def fill(url: str, facts: int) -> KnowledgeBase:
    """Store the definitions that the facts need."""
    kb = kant_sql.connect(url, actor="benchmark")
    kb.objects.save_all([RB1, *map(waypoint, range(facts))])
    kb.propositions.save(robot_at(RB1, waypoint(facts)))
    return kb


def measure(backend: str, new_store: Callable[[], str], facts: int) -> list[tuple[str, ...]]:
    """Measure on two stores; each line has the median time of a call, and its ratio."""
    from kant_msgs.srv import UpdatePddlProposition
    from std_srvs.srv import Empty

    from tests.ros.clients import Caller, fact

    url = new_store()
    fill(url, facts).close()
    programs = ["-m", "kant_sql.cli.main", "ros", url], ["-c", ECHO]
    processes = [subprocess.Popen([sys.executable, *words]) for words in programs]
    caller, kb = Caller(), fill(new_store(), facts)
    try:
        saves = caller.node.create_client(UpdatePddlProposition, "update_proposition")
        echoes = caller.node.create_client(Empty, "echo")

        for client in (saves, echoes):
            assert client.wait_for_service(60)

        def call(client: Any, request: Any) -> Callable[[], object]:
            return lambda: caller(client, request)

        times = alternate(
            facts,
            lambda number: partial(kb.propositions.save, robot_at(RB1, waypoint(number))),
            lambda number: call(saves, fact("rb1", f"wp{number}")),
            lambda _: call(echoes, Empty.Request()),
        )
    finally:
        for process in processes:
            process.kill()
            process.wait(60)
        kb.close()
        caller.close()
    direct, *others = map(median, times)
    named = zip(("through the node", "an empty call"), others, strict=True)
    return [
        (backend, "directly", f"{1e3 * direct:.2f} ms"),
        *(
            (backend, what, f"{1e3 * took:.2f} ms", f"{took / direct:.2f} x")
            for what, took in named
        ),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, facts=FACTS)
    if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("kant_msgs") is None:
        print("skipped: it needs ROS 2 with kant_msgs; source its setup.bash")
        return 0
    with stores(options.backend) as made:
        rows = [row for each in made for row in measure(each, made[each], options.facts)]
    print_table("saving a fact", ("store", "call", "takes", "ratio"), rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
