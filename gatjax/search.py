"""CMA-ES over any cost: evosax behind three pure functions, `start`, `ask` and `tell`.

The search works in z = (policy - theta0) / step, so that one sigma suits parameters of
all sizes. Nothing but this file knows evosax. Four things are different from using
`evosax.algorithms.CMA_ES` as it is:

- The stall test of the rank-one update counts generations as Hansen does (see `_Strategy`).
- What is told is what was evaluated: policies after clipping to their bounds. Measured in
  15-D with 10 flat directions, a bound beside the optimum and 150 x 60 evaluations: see
  `tell`.
- sigma is capped after every `tell`. evosax's step size is free to run away on directions
  that make no difference; in the walk prototype it went from 0.5 to 5 in ten generations.
- A cost that is not finite counts as `DIVERGED_COST` and so ranks last.
"""
