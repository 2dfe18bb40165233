; Numbers and negative preconditions, within what numeric planners read.
(define (domain watering)
  (:requirements :typing :fluents :negative-preconditions)
  (:types plant well)
  (:predicates (at-well ?w - well) (dry ?w - well))
  (:functions (carried) (poured ?p - plant) (wanted ?p - plant) (capacity) (effort))
  (:action walk
    :parameters (?from ?to - well)
    :precondition (at-well ?from)
    :effect (and (not (at-well ?from)) (at-well ?to) (increase (effort) 1.5)))
  (:action draw
    :parameters (?w - well)
    :precondition (and (at-well ?w) (not (dry ?w)) (< (carried) (capacity)))
    :effect (and (increase (carried) 1) (increase (effort) (* 0.25 (carried)))))
  (:action pour
    :parameters (?p - plant)
    :precondition (and (>= (carried) 1) (< (poured ?p) (wanted ?p)))
    :effect (and (decrease (carried) 1) (increase (poured ?p) 1))))
