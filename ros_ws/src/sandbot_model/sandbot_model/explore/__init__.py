"""The explorer: one page a researcher keeps open to switch effects on and watch where the model fails and how far.

What the user chose (``discovery.choice``) lives in the address of the page.

app            the page's answers; wiring: which control asks for what
controls       the page; effect_list, suggested, cell_trials: parts of it; blocks, still: what all are made of
views          a selection as figure, ladder, captions; sheet: as CSV; chosen, condition: the cell that was picked
actions        what a control does to the selection
session        fits, kept and made ahead; helpful: which effects help; job: discoveries, one at a time
cards_page, why_page, atlas_page   every effect; the argument for a verdict; the paper's figures. asked: their address
theatre_page   one trial with film and records; scene, scene_figures: what it shows; clip, rrd: as MP4, as Rerun file
live           data that change; no_data: data that can't be shown; loopback: this host only
"""
