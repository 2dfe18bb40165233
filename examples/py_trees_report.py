"""A behaviour tree reports what it does: each leaf that runs, succeeds, fails or is interrupted.

$ pip install py_trees
$ python examples/py_trees_report.py [URL] [DEMO ...]
"""

from __future__ import annotations

import sys
from importlib import import_module

import py_trees
from py_trees.common import Status

import kant_sql
from kant_sql import Execution, KnowledgeBase
from kant_sql.acts import Outcome

OUTCOMES: dict[Status, Outcome] = {
    Status.RUNNING: "running",
    Status.SUCCESS: "succeeded",
    Status.FAILURE: "failed",
    Status.INVALID: "aborted",
}


class Reporter(py_trees.visitors.VisitorBase):
    """Reports the leaves of a tree when their status changes."""

    def __init__(self, kb: KnowledgeBase) -> None:
        super().__init__(full=True)  # Those that were interrupted, too.
        self.kb = kb
        self.known: dict[object, tuple[Status, str | Execution]] = {}

    def run(self, behaviour: py_trees.behaviour.Behaviour) -> None:
        """Report a behaviour after a tick."""
        now, text = behaviour.status, behaviour.feedback_message or None
        before, act = self.known.get(behaviour.id, (Status.INVALID, behaviour.name))
        if behaviour.children or now == before:
            return
        if now != Status.INVALID or before == Status.RUNNING:
            done = self.kb.executions.report(act, outcome=OUTCOMES[now], text=text)
            act = done if now == Status.RUNNING else behaviour.name
        self.known[behaviour.id] = now, act


def main(url: str, demos: list[str]) -> None:
    """Run demos of py_trees, and print what they did, oldest first."""
    for demo in demos:
        with kant_sql.connect(url, knowledge_base=demo, actor="tree") as kb:
            tree = py_trees.trees.BehaviourTree(
                import_module(f"py_trees.demos.{demo}").create_root()
            )
            tree.add_visitor(Reporter(kb))
            tree.setup()
            for _ in range(4):
                tree.tick()
            tree.interrupt()
            for done in reversed([*kb.executions.get_all()]):
                print(demo, done, done.outcome)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        given[0] if given else "sqlite:///tree.db",
        given[1:] or ["selector", "sequence", "pick_up_where_you_left_off"],
    )
