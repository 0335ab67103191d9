"""The explorer: one page a researcher keeps open to switch effects on and watch where the model fails and how far.

``selection`` is what the user chose (it lives in the address of the page), ``actions`` changes it, ``session`` fits it
and keeps the fits, ``reproduce`` gives its numbers to ``compare``. ``views`` turns it into figures and text,
``waveforms`` and ``cell_trials`` show the trials of a cell. ``controls`` is the page, ``effect_list`` and
``suggested`` are parts of it, ``blocks`` what all are made of; ``app`` wires them. ``no_data`` is the page for data
that can't be shown, and ``loopback`` keeps both on this host.
"""
