"""Command-line tools, one module each.

compare, discover, effects, atlas, explore, export: the commands; python_api: two of them from Python
arguments         what several commands share
answer, tables    what compare and discover print; card: an effect in words
trials_to_run     the next trials as a table to fill in
"""
