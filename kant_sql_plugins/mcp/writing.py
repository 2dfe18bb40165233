"""Tools that write: to branches that the actor has begun, or where a kept rule refuses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import anyio
from mcp.server.mcpserver.tools import Tool
from mcp_types import ToolAnnotations
from pydantic import Field, StrictFloat, StrictInt

from kant_sql.arguments import shown
from kant_sql.errors import InvalidArgumentError, ReadOnlyError
from kant_sql.knowledge_base import KnowledgeBase, connect
from kant_sql.web.registry import At, moment
from kant_sql.web.stores import OpenStore
from kant_sql.web.writing import WriteAnswer, apply, facts, values, write

from .questions import Step
from .server import Asking, make_tool

T = TypeVar("T")
Target = Literal["branch", "checked"]

MOST_WRITTEN = 1_000
Reason = Annotated[
    str, Field(min_length=1, max_length=10_000, description="Why: others read it in the log.")
]
Facts = Annotated[
    tuple[str, ...],
    Field(max_length=MOST_WRITTEN, description="Facts as `(robot_at rb1 wp1)`, of known names."),
]
Fluents = Annotated[
    tuple[str, ...],
    Field(max_length=MOST_WRITTEN, description="Fluents to unset."),
]
Values = Annotated[
    dict[str, StrictInt | StrictFloat | str],
    Field(max_length=MOST_WRITTEN, description="Values by fluents: `{'(battery rb1)': 90}`."),
]
BranchName = Annotated[str, Field(min_length=1, description="The name of the new branch.")]
SAID = {
    "branch": "You write to branches alone: `begin_branch`, then give its name as `kb`. A person "
    "compares and merges it.",
    "checked": "What you write counts at once, unless it violates a rule that is kept (`rules`).",
}


class BegunBranch(NamedTuple):
    """A branch: its name, which the other tools take as `kb`, and its first revision."""

    kb: str
    revision: int


class Writing(Asking):
    """Writes only where the actor may write."""

    def __init__(self, store: OpenStore, target: Target, name: str | None, actor: str) -> None:
        super().__init__(store)
        self._target = target
        self._name = name
        self._actor = actor
        if target == "checked":
            self._name = store.choose(name)
            self.of_kb(None, lambda kb: None)

    async def answer(self, work: Callable[[], T]) -> T:
        """Write; a begun write is not cancelled."""
        return await anyio.to_thread.run_sync(work, limiter=self._limiter)

    def of_kb(self, name: str | None, question: Callable[[KnowledgeBase], T]) -> T:
        """Write to a knowledge base, if the actor may."""
        chosen = self.store.choose(name or self._name)
        # Without this, a write would create it.
        self.store.require(chosen)
        with self.store.knowledge_base(chosen) as kb:
            if self._target == "branch":
                self._require_own(kb, chosen)
            else:
                self._require_rule(kb, chosen)
            return question(kb)

    def _require_own(self, kb: KnowledgeBase, name: str) -> None:
        first = kb.store.revisions(0, limit=1)[0]
        is_branch = isinstance(first.source, Mapping) and "parent" in first.source
        if not is_branch or first.actor != self._actor:
            raise ReadOnlyError(
                f"{shown(name)} is not a branch that {shown(self._actor)} has begun; begin one "
                "with the tool begin_branch, and give its name as kb"
            )

    def _require_rule(self, kb: KnowledgeBase, name: str) -> None:
        if name != self._name:
            raise ReadOnlyError(f"this server writes to {shown(self._name)} only")
        if not any(rule.on_violation == "refuse" for rule in kb.rules.get_all()):
            raise ReadOnlyError(
                f"{shown(name)} keeps no rule that refuses, so nothing would check writes; keep "
                "one by kb.rules.save(NAME, RULE, on_violation='refuse'), or write to branches: "
                "--write branch"
            )

    def tools(self) -> list[Tool]:
        """Make the tools."""
        is_branch = self._target == "branch"
        hints = ToolAnnotations(
            read_only_hint=False, destructive_hint=not is_branch, open_world_hint=False
        )
        made = [make_tool(self, one.__name__, one, hints) for one in self._functions()]
        if is_branch:
            # A branch can begin from everything that the actor may read.
            made.append(make_tool(Asking(self.store), "begin_branch", self._begin(), hints))
        return made

    def _functions(self) -> tuple[Callable[..., Any], ...]:
        def write_facts(
            kb: KnowledgeBase, reason: Reason, save: Facts = (), delete: Facts = ()
        ) -> WriteAnswer:
            """Retract and assert facts, as one revision: all or nothing."""
            return self._written(kb, reason, partial(facts, save=save, delete=delete))

        def write_values(
            kb: KnowledgeBase, reason: Reason, set: Values | None = None, unset: Fluents = ()
        ) -> WriteAnswer:
            """Set values of functions, as one revision: all or nothing."""
            return self._written(kb, reason, partial(values, set=set, unset=unset))

        def apply_step(kb: KnowledgeBase, step: Step, reason: Reason) -> WriteAnswer:
            """Write the effects of a step if its conditions hold; nothing moves in the world."""
            return self._written(kb, reason, partial(apply, step=step))

        return write_facts, write_values, apply_step

    def _written(
        self, kb: KnowledgeBase, reason: str, work: Callable[[KnowledgeBase], Any]
    ) -> WriteAnswer:
        def checked(kb: KnowledgeBase) -> Any:
            if self._target == "checked":
                # Now nobody else can delete the rule.
                self._require_rule(kb, kb.store.factory.name)
            return work(kb)

        return write(kb, {"actor": self._actor, "reason": reason}, checked)[0]

    def _begin(self) -> Callable[..., BegunBranch]:
        store, actor = self.store, self._actor

        def begin_branch(kb: KnowledgeBase, name: BranchName, at: At = None) -> BegunBranch:
            """Begin a branch with a state of a knowledge base, to write to without changing it."""
            parent = kb.store.factory.name
            store.require(parent)
            with (
                connect(store.url, knowledge_base=parent, actor=actor) as own,
                own.branch(name, at=moment(at)) as made,
            ):
                if not made.revision:
                    raise InvalidArgumentError(
                        f"the state of {shown(parent)} is empty, so it has no branch; begin with "
                        "another state"
                    )
                return BegunBranch(name, made.revision)

        return begin_branch
