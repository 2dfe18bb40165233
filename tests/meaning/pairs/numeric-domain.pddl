; Numeric fluents (PDDL 2.1): every assignment, every operator, every comparison.
(define (domain brewing)
  (:requirements :typing :fluents :negative-preconditions :equality)
  (:types vessel)
  (:predicates (clean ?v - vessel) (bottled))
  (:functions (volume ?v - vessel) (heat ?v - vessel) (capacity ?v - vessel) (cost) (total-cost))
  (:action fill
    :parameters (?v - vessel)
    :precondition (and (clean ?v) (= (volume ?v) 0) (>= (capacity ?v) 1))
    :effect (and (assign (volume ?v) (- (capacity ?v) 0.125)) (not (clean ?v))
                 (increase (cost) (* 0.2 (capacity ?v)))))
  (:action boil
    :parameters (?v - vessel)
    :precondition (and (> (volume ?v) 0) (< (heat ?v) 100))
    :effect (and (scale-up (heat ?v) 2.5) (scale-down (volume ?v) 1.25)
                 (increase (cost) (/ (heat ?v) 8))))
  (:action pour
    :parameters (?from ?to - vessel)
    :precondition (and (not (= ?from ?to)) (>= (heat ?from) 100)
                       (<= (+ (volume ?from) (volume ?to)) (capacity ?to)))
    :effect (and (increase (volume ?to) (volume ?from)) (decrease (volume ?from) (volume ?from))
                 (assign (heat ?to) (/ (+ (* (heat ?from) 3) (heat ?to)) 4))))
  (:action bottle
    :parameters (?v - vessel)
    :precondition (and (clean ?v) (>= (volume ?v) 6))
    :effect (and (bottled) (decrease (cost) (- (- 1) (- 0.5))))))
