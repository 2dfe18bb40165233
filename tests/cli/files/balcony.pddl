(define (problem balcony)
  (:domain watering)
  (:objects basil rose - plant)
  (:init
    (dry basil) (full can) (not (raining)) (= (water basil) 0.50) (= (water rose) 2)
    (= (next basil) rose) (= (total-cost) 0) (at 5 (raining)) (at 6.5 (not (raining))))
  (:goal (and (not (dry basil)) (full can) (preference wet (>= (water rose) 3))))
  (:constraints (and (sometime (thirsty)) (within 10 (not (thirsty)))))
  (:metric minimize (+ (* 2 (is-violated wet)) (total-cost))))
