"""One model fitted to one set of cells, and how well it does.

fit             a model to cells: one k per φ level; fitted: what was found, and what follows from it
global_minimum  the search; starts, levenberg_marquardt, scans: its parts
likelihood      predictions and deviance of a model; states: at many points at once; jacobian: derivatives
  cell_means    what a model says of a cell's mean; switch: where walking ends between two nodes
  nuisances     what trials share
  points        where a chain is evaluated; operations, kernels: how, compiled
goodness        tests against pure error; leave_one_out, diagnose: out of sample, stage by stage
uncertainty     how precise; profile, bootstrap: by refits; walked: a profile across cliffs
finite          whether a user's effect gives numbers at all
parallel        many fits at once
text, plain     results for people, and for JSON
"""
