"""The figures of Li et al. 2009 from any data set, as plates for print: Figs 1c-e, 2a-c, 3a-d, 4a-b.

`tools.atlas` writes them. Points are trials, not means; lines are models fitted to them; what is seen stands in the
caption, in numbers. Each module draws what belongs together and knows no other.
"""
