; Conditional and universal effects (ADL), constants, action costs, a
; parameter that any object fits.
(define (domain cafe)
  (:requirements :adl :action-costs)
  (:types staff ware - thing thing place - object waiter cook - staff table kitchen - place
          cup plate - ware)
  (:constants bar - kitchen)
  (:predicates
    (at ?x - thing ?p - place)
    (carries ?w - waiter ?x - ware)
    (dirty ?x - ware)
    (free ?w - waiter)
    (known ?x - object))
  (:functions (total-cost) - number (fare ?from ?to - place) - number)
  (:action walk
    :parameters (?w - waiter ?from ?to - place)
    :precondition (at ?w ?from)
    :effect (and (not (at ?w ?from)) (at ?w ?to)
                 (forall (?x - ware)
                   (when (carries ?w ?x) (and (at ?x ?to) (not (at ?x ?from)))))
                 (increase (total-cost) (fare ?from ?to))))
  (:action take
    :parameters (?w - waiter ?x - ware ?p - place)
    :precondition (and (at ?w ?p) (at ?x ?p) (or (free ?w) (known ?x)))
    :effect (and (carries ?w ?x) (not (free ?w)) (increase (total-cost) 1)))
  (:action wash
    :parameters (?w - waiter)
    :precondition (and (at ?w bar) (exists (?x - ware) (carries ?w ?x)))
    :effect (and (forall (?x - cup ?p - place) (when (and (carries ?w ?x) (dirty ?x)) (not (dirty ?x))))
                 (forall (?x - plate) (when (carries ?w ?x) (not (dirty ?x))))
                 (increase (total-cost) 2))))
