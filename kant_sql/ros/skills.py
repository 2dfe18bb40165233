"""The action `~/execute`: a plan whose steps are goals of the robot's own action servers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from ..acts import Execution
from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase, state_of
from ..reasoning.execute import ExecutedPlan, Executive

# Parallel plans: each has a thread of the node. Seconds to wait for a server, and between checks.
GOALS, PATIENCE, LOOK = 4, 5.0, 0.1


class SkillError(Exception):
    """An action server did not execute its step; `code` says why."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


class _Client(ActionClient):  # type: ignore[misc]
    """A client whose answers wait until rclpy has noted their requests: it drops them otherwise."""

    def __init__(self, server: PlanServer, name: str) -> None:
        self.guard = threading.RLock()
        super().__init__(server.node, server.made.Perform, name, callback_group=server.group)

    async def execute(self, taken: Any) -> None:
        """Take an answer."""
        with self.guard:
            await super().execute(taken)


class PlanServer:
    """Serves `~/execute`; `made` is the module `kant_sql_msgs.action`."""

    def __init__(self, node: Any, kb: KnowledgeBase, made: Any) -> None:
        self.node, self.kb, self.made = node, kb, made
        self.group = ReentrantCallbackGroup()
        self._goals: dict[bytes, _Goal] = {}
        self._clients: dict[str, _Client] = {}
        self.is_closed = threading.Event()
        self._is_idle = threading.Condition()
        self._server = ActionServer(
            *(node, made.Execute, "~/execute", self._execute),
            callback_group=self.group,
            goal_callback=self._accept,
            cancel_callback=self._cancel,
        )

    def close(self) -> None:
        """Abort running plans, and withdraw the action."""
        self.is_closed.set()
        for goal in [*self._goals.values()]:
            goal.end()
        with self._is_idle:
            self._is_idle.wait_for(lambda: not self._goals, PATIENCE)
        for each in (self._server, *self._clients.values()):
            each.destroy()

    def client(self, name: str) -> _Client:
        """Return the client of an action, which lasts: the executor's thread alone may end one."""
        with self._is_idle:
            if name not in self._clients:
                self._clients[name] = _Client(self, name)
            return self._clients[name]

    def _accept(self, _: object) -> GoalResponse:
        return GoalResponse.ACCEPT if len(self._goals) < GOALS else GoalResponse.REJECT

    def _cancel(self, handle: Any) -> CancelResponse:
        goal = self._goals.get(bytes(handle.goal_id.uuid))
        if goal is not None:
            goal.end()
        return CancelResponse.ACCEPT

    def _execute(self, handle: Any) -> Any:
        key = bytes(handle.goal_id.uuid)
        self._goals[key] = goal = _Goal(self, handle)
        try:
            return goal.run()
        finally:
            with self._is_idle:
                del self._goals[key]
                self._is_idle.notify_all()


class _Goal:
    """A running plan."""

    def __init__(self, server: PlanServer, handle: Any) -> None:
        self._server, self._handle = server, handle
        self._skills: dict[str, Any] = {}
        self._done = self._total = 0
        self._executive: Executive | None = None
        self._is_over = threading.Event()

    def end(self) -> None:
        """Abort the running steps."""
        self._is_over.set()
        if self._executive is not None:
            self._executive.give_up()

    def run(self) -> Any:
        """Execute the plan, and return the result of the goal."""
        request, made = self._handle.request, self._server.made
        text = request.plan.strip()
        # Text with a line end is not a path.
        plan: int | str = int(text) if text.isdecimal() else f"{text}\n"
        try:
            state = state_of(self._server.kb)
            reason = request.reason or None
            self._executive = Executive(state, plan, self._perform, self._cancel, reason=reason)
            self._total = self._executive.size
            if self._is_over.is_set():
                self._executive.give_up()
            return self._result(self._executive.run())
        except KantSqlError as error:
            self._handle.abort()
            return made.Execute.Result(outcome="refused", text=str(error))

    def _result(self, found: ExecutedPlan) -> Any:
        if found.outcome == "succeeded":
            self._handle.succeed()
        elif self._is_over.is_set() and self._handle.is_cancel_requested:
            self._handle.canceled()
        else:
            self._handle.abort()
        step = found.step
        said = {} if step is None else {"execution": step.id, "code": step.code, "text": step.text}
        said = {key: value or "" for key, value in said.items()}
        return self._server.made.Execute.Result(outcome=found.outcome, **said)

    def _tell(self, step: Execution, outcome: str, text: str = "") -> None:
        feedback = self._server.made.Execute.Feedback(
            execution=step.id, step=str(step), outcome=outcome, text=text
        )
        feedback.progress = self._done / self._total
        with suppress(Exception):  # The client has gone.
            self._handle.publish_feedback(feedback)

    def _perform(self, step: Execution) -> None:
        """Let the action server of the action's name execute a step."""
        server, outcome = self._server, "failed"
        name = step.action.replace("-", "_")
        kind = server.made.Perform
        client = server.client(name)
        self._tell(step, "running")
        try:
            if not client.wait_for_server(PATIENCE):
                raise SkillError("no server", f"nobody serves the action {name}")
            goal = kind.Goal(execution=step.id, action=step.action, arguments=[*step.arguments])
            goal.duration = float(step.duration or 0)

            def say(message: Any) -> None:
                self._tell(step, "running", message.feedback.text)

            skill = self._wait(client, lambda: client.send_goal_async(goal, say))
            if not skill.accepted:
                raise SkillError("rejected", f"the server of {name} rejects {step}")
            if step.id in self._skills:  # It was cancelled before.
                skill.cancel_goal_async()
            self._skills[step.id] = skill
            answer = self._wait(client, skill.get_result_async)
            if answer.status == GoalStatus.STATUS_CANCELED:
                raise CancelledError
            if answer.status != GoalStatus.STATUS_SUCCEEDED or answer.result.code:
                raise SkillError(answer.result.code or "aborted", answer.result.text)
            self._done += 1
            outcome = "succeeded"
        except CancelledError:
            outcome = "aborted"
            raise
        finally:
            self._tell(step, outcome)

    def _wait(self, client: _Client, ask: Callable[[], Any]) -> Any:
        """Ask, and wait as long as there is somebody to wait for."""
        done = threading.Event()
        with client.guard:
            future = ask()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(LOOK):
            if self._server.is_closed.is_set():
                raise CancelledError
            if not client.server_is_ready():
                raise SkillError("no server", "the action's server has gone")
        return future.result()

    def _cancel(self, step: Execution) -> None:
        """Cancel the goal of a cancelled step."""
        skill = self._skills.setdefault(step.id, None)
        if skill is not None:
            skill.cancel_goal_async()
