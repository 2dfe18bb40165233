"""A process that grounds a pair with pyperplan, and says what it has got in a normal form."""

from __future__ import annotations

import sys

from pyperplan.grounding import ground
from pyperplan.pddl.parser import Parser


def main(domain: str, problem: str) -> None:
    """Print the grounded task: pyperplan's own order depends on that of sets."""
    parser = Parser(domain, problem)
    task = ground(parser.parse_problem(parser.parse_domain()))
    lines = [f"fact {fact}" for fact in task.facts]
    lines += [f"init {fact}" for fact in task.initial_state]
    lines += [f"goal {fact}" for fact in task.goals]
    for action in task.operators:
        parts = (action.preconditions, action.add_effects, action.del_effects)
        lines.append(f"{action.name} {[sorted(part) for part in parts]}")
    print("\n".join(sorted(lines)))


if __name__ == "__main__":
    main(*sys.argv[1:])
