"""`kant-sql ros` and `import`: the store as a node of ROS 2, and recordings of it as revisions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..errors import ExtraMissingError
from .common import DEFAULT_NAME, Actor, AsJson, Url, leaving_nothing, split_url, words_argument
from .output import write_json

ROS_MISSING = (
    "this needs rclpy, which comes with ROS 2 and not from pip; run: source "
    "/opt/ros/jazzy/setup.bash, in an environment with the Python of your ROS 2"
)
_Kb = Annotated[str, typer.Option("--kb", metavar="NAME", help="The knowledge base to write to.")]


_USAGE = "URL [ROS_ARGUMENT]..."
_EXAMPLE = "kant-sql ros sqlite:///robot.db -- --ros-args -r __ns:=/rb1"


def ros(
    words: Annotated[list[str], words_argument(_USAGE, "behind -- the arguments of ROS 2.")],
    kb: _Kb = DEFAULT_NAME,
    actor: Actor = None,
) -> None:
    """Serve the store as a node of ROS 2: the services of KANT and of PlanSys2's experts.

    Ends with Ctrl-C. Words after -- are the node's, such as: -- --ros-args -r __ns:=/rb1
    """
    url, arguments = split_url(words, _USAGE, _EXAMPLE)
    try:
        from ..ros.node import main
    except ImportError as error:
        raise ExtraMissingError(ROS_MISSING) from error
    main([sys.argv[0], *arguments], url=url, knowledge_base=kb, actor=actor or "")


def import_(
    url: Url,
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="The folder or the file of a bag.")],
    kb: _Kb = DEFAULT_NAME,
    actor: Actor = None,
    as_json: AsJson = False,
) -> None:
    """Take over a recording of rosbag2: requests and changes, with their times in the bag."""
    from ..knowledge_base import connect
    from ..ros.bags import import_bag

    with leaving_nothing(url), connect(url, knowledge_base=kb, actor=actor) as knowledge_base:
        made = import_bag(knowledge_base, bag)
    if as_json:
        write_json(made._asdict())
    else:
        sys.stdout.write(
            f"{made.messages} messages, {made.revisions} revisions, {made.refused} refused\n"
        )
