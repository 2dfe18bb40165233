"""A behaviour tree reports its leaves: each that runs, succeeds, fails or is interrupted.

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
    """Reports each leaf that a tick runs, and those that are interrupted."""

    def __init__(self, kb: KnowledgeBase) -> None:
        super().__init__(full=False)  # The leaves of the present tick.
        self.kb = kb
        self.running: dict[py_trees.behaviour.Behaviour, Execution] = {}

    def run(self, behaviour: py_trees.behaviour.Behaviour) -> None:
        """Report a behaviour after its tick."""
        now, act = behaviour.status, self.running.pop(behaviour, None)
        if behaviour.children or (now == Status.INVALID and act is None):
            return
        if act is None or now != Status.RUNNING:
            name = behaviour.name.strip() or type(behaviour).__name__
            text = behaviour.feedback_message or None
            act = self.kb.executions.report(act or name, outcome=OUTCOMES[now], text=text)
        if now == Status.RUNNING:
            self.running[behaviour] = act

    def finalise(self) -> None:
        """Report interrupted leaves, which were not ticked."""
        for each in [each for each in self.running if each.status == Status.INVALID]:
            self.run(each)


def main(url: str, demos: list[str]) -> None:
    """Run demos of py_trees, and print their executions, oldest first."""
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
