"""Rarer parts of PDDL, and whole documents as trees."""

from __future__ import annotations

from . import documents, reasoning
from .binding import Front, creates, reads, writes
from .factory import DaoFactory

__all__ = ["PddlParts"]


class PddlParts(Front):
    """`kb.pddl`: the rarer parts of PDDL, and whole documents as trees."""

    processes = creates(DaoFactory.create_pddl_process_dao)
    events = creates(DaoFactory.create_pddl_event_dao)
    derived_predicates = creates(DaoFactory.create_derived_predicate_dao)
    timed_initial_literals = creates(DaoFactory.create_timed_initial_literal_dao)
    initial_literals = creates(DaoFactory.create_initial_literal_dao)
    constraints = creates(DaoFactory.create_constraint_dao)
    domain_constraints = creates(DaoFactory.create_domain_constraint_dao)
    metric = creates(DaoFactory.create_metric_dao)

    metric_value = reads(lambda: reasoning.explain.metric_value)
    check_rules = reads(lambda: reasoning.rules.check_rules)
    broken_invariants = reads(lambda: reasoning.durative.broken_invariants)

    domain = reads(lambda: documents.exchange.domain)
    problem = reads(lambda: documents.exchange.problem)
    requirements = reads(lambda: documents.exchange.requirements)
    complete = reads(lambda: reasoning.complete.complete)
    to_unified_planning = reads(lambda: documents.planners.to_unified_planning)
    load_unified_planning = writes(lambda: documents.planners.load_unified_planning)
