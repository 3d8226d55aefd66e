"""One script a figure: a schematic, or a picture of data that runs have left; none simulates.

A script is a module with ``DATA``, the paths that it reads, and ``make()``, which returns the
figure; `python -m figures` makes every figure whose data are there.
"""
