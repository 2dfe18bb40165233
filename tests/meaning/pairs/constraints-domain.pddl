; Constraints on the trajectory (PDDL 3.0), in the domain and in the problem.
(define (domain patrol)
  (:requirements :adl :constraints :durative-actions :fluents)
  (:types place)
  (:predicates (at ?p - place) (link ?from ?to - place) (seen ?p - place) (charging) (gate)
               (base ?p - place))
  (:constraints (and (always (imply (charging) (exists (?p - place) (and (at ?p) (base ?p)))))
                     (forall (?p - place) (at-most-once (charging)))))
  (:durative-action move
    :parameters (?from ?to - place)
    :duration (= ?duration 2)
    :condition (and (at start (at ?from)) (at start (link ?from ?to)) (over all (gate)))
    :effect (and (at start (not (at ?from))) (at end (at ?to)) (at end (seen ?to))))
  (:durative-action charge
    :parameters (?p - place)
    :duration (= ?duration 3)
    :condition (and (over all (at ?p)) (over all (base ?p)))
    :effect (and (at start (charging)) (at end (not (charging)))))
  (:durative-action toggle
    :parameters ()
    :duration (= ?duration 0.5)
    :condition (at start (not (gate)))
    :effect (at end (gate))))
