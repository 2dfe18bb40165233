; Durative actions with durations from the state, within what temporal planners read.
(define (domain baking)
  (:requirements :typing :durative-actions :fluents)
  (:types cake oven)
  (:predicates (raw ?c - cake) (baked ?c - cake) (iced ?c - cake) (hot ?o - oven) (free ?o - oven))
  (:functions (time-for ?c - cake))
  (:durative-action heat
    :parameters (?o - oven)
    :duration (= ?duration 5)
    :condition (at start (free ?o))
    :effect (and (at start (not (free ?o))) (at end (hot ?o)) (at end (free ?o))))
  (:durative-action bake
    :parameters (?c - cake ?o - oven)
    :duration (= ?duration (time-for ?c))
    :condition (and (at start (raw ?c)) (over all (hot ?o)) (at start (free ?o)))
    :effect (and (at start (not (free ?o))) (at start (not (raw ?c)))
                 (at end (baked ?c)) (at end (free ?o))))
  (:durative-action ice
    :parameters (?c - cake)
    :duration (= ?duration 2)
    :condition (over all (baked ?c))
    :effect (at end (iced ?c))))
