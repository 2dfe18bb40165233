"""A world of robots on a graph of places, with elements for all conditions."""

from __future__ import annotations

from kant_sql import KnowledgeBase

DOMAIN = """
(define (domain graph)
  (:requirements :typing :fluents :object-fluents :derived-predicates)
  (:types robot place - object drone - robot)
  (:constants w0 - place)
  (:predicates (robot_at ?r - robot ?w - place) (free) (conn ?a ?b - place) (blocked ?w - place)
    (tri ?a ?b ?c - place) (reach ?a ?b - place) (back ?a ?b - place) (pair ?a ?b - place)
    (even ?a - place) (odd ?a - place) (big ?a - place) (all_free ?a - place))
  (:functions (fuel ?r - robot) - number (dist ?a ?b - place) - number (home ?r - robot) - place)
  (:derived (reach ?a ?b - place)
    (or (conn ?a ?b) (exists (?c - place) (and (conn ?a ?c) (reach ?c ?b)))))
  (:derived (back ?a ?b - place)
    (or (conn ?b ?a) (exists (?c - place) (and (back ?a ?c) (conn ?b ?c)))))
  (:derived (pair ?a ?b - place)
    (or (conn ?a ?b) (exists (?c - place) (and (pair ?a ?c) (pair ?c ?b)))))
  (:derived (even ?a - place) (or (= ?a w0) (exists (?b - place) (and (conn ?b ?a) (odd ?b)))))
  (:derived (odd ?a - place) (exists (?b - place) (and (conn ?b ?a) (even ?b))))
  (:derived (big ?a - place) (and (even ?a) (not (blocked ?a))))
  (:derived (all_free ?a - place)
    (and (not (blocked ?a)) (forall (?b - place) (imply (conn ?a ?b) (all_free ?b)))))
  (:action move :parameters (?r - robot ?a ?b - place)
    :precondition (and (robot_at ?r ?a) (conn ?a ?b))
    :effect (and (not (robot_at ?r ?a)) (robot_at ?r ?b))))
"""
PROBLEM = """
(define (problem line) (:domain graph)
  (:objects rb1 rb2 - robot d1 - drone w1 w2 w3 w4 w5 w6 - place)
  (:init (robot_at rb1 w1) (robot_at rb2 w3) (blocked w2)
    (conn w0 w1) (conn w1 w2) (conn w2 w3) (conn w3 w4) (conn w4 w5) (conn w5 w6)
    (tri w1 w2 w3) (tri w2 w2 w4)
    (= (fuel rb1) 5) (= (dist w1 w2) 3) (= (home rb1) w1))
  (:goal (and (free) (robot_at rb1 w6))))
"""


def load(kb: KnowledgeBase) -> None:
    """Load domain and problem."""
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM)
