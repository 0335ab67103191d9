"""The walking models and their effects: pure functions of depth, k, Δt and the effects' parameters.

walking      from a condition to the observables of a trial; stages, chain: the steps between, and their quantities
  geometry, gait, observables  legs in the ground, clock signals, what is measured
  averaging  over a φ that varies from trial to trial, and along the track
model        a base model with effects: names and ranges of its parameters; predictor: one with given values
effect       an effect; effects/, catalogue: all effects; variants: other conventions of their formulas
formula      effects as formulas, symbols; typeset: as MathML; syntax: the trees of their expressions
  guarded, first_run  a user's effect: it cannot write into shared arrays, and is tried before any fit
tape         a chain recorded as operations; machine: runs them, compiled
"""
