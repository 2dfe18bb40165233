; Timed initial literals (PDDL 2.2), durations that are inequalities, conditions at all three times.
(define (domain ferry)
  (:requirements :typing :durative-actions :duration-inequalities :fluents :timed-initial-literals)
  (:types place vehicle - object car ferry - vehicle)
  (:constants charon - ferry)
  (:predicates
    (at ?v - vehicle ?p - place)
    (aboard ?c - car)
    (tide-high)
    (harbour-open ?p - place))
  (:functions
    (crossing ?from ?to - place)
    (weight ?c - car)
    (load))
  (:durative-action board
    :parameters (?c - car ?p - place)
    :duration (= ?duration 1.5)
    :condition (and (at start (at ?c ?p)) (over all (at charon ?p))
                    (at start (<= (+ (load) (weight ?c)) 3.25)))
    :effect (and (at start (not (at ?c ?p))) (at end (aboard ?c))
                 (at start (increase (load) (weight ?c)))))
  (:durative-action sail
    :parameters (?from ?to - place)
    :duration (and (>= ?duration (crossing ?from ?to))
                   (<= ?duration (* 2 (crossing ?from ?to))))
    :condition (and (at start (at charon ?from)) (over all (tide-high))
                    (at end (harbour-open ?to)))
    :effect (and (at start (not (at charon ?from))) (at end (at charon ?to))))
  (:durative-action leave
    :parameters (?c - car ?p - place)
    :duration (= ?duration 1)
    :condition (and (over all (at charon ?p)) (at start (aboard ?c)))
    :effect (and (at end (at ?c ?p)) (at start (not (aboard ?c)))
                 (at end (decrease (load) (weight ?c))))))
