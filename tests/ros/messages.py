"""Messages with the fields that the interface files of PlanSys2 and of the paper give them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from kant_sql.ros.service import Service


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


class Kinds:
    """Stands for a module of services: the class of a service is its name."""

    def __getattr__(self, name: str) -> str:
        return name


class Client:
    """Calls services as a client does; an answer has the fields that were set."""

    def __init__(self, services: list[Service]) -> None:
        self._services = {each.name.rpartition("/")[2]: each for each in services}

    def __call__(self, name: str, **request: Any) -> SimpleNamespace:
        response = SimpleNamespace()
        self._services[name].answer(SimpleNamespace(**request), response)
        return response

    def __len__(self) -> int:
        return len(self._services)


def __getattr__(name: str) -> Any:
    return message
