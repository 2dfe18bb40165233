"""Causal links agree with the states of the plan, and with unified-planning's partial orders."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import CausalLink, KnowledgeBase, Plan, PlanStep
from tests.meaning.material import ALL, PLANS
from tests.meaning.successors import plain
from tests.support.corpus import PAIRS, WITHOUT_CORPUS, Pair

networkx: Any = pytest.importorskip("networkx")
_STEP = re.compile(r"^\(([^()]+)\)", re.M)
SAMPLE = ("blocks-strips-typed", "gripper-round-1-adl", "elevator-adl-simple")


def plan_of(pair: Pair) -> Path:
    return PLANS / f"{pair.name.replace('/', '.').removesuffix('.pddl')}.plan"


def partial_order(files: list[str], plan: Path) -> Any:
    """The order of steps that unified-planning keeps, by their positions."""
    from unified_planning.environment import get_environment
    from unified_planning.io import PDDLReader
    from unified_planning.plans import PlanKind

    environment = get_environment()
    environment.error_used_name = False
    reader = PDDLReader()
    with warnings.catch_warnings():
        # Its reader calls pyparsing by old names.
        warnings.simplefilter("ignore")
        problem = reader.parse_problem(*files)
        found = reader.parse_plan(problem, str(plan))
    place = {id(one): number for number, one in enumerate(found.actions)}
    order: Any = found.convert_to(PlanKind.PARTIAL_ORDER_PLAN, problem)
    graph = networkx.DiGraph()
    graph.add_nodes_from(place.values())
    for one, after in order.get_adjacency_list.items():
        graph.add_edges_from((place[id(one)], place[id(each)]) for each in after)
    return networkx.transitive_closure(graph)


def check_states(kb: KnowledgeBase, steps: list[PlanStep], links: list[CausalLink]) -> None:
    """A literal holds from its supporter up to where it is needed, and not before."""
    states = [kb.state()]
    for step in steps:
        states.append(states[-1].apply(step))
    for link in links:
        end = len(steps) if link.position is None else link.position
        begin = 0 if link.supporter is None else link.supporter + 1
        assert begin <= end, link
        if kb.pddl.domain().functions and not link.literal.startswith("(not "):
            # The value of a fluent is no condition.
            continue
        assert all(each.holds(link.literal) for each in states[begin : end + 1]), link
        assert link.supporter is None or not states[link.supporter].holds(link.literal), link


@pytest.mark.skipif(not PAIRS, reason=WITHOUT_CORPUS)
def test_links_are_within_the_partial_order_of_unified_planning(tmp_path: Path) -> None:
    judged = 0
    for number, pair in enumerate(PAIRS):
        plan = plan_of(pair)
        if not plan.exists() or not (ALL or any(word in pair.name for word in SAMPLE)):
            continue
        folder = tmp_path / str(number)
        folder.mkdir()
        steps = [PlanStep(None, *_words(text)) for text in _STEP.findall(plan.read_text())]
        files = plain(pair, folder).files
        order = partial_order(files, plan)
        with kant_sql.connect("sqlite://") as kb:
            kb.load_domain(Path(files[0]))
            kb.load_problem(Path(files[1]))
            links = kb.pddl.causal_links(Plan(tuple(steps), "by hand", "unknown"))
            check_states(kb, steps, links)
        between = {(one.supporter, one.position) for one in links} - {(None, None)}
        between = {each for each in between if None not in each}
        assert between <= {*order.edges}, f"{pair.name}: {between - {*order.edges}}"
        # What nothing supports but the plan is made for supports the goal.
        assert {one.supporter for one in links} - {None}, pair.name
        judged += len(between)
    assert judged > 10


def _words(text: str) -> tuple[str, tuple[str, ...]]:
    name, *arguments = text.split()
    return name, tuple(arguments)
