"""The strategies that other tests rely on draw every construct of the language."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, seed, settings

from kant_sql.dto import formulas as f
from kant_sql.pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS, Domain, Problem
from kant_sql.pddl.requirements import REQUIREMENTS, used_requirements
from tests.support.generators.documents import domains_and_problems

NODES = {
    kind.__name__
    for kind in (*f.Node.__subclasses__(), *f.FormulaNode.__subclasses__())
    if kind.__module__.startswith("kant_sql.dto.")
} - {"Count", "FormulaNode"}


def roots(domain: Domain, problem: Problem) -> list[f.Node]:
    found: list[f.Node] = [
        *domain.constraints,
        *domain.derived,
        *problem.goal,
        *problem.constraints,
    ]
    found += [*problem.literals, *problem.facts, *problem.timed]
    found += [problem.metric] if problem.metric is not None else []
    for action in domain.actions:
        found += [*action.duration, *action.condition, *action.effect]
    return found


def labels(node: f.Node) -> set[str]:
    found = {type(node).__name__}
    match node:
        case f.Comparison() | f.Arithmetic() | f.Assign() | f.Modal():
            found.add(f"{type(node).__name__} {node.operator}")
        case f.Timed():
            found.add(node.time)
        case f.Preference():
            found.add("named" if node.name else "unnamed")
    return found


def draw(drawn: set[str], seed_: int) -> None:
    """Draw 40 pairs of documents, and note what is in them."""

    @seed(seed_)
    @settings(
        max_examples=40,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(domains_and_problems())
    def note(documents: tuple[Domain, Problem]) -> None:
        domain, problem = documents
        drawn.update(used_requirements(domain, problem=problem))
        drawn.update(action.kind for action in domain.actions)
        for node in f.walk(*roots(domain, problem)):
            drawn.update(labels(node))

    note()


@pytest.mark.more
def test_every_construct_is_drawn() -> None:
    drawn: set[str] = set()
    wanted = NODES | set(f.TIMES) | {"named", "unnamed", ACTION, DURATIVE_ACTION, PROCESS, EVENT}
    wanted |= {f"Comparison {operator}" for operator in f.COMPARISONS}
    wanted |= {f"Arithmetic {operator}" for operator in f.ARITHMETIC}
    wanted |= {f"Assign {operator}" for operator in f.ASSIGNMENTS}
    wanted |= {f"Modal {operator}" for operator in f.MODALS}
    # Costs are a matter of chance: numbers that happen to be used for nothing else.
    wanted |= set(REQUIREMENTS) - {":action-costs"}
    # What is rare may take more: what is drawn depends on the constants in the code.
    for number in range(50):
        draw(drawn, number)
        if wanted <= drawn:
            break
    assert wanted - drawn == set()
