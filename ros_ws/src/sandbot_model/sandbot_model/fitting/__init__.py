"""One model fitted to one set of cells, and how well it fits.

fit             a model to cells: one k per φ level; fitted: the result, and what follows from it
global_minimum  the search; starts, levenberg_marquardt, scans: its parts
likelihood      predictions and deviance of a model; states: at many points at once; jacobian: derivatives
  cell_means    predictions of the cell means; switch: where walking ends between two nodes
  nuisances     nuisance parameters: errors that trials share
  points        where a chain is evaluated; operations, kernels: how, compiled
goodness        tests against pure error (thresholds); leave_one_out, diagnose: out of sample, stage by stage
uncertainty     standard errors; profile, stepwise_profile (across cliffs), bootstrap: by refits
errors          standard errors where the deviance is not parabolic, by a posterior sample (sample)
finite          whether a user's effect gives finite numbers
parallel        many fits at once
text, plain     results for people, and for JSON
"""
