; Preferences (PDDL 3.0) in a precondition; their names are shared, and one has none.
(define (domain delivery)
  (:requirements :adl :fluents :preferences :constraints)
  (:types room parcel)
  (:predicates (robot-in ?r - room) (in ?p - parcel ?r - room) (holding ?p - parcel)
               (quiet ?r - room) (visited ?r - room))
  (:functions (steps))
  (:action go
    :parameters (?from ?to - room)
    :precondition (and (robot-in ?from) (not (= ?from ?to))
                       (preference silence (not (quiet ?to))))
    :effect (and (robot-in ?to) (not (robot-in ?from)) (visited ?to) (increase (steps) 1)))
  (:action take
    :parameters (?p - parcel ?r - room)
    :precondition (and (robot-in ?r) (in ?p ?r) (forall (?q - parcel) (not (holding ?q))))
    :effect (and (holding ?p) (not (in ?p ?r))))
  (:action drop
    :parameters (?p - parcel ?r - room)
    :precondition (and (robot-in ?r) (holding ?p))
    :effect (and (in ?p ?r) (not (holding ?p)))))
