"""The walking models and their effects: pure functions of depth, k, Δt and the effects' parameters.

walking      from a condition to what a trial shows; stages, chain: the steps between, and the quantities they pass on
  geometry, gait, observables  legs in the ground, clock signals, what is measured
  averaging  over a φ that varies from trial to trial, and along the track
model        a base model with effects: names and ranges of its parameters; predictor: one with values for all
effect       what an effect is; effects/, catalogue, variants: those there are, and their other conventions
formula      effects as formulas, symbols; typeset: as MathML
  guarded, first_run  a user's effect: kept from others' arrays, and tried before any fit
tape         a chain written down as operations; machine: runs them, compiled
"""
