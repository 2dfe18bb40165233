"""The lifecycle node: it opens a knowledge base when it is configured, and answers while active.

It needs `rclpy`, which comes with ROS 2 and not from an index of Python packages.
"""

from __future__ import annotations

import importlib
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import ModuleType
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile

from ..compat import DaoFactory
from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase, connect, factory_of
from .experts import DomainExpert, Planner, ProblemExpert
from .own import OwnServices, write_revision
from .paper import services as paper_services
from .service import Service

# Messages that a publisher keeps for those who come late, as PlanSys2's does.
KEPT = 100
# Seconds between looks whether the node is to stop.
LOOK = 0.5
_LATE = QoSProfile(depth=KEPT, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class KnowledgeNode(LifecycleNode):  # type: ignore[misc]
    """Answers the services of the paper's node and of PlanSys2's experts from a knowledge base.

    Parameters of the node: `url`, the database; `knowledge_base`, its name; `actor`, who writes
    (the name of the node by default). Services whose interfaces are not installed are left out.
    """

    def __init__(self, parameters: Mapping[str, str | None]) -> None:
        super().__init__("kant_sql")
        for parameter, default in (("url", ""), ("knowledge_base", "default"), ("actor", "")):
            self.declare_parameter(parameter, parameters.get(parameter) or default)
        self._kb: KnowledgeBase | None = None
        self._made: list[tuple[Callable[[Any], object], Any]] = []
        self._expert: ProblemExpert | None = None
        self._stop = threading.Event()
        self._watcher: threading.Thread | None = None

    def _parameter(self, name: str) -> str:
        return str(self.get_parameter(name).value)

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        """Open the knowledge base; the node stays unconfigured where that fails."""
        del state
        name = self._parameter("knowledge_base")
        actor = self._parameter("actor") or self.get_name()
        try:
            self._kb = connect(self._parameter("url"), knowledge_base=name, actor=actor)
        except KantSqlError as error:
            self.get_logger().error(str(error))
            self._close()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Offer the services and the topics."""
        for service in self._offered():
            made = self.create_service(service.kind, service.name, self._guarded(service))
            self._made.append((self.destroy_service, made))
        self._watch()
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Withdraw the services and the topics."""
        self._stop.set()
        if self._watcher is not None:
            self._watcher.join()
        while self._made:
            destroy, made = self._made.pop()
            destroy(made)
        return super().on_deactivate(state)

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:
        """Close the knowledge base."""
        del state
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        """Withdraw everything, and close the knowledge base."""
        self.on_deactivate(state)
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def _close(self) -> None:
        if self._kb is not None:
            self._kb.close()
        self._kb = None

    def _offered(self) -> Iterator[Service]:
        """Yield the services whose interfaces are installed."""
        assert self._kb is not None
        messages, kinds = _interfaces("kant_sql_msgs")
        if kinds is not None:
            yield from OwnServices(self._kb, messages, Time).services(kinds)
        messages, kinds = _interfaces("kant_msgs")
        if kinds is not None:
            empty = importlib.import_module("std_srvs.srv").Empty
            yield from paper_services(DaoFactory.of(factory_of(self._kb)), messages, kinds, empty)
        messages, kinds = _interfaces("plansys2_msgs")
        if messages is not None:
            self._expert = ProblemExpert(self._kb, messages)
            yield from DomainExpert(self._kb, messages).services(kinds)
            yield from self._noticed(self._expert.services(kinds), messages)
            yield from Planner(messages).services(kinds)

    def _noticed(self, services: Iterator[Service], messages: Any) -> Iterator[Service]:
        """Publish what the problem expert knows after each call that may have changed it."""
        empty = importlib.import_module("std_msgs.msg").Empty
        expert = self._expert
        assert expert is not None
        notify = self.create_publisher(empty, "problem_expert/update_notify", KEPT)

        is_late = threading.Event()

        def publish() -> None:
            # To write down all that is known costs time, and is done for those who listen.
            is_late.set()
            if knowledge.get_subscription_count():
                is_late.clear()
                knowledge.publish(expert.knowledge())

        def listened(_: object) -> None:
            if is_late.is_set():
                publish()

        matched = PublisherEventCallbacks(matched=listened)
        knowledge = self.create_publisher(
            messages.Knowledge, "problem_expert/knowledge", _LATE, event_callbacks=matched
        )
        self._made += [(self.destroy_publisher, one) for one in (notify, knowledge)]

        def changing(service: Service) -> Service:
            def answer(request: Any, response: Any) -> None:
                service.answer(request, response)
                notify.publish(empty())
                publish()

            return service._replace(answer=answer)

        for service in services:
            yield changing(service) if "_expert/get_" not in service.name else service

    def _guarded(self, service: Service) -> Callable[[Any, Any], Any]:
        """Answer with the error of a request that cannot be answered; the node goes on."""

        def answer(request: Any, response: Any) -> Any:
            try:
                service.answer(request, response)
            except KantSqlError as error:
                self.get_logger().warning(f"{service.name}: {error}")
                _say(response, success=False, error_info=str(error))
            except Exception as error:
                # An exception that left here would end the node, and with it all other services.
                self.get_logger().error(f"{service.name}: {traceback.format_exc()}")
                _say(response, success=False, error_info=f"{type(error).__name__}: {error}")
            else:
                if hasattr(response, "error_info"):
                    response.success = True
            return response

        return answer

    def _watch(self) -> None:
        """Publish each revision, whoever writes it, in order and without gaps."""
        messages, _ = _interfaces("kant_sql_msgs")
        if messages is None:
            return
        publisher = self.create_publisher(messages.Revision, "~/changes", _LATE)
        self._made.append((self.destroy_publisher, publisher))
        kb = self._kb
        assert kb is not None
        last = max(kb.revision - 1, 0)
        self._stop.clear()

        def run() -> None:
            after = last
            while not self._stop.is_set():
                try:
                    for entry in kb.changes(after):
                        publisher.publish(write_revision(entry, messages, Time))
                        after = entry.revision.number
                    kb.watch(after, timeout=LOOK)
                except KantSqlError as error:
                    self.get_logger().warning(f"~/changes: {error}")
                    self._stop.wait(LOOK)

        self._watcher = threading.Thread(target=run, name="kant_sql changes", daemon=True)
        self._watcher.start()


def _say(response: Any, **fields: object) -> None:
    for field, value in fields.items():
        if hasattr(response, field):
            setattr(response, field, value)


def _interfaces(package: str) -> tuple[ModuleType | None, ModuleType | None]:
    """Import the messages and the services of a package, if it is installed."""
    try:
        return importlib.import_module(f"{package}.msg"), importlib.import_module(f"{package}.srv")
    except ModuleNotFoundError:
        return None, None


def main(arguments: Sequence[str] | None = None, **parameters: str | None) -> None:
    """Run the node until Ctrl-C; with a `url` it is configured and active at once.

    Args:
        arguments: the arguments of ROS 2, such as `--ros-args -r __ns:=/rb1`.
        **parameters: `url`, `knowledge_base` and `actor`.
    """
    rclpy.init(args=list(sys.argv if arguments is None else arguments))
    node = KnowledgeNode(parameters)
    try:
        if parameters.get("url"):
            for step in (node.trigger_configure, node.trigger_activate):
                if step() is not TransitionCallbackReturn.SUCCESS:
                    raise SystemExit(1)
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.on_shutdown(None)
        node.destroy_node()
        rclpy.try_shutdown()
