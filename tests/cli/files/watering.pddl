; Something of nearly all that PDDL has.
(define (domain watering)
  (:requirements :typing :fluents :object-fluents :durative-actions :duration-inequalities :time
    :derived-predicates :timed-initial-literals :timed-initial-fluents :negative-preconditions
    :equality :constraints :preferences :disjunctive-preconditions :universal-preconditions)
  (:types plant - thing)
  (:constants can - thing)
  (:predicates (dry ?p - plant) (raining) (thirsty) (full ?t - thing))
  (:functions (water ?p - plant) - number (next ?p - plant) - plant (total-cost) - number)
  (:constraints (forall (?p - plant) (always (>= (water ?p) 0))))
  (:derived (thirsty) (exists (?p - plant) (dry ?p)))
  (:durative-action pour
    :parameters (?p - plant)
    :duration (and (>= ?duration 1) (<= ?duration 2.50))
    :condition (and (at start (full can)) (over all (not (raining))))
    :effect (and (at end (not (dry ?p))) (at end (increase (water ?p) 1.5))))
  (:process rain
    :parameters (?p - plant)
    :precondition (raining)
    :effect (increase (water ?p) (* #t 0.1)))
  (:event drown
    :parameters (?p - plant)
    :precondition (> (water ?p) 9)
    :effect (assign (water ?p) 9)))
