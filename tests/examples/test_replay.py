"""A mission that failed is replayed from the store: what was known, and what each step caused."""

from __future__ import annotations

import kant_sql
from tests.support.chain import check_chain
from tests.support.processes.commands import run_example

REPLAYED = """\
  (:goal (and
    (checked kitchen)
    (checked lab)
  ))
)

0 (move rb1 hall kitchen) succeeded
    3: + (at rb1 kitchen)
    3: - (at rb1 hall)
1 (check rb1 kitchen) succeeded
    4: + (checked kitchen)
2 (move rb1 kitchen lab) failed
    6: - (open lab)
3 (check rb1 lab) aborted
"""


def test_it_tells_what_the_planner_was_given_and_what_each_step_caused(file_url: str) -> None:
    done = run_example("replay.py", file_url)
    assert (done.returncode, done.stderr) == (0, "")
    first, given = done.stdout.split("\n", 1)
    assert first.endswith("was made from revision 1 by the night planner. It was given")
    assert given.endswith(REPLAYED)
    assert check_chain(file_url) == {"rounds": 8}
    with kant_sql.connect(file_url, knowledge_base="rounds") as kb:
        (plan,) = kb.plans.get_all()
        assert given.startswith(plan.problem_pddl())
        assert kb.at(1).problem_pddl() == plan.problem_pddl() != kb.problem_pddl()
