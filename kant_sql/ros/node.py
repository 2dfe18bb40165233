"""The lifecycle node: it opens a knowledge base when configured, and answers while active.

It needs `rclpy`, which comes with ROS 2, not from a Python package index.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from typing import Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ShutdownException, TimeoutException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState

from ..arguments import URL_VARIABLE
from ..compat import DaoFactory
from ..errors import InvalidArgumentError, InvalidUrlError, KantSqlError
from ..history.follow import watch_until
from ..knowledge_base import KnowledgeBase, connect, factory_of, state_of
from ..limits import Limit, obeying
from ..sql.dialects import parse_url
from ..sql.dialects.base import url_label
from . import own, paper
from .experts import DomainExpert, ProblemExpert, planner_services
from .service import Service
from .skills import PlanServer

logger = logging.getLogger("kant_sql.ros")

# Parallel long calls, and the seconds after which a call counts as long.
THREADS, LONG = 8, 0.05
# Seconds before new revisions are read, as the answer to who wrote them goes first; after an error.
PAUSE, PAUSE_AFTER_ERROR = 0.02, 0.5
# Seconds between checks whether to end: rclpy wakes up once for a signal, perhaps before the signal
# has ended the context.
LOOK = 1.0
# PlanSys2's publishers keep as many messages for late subscribers.
_LATE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# The events of a service: deep enough for a recorder that is held up for a moment.
_EVENTS = QoSProfile(depth=1000)


def _transition(step: Callable[[KnowledgeNode], None]) -> Callable[..., TransitionCallbackReturn]:
    """Make a transition of a step: its error, which rclpy would drop, is logged and fails it."""

    def run(node: KnowledgeNode, _: object = None) -> TransitionCallbackReturn:
        try:
            step(node)
        except Exception as error:
            _complain(step.__name__.removeprefix("on_"), error)
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    return run


class KnowledgeNode(LifecycleNode):  # type: ignore[misc]
    """Answers the services of KANT's node and of PlanSys2's experts from a knowledge base.

    Parameters of the node: `url`, the database, by default the environment variable `KANT_SQL_URL`;
    `knowledge_base`, its name; `actor`, who writes (by default the name of the node);
    `introspection`, whether calls of services are published for recorders, with their contents;
    `autostart`, whether it is configured and active at once (both false by default). It omits
    services whose interfaces are not installed.
    """

    def __init__(self, url: str = "", knowledge_base: str = "default", actor: str = "") -> None:
        super().__init__("kant_sql")
        self._url = url or os.environ.get(URL_VARIABLE, "")
        shown = ""
        with suppress(InvalidUrlError):  # Configuring says what is wrong.
            shown = "" if _has_password(self._url) else self._url
        given = {"url": shown, "knowledge_base": knowledge_base, "actor": actor}
        for name, default in {**given, "introspection": False, "autostart": False}.items():
            self.declare_parameter(name, default)
        # Changes are made in order of arrival; questions do not wait for each other.
        self._groups = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
        self._kb: KnowledgeBase | None = None
        self._active = ExitStack()

    def parameter(self, name: str) -> Any:
        """Return the value of a parameter."""
        return self.get_parameter(name).value

    @_transition
    def on_configure(self) -> None:
        """Open the knowledge base; the node stays unconfigured where that fails."""
        url, actor = self.parameter("url"), self.parameter("actor") or self.get_name()
        if url and _has_password(url):
            raise InvalidUrlError(
                "each node can read the parameter url, and this one has a password; put the URL "
                f"into the environment variable {URL_VARIABLE}, or the password into ~/.pgpass"
            )
        name = self.parameter("knowledge_base")
        self._kb = connect(url or self._url, knowledge_base=name, actor=actor)

    @_transition
    def on_activate(self) -> None:
        """Offer the services and the topics."""
        assert self._kb is not None
        limit = Limit()
        with self._active:
            for service in self._offered(self._kb):
                group = self._groups[service.is_question]
                answer = self._guarded(service, limit)
                made = self.create_service(service.kind, service.name, answer, callback_group=group)
                self._active.callback(self.destroy_service, made)
                if self.parameter("introspection"):
                    contents = ServiceIntrospectionState.CONTENTS
                    made.configure_introspection(self.get_clock(), _EVENTS, contents)
            self._active.callback(limit.cancel)
            self._active = self._active.pop_all()

    @_transition
    def on_deactivate(self) -> None:
        """Withdraw the services and the topics; running questions end."""
        self._active.close()

    @_transition
    def on_cleanup(self) -> None:
        """Withdraw everything, and close the knowledge base."""
        self._active.close()
        if self._kb is not None:
            self._kb.close()

    on_shutdown = on_error = on_cleanup

    def _offered(self, kb: KnowledgeBase) -> Iterator[Service]:
        """Yield the services whose interfaces are installed."""
        for messages, kinds in _interfaces("kant_sql_msgs"):
            self._watch(kb, messages)
            with suppress(ModuleNotFoundError):  # Built before it had actions.
                made = importlib.import_module("kant_sql_msgs.action")
                self._active.callback(PlanServer(self, kb, made).close)
            yield from own.services(kb, messages, kinds)
        for messages, kinds in _interfaces("kant_msgs"):
            empty = importlib.import_module("std_srvs.srv").Empty
            yield from paper.services(DaoFactory.of(factory_of(kb)), messages, kinds, empty)
        for messages, kinds in _interfaces("plansys2_msgs"):
            yield from DomainExpert(kb, messages).services(kinds)
            yield from self._noticed(ProblemExpert(kb, messages), messages, kinds)
            yield from planner_services(messages, kinds)

    def _noticed(self, expert: ProblemExpert, messages: Any, kinds: Any) -> Iterator[Service]:
        """Publish the problem expert's knowledge after each call that may have changed it."""
        empty = importlib.import_module("std_msgs.msg").Empty
        notify = self._publisher(empty, "problem_expert/update_notify", 100)

        # Set while nobody was told what is known: to write that down costs time, so that it is done
        # for those who listen, and for the first who comes later.
        untold = threading.Event()
        if expert.instances():
            untold.set()

        def publish() -> None:
            untold.set()
            if knowledge.get_subscription_count():
                untold.clear()
                knowledge.publish(expert.knowledge())

        def listened(_: object) -> None:
            if untold.is_set():
                publish()

        matched = PublisherEventCallbacks(matched=listened)
        topic = "problem_expert/knowledge"
        knowledge = self._publisher(messages.Knowledge, topic, _LATE, event_callbacks=matched)

        def changing(service: Service) -> Service:
            def answer(request: Any, response: Any) -> None:
                service.answer(request, response)
                if notify.get_subscription_count():
                    notify.publish(empty())
                publish()

            return service._replace(answer=answer)

        for service in expert.services(kinds):
            yield service if service.is_question else changing(service)

    def _publisher(self, *arguments: Any, **options: Any) -> Any:
        publisher = self.create_publisher(*arguments, **options)
        self._active.callback(self.destroy_publisher, publisher)
        return publisher

    def _guarded(self, service: Service, limit: Limit) -> Callable[[Any, Any], Any]:
        """Answer a failed request with its error; the node continues."""

        def answer(request: Any, response: Any) -> Any:
            said = ""
            try:
                with obeying(limit):
                    service.answer(request, response)
            except Exception as error:
                said = str(error) or type(error).__name__
                _complain(service.name, error)
            if hasattr(response, "error_info"):
                response.success, response.error_info = not said, said
            elif said and hasattr(response, "success"):
                response.success = False
            return response

        return answer

    def _watch(self, kb: KnowledgeBase, messages: Any) -> None:
        """Publish each revision, whoever writes it, in order and without gaps."""
        publisher = self._publisher(messages.Revision, "~/changes", _LATE)
        stop = threading.Event()
        first = max(kb.revision - 1, 0)

        def run() -> None:
            after = first
            while not stop.wait(PAUSE):
                try:
                    for entry in kb.changes(after):
                        publisher.publish(own.write_revision(entry, messages))
                        after = entry.revision.number
                    watch_until(state_of(kb), after, None, stop.is_set)
                except Exception as error:
                    if not self.context.ok():  # Ctrl-C ends it at any moment.
                        return
                    _complain("~/changes", error)
                    stop.wait(PAUSE_AFTER_ERROR)

        watcher = threading.Thread(target=run, name="kant_sql changes", daemon=True)
        watcher.start()
        self._active.callback(watcher.join)
        self._active.callback(stop.set)


class Threads(Executor):  # type: ignore[misc]
    """Runs services in threads, and waits briefly for each, because most end soon.

    rclpy's MultiThreadedExecutor prepares the next wait meanwhile, in Python: a save through it
    took 45 % longer than in one thread, and takes 6 % longer here.
    """

    def __init__(self, node: KnowledgeNode) -> None:
        super().__init__()
        self._own = node.default_callback_group
        self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="kant_sql service")

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Begin one callback, and wait for its end if that comes soon."""
        with suppress(ShutdownException, TimeoutException, TimeoutError):
            task, entity, _ = self.wait_for_ready_callbacks(timeout_sec)
            if entity is not None and entity.callback_group is self._own:
                self._run(task)  # Lifecycle and parameters wait for no service.
            else:
                self._pool.submit(self._run, task).exception(LONG)

    def _run(self, task: Any) -> None:
        task()
        # Nobody reads the answer of a service that is withdrawn, or of a node that ends.
        error = task.exception()
        if error is not None and not isinstance(error, InvalidHandle) and self.context.ok():
            _complain("an answer cannot be sent", error)


class _Log(logging.Handler):
    """Passes the library's log on to the node's log, and so to /rosout."""

    def __init__(self, node: KnowledgeNode) -> None:
        super().__init__()
        self._log = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        """Log a line; rclpy wants one severity from each place that logs."""
        if record.levelno >= logging.ERROR:
            self._log.error(self.format(record))
        elif record.levelno == logging.WARNING:
            self._log.warning(self.format(record))
        else:
            self._log.info(self.format(record))


def _complain(what: str, error: Exception) -> None:
    """Log an error; an unexpected one with its traceback."""
    shown = None if isinstance(error, KantSqlError) else error
    logger.error("%s: %s", what, error, exc_info=shown)


def _has_password(url: str) -> bool:
    parsed = parse_url(url)
    return url_label(parsed) != parsed.render_as_string(hide_password=False)


def _interfaces(package: str) -> Iterator[tuple[Any, Any]]:
    """Import the messages and the services of a package, if it is installed."""
    with suppress(ModuleNotFoundError):
        yield importlib.import_module(f"{package}.msg"), importlib.import_module(f"{package}.srv")


def main(arguments: Sequence[str] | None = None, **given: str) -> None:
    """Run the node until Ctrl-C.

    Args:
        arguments: the arguments of ROS 2, such as `--ros-args -r __ns:=/rb1`.
        **given: `url`, `knowledge_base` and `actor`; with these it starts at once, or not at all.

    Raises:
        InvalidArgumentError: ROS 2 cannot read `arguments`.
        SystemExit: the node could not be configured; its log says why.
    """
    try:
        rclpy.init(args=list(sys.argv if arguments is None else arguments))
    except Exception as error:
        raise InvalidArgumentError(f"ROS 2 refuses its arguments: {error}") from error
    node = KnowledgeNode(**given)
    node.create_timer(LOOK, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))
    library = logging.getLogger("kant_sql")
    library.addHandler(_Log(node))
    library.propagate = False
    try:
        if given or node.parameter("autostart"):
            steps = node.trigger_configure, node.trigger_activate
            if any(step() is not TransitionCallbackReturn.SUCCESS for step in steps) and given:
                raise SystemExit(1)
        rclpy.spin(node, Threads(node))
    except KeyboardInterrupt:
        pass
    except Exception:
        if rclpy.ok():  # A signal ends the context at any moment.
            raise
    finally:
        node.on_shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
