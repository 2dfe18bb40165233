; No types, upper case, sections out of the usual order, an empty precondition.
(DEFINE (DOMAIN Ring-World)
  (:PREDICATES (NEXT ?from ?to) (RING ?x) (Door ?x) (Locked ?X) (on ?x ?y))
  (:CONSTANTS north-door)
  (:REQUIREMENTS :strips :NEGATIVE-PRECONDITIONS)
  (:ACTION shout :PARAMETERS () :Precondition () :EFFECT (not (Locked NORTH-DOOR)))
  (:action move-ring
    :parameters (?X ?from ?to)
    :precondition (AND (ring ?x) (next ?from ?TO) (door ?To) (NOT (locked ?to)) (on ?x ?from))
    :effect (and (on ?x ?to) (not (on ?x ?from)))))
