"""Which effects are missing: comparison, search over the catalogue, verdict, next trials.

discover         from cells to what is reported: the main flow; result: what it found
judgement        from the search to a verdict; remarks: what is said beside it
effect_search    no effect, singles, pairs and triples, each fitted to its global minimum; candidates: single effects
compare          a ladder of named effects; ladder: the same as a table; reproduce: the ladder of a saved selection
selection        what the user of the explorer selected
verdict          the rules; criteria: their thresholds
  partial        one effect repairs most; untested: whether pure error is known well enough
  sharing        with nuisances; nuisances_about, structure: batch offsets, and whether they are
                 random; batch_sd: their standard deviations; nuisances_in_words: as text
                 batches_apart: whether k of two batches differs by more than a bed's
  checks of a claim: calibration_error, conventions, leg_radius, lone_trials, one_observable, other_sign,
                         plausibility, smooth, stability
assumed          what nobody said: robot, gait, cameras, bed; other_gait: whether the verdict depends on the gait
each_gait        what the trials of each gait say by themselves
limits, unseen   effects that are absent, or would not show; power: detectable strengths; error_rates: of the verdict
next_trials      trials that discriminate between the surviving sets; one_value: those that trials at one ω or φ lack
                 repeats: those that the verdict asks for again
fingerprint      where an effect would show
formula_search   a formula to try where no effect fits; residual, scored_terms, term_library
"""
