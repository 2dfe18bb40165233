; A robot whose battery is nearly empty brings things to places.
(define (domain kitchen)
  (:requirements :strips :typing :negative-preconditions :fluents :preferences :constraints)
  (:types robot item wp - object)
  (:predicates (at ?r - robot ?w - wp) (lies ?i - item ?w - wp) (holds ?r - robot ?i - item))
  (:functions (battery ?r - robot))
  (:action move
    :parameters (?r - robot ?from ?to - wp)
    :precondition (and (at ?r ?from) (not (at ?r ?to)) (>= (battery ?r) 10))
    :effect (and (not (at ?r ?from)) (at ?r ?to) (decrease (battery ?r) 10)))
  (:action take
    :parameters (?r - robot ?i - item ?w - wp)
    :precondition (and (at ?r ?w) (lies ?i ?w))
    :effect (and (not (lies ?i ?w)) (holds ?r ?i))))
