"""Seed and tile set of the chessboard (the paper's figure of that name).

The seed is that of the paper's scene, and what is faded is what abstract growth makes of it.
The paper's drawing of the set is not to be had: both readings of it that the package knows are
drawn, the first of which is the default.
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from figures._shapes import PAPER, canvas, note, signed, stage, tile
from tbsa.model.scene import SETS
from tbsa.model.tiles import ground_truth

DATA: tuple[Path, ...] = ()


def make() -> Figure:
    """The seed in what grows from it, and the tiles of both sets."""
    fig = canvas(2.15)
    truth = ground_truth(PAPER)
    columns = [c for c, _ in truth.types]
    unit = 1.78 / (max(columns) - min(columns) + 1)
    ax = stage(fig, (0.0, 0.0, 1.9, 2.15), unit, (min(columns) - 0.9, min(columns) - 1.4),
               "a seed and pattern")
    for (column, row), number in truth.types.items():
        held = (column, row) in truth.seed
        tile(ax, PAPER.types[number], column, row, magnets=False, pale=not held, seed=held)
    for k, (name, types) in enumerate(SETS.items()):
        ax = stage(fig, (1.98, 1.13 - 1.06 * k, 1.52, 1.02), 0.56, (-0.6, -0.75),
                   f"{'bc'[k]} {name}" + ", default" * (types == PAPER.types))
        for column, kind in enumerate(types):
            tile(ax, kind, 1.35 * column, 0.0, pale=False, glues="NESW", heading=True)
            note(ax, f"family {signed(kind.family)}", (1.35 * column, -0.65))
    return fig
