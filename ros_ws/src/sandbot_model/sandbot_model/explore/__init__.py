"""The explorer: an interactive page on which to switch effects on and see where, and by how much, the model fails.

The user's selection (``discovery.selection``) is kept in the address of the page.

app            the callbacks; wiring: their inputs and outputs
controls       the page; effect_list, suggestion, cell_trials: parts of it; blocks, static_html: building blocks
views          a selection as figure, ladder, captions; highlight, condition: the chosen cell
actions        the effect of each control on the selection
session        fits, cached and prefetched; previews: which effects help; job: discoveries, one at a time
cards_page, why_page, atlas_page   all effects; argument for a verdict; the paper's figures; pages: what they share
trial_page     one trial with film and records; scene, scene_figures: its content; clip, rrd: export as MP4, Rerun file
live           data that change; no_data: data that can't be shown; loopback: access from this host only
"""
