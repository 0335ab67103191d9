"""Which effects are missing: comparison, search over the catalogue, verdict, next trials.

discover         from cells to a verdict: the main flow
effect_search    none, singles, pairs, triples, each fitted to its global minimum; candidates: each single effect
compare          a ladder of named effects; ladder: as a table; reproduce: that of a selection
choice           what the user of the explorer chose
verdict          the rules; criteria: their numbers
  partial        one effect repairs most; untested: whether pure error is known
  sharing        beside what trials share; nuisances_about, structure: the bed's offsets, and whether they are random
  against a claim: calibration, conventions, plausibility, smooth, stability
limits, unseen   what is not there, or would not show; power: in a design; error_rates: of the verdict itself
next_trials      what would tell the surviving sets apart; fingerprint: where an effect would show
formula_search   a formula to try where no effect fits; residual, scored_terms, term_library
"""
