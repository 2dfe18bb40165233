"""`kant-sql ros` and `import`: the store as a node of ROS 2, and recordings of it as revisions."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from ..errors import needing
from .common import DEFAULT_NAME, Actor, AsJson, CommandWords, Target, leaving_nothing
from .output import Printer, plural, write_json

ROS_MISSING = (
    "this needs rclpy, which comes with ROS 2 and not from pip; run: source "
    "/opt/ros/jazzy/setup.bash, in an environment with the Python of your ROS 2"
)
_NODE = CommandWords("[URL] [ROS_ARGUMENT]...", "sqlite:///robot.db -- --ros-args -r __ns:=/rb1")
_IMPORT = CommandWords("[URL] BAG", "sqlite:///flight.db rosbag2_2026_03_02-14_03_00")


def ros(
    words: Annotated[list[str] | None, _NODE.argument("behind -- the arguments of ROS 2.")] = None,
    kb: Target = DEFAULT_NAME,
    actor: Actor = None,
) -> None:
    """Serve the store as a node of ROS 2.

    It answers the services of KANT and of PlanSys2's experts, until Ctrl-C. Words after -- are for
    the node, such as: -- --ros-args -r __ns:=/rb1
    """
    url, arguments = _NODE.split(words)
    with needing(ROS_MISSING):
        from ..ros.node import main
    main([sys.argv[0], *arguments], url=url, knowledge_base=kb, actor=actor or "")


def import_(
    words: Annotated[list[str], _IMPORT.argument("the folder of a bag of ROS 2, or its file.")],
    namespace: Annotated[
        str | None, typer.Option(metavar="NS", help="The namespace of the node, such as /rb1.")
    ] = None,
    kb: Target = DEFAULT_NAME,
    actor: Actor = None,
    clock: Annotated[
        str,
        typer.Option(
            metavar="CLOCK",
            help="Facts hold from the import on, 'committed' (default), or from their time in the "
            "recording on, 'observed'.",
        ),
    ] = "committed",
    as_json: AsJson = False,
) -> None:
    """Import a recording by rosbag2 as revisions.

    Each message of the recorded node becomes a revision, with its time in the recording: messages
    of the topic changes, or else calls of services. First load the knowledge that the node had
    before the recording. After an interruption, run it again.
    """
    from ..knowledge_base import connect
    from ..ros.bags import import_bag

    url, (bag,) = _IMPORT.split(words)
    with (
        leaving_nothing(url),
        connect(url, knowledge_base=kb, actor=actor, clock=clock) as knowledge_base,
    ):
        made = import_bag(knowledge_base, bag, namespace=namespace)
    if as_json:
        write_json(made._asdict())
    else:
        known = f", {made.known} known from before" if made.known else ""
        Printer().line(
            f"{bag}: {plural(made.messages, 'message')}, {plural(made.revisions, 'revision')}, "
            f"{made.refused} refused{known}"
        )
