; PDDL+: a process, an event, and a continuous effect of a durative action.
(define (domain tank)
  (:requirements :typing :durative-actions :fluents :time :continuous-effects
                 :negative-preconditions :duration-inequalities)
  (:types pump)
  (:predicates (on ?p - pump) (leaking) (spilt))
  (:functions (level) (rate ?p - pump) (limit))
  (:durative-action run
    :parameters (?p - pump)
    :duration (and (>= ?duration 1) (<= ?duration 30))
    :condition (at start (not (on ?p)))
    :effect (and (at start (on ?p)) (at end (not (on ?p)))
                 (increase (level) (* #t (rate ?p)))))
  (:action mend
    :parameters ()
    :precondition (leaking)
    :effect (not (leaking)))
  (:process leak
    :parameters ()
    :precondition (and (leaking) (> (level) 0))
    :effect (decrease (level) (* #t 0.5)))
  (:event overflow
    :parameters ()
    :precondition (and (not (spilt)) (>= (level) (limit)))
    :effect (spilt)))
