"""Trials gathered into cells, with their pure error: what every fit and every test is measured against.

conditions    trials to cells; clustering: φ and ω to levels; covariate: speeds at the level's φ
pure_error    the scatter of replicates; stated_error: error bars instead; rounding: the least it can be
two_groups    whether replicates fall into two groups: two robots in one table
quality       what is odd about the trials; mean_rows: means among them; regime: whether they walked or swam
penetrometer  readings of the ground's strength
distributions tails of χ², F, t and beta
"""
