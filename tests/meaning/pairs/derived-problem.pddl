(define (problem two-lamps)
  (:domain wiring)
  (:objects battery - source joint - node hall porch - lamp main back - switch)
  (:init
    (between main battery joint) (between back joint porch)
    (wire joint hall)
    (closed main) (burnt hall))
  (:goal (and (all-lit) (imply (closed back) (lit porch)))))
