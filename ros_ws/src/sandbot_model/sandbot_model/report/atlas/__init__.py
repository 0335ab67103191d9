"""The figures of Li et al. 2009 from any data set, as plates for print: Figs 1c-e, 2a-c, 3a-d, 4a-b.

`tools.atlas` writes them. Points are trials, not means; lines are fitted models; each caption states the result in
numbers. Each module draws related figures and is independent of the others: motion, speeds, collapse, force, leg.
``plates`` puts them in order, ``collect`` gathers their material (``material``), ``style`` is that of the journal.
"""
