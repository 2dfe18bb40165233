"""What each action needs, adds and deletes, read from its expression trees."""

from __future__ import annotations

import pytest

from tests.support.citus import view_of
from tests.support.pages import ask
from tests.support.stores import Connect

pytestmark = pytest.mark.every_backend

DOMAIN = """
(define (domain trees)
  (:requirements :adl :typing :durative-actions :preferences :object-fluents)
  (:types room - object)
  (:constants hall - room)
  (:predicates (p ?x - room) (q ?x ?y - room) (r))
  (:functions (next ?x - room) - room)
  (:action {name}
    :parameters (?a ?b - room)
    :precondition {condition}
    :effect {effect}))
"""
DURATIVE = DOMAIN.replace(":action", ":durative-action").replace(
    ":precondition {condition}", ":duration (= ?duration 5) :condition {condition}"
)

CONDITIONS = {
    "(and (p ?a) (r))": ["needs | (p ?a) | 0", "needs | (r) | 0"],
    "(not (p ?a))": ["needs not | (p ?a) | 0"],
    "(not (not (p ?a)))": ["needs | (p ?a) | 0"],
    "(not (not (not (p ?a))))": ["needs not | (p ?a) | 0"],
    "(or (p ?a) (not (p ?b)))": ["needs | (p ?a) | 1", "needs not | (p ?b) | 1"],
    # A conjunction that is denied is a disjunction, and the other way round.
    "(not (and (p ?a) (p ?b)))": ["needs not | (p ?a) | 1", "needs not | (p ?b) | 1"],
    "(not (or (p ?a) (p ?b)))": ["needs not | (p ?a) | 0", "needs not | (p ?b) | 0"],
    "(not (or (p ?a) (not (or (p ?b) (r)))))": [
        "needs not | (p ?a) | 0",
        "needs | (p ?b) | 1",
        "needs | (r) | 1",
    ],
    "(imply (p ?a) (q ?a ?b))": ["needs not | (p ?a) | 1", "needs | (q ?a ?b) | 1"],
    "(imply (not (p ?a)) (not (r)))": ["needs | (p ?a) | 1", "needs not | (r) | 1"],
    # To deny that one follows from the other is to need both of these.
    "(not (imply (p ?a) (p ?b)))": ["needs | (p ?a) | 0", "needs not | (p ?b) | 0"],
    "(imply (imply (p ?a) (p ?b)) (r))": [
        "needs | (p ?a) | 1",
        "needs not | (p ?b) | 1",
        "needs | (r) | 1",
    ],
    "(exists (?z - room) (and (q ?a ?z) (not (p ?z))))": [
        "needs | (q ?a ?z) | 1",
        "needs not | (p ?z) | 1",
    ],
    "(forall (?y ?z - room) (not (q ?y ?z)))": ["needs not | (q ?y ?z) | 1"],
    "(preference soft (p ?a))": ["needs | (p ?a) | 1"],
    "(and (q hall ?b) (not (= ?a ?b)))": ["needs | (q hall ?b) | 0"],
    "(q (next (next ?a)) ?b)": ["needs | (q (next (next ?a)) ?b) | 0"],
    "(q (next hall) (next ?b))": ["needs | (q (next hall) (next ?b)) | 0"],
    "(and)": [],
}
EFFECTS = {
    "(and (p ?a) (not (p ?b)))": ["adds | (p ?a) | 0", "deletes | (p ?b) | 0"],
    "(when (not (p ?a)) (and (p ?b) (not (r))))": [
        "needs not | (p ?a) | 1",
        "adds | (p ?b) | 1",
        "deletes | (r) | 1",
    ],
    "(when (imply (p ?a) (r)) (p ?b))": [
        "needs not | (p ?a) | 1",
        "needs | (r) | 1",
        "adds | (p ?b) | 1",
    ],
    "(forall (?z - room) (when (q ?a ?z) (not (p ?z))))": [
        "needs | (q ?a ?z) | 1",
        "deletes | (p ?z) | 1",
    ],
    "(and (assign (next ?a) ?b) (q ?a hall))": ["adds | (q ?a hall) | 0"],
}


def literals(connect: Connect, url: str, domain: str, section: str) -> list[str]:
    name = f"{section} {hash(domain)}"
    kb = connect(url, knowledge_base=name)
    kb.load_domain(domain)
    return ask(
        url,
        "SELECT role, literal, is_conditional "
        f"FROM {view_of(url, 'audit_action_literal', name)} "
        f"WHERE knowledge_base = '{name}' AND action = 'act' "
        f"AND section = '{section}' AND until IS NULL ORDER BY position",
    )


@pytest.mark.parametrize("condition", CONDITIONS)
def test_what_an_action_needs(scratch_url: str, connect: Connect, condition: str) -> None:
    domain = DOMAIN.format(name="act", condition=condition, effect="(and)")
    assert literals(connect, scratch_url, domain, "condition") == CONDITIONS[condition]


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_an_action_does(scratch_url: str, connect: Connect, effect: str) -> None:
    domain = DOMAIN.format(name="act", condition="(and)", effect=effect)
    assert literals(connect, scratch_url, domain, "effect") == EFFECTS[effect]


def test_when_a_durative_action_needs_and_does_it(scratch_url: str, connect: Connect) -> None:
    condition = "(and (at start (p ?a)) (over all (and (not (p ?b)) (r))))"
    effect = "(and (at start (not (p ?a))) (when (at start (r)) (at end (p ?b))))"
    kb = connect(scratch_url, knowledge_base="durative")
    kb.load_domain(DURATIVE.format(name="act", condition=condition, effect=effect))
    lines = ask(
        scratch_url,
        "SELECT kind, section, role, literal, time, is_conditional "
        f"FROM {view_of(scratch_url, 'audit_action_literal', 'durative')} "
        "WHERE knowledge_base = 'durative' ORDER BY section, position",
    )
    assert lines == [
        f"durative-action | {line}"
        for line in (
            "condition | needs | (p ?a) | at start | 0",
            "condition | needs not | (p ?b) | over all | 0",
            "condition | needs | (r) | over all | 0",
            "effect | deletes | (p ?a) | at start | 0",
            "effect | needs | (r) | at start | 1",
            "effect | adds | (p ?b) | at end | 1",
        )
    ]
