"""A process in which another tool walks at random through the states of a pair.

It prints a line of JSON for each state as soon as it has it: the facts and the numbers of what
actions change, the applicable actions, and the one that it takes.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from random import Random
from typing import Any

# Facts, values, and the applicable actions with what makes the next state of each.
State = tuple[list[list[str]], list[tuple[list[str], float]], dict[tuple[str, ...], Any]]


class Pyperplan:
    """STRIPS, grounded before."""

    def __init__(self, domain: str, problem: str) -> None:
        from pyperplan.grounding import ground
        from pyperplan.pddl.parser import Parser

        parser = Parser(domain, problem)
        task = parser.parse_problem(parser.parse_domain())
        self._task = ground(task, False, False)
        self.first = self._task.initial_state

    def look(self, state: Any) -> State:
        applicable = {words(o.name): o for o in self._task.operators if o.applicable(state)}
        return [[*words(fact)] for fact in state], [], applicable

    def next(self, state: Any, taken: Any) -> Any:
        return taken.apply(state)


class Mimir:
    """Lifted successor generation; its numbers are those of functions that actions change."""

    def __init__(self, domain: str, problem: str) -> None:
        import pymimir

        task = pymimir.Problem(pymimir.Domain(domain), problem, mode="lifted")
        self.first = task.get_initial_state()
        values = task._advanced_problem.get_fluent_function_values()
        fluents = {value.get_function().get_index(): value.get_function() for value in values}
        self._fluents = [fluents[index] for index in sorted(fluents)]

    def look(self, state: Any) -> State:
        facts = [
            [atom.get_predicate().get_name(), *(term.get_name() for term in atom.get_terms())]
            for atom in state.get_atoms(ignore_static=True, ignore_derived=True)
        ]
        numbers = state._advanced_state.get_numeric_variables()
        values = [
            ([f.get_function_skeleton().get_name(), *(o.get_name() for o in f.get_objects())], n)
            for f, n in zip(self._fluents, numbers, strict=True)
        ]
        applicable = {
            (a.get_action().get_name(), *(o.get_name() for o in a.get_objects())): a
            for a in state.generate_applicable_actions()
        }
        return facts, values, applicable

    def next(self, state: Any, taken: Any) -> Any:
        return taken.apply(state)


class UnifiedPlanning:
    """The simulator of unified-planning, which enumerates the groundings of each action."""

    def __init__(self, domain: str, problem: str) -> None:
        from unified_planning.engines import UPSequentialSimulator
        from unified_planning.environment import get_environment
        from unified_planning.io import PDDLReader

        environment = get_environment()
        environment.credits_stream = None
        environment.error_used_name = False
        self._task = PDDLReader().parse_problem(domain, problem)
        self._simulator = UPSequentialSimulator(self._task, error_on_failed_checks=False)
        self.first = self._simulator.get_initial_state()
        self._fluents = [*self._task.initial_values]

    def look(self, state: Any) -> State:
        facts, values = [], []
        for fluent in self._fluents:
            value = state.get_value(fluent)
            name = [fluent.fluent().name, *map(str, fluent.args)]
            if value.is_true():
                facts.append(name)
            elif not value.is_bool_constant():
                values.append((name, float(value.constant_value())))
        applicable = {
            (action.name, *map(str, arguments)): (action, arguments)
            for action, arguments in self._simulator.get_applicable_actions(state)
        }
        return facts, values, applicable

    def next(self, state: Any, taken: Any) -> Any:
        return self._simulator.apply(state, *taken)


JUDGES = {"pyperplan": Pyperplan, "pymimir": Mimir, "unified_planning": UnifiedPlanning}


def words(text: str) -> tuple[str, ...]:
    """The words of a ground atom or action."""
    return tuple(text.strip("()").split())


def walk(judge: Any, steps: int, seed: int) -> Iterator[dict[str, object]]:
    """Go so many steps at random, or up to where there is none."""
    random, state = Random(seed), judge.first
    for number in range(steps + 1):
        facts, values, applicable = judge.look(state)
        taken = random.choice(sorted(applicable)) if applicable and number < steps else None
        yield {"facts": facts, "values": values, "applicable": sorted(applicable), "taken": taken}
        if taken is None:
            return
        state = judge.next(state, applicable[taken])


def main(name: str, domain: str, problem: str, steps: str, seed: str) -> None:
    """Print the states of a walk."""
    for line in walk(JUDGES[name](domain, problem), int(steps), int(seed)):
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
