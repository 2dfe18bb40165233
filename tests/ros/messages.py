"""Messages with the fields that the interface files of PlanSys2 and of the paper give them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any


@dataclass
class Param:
    """plansys2_msgs/msg/Param."""

    name: str = ""
    type: str = ""
    sub_types: list[str] = field(default_factory=list)


@dataclass
class Node:
    """plansys2_msgs/msg/Node."""

    node_type: int = 0
    expression_type: int = 0
    modifier_type: int = 0
    node_id: int = 0
    children: list[int] = field(default_factory=list)
    name: str = ""
    parameters: list[Param] = field(default_factory=list)
    value: float = 0.0
    negate: bool = False


def message(**fields: Any) -> SimpleNamespace:
    """Make a message of any other type."""
    return SimpleNamespace(**fields)


class Tree:
    """plansys2_msgs/msg/Tree."""

    def __init__(self, nodes: Sequence[Any] = ()) -> None:
        self.nodes = list(nodes)


def __getattr__(name: str) -> Any:
    return message
