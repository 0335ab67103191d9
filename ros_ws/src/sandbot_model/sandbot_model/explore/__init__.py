"""The explorer: one page a researcher keeps open to switch effects on and watch where the model fails and how far.

``selection`` is what the user chose (it lives in the address of the page), ``session`` fits it and remembers,
``views`` turns it into figures, ``waveforms`` reads the trials behind a cell, ``app`` is the page.
"""
