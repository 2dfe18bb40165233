; STRIPS with types: what the smallest of parsers reads.
(define (domain crane)
  (:requirements :strips :typing)
  (:types spot box)
  (:predicates (on ?b - box ?s - spot) (empty ?s - spot) (held ?b - box) (idle))
  (:action grab
    :parameters (?b - box ?s - spot)
    :precondition (and (on ?b ?s) (idle))
    :effect (and (held ?b) (empty ?s) (not (on ?b ?s)) (not (idle))))
  (:action place
    :parameters (?b - box ?s - spot)
    :precondition (and (held ?b) (empty ?s))
    :effect (and (on ?b ?s) (idle) (not (held ?b)) (not (empty ?s)))))
