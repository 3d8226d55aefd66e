"""One script a figure: each reads data that runs have left, and never simulates.

A script is a module with ``DATA``, the paths that it reads, and ``make()``, which returns the
figure; `python -m figures` makes every figure whose data are there.
"""
