; A robot brings things to places.
(define (domain delivery)
  (:requirements :strips :typing)
  (:types robot item wp - object)
  (:predicates (at ?r - robot ?w - wp) (lies ?i - item ?w - wp) (holds ?r - robot ?i - item))
  (:action move
    :parameters (?r - robot ?from ?to - wp)
    :precondition (at ?r ?from)
    :effect (and (not (at ?r ?from)) (at ?r ?to)))
  (:action take
    :parameters (?r - robot ?i - item ?w - wp)
    :precondition (and (at ?r ?w) (lies ?i ?w))
    :effect (and (not (lies ?i ?w)) (holds ?r ?i)))
  (:action put
    :parameters (?r - robot ?i - item ?w - wp)
    :precondition (and (at ?r ?w) (holds ?r ?i))
    :effect (and (not (holds ?r ?i)) (lies ?i ?w))))
